"""What can be read from a picture alone."""
