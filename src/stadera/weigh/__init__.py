"""Weighing from a log: trunk, payload and changes of load; can be called: `stadera.weigh(robot, log)`."""

from stadera.checks import Finding, diagnose
from stadera.lazy import make_callable
from stadera.weigh.model import WeighedModel, weighed_model
from stadera.weigh.result import Refusal, Timeline, Weighing
from stadera.weigh.settings import WeighSettings
from stadera.weigh.weigh import weigh

__all__ = [
    "Finding",
    "Refusal",
    "Timeline",
    "WeighSettings",
    "WeighedModel",
    "Weighing",
    "diagnose",
    "weigh",
    "weighed_model",
]

make_callable(__name__, "stadera.weigh.weigh")
