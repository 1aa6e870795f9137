"""Parts of the data that agree, and what is named where they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify.leg_runs import DRIVE, hyq, noisy, run
from stadera.body import Rows
from stadera.identify.agreement import Agreement
from stadera.identify.legs import identify
from stadera.identify.prior import Prior, robot_prior
from stadera.identify.settings import IdentifySettings
from stadera.information import Information

JOINTS = hyq().leg("RH").joints
TERMS = tuple(f"{joint}.{term}" for joint in JOINTS for term in ("viscous", "coulomb"))


def draws(count: int, change: float = 0.0, seed: int = 0) -> tuple[list[Information], Prior]:
    """Information of some parts of one truth drawn from the prior; the last part's first parameter is another."""
    rng, prior = np.random.default_rng(seed), robot_prior(hyq(), TERMS)
    truth, parts = prior.values + prior.root @ rng.standard_normal(len(TERMS)), []
    for k in range(count):
        matrix = rng.standard_normal((40, len(TERMS))) / prior.scales * rng.uniform(1.0, 5.0)
        values = truth + (change * prior.scales if k == count - 1 else 0.0) * (np.arange(len(TERMS)) == 0)
        parts.append(Information.of([Rows(TERMS, matrix, matrix @ values + rng.standard_normal(40))], TERMS))
    return parts, prior


@pytest.mark.parametrize("count", [2, 4])
def test_deviations_have_unit_variance_where_parts_agree(count: int) -> None:
    found = [Agreement.of([str(k) for k in range(count)], [draws(count, seed=seed)]) for seed in range(60)]
    assert np.mean([a.chi2 for a in found]) == pytest.approx(1.0, abs=0.15)
    assert np.mean([bool(a.differs) for a in found]) <= 0.15
    assert found[0].looks == len(TERMS) * (1 if count == 2 else count)


def test_what_differs_is_named_and_its_bar_widened() -> None:
    found = Agreement.of(["a", "b", "c"], [draws(3, change=1.5)])
    assert [name for name, c in found.parameters.items() if not c.agrees] == [TERMS[0]]
    (sentence,) = found.differs
    assert TERMS[0] in sentence
    assert "temperature" in sentence
    wider = found.widened(TERMS, np.zeros((len(TERMS), len(TERMS))))
    assert wider[0, 0] == pytest.approx(found.parameters[TERMS[0]].spread ** 2)
    assert not wider[1:, 1:].any()


def test_halves_of_one_log_are_always_compared() -> None:
    for split in (0.5, 1.0):
        result = identify(hyq(), noisy(run(), 0.5), IdentifySettings(legs=("RH",), split=split))
        assert result.agreement is not None
        assert len(result.agreement.parts) == 2
        assert result.agreement.chi2 < 3.0
        assert result.to_dict()["agreement"]["looks"] == result.agreement.looks > 0


def test_a_log_of_a_hot_robot_differs_in_friction() -> None:
    hot = replace(DRIVE, coulomb=4.0)
    logs = [noisy(run(), 0.3), noisy(run(seed=1), 0.3, seed=6), noisy(run(hot, seed=2), 0.3, seed=7)]
    result = identify(hyq(), logs, IdentifySettings(legs=("RH",)))
    assert result.agreement is not None
    differing = {name for name, c in result.agreement.parameters.items() if not c.agrees}
    assert {f"{joint}.coulomb" for joint in JOINTS} & differing
    assert any("coulomb differs" in warning for warning in result.warnings)
