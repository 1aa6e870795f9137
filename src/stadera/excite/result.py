"""Result of designing an excitation, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stadera.excite.sinusoids import Sinusoids
from stadera.excite.worth import LegExperiment
from stadera.identify.observability import Combination
from stadera.results import Result, data_frame, finite_or_none
from stadera.types import Array

if TYPE_CHECKING:
    from stadera.excite.design import ExciteSettings
    from stadera.report.figures import Figure
    from stadera.report.table import TableData


@dataclass(frozen=True, eq=False)
class Appraisal:
    """Expected information from one motion."""

    motion: Sinusoids
    gain: float  # information gain [nat]
    rank: int  # number of directions that would be known better than from the prior, joint terms included
    rigid_rank: int  # the same for the links' parameters alone, with the joint terms known
    std: Array  # (combinations,), standard deviation of each identifiable combination as a share of its prior one


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(Result):
    """A designed excitation.

    Attributes:
        experiment: the leg, its bounds and the noise.
        settings: as requested.
        chosen: the motion to play.
        draws: the paper's random draws for comparison; empty if the motion is itself one.
        combinations: that motion can identify at best.
        rigid_rank: number of combinations of the links' parameters alone.
        peaks: extremes of the chosen motion.
    """

    experiment: LegExperiment
    settings: ExciteSettings
    chosen: Appraisal
    draws: tuple[Appraisal, ...]
    combinations: tuple[Combination, ...]
    rigid_rank: int
    peaks: Peaks

    @property
    def gained(self) -> float | None:
        """Information in excess of the median random draw's [nat]; None without draws."""
        return self.chosen.gain - float(np.median([d.gain for d in self.draws])) if self.draws else None

    @cached_property
    def ratios(self) -> Array | None:
        """By combination, the random draws' median standard deviation divided by the chosen motion's."""
        return np.median([d.std for d in self.draws], axis=0) / self.chosen.std if self.draws else None

    @property
    def median_ratio(self) -> float | None:
        """The median of `ratios`; None without draws."""
        return None if self.ratios is None else float(np.median(self.ratios))

    @property
    def motions(self) -> dict[str, Appraisal]:
        """The motion and those it is compared with, by name."""
        if not self.draws:
            return {"random draw": self.chosen}
        return {"optimised": self.chosen, **{f"draw {k + 1}": draw for k, draw in enumerate(self.draws)}}

    def to_html(self) -> str:
        """The report as one self-contained HTML page."""
        from stadera.report.excite import excitation_html

        return excitation_html(self)

    def to_tables(self) -> list[TableData]:
        """Extremes of the motion, and its expected information."""
        from stadera.report.excite import limits_table, worth_table

        return [limits_table(self), worth_table(self)]

    def to_figures(self) -> Mapping[str, Figure]:
        """Figures: information (of each combination of parameters) and motion."""
        from stadera.report.excite import figures

        return figures(self)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame, one row for each identifiable combination: combination, std (share of the prior's),
        random_std (median of the random draws, NaN without them).

        Raises:
            MissingExtraError: pandas is not installed.
        """
        random = (
            np.median([d.std for d in self.draws], axis=0) if self.draws else np.full(len(self.combinations), np.nan)
        )
        names = [str(combination) for combination in self.combinations]
        return data_frame({"combination": names, "std": self.chosen.std, "random_std": random})

    def __repr__(self) -> str:
        bounds, settings = self.experiment.bounds, self.settings
        gained = "" if self.gained is None else f", {self.gained:.3g} nat more than the median random draw"
        return (
            f"Excitation of {bounds.robot.name} {bounds.leg}, {settings.duration:g} s at {settings.rate:g} Hz: "
            f"{self.chosen.gain:.4g} nat, {self.chosen.rigid_rank} of {self.rigid_rank} combinations{gained}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: settings, extremes, information of each motion, and the sinusoids themselves.

        Standard deviations are shares of the prior's. Limits that the model does not state are null.
        """
        bounds, settings, motion = self.experiment.bounds, self.settings, self.chosen.motion
        arrays = ("rest", "origins", "amplitudes", "frequencies", "phases", "starts")
        return {
            "robot": bounds.robot.name,
            "leg": bounds.leg,
            "kind": "random" if settings.random else "optimised",
            "duration": settings.duration,
            "rate": settings.rate,
            "seed": settings.seed,
            "stand_height": settings.stand_height,
            "torque_noise": dict(zip(bounds.joints, self.experiment.noise.tolist(), strict=True)),
            "joints": {joint: self._extremes(k) for k, joint in enumerate(bounds.joints)},
            "least_distance": finite_or_none(self.peaks.distance),
            "motions": [
                {"name": name, "gain": a.gain, "rank": a.rank, "rigid_rank": a.rigid_rank}
                for name, a in self.motions.items()
            ],
            "combinations": [
                {
                    "text": str(combination),
                    "std": float(self.chosen.std[k]),
                    "random_std": float(np.median([draw.std[k] for draw in self.draws])) if self.draws else None,
                    "ratio": None if self.ratios is None else float(self.ratios[k]),
                }
                for k, combination in enumerate(self.combinations)
            ],
            "gained": self.gained,
            "median_ratio": self.median_ratio,
            "rigid_rank": self.rigid_rank,
            "sinusoids": {name: getattr(motion, name).tolist() for name in arrays} | {"fade": motion.fade},
            "notes": list(bounds.clearance.notes),
            "units": dict(_UNITS),
        }

    def _extremes(self, joint: int) -> dict[str, Any]:
        """Extremes of a joint's motion, and its bounds."""
        bounds, peaks = self.experiment.bounds, self.peaks
        return {
            "position": [float(peaks.lower[joint]), float(peaks.upper[joint])],
            "position_bounds": [float(bounds.lower[joint]), float(bounds.upper[joint])],
            "velocity": float(peaks.velocity[joint]),
            "velocity_bound": finite_or_none(bounds.velocity[joint]),
            "acceleration": float(peaks.acceleration[joint]),
            "torque": float(peaks.torque[joint]),
            "torque_bound": finite_or_none(bounds.effort[joint]),
        }


_UNITS = {
    "duration": "s",
    "rate": "Hz",
    "stand_height": "m",
    "torque_noise": "N·m",
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s²",
    "torque": "N·m",
    "least_distance": "m",
    "gain": "nat",
    "gained": "nat",
    "std": "of the prior's",
    "sinusoids": "rad, Hz, s",
}


@dataclass(frozen=True, eq=False)
class Peaks:
    """Extremes of a motion, (n,) each."""

    lower: Array  # least position [rad]
    upper: Array  # largest position [rad]
    velocity: Array  # magnitude [rad/s]
    acceleration: Array  # magnitude [rad/s²]
    torque: Array  # magnitude, predicted by the prior model [N·m]
    distance: float  # least distance to trunk, other legs, itself and the ground [m]; above 0.1 m a lower bound of it
