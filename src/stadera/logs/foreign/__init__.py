"""Logs with other column names: maps of their names and units to those of the flat table."""
