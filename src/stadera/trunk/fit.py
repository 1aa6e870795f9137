"""Fit quality of the rows, and which of the model errors is the likeliest cause of a bad one.

The residual r = b - A θ̂ - C p̂ has the energy S. White noise and sampling explain E_w of it, and model errors with their
prior covariance Σ0 explain E_m = tr(Σ0 D), with D the products of their columns after eliminating θ. The misfit is
S / (E_w + E_m).

Sampling errors are those of signals that change within a sample, as at a touchdown on hard ground, where an
accelerometer read at 200 or 500 Hz misses part of the impact or counts it twice. They are at most as large as half the
difference between rows of every other sample (`stadera.trunk.rows`), white noise included, so E_w lies between the
energy of white noise and the energy of these differences, and is taken to be in the middle. Friction, rotor
inertia and lag were estimated from the same rows, so their errors follow the sampling error e: all errors together are
e f, with f the column of Σ that belongs to e over its variance e², plus others whose covariance is Σ - e² f fᵀ. The
first leave the energy fᵀ D f in place of that of the differences, E_m is that of the others, and neither can be
negative. Products of D and Σ have cross terms of the two, which can.

Rows of limbs are in the unit of their residual before the tare, so they have a misfit of their own, and the larger one
counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stadera.robot.model import Robot
from stadera.trunk.block_rows import SwingRows
from stadera.trunk.error_model import ErrorLayout, ErrorModel
from stadera.trunk.front import Front
from stadera.trunk.history import History
from stadera.trunk.joint_errors import Errors
from stadera.trunk.segment import RowSums
from stadera.trunk.settings import TrunkSettings
from stadera.trunk.sizes import Sizes
from stadera.trunk.swing import SwingJoints
from stadera.trust import Trust, Verdict
from stadera.types import Array

_CAUSES = {
    "rotor": "rotor inertia that the model lacks",
    "viscous": "viscous friction that the model lacks",
    "coulomb": "Coulomb friction that the model lacks",
    "load_friction": "friction that grows with the load, which the model lacks",
    "stiction": "joints that stick",
    "standstill": "joints that stick in every step",
    "offset": "constant torque errors",
    "gain": "the scale of some joints' torques, or their sign or order",
    "encoder": "zeros of the joint encoders",
    "contact": "where the feet touch the ground",
    "link_mass": "masses of the legs' links",
    "link_com": "centres of mass of the legs' links",
    "imu_lever": "where the IMU is",
    "imu_rotation": "how the IMU is turned",
    "imu_response": "accelerations that the torques do not follow",
    "torque_lag": "torques that are late",
    "velocity_lag": "joint velocities that are late",
    "limb_mass": "masses of the links of arms and other limbs",
}


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit quality of all rows so far.

    Attributes:
        misfit: variance of the residual divided by the expected one.
        sums: see `RowSums.remainder`. errors: p̂. layout: their places.
        white: E_w.
    """

    misfit: float
    sums: Array
    errors: Array
    white: float
    layout: ErrorLayout

    @classmethod
    def of(cls, rows: RowSums, errors: Errors) -> Fit:
        """Evaluates the fit of rows of the same robot.

        Args:
            errors: p̂, and Σ0 of p at its prior size where nothing else is known.
        """
        sums, white, p = rows.remainder, rows.white, errors.mean
        products, joints = sums[1:, 1:], errors.layout.by_swing
        along = sums[1:, 0] - products[:, joints] @ p[joints]
        square = float(sums[0, 0] - (sums[1:, 0] + along) @ p)
        of_sampling, stated = errors.energies(sums)
        noise = white + 0.5 * max(of_sampling - white, 0.0)
        misfit = max(square, 0.0) / max(noise + stated, 1e-300)
        if rows.limb_count:
            expected = rows.limb_count + sum(errors.energies(rows.of_limbs))
            misfit = max(misfit, float(rows.of_limbs[0, 0]) / expected)
        return cls(misfit, sums, p, noise, errors.layout)

    @cached_property
    def remainder(self) -> Array:
        """See `Segment.remainder`, of the residual after subtracting C p̂."""
        return _without(self.sums, self.errors, self.layout.by_swing)

    def trust(self, robot: Robot, errors: ErrorModel, settings: TrunkSettings, swing: SwingJoints) -> Trust:
        """The verdict, with reasons; `swing`: sums of the legs in the air."""
        bad = self.misfit > settings.doubtful
        reasons: tuple[str, ...] = (self._cause(errors, settings.explained),) if bad else ()
        by_leg, beyond = self._by_leg(robot, errors)
        off = {name: misfit for name, misfit in beyond.items() if misfit > settings.doubtful}
        if off and not bad:  # else the residual's cause is named
            reasons += (
                f"joints of {', '.join(off)} are up to {max(off.values()):.1f} times as far from the model as usual "
                "errors explain, whichever way they turn: a torque is off there, or something holds or pushes it",
            )
        names, stepped = [joint for leg in robot.legs for joint in leg.joints], swing.stepped
        reasons += tuple(
            f"torque of {names[k]!r}: off by {stepped[k]:.3g} N·m while its leg swings, since a jump or all the time"
            for k in np.flatnonzero(stepped)
        )
        reasons += tuple(
            f"leg {robot.legs[k].name} seems to carry while it swings, unlike the others: a torque of it is off, or "
            "something holds it"
            for k in np.flatnonzero(swing.heavy)
        )
        verdict: Verdict = "bad" if self.misfit > settings.bad else "doubtful" if reasons else "good"
        return Trust(verdict, self.misfit, by_leg, reasons)

    def _by_leg(self, robot: Robot, errors: ErrorModel) -> tuple[dict[str, float], dict[str, float]]:
        """Mean square of the residual along each leg's errors, divided by that expected from noise and the errors of
        all legs; and by how much that along its torques' offsets is larger than that along its friction. What friction
        does has the direction of motion, and what its law leaves is large along both; what is off all the time has not.
        """
        std = np.sqrt(np.diag(errors.covariance))
        along = self.remainder[1:, 0] * std
        cross = self.remainder[1:, 1:] * std * std[:, None]
        expected = (cross**2).sum(axis=1) + np.diag(cross)
        ratio = along**2 / np.maximum(expected, 1e-300)
        by_joint = np.array([ratio[self.layout.places[name]] for name in ("gain", "coulomb", "offset", "encoder")])
        edges, names = np.cumsum([0, *self.layout.legs[:-1]]), [leg.name for leg in robot.legs]
        _, friction, offset, _ = by_leg = np.add.reduceat(by_joint, edges, axis=1) / self.layout.legs
        mean = dict(zip(names, by_leg.mean(axis=0).tolist(), strict=True))
        return mean, dict(zip(names, (offset - friction).tolist(), strict=True))

    def _cause(self, errors: ErrorModel, most: float) -> str:
        """How bad the fit is, and the three errors that explain most of the residual, each alone and up to `most` times
        its prior size.
        """
        sized = {name: self.layout.places[name] for name in _CAUSES}
        shares = {name: self._explained(errors, at, most) for name, at in sized.items() if at.stop > at.start}
        best = sorted((name for name in shares if shares[name] > 0.05), key=lambda name: -shares[name])[:3]
        named = [f"{_CAUSES[name]} would explain {100.0 * shares[name]:.0f} % of it" for name in best]
        size = f"the residual is {self.misfit:.1f} times what noise and usual errors of models explain"
        return f"{size}; {', '.join(named)}" if named else size

    def _explained(self, errors: ErrorModel, place: slice, most: float) -> float:
        inside = slice(place.start + 1, place.stop + 1)
        along, normal = self.remainder[inside, 0], self.remainder[inside, inside]
        level = max(float(self.remainder[0, 0]), 1e-300)
        prior = most**2 * errors.covariance[place, place]  # singular where an error is taken to be none
        return float(along @ prior @ np.linalg.solve(normal @ prior + np.eye(len(prior)), along)) / level


class ModelFit:
    """Model errors of a robot as estimated from all its rows so far, and how well they explain these.

    Args:
        robot: the model. settings: sizes of the errors, limits of the verdict, and when both are updated.

    Attributes:
        model: prior of the errors. swing: sums of the legs in the air. errors: p̂ and Σ. sizes: of its kinds.
        fit: of the rows; None before the first update. evaluated: whether there are enough rows to judge it.
        friction: (joints,) [N·m], standard deviation of the friction that holds joints which hardly move, of whichever
            direction and changing with every sway; None of robots on point feet.
        due: number of blocks after which all are updated next.
    """

    def __init__(self, robot: Robot, settings: TrunkSettings) -> None:
        self._robot, self._settings = robot, settings
        self.model = ErrorModel(robot, settings.model)
        self.swing = SwingJoints(self.model, settings.swing)
        self.errors = Errors(self.model, self.swing)
        self.sizes = Sizes(self.model.layout, settings.size_spread)
        self._usual: Array | None = None  # factors on the sizes with which the fit is evaluated
        self.friction: Array | None = None
        if self.model.layout.flat:
            self._usual = np.ones(self.model.layout.count)
            for name in ("stiction", "standstill"):
                self._usual[self.model.layout.places[name]] = settings.model.gears
            held = self.model.variance[self.model.layout.sticking]
            self.friction = settings.model.gears * np.sqrt(held)
        self.fit: Fit | None = None
        self.evaluated = False
        self.due, self._trust = 0, None  # type: int, Trust | None
        self._gravity: Array | None = None

    def add_swing(self, swing: SwingRows) -> None:
        """Adds a block's rows of legs in the air."""
        self.swing.count(swing.swings, swing.air)
        if swing.air.any():
            self.swing.add(swing.air, swing.terms, swing.rate, swing.residual, np.sqrt(swing.white), swing.unsure)

    def update(self, history: History, front: Front) -> bool:
        """Updates p̂, Σ and the fit if it is time to, and returns whether it was."""
        if history.blocks < self.due:
            return False
        self.due = history.blocks + self._settings.wait(history.blocks)
        rows, layout = history.total, self.model.layout
        usual = Errors(self.model, self.swing, self._usual, rows, layout.by_swing)
        self.fit = Fit.of(rows, usual)
        if rows.moved:
            self.sizes.update(*usual.evidence(self.swing))
        self._gravity = front.at_rest.known(layout, self._settings.model)
        self.errors = Errors(self.model, self.swing, self.sizes.factors, rows, gravity=self._gravity)
        laws = [layout.places[name] for name in ("rotor", "viscous", "coulomb")]
        front.know_joints(*(np.array([x[law] for law in laws]) for x in (self.errors.mean, self.errors.std)))
        self.evaluated = front.seen >= self._settings.evaluated
        self._trust = None
        return True

    def of_drives(self, history: History) -> Errors:
        """The same errors with strides in the air alike, as those under load are."""
        rows = history.total if self.fit is not None else None
        return Errors(self.model, self.swing, self.sizes.factors, rows, gravity=self._gravity, strides_alike=True)

    @property
    def misfit(self) -> float:
        """That of the fit; one before there are enough rows to evaluate it."""
        return self.fit.misfit if self.fit is not None and self.evaluated else 1.0

    @property
    def trust(self) -> Trust:
        """The verdict with its reasons."""
        if self._trust is None:
            if self.fit is None or not self.evaluated:
                self._trust = Trust("doubtful", np.nan, {}, ("too few rows yet to evaluate the fit",))
            else:
                self._trust = self.fit.trust(self._robot, self.model, self._settings, self.swing)
                if self._turned:
                    text = f"the IMU would be turned by {np.degrees(self._turned):.1f}°, more than the bars allow for"
                    alike = "a torque is off all the time, or something pushes or pulls the robot"
                    self._trust = self._trust.at_most("doubtful", f"{text}; if it is not, {alike}")
        return self._trust

    @property
    def _turned(self) -> float:
        """Turn of the IMU about one axis [rad] if it is beyond its prior, on which the trunk's bars rely; else zero."""
        turn = float(np.abs(self.errors.mean[self.model.layout.places["imu_rotation"]]).max())
        return turn if turn > self._settings.turned * self._settings.model.imu_rotation else 0.0


def _without(products: Array, errors: Array, joints: slice) -> Array:
    """Products of target and errors, after subtracting C p̂ from the target; p̂ is zero but for `joints`."""
    out = products.copy()
    out[1:, 0] -= products[1:, 1:][:, joints] @ errors[joints]
    out[0, 1:] = out[1:, 0]
    out[0, 0] -= (products[1:, 0] + out[1:, 0]) @ errors
    return out
