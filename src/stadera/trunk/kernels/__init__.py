"""Compiled functions for `TrunkEstimator`, one file for each numpy code that they replace (`stadera.compiled`)."""
