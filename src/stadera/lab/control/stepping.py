"""Steps in place, or a slow walk, of robots on two flat feet: a linear inverted pendulum with planned footholds.

With c the centre of mass at a height h above the ground, p the centre of pressure and ω² = g / h, c̈ = ω² (c - p). The
divergent component of motion ξ = c + ċ / ω then obeys ξ̇ = ω (ξ - p), so a plan p(t), linear between the soles while
both feet stand, is followed from

    ξ_ref(t) = ω ∫_t^∞ exp(-ω (s - t)) p(s) ds = p(t) + Σ_k ṗ_k / ω (exp(-ω (t_k - t)) - exp(-ω (t_k+1 - t)))

over its linear pieces k (Englsberger et al., Three-dimensional bipedal walking control based on divergent component of
motion, 2015). An error e = ξ - ξ_ref is gone when the foot in the air lands, in a time T, if the centre of pressure is
moved by e G / (G - 1), G = exp(ω T). What the sole is too small for is left to the foothold: it is moved by what then
remains of the error. A foot is lifted when an error of that moment can be stepped out.

The centre of mass is elsewhere than the model's, by d, because of a load that the controller does not know. On one
foot, ξ̇ = ω (ξ + d - p) with the centre of pressure of its own forces: d is observed from it, with both poles at a
settings' `load` ω. Friction is compensated by that of the plan's velocities; measured ones would chatter.
"""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from stadera.constants import GRAVITY
from stadera.errors import StaderaError
from stadera.lab.control.arms import Arms
from stadera.lab.control.swing import SwingTrajectory
from stadera.lab.control.whole_body import Seen, WholeBody
from stadera.robot.model import Robot
from stadera.robot.shapes import FLAT
from stadera.types import Array


@dataclass(frozen=True)
class StepSettings:
    """Settings of steps; times in units of the pendulum's 1 / ω, about 0.27 s of a G1 and 0.3 s of a Talos."""

    shift: float = 5.0  # time of the first shift of the weight
    swing: float = 2.2  # time of a foot in the air
    both: float = 0.9  # time on both feet between two swings
    wait: float = 2.0  # most by which that is longer until the next foot can be lifted
    level: float = 2.0  # time constant of the ground's height
    clearance: float = 0.06  # of the feet, share of the legs' length
    sole: float = 0.7  # share of the soles within which the centre of pressure is moved
    ankle: float = 0.65  # share of the ankles' effort limit with which they hold the weight
    gain: float = 2.5  # largest of the centre of pressure to an error of ξ on one foot
    press: float = 3.0  # the same on both feet
    load: float = 0.8  # of the observer of the centre of mass
    reach: float = 0.2  # most that a foothold is moved, share of the legs' length
    narrow: float = 0.8  # least distance between the feet across, share of that in the stance
    fixed: float = 0.8  # share of a swing after which its foothold is
    landing: float = 0.6  # share of a swing after which the ground may be there
    late: float = 1.15  # share of a swing after which the foot is taken as landed
    touch: float = 0.003  # height of a foot above the end of its trajectory that only the ground explains [m]
    early: float = 0.01  # and above its trajectory before that [m]
    light: float = 0.1  # share of the weight below which a foot is pressed down, since nothing else holds it
    down: float = 4.0  # acceleration with which it is [m/s²]
    foot: float = 40.0  # natural frequency of the tracking of feet in the air, damped critically [rad/s]
    slides: float = 0.05  # speed of a joint in the plan from which its whole friction is compensated [rad/s]
    ahead: int = 4  # steps that are planned


class Stepping(WholeBody):
    """Stands as `WholeBody` until `walk`, then steps. Raises StaderaError: the robot has not two flat feet.

    `count` is the number of steps that have landed.
    """

    def __init__(self, robot: Robot, arms: Arms, settings: StepSettings | None = None) -> None:
        if [leg.contact for leg in robot.legs] != [FLAT, FLAT]:
            raise StaderaError(f"robot {robot.name} cannot step: it has not two flat feet")
        super().__init__(robot, arms)
        self.settings, self.count = settings or StepSettings(), 0
        drives = [robot.dynamics[joint] for joint in robot.tree.joints]
        self._coulomb, self._viscous = (np.array([getattr(d, k) for d in drives]) for k in ("coulomb", "viscous"))
        self._points = np.repeat([0, 1], [len(points) for points, _ in self._soles])
        ankle = min(robot.limits[joint].effort for leg in robot.legs for joint in leg.joints[-2:])
        self._lever = self.settings.ankle * ankle / (robot.mass * GRAVITY)
        self._speed: float | None = None  # [m/s]; None before it walks
        self._omega = self._height = self._level = 0.0
        self._next, self._path = 0, None  # foot that is lifted next, or in the air; its trajectory
        self._since, self._both = 0.0, 0.0  # beginning of the phase, and how long both feet stand [s]
        self._middles, self._sides, self._flat = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 3, 3))
        # ξ, its reference, its model's, d, and the centre of pressure: now, at the phase's beginning, of the forces
        self._xi, self._wanted, self._modelled, self._off = np.zeros((4, 2))
        self._pressure, self._before, self._realised = np.zeros((3, 2))
        self._carried = np.full(2, 0.5)  # share of the weight on each foot

    _path: SwingTrajectory | None

    def walk(self, speed: float = 0.0) -> None:
        """Steps from now on, ahead with a speed [m/s], zero in place."""
        self._require_update("it stands before it walks")
        self._speed = speed

    # -- phases ---------------------------------------------------------------------------------------------------
    def _plan(self, seen: Seen, dt: float) -> None:
        if self._speed is None:
            return
        self._middles = np.array([(self.position + self._middle(seen, k))[:2] for k in range(2)])
        if not self._omega:
            self._start(seen)
        s, w, t = self.settings, self._omega, self.time - self._since
        self._xi = (self.position + seen.com)[:2] + self._off + seen.com_velocity[:2] / w
        self._level += dt * w / s.level * (float(self._anchors[:, 2].mean()) - self._level)
        if (path := self._path) is not None:
            self._observe(dt)
            above = float((self.position + seen.feet[self._next] - path.at(self.time)[0])[2])
            sure = s.touch if self.time > path.end else s.early if path.progress(self.time) > s.landing else np.inf
            if above > sure or t > s.late * path.duration:
                self._land(seen)
        elif t >= self._both and self._may_lift(seen, t > self._both + s.wait / w):
            self._lift(seen)
        else:
            self._load(seen, t)
        self._balance(seen)

    def _start(self, seen: Seen) -> None:
        self._level = float(self._anchors[:, 2].mean())
        self._height = float((self.position + seen.com)[2]) - self._level
        self._omega = float(np.sqrt(GRAVITY / self._height))
        self._sides, self._flat = self._middles - self._middles[::-1], seen.turned
        self._both, self._since, self._before = self.settings.shift / self._omega, self.time, self._middles.mean(axis=0)

    def _load(self, seen: Seen, t: float) -> None:
        """Loads a foot that has landed; one that carries little does not tell where the trunk is."""
        share, light = t * self._omega / self.settings.both, self._carried < self.settings.light
        self._weights = self._carried
        self._anchors[light] = self.position + seen.feet[light]
        most = max(share, 0.01) * 0.6 * self.robot.mass * GRAVITY if self.count and share < 1.0 else np.inf
        self._sharing.set_most(np.where(self._points == 1 - self._next, most, np.inf))

    def _may_lift(self, seen: Seen, late: bool) -> bool:
        """Whether the next foot can be lifted. If it waits for too long, the better one of both is, at once."""
        excess, swing = [], self.settings.swing
        for leg in range(2):
            error, grown = self._xi - self._followed(seen, leg, swing / self._omega)[0], np.exp(swing)
            move = self._inside(seen, (1 - leg,), self._middles[1 - leg] + error * grown / (grown - 1.0))
            moved = error * grown - (move - self._middles[1 - leg]) * (grown - 1.0)
            excess.append(float(np.linalg.norm(moved - self._reachable(leg, moved))))
        if late:
            self._next = int(np.argmin(excess))
        return late or excess[self._next] < 1e-9

    def _lift(self, seen: Seen) -> None:
        leg, start = self._next, self.position + seen.feet[self._next]
        self.stance = np.arange(2) != leg
        self._weights, self._since, self._modelled = self.stance.astype(float), self.time, self._xi
        self._sharing.set_most(np.where(self.stance, np.inf, 0.0)[self._points])
        duration, clearance = self.settings.swing / self._omega, self.settings.clearance * self.robot.leg_length
        self._path = SwingTrajectory(start, start, self.time, duration, clearance)

    def _land(self, seen: Seen) -> None:
        self._path, self._since, self._both = None, self.time, self.settings.both / self._omega
        self.stance, self._before = np.ones(2, dtype=bool), self._pressure
        self.count, self._next = self.count + 1, 1 - self._next
        self._load(seen, 0.0)

    # -- balance --------------------------------------------------------------------------------------------------
    def _observe(self, dt: float) -> None:
        """Where the centre of mass is from the model's; ξ is with what is known of it."""
        w, load, error = self._omega, self.settings.load, self._xi - self._modelled
        learnt = dt * w * load**2 * error
        self._modelled = self._modelled + dt * w * (self._xi - self._realised + 2.0 * load * error) + learnt
        self._xi, self._off = self._xi + learnt, self._off + learnt

    def _followed(self, seen: Seen, leg: int, left: float, flying: bool = True) -> tuple[Array, Array, Array]:
        """ξ_ref and p now, and where the middle of a leg's sole lands next, (2,) [m] each, from the time [s] that is
        left until it lands if it flies, until it is lifted otherwise.
        """
        s, w, stood = self.settings, self._omega, self._middles[1 - leg]
        swing, both = s.swing / w, s.both / w
        step = seen.rotation[:2, 0] * (self._speed or 0.0) * (swing + both)
        times, places = [0.0, left], [stood, stood]
        if not flying:
            begun = self._before + (stood - self._before) * (1.0 - left / self._both)
            times, places = [0.0, left, left + swing], [begun, stood, stood]
        place = landing = stood + self._sides[leg] + step
        for k in range(s.ahead):
            times += [times[-1] + both, times[-1] + both + swing]
            places += [place, place]
            place = place + self._sides[leg if k % 2 else 1 - leg] + step
        T, P = np.array(times), np.array(places)
        slopes = np.diff(P, axis=0) / np.maximum(np.diff(T), 1e-9)[:, None]
        return P[0] - np.diff(np.exp(-w * T)) @ slopes / w, P[0], landing

    def _balance(self, seen: Seen) -> None:
        """Chooses the centre of pressure, and the foothold."""
        s, leg, path = self.settings, self._next, self._path
        if path is None:
            left = max(self._both - (self.time - self._since), 0.0)
            self._wanted, planned, _ = self._followed(seen, leg, left, flying=False)
            pressed = (planned if left else self._wanted) + s.press * (self._xi - self._wanted)
            self._pressure = self._inside(seen, (0, 1), pressed)
            return
        left = max(path.end - self.time, 0.0)
        self._wanted, planned, landing = self._followed(seen, leg, left)
        error, grown = self._xi - self._wanted, float(np.exp(self._omega * left))
        self._pressure = self._inside(seen, (1 - leg,), planned + error * min(grown / max(grown - 1.0, 1e-6), s.gain))
        if path.progress(self.time) < s.fixed:
            moved = self._reachable(leg, error * grown - (self._pressure - planned) * (grown - 1.0))
            foot = landing + moved - (self._flat[leg] @ self._soles[leg][0].mean(axis=0))[:2]
            stood, normal = self.position + seen.feet[1 - leg], self._flat[leg][:, 2]
            height = stood[2] - normal[:2] @ (foot - stood[:2]) / normal[2]
            self._path = replace(path, target=np.array([*foot, height]))

    def _inside(self, seen: Seen, feet: tuple[int, ...], pressure: Array) -> Array:
        """The centre of pressure (2,) [m] within the soles of feet, or the rectangle around both, and near ankles."""
        axes, bounds = seen.turned[feet[0]][:2, :2], []
        for foot in feet:
            half = 0.5 * self.settings.sole * np.ptp(self._soles[foot][0], axis=0)[:2]
            ankle = self.position + seen.feet[foot] - seen.turned[foot] @ self.robot.legs[foot].foot_position
            middle, centre = self._middles[foot] @ axes, ankle[:2] @ axes
            bounds.append(np.clip([middle - half, middle + half], centre - self._lever, centre + self._lever))
        low, high = np.min(bounds, axis=(0, 1)), np.max(bounds, axis=(0, 1))
        return np.asarray(axes @ np.clip(pressure @ axes, low, high))

    def _reachable(self, leg: int, moved: Array) -> Array:
        """A displacement (2,) [m] of a leg's foothold, or the largest in its direction that does not cross the legs."""
        side, s = self._sides[leg], self.settings
        moved = moved * min(1.0, s.reach * self.robot.leg_length / max(float(np.linalg.norm(moved)), 1e-9))
        inwards = -(1.0 - s.narrow) - float(side @ moved) / float(side @ side)
        return np.asarray(moved + max(inwards, 0.0) * side)

    # -- demands --------------------------------------------------------------------------------------------------
    def _com_acceleration(self, seen: Seen) -> Array | None:
        if not self._omega:
            return None
        com = self.position + seen.com
        flat = self._omega**2 * (com[:2] + self._off - self._pressure)
        up = self._stiffness[0] * (self._level + self._height - com[2]) - self._damping[0] * seen.com_velocity[2]
        return np.array([*flat, up])

    def _foot_acceleration(self, seen: Seen, leg: int, velocity: Array) -> Array:
        if self._path is None or leg != self._next:
            lightness = max(1.0 - self._carried[leg] / self.settings.light, 0.0) if self._omega else 0.0
            return -lightness * (2.0 * self.settings.foot * velocity + [0.0, 0.0, self.settings.down, 0.0, 0.0, 0.0])
        w, (place, rate, rate_2) = self.settings.foot, self._path.at(self.time)
        off = place - self.position - seen.feet[leg]
        turn = seen.turned[leg] @ pin.log3(seen.turned[leg].T @ self._flat[leg])
        pull = w * w * np.concatenate([off, turn]) - 2.0 * w * velocity
        return np.asarray(pull + np.concatenate([rate_2 + 2.0 * w * rate, np.zeros(3)]))

    def _friction(self, seen: Seen) -> Array:
        torque = super()._friction(seen)
        if not self._omega:
            return torque
        com = self._omega * (self._wanted - (self.position + seen.com)[:2] - self._off)
        trunk = np.concatenate([seen.rotation.T @ [*com, 0.0], np.zeros(3)])
        for leg, ((_, columns, _), jacobian) in enumerate(zip(self._legs, seen.jacobians, strict=True)):
            foot = np.zeros(6)
            if self._path is not None and leg == self._next:
                foot[:3] = self._path.at(self.time)[1]
            rates, joints = seen.inverses[leg] @ (foot - jacobian[:, :6] @ trunk), columns - 6
            torque[joints] = self._coulomb[joints] * np.tanh(rates / self.settings.slides)
            torque[joints] += self._viscous[joints] * rates
        return torque

    def _forces(self, seen: Seen, needed: Array) -> tuple[list[Array], list[Array]]:
        forces, arms = super()._forces(seen, needed)
        places = np.concatenate([own + place for own, place in zip(arms, seen.feet, strict=True)])
        up = np.concatenate(forces)[:, 2]
        if (total := float(up.sum())) > self.settings.light * self.robot.mass * GRAVITY:
            self._realised = (self.position + up @ places / total)[:2]
            self._carried = np.array([float(f[:, 2].sum()) for f in forces]) / total
        return forces, arms
