"""Worlds that yield frames, one module or package a simulator."""
