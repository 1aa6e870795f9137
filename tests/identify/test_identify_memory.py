"""A robot's memory in identification, of legs in the air and of a robot on its feet."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stadera import IdentificationError, identify, load_robot
from stadera.identify.settings import IdentifySettings
from stadera.lab.plant.leg import simulate_leg
from stadera.logs import Recording, write_table
from stadera.robot import JointDynamics, Robot
from stadera.trunk.memory import Memory

from identify.leg_runs import hyq, noisy, swing  # isort: skip
from identify.test_floating import walk  # isort: skip

RH = IdentifySettings(legs=("RH",))
JOINT = hyq().leg("RH").joints[2]


@cache
def made(coulomb: float) -> Robot:
    """A HyQ whose right hind knee has Coulomb friction that the model lacks [N·m]."""
    return replace(hyq(), dynamics=dict(hyq().dynamics) | {JOINT: JointDynamics(coulomb=coulomb)})


def in_air(coulomb: float, seed: int) -> Recording:
    hung = simulate_leg(made(coulomb), "RH", swing().sample(250.0))
    return noisy(replace(hung, velocity=None, acceleration=None, source=f"air {seed}"), 2.0, seed=seed)


def test_legs_in_the_air_are_remembered_and_known_better() -> None:
    first = identify(hyq(), in_air(1.5, 0), RH, memory=Memory.none(hyq()))
    assert first.memory is not None
    assert first.memory.logs == 1
    mean, std = first.memory.marginals()[f"coulomb.{JOINT}"]
    size = 0.02 * hyq().limits[JOINT].effort
    assert size * mean == pytest.approx(1.5, abs=3.0 * size * std)
    assert size * std < 0.3
    second = identify(hyq(), in_air(1.5, 1), RH, memory=first.memory)
    alone = identify(hyq(), in_air(1.5, 1), RH)
    assert second.memory is not None
    assert any("of 1 earlier log, and of this one" in note for note in second.notes)
    for name in (f"{JOINT}.coulomb", f"{JOINT}.viscous"):
        found, without = second.legs[0].parameters[name].std, alone.legs[0].parameters[name].std
        assert found is not None
        assert without is not None
        assert found < 0.95 * without


def test_a_leg_with_another_motor_is_named_and_not_merged() -> None:
    memory = identify(hyq(), in_air(1.5, 0), RH, memory=Memory.none(hyq())).memory
    changed = identify(hyq(), in_air(9.0, 1), RH, memory=memory)
    assert changed.memory is None
    assert any(f"contradicts the memory of 1 log in the Coulomb friction of {JOINT}" in note for note in changed.notes)
    alone = identify(hyq(), in_air(9.0, 1), RH)
    found, without = (result.legs[0].parameters[f"{JOINT}.coulomb"].value for result in (changed, alone))
    assert found == pytest.approx(without, rel=1e-6)


def test_a_memory_of_a_walk_serves_legs_in_the_air_and_the_other_way_round(
    run: Callable[..., Any], tmp_path: Path
) -> None:
    log, memory = write_table(walk(), tmp_path / "walk.csv"), tmp_path / "hyq-17.json"
    ended = run("identify", log, "--robot", "hyq", "--memory", memory, "--json", tmp_path / "out.json")
    assert ended.code == 0, ended.err
    kept = Memory.read(memory, hyq())
    assert kept.logs == 1
    assert any("of 0 earlier logs" in note for note in json.loads((tmp_path / "out.json").read_text())["notes"])
    again = run("identify", log, "--robot", "hyq", "--memory", memory)
    assert again.code == 0, again.err
    assert "stays as it was: these samples are in the memory already" in " ".join(again.out.split())
    assert Memory.read(memory, hyq()).logs == 1
    with pytest.raises(IdentificationError, match="another model than go2"):
        identify(load_robot("go2"), walk(), memory=kept)
    found = identify(hyq(), in_air(1.5, 2), RH, memory=kept)
    assert found.memory is not None
    assert found.memory.logs == 2
    assert np.isfinite([leg.estimate.covariance for leg in found.legs]).all()
