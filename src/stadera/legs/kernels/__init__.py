"""Compiled functions for the regressors of joint torques (`stadera.compiled`)."""
