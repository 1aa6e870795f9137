"""Only what is known well enough is handed on."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.lab.supervise.supervisor import TrustedEstimator
from stadera.robot import load_robot
from stadera.trunk.measurement import Measurement
from stadera.trunk.model import TrunkModel
from stadera.trunk.protocol import Estimator, Status, TrunkEstimate, unobserved

HYQ = load_robot("hyq")
PRIOR = TrunkModel.prior(HYQ)


class Told:
    """Believes what it is told."""

    def __init__(self) -> None:
        self.tell(0.0, PRIOR.mass, np.nan)

    def tell(self, time: float, mass: float, std: float, x: float = 0.0, reason: str = "") -> None:
        covariance = unobserved() if np.isnan(std) else np.diag([std, 1e-3, 1e-3, 1e-3]) ** 2
        status = Status.REFUSED if reason else Status.MOVING
        self._estimate = TrunkEstimate(
            time, TrunkModel(mass, PRIOR.com_trunk + np.array([x, 0.0, 0.0])), covariance, status, reason
        )

    def update(self, measurement: Measurement) -> None:
        raise NotImplementedError

    def estimate(self) -> TrunkEstimate:
        return self._estimate


def test_wide_error_bars_keep_the_last_good_estimate() -> None:
    inner = Told()
    trusted = TrustedEstimator(inner, HYQ)
    assert isinstance(trusted, Estimator)
    assert trusted.estimate().status is Status.WAITING
    assert trusted.estimate().trunk.mass == PRIOR.mass
    inner.tell(1.0, 70.0, 0.1)
    assert trusted.estimate().status is Status.MOVING
    assert trusted.estimate().trunk.mass == 70.0
    inner.tell(2.0, 75.0, 12.0)
    late = trusted.estimate()
    assert (late.status, late.trunk.mass, late.time) == (Status.REFUSED, 70.0, 1.0)
    assert "known to 12.00 kg only" in late.reason
    inner.tell(3.0, 75.0, 0.2)
    assert trusted.estimate().trunk.mass == 75.0


@pytest.mark.parametrize(
    ("mass", "x", "reason", "said"),
    [
        (70.0, 2.0, "", "centre of mass x"),
        (1e3, 0.0, "", "trunk mass"),
        (70.0, 0.0, "a foot slips", "a foot slips"),
    ],
)
def test_what_is_not_plausible_is_not_handed_on(mass: float, x: float, reason: str, said: str) -> None:
    inner = Told()
    trusted = TrustedEstimator(inner, HYQ)
    inner.tell(1.0, 65.0, 0.1)
    assert trusted.estimate().trunk.mass == 65.0
    inner.tell(2.0, mass, 0.1, x, reason)
    assert trusted.estimate().trunk.mass == 65.0
    assert said in trusted.estimate().reason
