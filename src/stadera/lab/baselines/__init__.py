"""Estimators from the literature, for comparison; `ALL_METHODS` contains them and the library's own."""

from collections.abc import Mapping
from types import MappingProxyType

from stadera.lab.baselines.signals import SignalBaseline
from stadera.lab.baselines.solvers import KalmanTrunk, LeastSquaresTrunk, RlsTrunk
from stadera.trunk.registry import METHODS, Method


def _baseline(summary: str, kind: type[SignalBaseline]) -> Method:
    return Method(f"baseline: {summary}", lambda s: kind(s.robot, s.start, s.mount))


ALL_METHODS: Mapping[str, Method] = MappingProxyType(
    {
        **METHODS,
        "ls": _baseline("plain least squares over two seconds", LeastSquaresTrunk),
        "rls": _baseline("recursive least squares with constant forgetting", RlsTrunk),
        "kalman": _baseline("a Kalman filter on m, m cx, m cy", KalmanTrunk),
    }
)
"""By name."""
