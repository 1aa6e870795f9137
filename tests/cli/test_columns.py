"""Tables of others through the commands."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd  # type: ignore[import-untyped]
import pytest

from log_formats import in_other_units, own_names
from stadera.logs import Recording
from stadera.robot import load_robot


@pytest.fixture
def legs(swing: Recording) -> tuple[str, ...]:
    return ("--robot", "hyq", "--legs", "RH")


def values_of(out: Path) -> list[float]:
    joints = json.loads(out.read_text())["joints"]
    return [found["value"] for joint in joints.values() for found in joint.values()]


def test_a_map_and_units_identify_what_the_table_does(run, log: Path, swing: Recording, legs, tmp_path: Path) -> None:
    own, given = own_names(swing, tmp_path / "own.csv")
    degrees = in_other_units(swing, tmp_path / "deg.csv")
    found = []
    for k, options in enumerate(((log,), (own, "--columns", given), (degrees, "--units", "deg,deg/s,ms"))):
        assert run("identify", *options, *legs, "--json", tmp_path / f"{k}.json").code == 0
        found.append(values_of(tmp_path / f"{k}.json"))
    # rotor inertias that are zero lie at their bound, where the interior-point solver stops within 1e-4 kg·m²
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=1e-6, atol=1e-4)


def test_a_template_is_a_map(run, log: Path, tmp_path: Path) -> None:
    written = run("inspect", log, "--columns")
    assert written.code == 0
    (tmp_path / "map.toml").write_text(written.out)
    shown = run("inspect", log, "--columns", tmp_path / "map.toml")
    assert shown.code == 0
    assert "hyq (RH)" in shown.out


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (("--columns", "nosuch"), 1, "neither a preset for columns (cheetah, isaac"),
        (("--units", "furlong"), 1, "unknown unit 'furlong'; valid: s, ms"),
        (("--pd", "20"), 1, "'20' is not a pair of gains kp,kd"),
        (("--pd", "20,1"), 1, "leave out --pd, which is for logs without"),
    ],
)
def test_options_that_are_wrong(run, log: Path, options: tuple[str, ...], code: int, message: str) -> None:
    finished = run("inspect", log, *options)
    assert finished.code == code
    assert message in finished.err
    assert finished.err.count("\n") == 1


def test_an_own_robots_columns_are_known_by_its_joints(run, swing: Recording, tmp_path: Path) -> None:
    """Inspect, and the map that it writes, know them as weigh does; without the robot they mean nothing."""
    source, names = load_robot("hyq").source, {"haa": "abad", "hfe": "swing", "kfe": "bend"}
    assert source is not None
    model, log, text = tmp_path / "own.urdf", tmp_path / "own.csv", source.read_text()
    for number, leg in enumerate(("lf", "rf", "lh", "rh"), start=1):
        for theirs, own in names.items():
            text = text.replace(f"{leg}_{theirs}_joint", f"leg{number}_{own}")
    model.write_text(text)
    table = {"stamp": swing.time, "gyr_x": np.zeros(len(swing))}
    for k, own in enumerate(names.values()):
        table |= {f"leg4_{own}_pos": swing.position[:, k], f"leg4_{own}_trq": swing.effort[:, k]}  # type: ignore[index]
    pd.DataFrame(table).to_csv(log, index=False)
    shown = run("inspect", log, "--robot", model)
    assert "joints with a position: leg4_abad, leg4_swing, leg4_bend" in shown.err
    assert '"leg4_bend.effort" = "leg4_bend_trq"' in run("inspect", log, "--robot", model, "--columns").out
    assert "not a flat table" in run("inspect", log).err
