"""Verdict on whether a result can be trusted, based on how well the model fits the log."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Self

from stadera.results import finite_or_none

Verdict = Literal["good", "doubtful", "bad"]
_ORDER: tuple[Verdict, ...] = ("good", "doubtful", "bad")


@dataclass(frozen=True)
class Trust:
    """Fit quality of a result.

    Attributes:
        verdict: "good": values and error bars hold. "doubtful": a reason speaks against them, and error bars cover
            no fault. "bad": the model does not explain the log, and no value is reliable.
        misfit: variance of the residuals divided by the stated variance; 1 if model and noise are right, NaN if not
            evaluated.
        by_leg: misfit of each leg.
        reasons: why the verdict is not "good", one sentence each, the likeliest cause first.
    """

    verdict: Verdict
    misfit: float
    by_leg: Mapping[str, float] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()

    def at_most(self, verdict: Verdict, reason: str) -> Self:
        """A copy whose verdict is at most `verdict`, with one more reason, which comes first if it decides."""
        worse = max(self.verdict, verdict, key=_ORDER.index)
        reasons = (*self.reasons, reason) if worse == self.verdict else (reason, *self.reasons)
        return replace(self, verdict=worse, reasons=reasons)

    def with_legs(self, distrust: str) -> Self:
        """A copy that is at most doubtful if the legs that it relies on are not to be trusted, see `Robot.distrust`."""
        if not distrust:
            return self
        return self.at_most("doubtful", f"identified legs that are not to be trusted: {distrust}")

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON; a misfit that was not evaluated is null."""
        return {
            "verdict": self.verdict,
            "misfit": finite_or_none(self.misfit),
            "by_leg": dict(self.by_leg),
            "reasons": list(self.reasons),
        }
