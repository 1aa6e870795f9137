"""A running robot, as it is shown."""
