"""Estimators for a robot that stands still."""
