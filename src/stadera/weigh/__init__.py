"""Weighing from a log: trunk, payload and changes of load; can be called: `stadera.weigh(robot, log)`."""

from stadera.checks import diagnose
from stadera.lazy import make_callable
from stadera.weigh.model import weighed_model
from stadera.weigh.result import Timeline, Weighing
from stadera.weigh.settings import TestWeight
from stadera.weigh.weigh import weigh

__all__ = ["TestWeight", "Timeline", "Weighing", "diagnose", "weigh", "weighed_model"]

make_callable(__name__, "stadera.weigh.weigh")
