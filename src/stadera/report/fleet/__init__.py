"""Report of a fleet: many logs of several robots."""
