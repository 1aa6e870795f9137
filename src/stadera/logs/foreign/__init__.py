"""Columns of others: maps of their names and units to those of the flat table."""
