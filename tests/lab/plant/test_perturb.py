"""The perturbed truths: what changes, by how much, and that they can be simulated."""

from __future__ import annotations

import numpy as np
import pytest

from stadera.errors import ModelError
from stadera.lab.plant.leg import perturbed, perturbed_physical
from stadera.lab.plant.model import least_leg_eigenvalue
from stadera.robot import Robot, load_robot


@pytest.fixture(scope="module")
def hyq() -> Robot:
    return load_robot("hyq")


def test_only_the_legs_centres_and_tensors_change(hyq: Robot) -> None:
    changed = perturbed(hyq, "RH", np.random.default_rng(0))
    for link in hyq.tree.links:
        before, after = hyq.inertias[link], changed.inertias[link]
        assert after.mass == before.mass
        if link in hyq.leg("RH").links:
            assert not np.isclose(after.vector[1:], before.vector[1:]).any()
        else:
            assert after == before


def test_noise_has_the_size_asked_for(hyq: Robot) -> None:
    """Small enough that no draw is refused, which would shape the distribution."""
    rng, link = np.random.default_rng(1), hyq.leg("RH").links[0]
    draws = [perturbed(hyq, "RH", rng, com_std=1e-3, inertia_std=2e-4, draws=1) for _ in range(100)]
    before = hyq.inertias[link]
    com = np.array([draw.inertias[link].com - before.com for draw in draws])
    tensor = np.array([(draw.inertias[link].vector - before.vector)[4:] for draw in draws])
    np.testing.assert_allclose(com.std(axis=0), 1e-3, rtol=0.25)
    np.testing.assert_allclose(tensor.std(axis=0), 2e-4, rtol=0.25)
    np.testing.assert_allclose(com.mean(axis=0), 0.0, atol=3e-4)


def test_paper_sized_perturbations_can_be_simulated(hyq: Robot) -> None:
    draws = [perturbed(hyq, "RH", np.random.default_rng(seed)) for seed in range(5)]
    nominal = least_leg_eigenvalue(hyq, "RH")
    assert all(least_leg_eigenvalue(draw, "RH") >= 0.1 * nominal for draw in draws)
    assert any(not draw.inertias[link].is_physical() for draw in draws for link in hyq.leg("RH").links)


def test_same_seed_same_robot(hyq: Robot) -> None:
    first, again = (perturbed(hyq, "LF", np.random.default_rng(9)) for _ in range(2))
    assert dict(first.inertias) == dict(again.inertias)


def test_hopeless_perturbation_is_refused(hyq: Robot) -> None:
    with pytest.raises(ModelError, match="none of 200"):
        perturbed(hyq, "RH", np.random.default_rng(0), margin=1e9)


def test_physical_perturbation_stays_physical(hyq: Robot) -> None:
    for seed in range(20):
        changed = perturbed_physical(hyq, "RH", np.random.default_rng(seed))
        for link in hyq.leg("RH").links:
            before, after = hyq.inertias[link], changed.inertias[link]
            assert after.is_physical()
            assert after.mass == pytest.approx(before.mass, rel=1e-12)
            assert 1e-4 < np.linalg.norm(after.com - before.com) < 0.1


def test_physical_perturbation_without_stretch_only_moves_the_body(hyq: Robot) -> None:
    link = hyq.leg("RH").links[1]
    changed = perturbed_physical(hyq, "RH", np.random.default_rng(0), stretch_std=0.0)
    np.testing.assert_allclose(changed.inertias[link].inertia_com, hyq.inertias[link].inertia_com, atol=1e-12)
