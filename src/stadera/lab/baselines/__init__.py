"""Estimators from the literature, for comparison; `ALL_METHODS` contains them and the library's own."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from stadera.lab.baselines.kalman import KalmanTrunk
from stadera.lab.baselines.ls import LeastSquaresTrunk
from stadera.lab.baselines.rls import RlsTrunk
from stadera.trunk.registry import METHODS, Method

ALL_METHODS: Mapping[str, Method] = MappingProxyType(
    {
        **METHODS,
        "ls": Method(
            "baseline: plain least squares over two seconds",
            lambda s: LeastSquaresTrunk(s.robot, s.start, mount=s.mount),
        ),
        "rls": Method(
            "baseline: recursive least squares with constant forgetting",
            lambda s: RlsTrunk(s.robot, s.start, mount=s.mount),
        ),
        "kalman": Method(
            "baseline: a Kalman filter on m, m cx, m cy", lambda s: KalmanTrunk(s.robot, s.start, s.mount)
        ),
    }
)
"""By name."""

__all__ = ["ALL_METHODS", "KalmanTrunk", "LeastSquaresTrunk", "RlsTrunk"]
