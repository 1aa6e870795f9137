"""A payload's inertia is written where it was observed and can be; its deviations, against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stadera.errors import IdentificationError
from stadera.estimate.walking_result import Payload
from stadera.inertia import InertialParameters
from stadera.weigh.model import payload_inertia, payload_link

COM = np.array([-0.2, 0.1, 0.15])
TENSOR = np.array([[0.3, 0.04, -0.02], [0.04, 0.5, 0.01], [-0.02, 0.01, 0.6]])
BOX = InertialParameters.from_com(8.0, COM, TENSOR)
RNG = np.random.default_rng(3)
SHAPE = RNG.standard_normal((10, 10)) * np.array([0.1, *[0.02] * 3, *[0.01] * 6])[:, None]


def payload(body: InertialParameters = BOX, scale: float = 1.0) -> Payload:
    return Payload.of(body.vector, scale**2 * SHAPE @ SHAPE.T, 0.1)


def least_ratio(scale: float) -> float:
    """The moments over their deviations, the least of them, by finite differences of Iₒ - m (|c|² 1 - c cᵀ)."""
    axes = np.linalg.eigh(TENSOR)[1]

    def moments(vector: np.ndarray) -> np.ndarray:
        tensor = InertialParameters(vector).inertia_com
        return np.asarray(np.einsum("ik,ij,jk->k", axes, tensor, axes))

    h = 1e-6
    slope = np.array([(moments(BOX.vector + h * e) - moments(BOX.vector - h * e)) / (2 * h) for e in np.eye(10)])
    std = scale * np.linalg.norm(slope.T @ SHAPE, axis=1)
    return float((moments(BOX.vector) / std).min())


def test_observed_from_three_deviations_on() -> None:
    limit = least_ratio(1.0) / 3.0
    assert payload_inertia(payload(scale=1.01 * limit)) is None
    found = payload_inertia(payload(scale=0.99 * limit))
    assert found is not None
    assert found == pytest.approx(TENSOR, abs=1e-12)


def test_a_tensor_no_body_has_is_a_point_mass() -> None:
    impossible = InertialParameters.from_com(8.0, COM, np.diag([0.1, 0.1, 0.5]))
    assert payload_inertia(payload(impossible, 1e-3)) is None


def test_the_link_says_which_it_is() -> None:
    sure = payload(scale=1e-3)
    link = payload_link(sure, np.zeros(3), payload_inertia(sure))
    assert link.tensor == pytest.approx(TENSOR)
    assert "inertia as observed" in link.note
    blurred = replace(sure, com=np.array([-0.2, 0.1, np.nan]), com_std=np.array([0.01, 0.01, np.nan]))
    assert payload_inertia(blurred) is None
    link = payload_link(blurred, np.array([0.0, 0.0, 0.03]))
    assert link.body.com == pytest.approx([-0.2, 0.1, 0.03])
    assert (link.tensor == 0.0).all()
    assert "a point mass" in link.note
    assert "z was not observed" in link.note
    with pytest.raises(IdentificationError, match="no payload to write"):
        payload_link(replace(sure, mass=0.0), np.zeros(3))
