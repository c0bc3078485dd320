"""Statistics on arrays: numpy and scipy only, never a file or a frame."""
