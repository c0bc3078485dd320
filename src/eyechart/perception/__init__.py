"""Readers of scenes from pictures alone."""
