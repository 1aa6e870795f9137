"""Where the load is: as its owner says, or the likeliest of trunk, torso, each limb's end, and two hands together."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np

from stadera.errors import UnknownNameError
from stadera.inertia import parameter_map
from stadera.robot.limbs import Limbs, Place, place_of
from stadera.robot.model import Robot
from stadera.trunk.history import History
from stadera.trunk.joint_errors import Errors
from stadera.trunk.load import Payload, without_scale
from stadera.trunk.placed import Blocks, Solved, log_odds
from stadera.trunk.segment import Segment
from stadera.types import Array

_AS_MODELLED = 0.4
"""Deviation of the trunk before the load from the model's, as a share of the robot's mass, up to which places are
compared: a robot without a load may be a fifth lighter or heavier than its model, and doubled torques make it twice as
heavy.
"""


_USUAL = 0.2
"""Deviation of a load's mass, as a share of the robot's, and of its parts from the origin of its place, of the legs'
length: quadrupeds are asked to carry up to a fifth of their mass. Of 31 loads on a G1 or Talos that sways on a plant of
its own, with drawn errors, two seem to be on the wrong side of the waist, at odds of 4 to 6 to 1; with half of it the
same two, with three times of it four, with over 98 % certainty.
"""


class Whereabouts:
    """Places where a load may be, and how likely each is.

    Args:
        robot: the model. at: the link or frame on which the load is, as its owner says; None if he does not.

    Attributes:
        places: links besides the trunk, in the order of the rows' columns.
        candidates: what is compared; first the place that the load is taken to be at before any row.
        probability: (candidates,), of the present load; NaN where nothing tells.
        ended: (candidates,), likewise, of the longest load since the tare that has ended; None without one, and if
            nobody said where it is.

    Raises:
        UnknownNameError: no such link or frame, or one of a leg, on which no load is looked for.
    """

    def __init__(self, robot: Robot, at: str | None = None) -> None:
        limbs, extra, n = Limbs.of(robot), robot.extra, len(robot.tree.joints)
        said = Place(robot.trunk, -1, np.eye(3), np.zeros(3)) if at is None else place_of(robot, at)
        if 0 <= said.body < n:
            links = extra.links if extra is not None else ()
            raise UnknownNameError("place of a load", said.name, (robot.trunk, *links), robot.name)
        own = {n + k: place_of(robot, extra.links[k]) for k in limbs.ends} if extra is not None else {}
        if said.body >= 0:
            own[said.body] = said
        self._trunk = said if said.body < 0 else Place(robot.trunk, -1, np.eye(3), np.zeros(3))
        self._fixed = at is not None
        self.places = tuple(own.values())
        number = {body: 1 + k for k, body in enumerate(own)}
        first = number.get(said.body, 0)
        alone = sorted(range(1 + len(own)), key=lambda k: k != first)
        both = ((number[n + one], number[n + other]) for one, other in limbs.hands)
        self.candidates: tuple[Blocks, ...] = (*((k,) for k in alone), *both)
        self.probability = np.full(len(self.candidates), np.nan)
        self.ended: Array | None = None
        self._longest = 0.0
        self._model = robot.inertias[robot.trunk].mass, _AS_MODELLED * robot.mass
        arm = _USUAL * robot.leg_length
        self._usual = _USUAL * robot.mass * np.array([1.0, *[arm] * 3, *[arm**2] * 6])

    def name(self, at: Blocks) -> str:
        """The link or links of a place."""
        return " + ".join(self._place(k).name for k in at)

    def _place(self, k: int) -> Place:
        return self.places[k - 1] if k else self._trunk

    def look(self, history: History, errors: Errors, repeats: float, certain: float) -> bool:
        """Compares the places by the rows since the present load came. Moves the load from the trunk to the
        likeliest if that is `certain`, from elsewhere if it is likelier than not, and nobody said where it is; returns
        whether it did.
        """
        since = history.since_load
        if since is None or history.before is None or len(self.candidates) == 1:
            return False
        if (shares := self._shares(since, history.before, errors, repeats)) is None:
            return False
        self.probability = shares
        most = int(np.nanargmax(shares))
        best = self.candidates[most]
        enough = certain if history.at == (0,) else 0.5  # else it would stay where another place is likelier
        if self._fixed or best == history.at or shares[most] < enough:
            return False
        history.move(best)
        return True

    def end(self, load: Segment, before: Segment, errors: Errors, repeats: float) -> None:
        """Keeps what a load that has ended tells of the place that its owner says. Weighed at a wrong place, a load
        seems to change whenever a limb moves, and what rows since then tell is little. A push is shorter.

        Args:
            load: rows of that load. before: those before any load.
        """
        if not self._fixed or load.count <= self._longest:
            return
        if (shares := self._shares(load, before, errors, repeats)) is not None:
            self.ended, self._longest = shares, load.count

    def forget(self) -> None:
        """Forgets what loads that have ended tell: they are the tare's."""
        self.ended, self._longest = None, 0.0

    def _shares(self, since: Segment, before: Segment, errors: Errors, repeats: float) -> Array | None:
        """Probability of each candidate, NaN of those whose joints are not recorded; None if nothing can be told."""
        # joints that are not recorded move no load
        begin = since.triangle.shape[1] - 10 * len(self.places)
        columns = since.triangle[:, begin:].reshape(10, -1, 10)
        seen = [all(k == 0 or columns[:, k - 1].any() for k in place) for place in self.candidates]
        trunk, most = self._model
        if abs(float(before.mean(errors.mean)[0]) - trunk) > most:
            return None  # torques of another scale, which an arm's own and the legs' do not show alike
        places = [place for place, known in zip(self.candidates, seen, strict=True) if known]
        if len(places) == 1:
            return None
        odds = log_odds(since, before, places, errors.prior, repeats, self._usual)
        shares = np.full(len(self.candidates), np.nan)
        shares[seen] = np.exp(odds - odds.max())
        return np.asarray(shares / np.nansum(shares))

    def payload(self, load: Solved, at: Blocks, errors: Errors, limit: float) -> Payload:
        """The load at a place, in the frame of its link; of one at two links, the mass.

        Args:
            limit: as of `Payload.of_parameters` [m].
        """
        covariance, mean = errors.load_covariance(load), load.mean(errors.mean)
        by_scale = errors.by_scale(load.sensitivity)
        if len(at) == 1:
            place = self._place(at[0])
            turn = place.rotation.T
            to_frame = parameter_map(turn, -turn @ place.translation)
            moved = to_frame @ mean, to_frame @ covariance @ to_frame.T
            return self.said(Payload.of_parameters(*moved, limit, by_scale), at)
        both = np.tile([1.0, *np.zeros(9)], len(at))  # the masses
        mass, variance, scale = float(both @ mean), float(both @ covariance @ both), float(both @ by_scale)
        unknown = np.full(3, np.nan), np.full((3, 3), np.nan)
        found = Payload(mass, sqrt(variance), *unknown, mass_std_without_scale=without_scale(variance, scale))
        return self.said(found, at)

    def said(self, payload: Payload, at: Blocks) -> Payload:
        """With where it is; the trunk has no name, see `Payload.at`."""
        probability = self.probability
        if self.ended is not None and not probability[0] < self.ended[0]:
            probability = self.ended
        known = zip(self.candidates, probability.tolist(), strict=True)
        shares = {self.name(place): share for place, share in known if np.isfinite(share)}
        return replace(payload, at="" if at == (0,) else self.name(at), places=shares)
