"""Robots in motion: Table V, section III, and the studies of weighing while walking."""
