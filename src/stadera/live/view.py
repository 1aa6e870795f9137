"""Shows a weighing in Rerun: the moving robot, and the estimates of its trunk and payload over time.

Its input is samples and an estimator, from a running robot or a log. All uncertainties are drawn as two standard
deviations; an unobserved quantity is drawn as wide as its plausible range.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from stadera.constants import EPOCH, GRAVITY
from stadera.errors import StaderaError, of_extra
from stadera.report.look import light
from stadera.robot.imu import ImuMount
from stadera.robot.kinematics import forward_kinematics
from stadera.robot.model import Robot, Shape
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.load import Payload
from stadera.trunk.model import TrunkBounds
from stadera.trunk.samples import Samples
from stadera.trunk.standing.forces import ContactForceEstimator
from stadera.types import Array, Bools
from stadera.weigh.pipeline import trust_now

if TYPE_CHECKING:
    import rerun

_TRUST_COLOURS = {"good": "green", "doubtful": "amber", "bad": "red"}
_TRUST_LEVELS = {"good": "INFO", "doubtful": "WARN", "bad": "ERROR"}


@dataclass(frozen=True, eq=False)
class Posture:
    """Posture at one instant, world axes: z upwards, the ground at zero, origin below the trunk's."""

    time: float  # [s]
    rotations: Array  # (links, 3, 3), of all links, trunk first
    origins: Array  # (links, 3) [m], of all links
    contacts: Array  # (legs, 3) [m]
    forces: Array  # (legs, 3) [N], of the ground on the feet
    stance: Bools  # (legs,), loaded feet


class Postures:
    """Tracks one robot's posture from encoders and IMU, every `period` [s].

    The tilt follows the direction of the specific force with time constant `settling` [s], stabilised over short times
    by the gyro (a complementary filter); the heading comes from the gyro alone. The robot's position is not measured:
    the lowest foot is on the ground, below a trunk that does not translate.
    """

    def __init__(self, robot: Robot, settling: float = 1.0, period: float = 0.04) -> None:
        self._settling, self._period = settling, period
        self._robot, self._forces = robot, ContactForceEstimator(robot)
        self._world: Rotation | None = None  # of the trunk
        self._last, self._due, self._age = -np.inf, -np.inf, 0.0

    def of(self, samples: Samples, mount: ImuMount) -> Iterator[Posture]:
        """Yields the postures due among these samples, IMU values in trunk axes."""
        for k in range(len(samples)):
            time = float(samples.time[k])
            if time < self._last:  # restarted
                self._world, self._due, self._age = None, -np.inf, 0.0
            if time >= self._due:
                since = int(np.searchsorted(samples.time, self._last))
                self._turn(samples[slice(min(since, k), k + 1)])
                self._due = time + self._period
                yield self._posture(samples, k, mount)
        self._turn(samples[samples.time > self._last])

    def _turn(self, samples: Samples) -> None:
        if not len(samples):
            return
        force = samples.specific_force.mean(axis=0)
        elapsed = min(float(samples.time[-1]) - self._last, self._settling)
        if self._world is None:
            self._world = Rotation.align_vectors([[0.0, 0.0, 1.0]], [force])[0]
        else:
            turned = self._world * Rotation.from_rotvec(samples.angular_velocity.mean(axis=0) * elapsed)
            up = turned.apply(force / np.linalg.norm(force))
            self._age = min(self._age + elapsed, self._settling)  # at first the mean of all forces so far
            share = elapsed / self._age if self._age > 0.0 else 0.0
            self._world = Rotation.from_rotvec(share * np.cross(up, [0.0, 0.0, 1.0])) * turned
        self._last = float(samples.time[-1])

    def _posture(self, samples: Samples, k: int, mount: ImuMount) -> Posture:
        assert self._world is not None
        R = self._world.as_matrix()
        one = replace(next(iter(samples[k : k + 1])), lever=mount.translation)
        found = self._forces.at(one)
        contacts = found.contact @ R.T
        lift = np.array([0.0, 0.0, -contacts[:, 2].min()])
        rotations, origins = forward_kinematics(self._robot.tree, samples.position[k : k + 1])
        forces = np.where(np.isfinite(found.force), found.force, 0.0) @ R.T
        return Posture(one.time, R @ rotations[0], origins[0] @ R.T + lift, contacts + lift, forces, found.stance)


class Viewer:
    """Draws one robot; a context manager that closes the recording. MissingExtraError if rerun is not installed,
    StaderaError if the viewer does not start.

    Args:
        spawn: open the viewer. save: write its recording to this .rrd file.
        period: interval of the timelines' entries [s]. deviations: number of standard deviations in a band.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        spawn: bool = False,
        save: Path | None = None,
        period: float = 0.1,
        deviations: float = 2.0,
    ) -> None:
        with of_extra("rerun-sdk", "view", "the viewer"):
            import rerun
        self._rr, self._robot = rerun, robot
        self._period, self._deviations = period, deviations
        self._postures, self._trunk = Postures(robot), list[object](["world", "robot", robot.trunk])
        self._wide = TrunkBounds.of(robot).spread[1:]
        self._longest = float(np.linalg.norm(robot.tree.translations, axis=1).max())
        self._force_scale = 2.0 * self._longest / (robot.mass * GRAVITY)
        self._rec = rerun.RecordingStream(f"stadera {robot.name}")
        self._open(spawn, save)
        self._begin, self._due, self._changes, self._verdict = np.nan, -np.inf, 0, ""
        self._style()
        self._draw_shapes()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._rec.disconnect()

    def watch(self, samples: Samples, estimator: TrunkEstimator) -> None:
        """Draws samples (IMU values in trunk axes), and the estimates of the estimator that has processed them."""
        for posture in self._postures.of(samples, estimator.mount):
            self._at(posture.time)
            self._draw_robot(posture)
        time = float(samples.time[-1])
        self._begin = float(samples.time[0]) if np.isnan(self._begin) else self._begin
        if not self._due - self._period <= time < self._due:
            self._due = time + self._period
            self._at(time)
            self._draw_known(estimator)

    # -- inside -----------------------------------------------------------------------------------------------
    def _open(self, spawn: bool, save: Path | None) -> None:
        rr, sinks = self._rr, []
        if spawn:
            if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
                raise StaderaError("the viewer needs a display, and there is none; --rrd F writes a file instead")
            try:
                rr.spawn(connect=False)
            except Exception as error:  # of several kinds: no program, no display
                raise StaderaError(f"the viewer does not start: {error}; --rrd F writes a file instead") from None
            sinks.append(rr.GrpcSink())
        if save is not None:
            sinks.append(rr.FileSink(str(save)))
        self._rec.set_sinks(*sinks, default_blueprint=_blueprint(self._longest))

    def _at(self, time: float) -> None:
        self._rec.set_time("time", **({"timestamp": time} if time > EPOCH else {"duration": time}))

    def _style(self) -> None:
        rr, log = self._rr, self._rec.log
        log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for name in ("trunk", "payload"):
            com = _band(rr, [f"{name} com {axis} [m]" for axis in "xyz"], ["red", "green", "blue"])
            log(f"plots/{name}/mass", _band(rr, [f"{name} mass [kg]"], ["blue"]), static=True)
            log(f"plots/{name}/com", com, static=True)
        verdicts, colours = list(_TRUST_COLOURS), [_rgb(name) for name in _TRUST_COLOURS.values()]
        log("trust", rr.StateConfiguration(values=verdicts, labels=verdicts, colors=colours), static=True)

    def _draw_shapes(self) -> None:
        shapes, trunk = self._robot.shapes, self._robot.trunk
        for link, kind in dict.fromkeys((shape.link, shape.kind) for shape in shapes):
            own = [shape for shape in shapes if (shape.link, shape.kind) == (link, kind)]
            colour = [*_rgb("steel"), 90] if link == trunk else _rgb("steel")  # keeps bodies inside the trunk visible
            self._rec.log(["world", "robot", link, kind], _drawn(self._rr, kind, own, colour), static=True)

    def _draw_robot(self, posture: Posture) -> None:
        rr, log = self._rr, self._rec.log
        for link, rotation, origin in zip(self._robot.tree.links, posture.rotations, posture.origins, strict=True):
            log(["world", "robot", link], rr.Transform3D(translation=origin, mat3x3=rotation))
        vectors = self._force_scale * posture.forces
        log("world/forces", rr.Arrows3D(vectors=vectors, origins=posture.contacts, colors=_rgb("box"), radii=0.006))
        corners = posture.contacts[posture.stance]
        x, y, _ = (corners - corners.mean(axis=0)).T if len(corners) > 1 else np.zeros((3, 0))
        around = np.argsort(np.arctan2(y, x))
        polygon = [corners[[*around, *around[:1]]]] if len(around) else []
        log("world/support", rr.LineStrips3D(polygon, colors=_rgb("soft"), radii=0.004))

    def _draw_known(self, estimator: TrunkEstimator) -> None:
        rr, log, trunk, payload = self._rr, self._rec.log, estimator.trunk, estimator.payload
        trust = trust_now(estimator)
        colour = _rgb(_TRUST_COLOURS[trust.verdict])
        if trust.verdict != self._verdict:
            self._verdict = trust.verdict
            text = f"trust: {', '.join([str(trust.verdict), *trust.reasons])}"
            log("trust", rr.StateChange(state=trust.verdict))
            log("events", rr.TextLog(text, level=_TRUST_LEVELS[trust.verdict]))
        if trunk.observed[0]:
            self._plot("trunk", trunk.inertial.mass, trunk.mass_std, trunk.com, trunk.com_std)
        half, turned = self._spread(trunk.covariance[1:, 1:])
        look = {"half_sizes": [half], "quaternions": [turned], "colors": [colour], "fill_mode": "solid"}
        log([*self._trunk, "com"], rr.Ellipsoids3D(centers=[trunk.inertial.com], **look))
        if payload is not None:
            self._plot("payload", payload.mass, payload.mass_std, payload.com, payload.com_std)
            self._draw_payload(payload, colour)
        for change in estimator.changes[self._changes :]:
            log("events", rr.TextLog(f"load {change.kind}, at {change.time - self._begin:.2f} s", level="INFO"))
        self._changes = len(estimator.changes)

    def _draw_payload(self, payload: Payload, colour: list[int]) -> None:
        """Draws a box around the payload's centre of mass; nothing if that was not observed, or is not in the trunk."""
        rr, place, com = self._rr, [*self._trunk, "payload"], payload.com
        if payload.at or np.isnan(com).all():
            self._rec.log(place, rr.Clear(recursive=False))
            return
        half = np.where(np.isnan(payload.com_std), self._wide, self._deviations * payload.com_std)
        look = {"half_sizes": [half], "colors": [colour], "labels": [f"{payload.mass:.2f} kg"]}
        self._rec.log(place, rr.Boxes3D(centers=[np.nan_to_num(com)], **look))

    def _plot(self, what: str, mass: float, mass_std: float, com: Array, com_std: Array) -> None:
        rr = self._rr
        for name, value, std in (("mass", np.array([mass]), np.array([mass_std])), ("com", com, com_std)):
            band = np.stack([value, value - self._deviations * std, value + self._deviations * std], axis=1)
            self._rec.log(f"plots/{what}/{name}", rr.Scalars(band.ravel()))

    def _spread(self, covariance: Array) -> tuple[Array, Array]:
        """Half axes [m] and orientation of a centre of mass's uncertainty ellipsoid."""
        seen = np.isfinite(np.diag(covariance))
        full = np.diag((self._wide / self._deviations) ** 2)
        full[np.ix_(seen, seen)] = covariance[np.ix_(seen, seen)]
        values, vectors = np.linalg.eigh(full)
        vectors[:, 0] *= np.sign(np.linalg.det(vectors))
        return self._deviations * np.sqrt(values), Rotation.from_matrix(vectors).as_quat()


def _drawn(rr: Any, kind: str, shapes: Sequence[Shape], colour: list[int]) -> Any:
    rotations, at = np.array([shape.rotation for shape in shapes]), np.array([shape.translation for shape in shapes])
    sizes, turned = np.array([shape.size for shape in shapes]), Rotation.from_matrix(rotations).as_quat()
    look: dict[str, Any] = {"colors": [colour] * len(shapes), "fill_mode": "solid"}
    if kind == "box":
        return rr.Boxes3D(centers=at, half_sizes=0.5 * sizes, quaternions=turned, **look)
    if kind == "sphere":
        return rr.Ellipsoids3D(centers=at, radii=sizes[:, 0], **look)
    look |= {"radii": sizes[:, 0], "lengths": sizes[:, 1], "quaternions": turned}
    if kind == "capsule":  # Rerun's capsules start at their first end
        return rr.Capsules3D(translations=at - 0.5 * sizes[:, 1:] * rotations[:, :, 2], **look)
    return rr.Cylinders3D(centers=at, **look)


def _band(rr: Any, names: list[str], colours: list[str]) -> Any:
    lines = [(f"{name}{part}", _rgb(colour), width) for name, colour in zip(names, colours, strict=True)
             for part, width in (("", 2.0), (" − 2σ", 0.7), (" + 2σ", 0.7))]  # fmt: skip
    shown, rgb, widths = (list(column) for column in zip(*lines, strict=True))
    return rr.SeriesLines(names=shown, colors=rgb, widths=widths)


def _rgb(name: str) -> list[int]:
    return list(bytes.fromhex(light(name).removeprefix("#")))


def _blueprint(size: float) -> rerun.blueprint.Blueprint:
    import rerun.blueprint as rrb

    names = {"mass": "mass [kg] ± 2σ", "com": "centre of mass [m] ± 2σ: x red, y green, z blue"}
    plots = [
        rrb.TimeSeriesView(
            origin=f"plots/{what}/{kind}", name=f"{what}, {name}", plot_legend=rrb.PlotLegend(visible=False)
        )
        for what in ("payload", "trunk")
        for kind, name in names.items()
    ]
    events = rrb.Horizontal(
        rrb.StateTimelineView(origin="trust", name="trust"),
        rrb.TextLogView(origin="events", name="events"),
        column_shares=[1, 2],
    )
    eye = rrb.EyeControls3D(position=(2.6 * size, 3.2 * size, 2.4 * size), look_target=(0.0, 0.0, size))
    scene = rrb.Spatial3DView(
        origin="world", name="robot, forces of its feet, centre of mass, payload", eye_controls=eye
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, events, row_shares=[3, 1]), rrb.Grid(*plots, grid_columns=1), column_shares=[3, 2]
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="time"),
    )
