"""Of a fleet: many logs of several robots."""
