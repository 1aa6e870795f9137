"""Rows of one block, as `stadera.trunk.rows` makes them."""

from dataclasses import dataclass

from stadera.types import Array, Bools


class Equations:
    """Six rows A θ + C p = b, and those of the limbs.

    Attributes:
        columns: (6, 10 + 1 + errors + 10 loads), of A, b, C and of what a load elsewhere does (`stadera.trunk.limbs`).
        limbs: (joints, the same), of the limbs' joints.
    """

    columns: Array
    limbs: Array | None

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
        """C (6, errors), then what loads do."""
        return self.columns[:, 11:]


@dataclass(frozen=True, eq=False)
class SwingRows:
    """A window's rows in joint space, for legs in the air: see `stadera.trunk.swing.SwingJoints.add`; `white` is the
    variance, `slides` (2, J) tells joints that slide forward, and backward, throughout the window, `stepping` is as of
    `Lifted`.
    """

    air: Bools
    terms: Array
    rate: Array
    residual: Array
    white: Array
    slides: Bools
    stepping: bool = False


@dataclass(frozen=True, eq=False)
class BlockRows(Equations):
    """Six rows A θ + C p = b from two neighbouring blocks.

    Attributes:
        time: of the last sample [s]. elapsed: since the previous block [s].
        columns: (6, ...), of A, b [N, N·m], C and loads. limbs: (joints, ...), None if there are none.
        white: (6,), variances of the white noise.
        swing: rows in joint space.
        unsure: (J,), variance 1 - s² of the direction of each joint's friction [1], s of the mean velocity and, as wide
            as that, its noise.
    """

    time: float
    elapsed: float
    columns: Array
    white: Array
    swing: SwingRows
    unsure: Array
    limbs: Array | None = None
