"""Supervisors that detect a change of a walking robot's load and have it weighed, at rest or while walking."""
