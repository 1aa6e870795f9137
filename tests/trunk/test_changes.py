"""Changes of the load, on rows made by hand: a trunk of constant specific force that turns a little."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from stadera.robot import load_robot
from stadera.trunk.changes import ChangeDetector, Jump
from stadera.trunk.considered import Errors
from stadera.trunk.error_model import ERRORS, ErrorModel
from stadera.trunk.segment import Segment, WeightedRows
from stadera.trunk.settings import ChangeSettings, ModelErrors, SwingDetection
from stadera.trunk.swing import SwingJoints
from stadera.trunk.wrench import trunk_matrix, trunk_signals

BLOCK = 0.02
SCALE = np.array([50.0, 30.0, 30.0, 30.0])
TRUNK = np.array([40.0, 2.0, 1.0, 0.5, *np.zeros(6)])
ROBOT = load_robot("hyq")


def errors() -> Errors:
    model = ErrorModel(ROBOT, ModelErrors(), 0.7)
    return Errors(model, SwingJoints(model, SwingDetection()), 1.0)


def rows(seconds: float, noise: float, load: np.ndarray, at: float, seed: int) -> list[WeightedRows]:
    """Rows of unit 1 N and 1 N·m; `load` comes on at a time."""
    rng, made = np.random.default_rng(seed), []
    for k in range(round(seconds / BLOCK)):
        time = k * BLOCK
        force = np.array([0.8 * np.sin(5.0 * time), 0.5 * np.cos(4.0 * time), 9.81])
        signals = trunk_signals(force[:, None], np.zeros((3, 1)), 0.5 * rng.standard_normal((3, 1)))[:, 0]
        matrix = trunk_matrix(signals)
        theta = TRUNK + (load if time >= at else 0.0)
        target = matrix @ theta + noise * rng.standard_normal(6)
        made.append(WeightedRows(time, matrix, np.zeros((6, ERRORS)), target, 6.0 * noise**2))
    return made


def looked(made: list[WeightedRows], settings: ChangeSettings, noise: float) -> list[tuple[float, Jump]]:
    """Every jump that is found, and when; nothing begins anew."""
    detector, known = ChangeDetector(settings, SCALE, BLOCK), errors()
    before = old = current = Segment.prior(TRUNK, 50.0 * np.ones(10))
    recent: deque[WeightedRows] = deque()
    found = []
    for r in made:
        recent.append(r)
        current = current.add(r)
        if len(recent) > settings.pending:
            before = before.add(recent[-settings.pending - 1])
        if len(recent) > 2 * settings.pending:
            old = old.add(recent.popleft())
        jump = detector.look(recent, before, old, current, known, noise**2, held=False)
        if jump is not None:
            found.append((r.time, jump))
    return found


def test_a_load_is_found_soon_and_placed() -> None:
    load = np.array([2.5, -0.5, 0.2, 0.3, *np.zeros(6)])
    time, jump = looked(rows(6.0, 5.0, load, 4.0, 1), ChangeSettings(), 5.0)[0]
    assert 4.0 < time < 4.3
    assert jump.reported
    assert abs(time - jump.blocks * BLOCK - 4.0) < 0.15


@pytest.mark.parametrize("noise", [1.0, 10.0, 60.0])
def test_noise_of_any_size_is_no_change(noise: float) -> None:
    """How much averages vary is learnt: nothing of the noise is stated."""
    assert not [j for _, j in looked(rows(30.0, noise, np.zeros(10), np.inf, 2), ChangeSettings(), noise) if j.reported]


def test_a_change_below_the_least_begins_anew_without_a_report() -> None:
    light = np.array([0.6, 0.0, 0.0, 0.0, *np.zeros(6)])
    found = looked(rows(9.0, 0.5, light, 5.0, 3), ChangeSettings(), 0.5)
    assert found
    assert not found[0][1].reported


def test_nothing_is_reported_while_the_model_does_not_fit() -> None:
    load = np.array([5.0, 0.0, 0.0, 0.0, *np.zeros(6)])
    made, settings = rows(6.0, 5.0, load, 4.0, 1), ChangeSettings()
    detector, known = ChangeDetector(settings, SCALE, BLOCK), errors()
    before = Segment.prior(TRUNK, 50.0 * np.ones(10))
    for r in made[:150]:
        before = before.add(r)
    recent = deque(made[150:])
    for _ in range(60):
        assert detector.look(recent, before, before, before, known, 1.0, held=True) is None
