"""Runs of the test-bed by name, as logs that the rest of the package reads."""
