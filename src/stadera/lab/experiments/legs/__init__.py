"""Legs identified on a fixed trunk: Table I, Fig. 4 and Fig. 5."""
