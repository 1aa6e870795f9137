"""Reads and writes MJCF files."""
