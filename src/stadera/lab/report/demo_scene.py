"""Data of the demo's 3D scene: the robot's tree and parts, and both films, packed.

A robot appears with its meshes if available (HyQ), else with rounded parts. A film's columns are stored as 16-bit
integers between each column's least and largest value, in base64: the error is at most half of the range / 65534, 10 µm
of a metre. -32768 marks missing values.
"""

import json
from base64 import b64encode
from collections.abc import Iterator
from importlib import resources
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.constants import GRAVITY
from stadera.lab.demo import DemoResult, DemoRun
from stadera.lab.experiments.loaded_walk import WalkOutcome
from stadera.lab.plant.payload import Tray
from stadera.lab.supervise.supervisor import Mode
from stadera.report.figures.robot import limbs, trunk_box
from stadera.report.numbers import with_std
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.types import Array

NAMES = ("without identification", "with identification")
"""Names of the two runs."""


def robot_parts(robot: Robot) -> dict[str, Any]:
    """Plain values, metres in the link's frame: meshes, each packed once, and parts on the tree's numbered links."""
    found, joints = _bundled(robot.name), robot.tree.joints
    if not {part["joint"] for part in found["parts"]} <= {None, *joints}:  # another model by the same name
        found = {"meshes": {}, "parts": []}
    parts = [_mesh_part(part, joints) for part in found["parts"]]
    return {"meshes": found["meshes"], "parts": [*(parts or _rounded(robot)), _plate(robot), *_feet(robot)]}


def _bundled(name: str) -> dict[str, Any]:
    file = resources.files("stadera.lab.report") / "vendor" / f"{name}.json"
    if not file.is_file():
        return {"meshes": {}, "parts": []}
    return dict(json.loads(file.read_text(encoding="utf-8")))


def _mesh_part(part: dict[str, Any], joints: tuple[str, ...]) -> dict[str, Any]:
    joint = joints.index(part["joint"]) if part["joint"] else None
    place = {"link": 0 if joint is None else joint + 1, "at": part["at"], "turn": part["turn"]}
    return {"kind": "mesh", "mesh": part["mesh"], **place} | ({} if joint is None else {"joint": joint})


def _plate(robot: Robot) -> dict[str, Any]:
    """The plate on which boxes land; slightly higher than in the plant, so that it covers a back at the same height."""
    tray = Tray.of(robot)
    cover = 0.002  # m
    at = tray.centre + np.array([0.0, 0.0, cover])
    return {"link": 0, "kind": "plate", "size": short(2.0 * tray.half_size), "at": short(at), "turn": [0, 0, 0, 1]}


def _rounded(robot: Robot) -> Iterator[dict[str, Any]]:
    """Yields a trunk, and legs from joint to joint."""
    if (box := trunk_box(robot)) is not None:  # lower by the thickness of the plate on top of it
        under = np.array([0.0, 0.0, 2.0 * Tray.of(robot).half_size[2]])
        turn = short(Rotation.from_matrix(box.rotation).as_quat())
        size, at = short(box.size), short(box.translation - under)
        yield {"link": 0, "kind": "body", "size": size, "at": at, "turn": turn}
    for part in (part for leg in robot.legs for part in limbs(robot, leg)):
        along = part.centres[-1] - part.centres[0]
        if part.kind == "limb":
            yield {"link": part.link, "kind": "limb", "to": short(part.centres[-1]), "radii": short(part.radii)}
        elif part.kind == "drive":
            width = float(np.linalg.norm(along))
            drum = {"axis": short(along / width), "radius": part.radii[0], "width": width}
            yield {"link": part.link, "kind": "drive", "joint": part.link - 1, **drum}


def _feet(robot: Robot) -> Iterator[dict[str, Any]]:
    for part in (part for leg in robot.legs for part in limbs(robot, leg) if part.kind == "foot"):
        for at, radius in zip(part.centres, part.radii.tolist(), strict=True):
            yield {"link": part.link, "kind": "foot", "at": short(at), "radius": radius}


def short(values: Any) -> list[float]:
    """Rounds each value to six digits."""
    return [float(f"{value:.6g}") for value in values]


BEFORE = 2.0
"""Time before the drop at which the scene begins [s]."""

_MOST, _NONE = 32767, -32768
_COLUMNS = ("trunk", "joints", "box", "feet", "force", "down", "limited", "com", "model", "margin")


def scene(result: DemoResult) -> dict[str, Any]:
    """Plain values for `walk_view.js`: metres, seconds, quaternions xyzw; links are numbered as in the robot's tree."""
    settings, robot = result.settings, load_robot(result.settings.robot)
    return {
        "load": settings.load_at,
        "box": list(settings.size),
        "weight": robot.mass * GRAVITY,
        "robot": {"joints": list(_joints(robot)), **robot_parts(robot)},
        "runs": [_run(run, name, settings.load_at - BEFORE) for name, run in zip(NAMES, result.runs, strict=True)],
    }


def _run(run: DemoRun, name: str, begin: float) -> dict[str, Any]:
    film, verdict = run.film, run.outcome.verdict
    shown = film.time >= begin - 1e-6
    columns = {name: getattr(film, name)[shown].reshape(int(shown.sum()), -1) for name in _COLUMNS}
    return {
        "name": name,
        "good": verdict.outcome is WalkOutcome.WALKED,
        "begin": float(film.time[shown][0]),
        "every": float(np.median(np.diff(film.time))),
        "frames": int(shown.sum()),
        "widths": {name: values.shape[1] for name, values in columns.items()},
        "events": list(_events(run)),
        **packed(np.concatenate([_smooth(name, values) for name, values in columns.items()], axis=1)),
    }


def _smooth(name: str, values: Array) -> Array:
    """Quaternions with the sign nearest to the previous frame, for interpolation."""
    if name not in ("trunk", "box"):
        return values.astype(float)
    found = np.array(values)
    turns = found[:, 3:]
    flips = np.nancumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    turns[1:] *= flips[:, None]
    return found


def packed(values: Array) -> dict[str, Any]:
    """Columns (k, c) as {low, step: c numbers each, data: base64 of int16 little-endian, row by row}."""
    seen = np.isfinite(values)
    low, high = np.where(seen, values, np.inf).min(axis=0), np.where(seen, values, -np.inf).max(axis=0)
    low, high = np.where(seen.any(axis=0), low, 0.0), np.where(seen.any(axis=0), high, 0.0)
    step = (high - low) / (2 * _MOST)
    scaled = np.where(seen, (values - low) / np.where(step > 0.0, step, 1.0) - _MOST, _NONE)
    return {
        "low": [float(f"{v:.7g}") for v in low],
        "step": [float(f"{v:.7g}") for v in step],
        "data": b64encode(np.rint(scaled).astype("<i2").tobytes()).decode(),
    }


def _events(run: DemoRun) -> Iterator[dict[str, Any]]:
    """Yields captions on a robot with their times, in order; `mark` names a moment of interest."""
    outcome = run.outcome
    trace, payload = outcome.trace, outcome.payload
    yield {"time": 0.0, "text": "walking", "level": ""}
    lands = float(trace.time[trace.since])
    yield {"time": lands, "text": f"{outcome.case.load.mass:.0f} kg land", "level": "", "mark": "box lands"}
    if (trace.fall is not None) and (tips := _tips(run)) is not None:
        yield {"time": tips, "text": "tips over", "level": "bad", "mark": "tips over"}
    for transition in outcome.transitions:
        text, mark = str(transition.after), str(transition.after)
        if transition.after is Mode.WEIGHING:
            text = mark = "load noticed"
        elif transition.after is Mode.WALKING and payload is not None:
            text, mark = f"weighed {with_std(payload.mass, payload.mass_std)} kg, walking on", "weighed"
        yield {"time": transition.time, "text": text, "level": "good", "mark": mark}
    if trace.fall is not None:
        text = f"fell after {trace.fall.time - trace.loaded_at:.1f} s"
        yield {"time": trace.fall.time, "text": text, "level": "bad", "mark": "falls"}
    elif outcome.verdict.outcome is WalkOutcome.STUCK:
        yield {"time": trace.loaded_at + 1.0, "text": "stuck", "level": "bad"}


def _tips(run: DemoRun) -> float | None:
    """Time at which the trunk is first tilted by more than 10° with the load."""
    film = run.film
    upright = 1.0 - 2.0 * (film.trunk[:, 3] ** 2 + film.trunk[:, 4] ** 2)
    tilted = np.flatnonzero((upright < np.cos(np.deg2rad(10.0))) & (film.time > run.outcome.trace.loaded_at))
    return float(film.time[tilted[0]]) if len(tilted) else None


def _joints(robot: Robot) -> Iterator[dict[str, Any]]:
    tree = robot.tree
    turns = Rotation.from_matrix(tree.rotations).as_quat()
    for k, parent in enumerate(tree.parents):
        yield {
            "parent": parent,
            "at": short(tree.translations[k]),
            "turn": short(turns[k]),
            "axis": short(tree.axes[k]),
        }
