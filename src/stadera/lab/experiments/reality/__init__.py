"""How well a robot is weighed that is not what its model file says: runs with `real` errors, and what they show."""
