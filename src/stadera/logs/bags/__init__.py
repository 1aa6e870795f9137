"""Bags: robot logs as messages of topics, in MCAP, sqlite3 and ROS 1 files."""
