"""Supervisors that detect a change of a walking robot's load and have it weighed, at rest or while walking."""

from stadera.supervise.load_test import LoadCheck, LoadTest, LoadTestSettings
from stadera.supervise.nonstop import NonstopSupervisor
from stadera.supervise.rest import RestLimits, RestMoment, RestWatch
from stadera.supervise.settings import SuperviseSettings
from stadera.supervise.strength import hardest_effort
from stadera.supervise.supervisor import Supervisor
from stadera.supervise.walker import PosingWalker, State, Transition, Walker

__all__ = [
    "LoadCheck",
    "LoadTest",
    "LoadTestSettings",
    "NonstopSupervisor",
    "PosingWalker",
    "RestLimits",
    "RestMoment",
    "RestWatch",
    "State",
    "SuperviseSettings",
    "Supervisor",
    "Transition",
    "Walker",
    "hardest_effort",
]
