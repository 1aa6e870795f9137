"""Reads and writes URDF files."""
