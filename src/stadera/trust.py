"""How far a result may be trusted: what its residuals say about its error bars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal

Verdict = Literal["good", "doubtful", "bad"]
_ORDER: tuple[Verdict, ...] = ("good", "doubtful", "bad")


@dataclass(frozen=True)
class Trust:
    """Fit quality of a result.

    Attributes:
        verdict: "good": values and error bars hold. "doubtful": the error bars are widened to the fit. "bad": the model
            does not explain the log, and no value is to be relied on.
        misfit: variance of the residuals over the stated one; 1 if model and noise are right, NaN if not evaluated.
        by_leg: the same for each leg.
        reasons: why the verdict is not "good", a sentence each, the likeliest cause first.
    """

    verdict: Verdict
    misfit: float
    by_leg: Mapping[str, float] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()

    def at_most(self, verdict: Verdict, reason: str) -> Trust:
        """The same, and no better than `verdict` for a further reason."""
        worse = max(self.verdict, verdict, key=_ORDER.index)
        return replace(self, verdict=worse, reasons=(*self.reasons, reason))

    def to_dict(self) -> dict[str, object]:
        """Plain values, for JSON; a misfit that was not evaluated is null."""
        return {
            "verdict": self.verdict,
            "misfit": self.misfit if isfinite(self.misfit) else None,
            "by_leg": dict(self.by_leg),
            "reasons": list(self.reasons),
        }
