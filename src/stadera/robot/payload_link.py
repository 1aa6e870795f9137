"""Payload to be written to a model file: a link fixed to the trunk, with its frame in the payload's centre of mass."""

from dataclasses import dataclass

import numpy as np

from stadera.errors import ModelError
from stadera.inertia import InertialParameters
from stadera.types import Array


@dataclass(frozen=True, eq=False)
class PayloadLink:
    """The link to add: its ten parameters in the trunk frame (with a zero tensor about its centre of mass a point
    mass), its name, and one sentence on the accuracy of the values for readers of the file, or empty. Raises
    ModelError: the mass is not positive.
    """

    body: InertialParameters
    name: str = "payload"
    note: str = ""

    def __post_init__(self) -> None:
        if not self.body.mass > 0:
            raise ModelError(f"a payload needs a positive mass to be a link, got {self.body.mass:.6g} kg")

    @property
    def tensor(self) -> Array:
        """Inertia about its centre of mass, trunk axes, (3, 3) [kg·m²]; rounding errors of a point mass are set to
        zero.
        """
        tensor = self.body.inertia_com
        return np.where(np.abs(tensor) < 1e-12 * np.abs(self.body.inertia).max(), 0.0, tensor)

    @property
    def comment(self) -> str:
        """The comment before the link."""
        return f" {self.name}: the load that was weighed. {self.note} "
