"""Checks on logs, run before anything is estimated, the same for all commands."""

from stadera.checks.diagnosis import contradictions, diagnose, unit_findings
from stadera.checks.finding import FATAL, Finding
from stadera.checks.limits import CheckLimits
from stadera.checks.mend import Mend

__all__ = ["FATAL", "CheckLimits", "Finding", "Mend", "contradictions", "diagnose", "unit_findings"]
