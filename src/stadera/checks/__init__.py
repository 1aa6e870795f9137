"""Consistency checks on logs, run before estimation and shared by all commands."""

from stadera.checks.diagnosis import Guard, contradictions, diagnose
from stadera.checks.finding import FATAL, Finding
from stadera.checks.limits import CheckLimits

__all__ = ["FATAL", "CheckLimits", "Finding", "Guard", "contradictions", "diagnose"]
