"""Report of a weighing routine: tables, figures, terminal, and page with a film of the motion."""

import json
from base64 import b64encode
from collections.abc import Iterator
from math import isfinite
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text
from scipy.spatial.transform import Rotation

from stadera.excite.trunk.planted import AXES
from stadera.excite.trunk.result import Routine
from stadera.report.figures import Axis, Figure, Panel, line
from stadera.report.figures.robot import outlines
from stadera.report.numbers import counted, number
from stadera.report.table import TableData, rich_table


def promise(result: Routine) -> str:
    """The error bars to expect, in one line."""
    bars = result.expected
    named = zip("xyz", bars.com, strict=True)
    x, y, z = (f"{axis} ± {1e3 * v:.0f} mm" if isfinite(v) else f"{axis} not determined" for axis, v in named)
    return (
        f"a payload of {number(result.load, 3)} kg to ± {number(bars.mass, 2)} kg, and ± {100.0 * bars.scale:.1f} % of "
        f"it for the torques' scale; its centre {x}, {y}, {z}"
    )


def trunk_table(result: Routine) -> TableData:
    """Largest value of each coordinate of the trunk."""
    path = result.path
    rows = []
    for k, axis in enumerate(AXES):
        peak, turns = result.peaks[k], k < 3
        if peak > 0.0:
            value = f"{np.rad2deg(peak):.1f}°" if turns else f"{1e3 * peak:.0f} mm"
            rows.append((axis, value, ", ".join(f"{f:.2f}" for f in sorted(path.frequencies[0, k]))))
    return TableData.of("The trunk's motion", ("coordinate", "largest", "frequencies [Hz]"), rows)


def joints_table(result: Routine) -> TableData:
    """Extremes of each joint, and its limits."""
    motion, limits = result.planted.motion, result.robot.limits
    rows = [
        (
            joint,
            f"{number(motion.position[:, k].min(), 3)} to {number(motion.position[:, k].max(), 3)}",
            f"{number(np.abs(motion.velocity[:, k]).max(), 3)} of {number(limits[joint].velocity, 3, 'no limit')}",
            f"{number(result.torque[k], 3)} of {number(limits[joint].effort, 3, 'no limit')}",
        )
        for k, joint in enumerate(result.robot.tree.joints)
    ]
    head = ("joint", "position [rad]", "velocity [rad/s]", "torque with the heaviest load [N·m]")
    return TableData.of("Extremes of the joints, of their limits", head, rows)


def tables(result: Routine) -> list[TableData]:
    """The trunk's motion and the joints' extremes."""
    return [trunk_table(result), joints_table(result)]


def figures(result: Routine) -> dict[str, Figure]:
    """The trunk's path over time, and the feet's normal forces."""
    time, pose = result.planted.time, result.planted.pose
    colours = ("blue", "orange", "green")
    panels = []
    for part, (scale, label) in enumerate(((np.rad2deg(1.0), "angle [°]"), (1e3, "shift [mm]"))):
        three = [k for k in range(3 * part, 3 * part + 3) if result.peaks[k] > 0.0]
        marks = tuple(line(time, scale * pose[:, k], AXES[k], colours[k % 3]) for k in three)
        if marks:
            panels.append((Panel(Axis("time [s]"), Axis(label), marks),))
    _, force = result.planted.torques(result.robot.inertias[result.robot.trunk])
    normal = (force * result.planted.motion.normal[:, None]).sum(axis=2)
    names = [leg.name for leg in result.robot.legs]
    cycle = ("blue", "orange", "green", "purple", "red", "steel")
    feet = tuple(line(time, normal[:, k], name, cycle[k % len(cycle)]) for k, name in enumerate(names))
    return {
        "path": Figure("Roll, pitch, yaw and shift of the trunk, relative to the stance", tuple(panels)),
        "feet": Figure("Normal force of each foot, bare robot", ((Panel(Axis("time [s]"), Axis("force [N]"), feet),),)),
    }


def routine_tables(result: Routine) -> Iterator[RenderableType]:
    """What to expect, the trunk's motion, the joints' extremes."""
    yield Text(promise(result)[0].upper() + promise(result)[1:] + ".")
    yield from map(rich_table, tables(result))


def film(result: Routine, rate: float = 10.0) -> dict[str, Any]:
    """The robot from the side and from the front: of each view the colours of its parts, and their corners in the world
    (pictures, parts, corners, 2) [mm], 16-bit integers in base64; the interval of the pictures [s], and their number.
    """
    planted, every = result.planted, max(1, round(result.settings.rate / rate))
    q, pose = planted.motion.position[::every], planted.pose[::every]
    turn, views = Rotation.from_euler("ZYX", pose[:, [2, 1, 0]]).as_matrix(), []
    for axes in ([0, 2], [1, 2]):
        colours, corners = zip(*outlines(result.robot, q, np.eye(3)[axes], turn, pose[:, 3:]), strict=True)
        numbers = np.round(1e3 * np.stack(corners, axis=1)).astype("<i2")
        views.append({"colours": colours, "corners": b64encode(numbers.tobytes()).decode()})
    return {"views": views, "interval": every / result.settings.rate, "count": len(q)}


def html(result: Routine) -> str:
    """The complete, self-contained page."""
    from stadera.report.page import render, script_data

    robot, seconds, given = result.robot.name, f"{result.settings.seconds:g}", result.robot.argument
    drawn = figures(result)
    return render(
        "routine.html.j2",
        title=f"Weighing routine of {robot}",
        headline=f"{seconds} s without and {seconds} s with the load weigh {promise(result)}.",
        level="note",
        word="Within the limits",
        why=f"Feet stay in place with up to {100.0 * result.settings.heaviest:g} % of the robot anywhere on its back.",
        next=(
            f"Write a script that plays it: `stadera excite --robot {given} --trunk --for unitree --out play.py`.",
            "Record joints, torques and IMU while the robot does it, stop, put the load on, and let it do it again.",
            f"Weigh the load: `stadera weigh LOG --robot {given} --tare 0:{seconds}`.",
        ),
        film=script_data(json.dumps(film(result), separators=(",", ":"))),
        trunk=trunk_table(result),
        joints=joints_table(result),
        path=drawn["path"],
        feet=drawn["feet"],
        facts={
            "Robot": robot,
            "Duration": f"{seconds} s, from rest to rest",
            "Error bars": "the estimator's on simulated logs, median of "
            f"{counted(result.settings.drawn, 'robot')} drawn from its prior",
            "Seed": str(result.settings.seed),
        },
    )
