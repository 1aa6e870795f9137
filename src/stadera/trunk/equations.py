"""Six equations of the trunk in a block, as one array."""

from stadera.types import Array


class Equations:
    """Six rows A θ + C p = b.

    Attributes:
        columns: (6, 10 + 1 + ERRORS), of A, b and C.
    """

    columns: Array

    @property
    def matrix(self) -> Array:
        """A (6, 10)."""
        return self.columns[:, :10]

    @property
    def target(self) -> Array:
        """b (6,)."""
        return self.columns[:, 10]

    @property
    def errors(self) -> Array:
        """C (6, ERRORS)."""
        return self.columns[:, 11:]
