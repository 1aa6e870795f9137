"""Supervisors that detect a change of a walking robot's load and have it weighed, at rest or while walking."""

from stadera.lab.supervise.load_test import LoadCheck, LoadTest, LoadTestSettings
from stadera.lab.supervise.nonstop import NonstopSupervisor
from stadera.lab.supervise.rest import RestLimits, RestMoment, RestWatch
from stadera.lab.supervise.settings import SuperviseSettings
from stadera.lab.supervise.strength import hardest_effort
from stadera.lab.supervise.supervisor import Supervisor
from stadera.lab.supervise.walker import PosingWalker, State, Transition, Walker

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
