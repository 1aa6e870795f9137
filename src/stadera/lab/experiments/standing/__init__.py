"""Robots weighed while they stand: Tables II to IV and Fig. 6."""
