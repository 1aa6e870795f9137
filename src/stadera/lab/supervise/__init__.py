"""Supervisors that detect a change of a walking robot's load and have it weighed, at rest or while walking."""

from stadera.lab.supervise.strength import hardest_effort
from stadera.lab.supervise.supervisor import (
    NonstopSupervisor,
    State,
    StoppingSupervisor,
    StopSettings,
    Supervisor,
    Transition,
    Walker,
)
from stadera.lab.supervise.weighing import CorrectedForces, Lean, Stage, StandingWeighing, WeighingSettings

__all__ = [
    "CorrectedForces",
    "Lean",
    "NonstopSupervisor",
    "Stage",
    "StandingWeighing",
    "State",
    "StopSettings",
    "StoppingSupervisor",
    "Supervisor",
    "Transition",
    "Walker",
    "WeighingSettings",
    "hardest_effort",
]
