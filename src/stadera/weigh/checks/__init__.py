"""Consistency checks on a log, run before estimation. Each finding names the fault and the evidence for it."""

from stadera.weigh.checks.diagnosis import FATAL, Finding, contradictions, diagnose
from stadera.weigh.checks.limits import CheckLimits

__all__ = ["FATAL", "CheckLimits", "Finding", "contradictions", "diagnose"]
