"""A payload to be written into a model file: a link fixed to the trunk, its frame in the payload's centre of mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class PayloadLink:
    """What is fixed to the trunk.

    Attributes:
        body: its ten parameters, in the trunk frame. A tensor of zero about its centre of mass makes it a point mass.
        name: of the link.
        note: what a reader of the file should know about the numbers; one sentence, or empty.

    Raises:
        ModelError: a mass that is not positive.
    """

    body: InertialParameters
    name: str = "payload"
    note: str = ""

    def __post_init__(self) -> None:
        if not self.body.mass > 0:
            raise ModelError(f"a payload needs a positive mass to be a link, got {self.body.mass:.6g} kg")

    @property
    def tensor(self) -> Array:
        """About its centre of mass, trunk axes, (3, 3) [kg·m²]; what rounding leaves of a point mass is zero."""
        tensor = self.body.inertia_com
        return np.where(np.abs(tensor) < 1e-12 * np.abs(self.body.inertia).max(), 0.0, tensor)

    @property
    def comment(self) -> str:
        """The comment in front of the link."""
        return f" {self.name}: the load that was weighed. {self.note} "
