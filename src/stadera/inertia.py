"""The ten inertial parameters of a rigid body: their order, conversions and frame changes.

The order, everywhere in code, files and print, is the paper's eq. 3::

    [m, m·cx, m·cy, m·cz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz]

with the inertia about the origin of the body's own frame, in that frame's axes. Dynamics are linear in these ten.

The pseudo-inertia (Wensing, Kim, Slotine 2018) is their 4x4 symmetric rearrangement::

    J = [[Σ, h], [hᵀ, m]],   Σ = ½ tr(I) 1 - I = ∫ρ r rᵀ dV,   h = m c

A body is physically possible (a non-negative mass density has these moments) exactly when J is positive
semidefinite; a frame change `r' = R r + p` acts as `J' = T J Tᵀ` with `T = [[R, p], [0, 1]]`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from stadera.errors import ModelError
from stadera.types import Array

if TYPE_CHECKING:
    import pinocchio

ORDER: tuple[str, ...] = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
"""Names of the ten parameters in their one order."""

UNITS: tuple[str, ...] = ("kg", *("kg·m",) * 3, *("kg·m²",) * 6)
"""Units of the ten parameters."""

_FROM_PINOCCHIO = np.array([0, 1, 2, 3, 4, 5, 7, 6, 8, 9])  # Pinocchio stores Ixx Ixy Iyy Ixz Iyz Izz; an involution

_INERTIA_INDEX = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def _tensor(components: Array) -> Array:
    xx, xy, xz, yy, yz, zz = components
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _pseudo_basis() -> Array:
    """The ten 4x4 matrices E_k with J(φ) = Σ_k φ_k E_k."""
    tensors = ((unit, _tensor(unit[4:])) for unit in np.eye(10))
    second = ((unit, 0.5 * np.trace(tensor) * np.eye(3) - tensor) for unit, tensor in tensors)
    return np.array([np.block([[S, unit[1:4, None]], [unit[1:4], unit[0]]]) for unit, S in second])


PSEUDO_BASIS: Array = _pseudo_basis()
"""The ten constant 4x4 matrices that turn parameters into a pseudo-inertia: J = Σ φ_k E_k. Shape (10, 4, 4)."""


def skew(v: ArrayLike) -> Array:
    """The matrix [v]x with [v]x w = v x w. Shape (3, 3)."""
    x, y, z = np.asarray(v, dtype=float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


_SKEWS = np.stack([skew(axis) for axis in np.eye(3)]).reshape(3, 9)


def skews(vectors: Array) -> Array:
    """[v]x of vectors (..., 3), shape (..., 3, 3)."""
    return np.asarray((vectors @ _SKEWS).reshape(*vectors.shape, 3))


def order_from_pinocchio(parameters: ArrayLike) -> Array:
    """Ten parameters (last axis) in Pinocchio's order, reordered to ours; applied again, it goes back."""
    return np.asarray(parameters, dtype=float)[..., _FROM_PINOCCHIO]


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


@dataclass(frozen=True, eq=False)
class InertialParameters:
    """The ten parameters of one body, in that body's own frame.

    Kept as the vector of eq. 3, so that differences of bodies (a payload as "after minus before") are values too,
    physical or not; ask `is_physical`.

    Args:
        vector: shape (10,), units kg, kg·m, kg·m².

    Raises:
        ModelError: wrong shape, or a value that is not finite.
    """

    vector: Array

    def __post_init__(self) -> None:
        vector = np.array(self.vector, dtype=float)
        if vector.shape != (10,):
            raise ModelError(f"inertial parameters need shape (10,), got {vector.shape}")
        if not np.isfinite(vector).all():
            bad = ", ".join(name for name, v in zip(ORDER, vector, strict=True) if not np.isfinite(v))
            raise ModelError(f"inertial parameters are not finite: {bad}")
        vector.flags.writeable = False
        object.__setattr__(self, "vector", vector)

    def __repr__(self) -> str:
        """Mass, centre of mass and the inertia about the frame's origin, on three lines."""
        names = " ".join(ORDER[4:])
        return (
            f"InertialParameters: mass {self.mass:.6g} kg\n  com [{_listed(self.com)}] m\n"
            f"  inertia about the frame's origin [{_listed(self.vector[4:])}] kg·m² ({names})"
        )

    # -- made from --------------------------------------------------------------------------------------------
    @classmethod
    def from_com(cls, mass: float, com: ArrayLike, inertia_com: ArrayLike) -> InertialParameters:
        """From the mass [kg], the centre of mass [m] and the inertia about the centre of mass [kg·m²], (3, 3)."""
        x, y, z = (float(c) for c in np.asarray(com, dtype=float))
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = np.asarray(inertia_com, dtype=float).tolist()
        about = xx + mass * (y * y + z * z), xy - mass * x * y, xz - mass * x * z, yy + mass * (x * x + z * z)
        return cls(
            np.array([mass, mass * x, mass * y, mass * z, *about, yz - mass * y * z, zz + mass * (x * x + y * y)])
        )

    @classmethod
    def from_moments(cls, mass: float, first_moment: ArrayLike, inertia: ArrayLike) -> InertialParameters:
        """From the mass, the first moment m·c [kg·m] and the inertia about the frame's origin [kg·m²], (3, 3)."""
        tensor = np.asarray(inertia, dtype=float)
        return cls(np.array([mass, *np.asarray(first_moment, dtype=float), *(tensor[i, j] for i, j in _INERTIA_INDEX)]))

    @classmethod
    def from_pseudo_inertia(cls, pseudo: ArrayLike) -> InertialParameters:
        """From the 4x4 pseudo-inertia, the inverse of `pseudo_inertia`."""
        J = np.asarray(pseudo, dtype=float)
        second = J[:3, :3]
        return cls.from_moments(J[3, 3], J[:3, 3], np.trace(second) * np.eye(3) - second)

    @classmethod
    def from_pinocchio(cls, inertia: pinocchio.Inertia) -> InertialParameters:
        """From Pinocchio's spatial inertia, expressed in the same frame."""
        return cls(order_from_pinocchio(inertia.toDynamicParameters()))

    @classmethod
    def zero(cls) -> InertialParameters:
        """No body at all."""
        return cls(np.zeros(10))

    # -- read as ----------------------------------------------------------------------------------------------
    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.vector[0])

    @property
    def first_moment(self) -> Array:
        """m·c [kg·m], shape (3,)."""
        return self.vector[1:4]

    @property
    def com(self) -> Array:
        """Centre of mass [m], shape (3,); NaN where the mass is zero."""
        return self.first_moment / self.mass if self.mass else np.full(3, np.nan)

    @property
    def inertia(self) -> Array:
        """Inertia about the frame's origin [kg·m²], shape (3, 3)."""
        return _tensor(self.vector[4:])

    @property
    def inertia_com(self) -> Array:
        """Inertia about the centre of mass, in the frame's axes [kg·m²], shape (3, 3)."""
        mass, x, y, z, xx, xy, xz, yy, yz, zz = self.vector.tolist()
        if not mass:
            return self.inertia
        xx, yy, zz = xx - (y * y + z * z) / mass, yy - (x * x + z * z) / mass, zz - (x * x + y * y) / mass
        return _tensor(np.array([xx, xy + x * y / mass, xz + x * z / mass, yy, yz + y * z / mass, zz]))

    @property
    def pseudo_inertia(self) -> Array:
        """The 4x4 pseudo-inertia J."""
        J: Array = np.tensordot(self.vector, PSEUDO_BASIS, axes=1)
        return J

    def to_pinocchio(self) -> pinocchio.Inertia:
        """As Pinocchio's spatial inertia.

        Raises:
            ModelError: the mass is zero while moments are not, which Pinocchio's mass-and-lever form cannot hold.
        """
        import pinocchio

        if self.mass == 0.0 and self.vector.any():
            raise ModelError("a body with zero mass and non-zero moments has no Pinocchio inertia")
        com = self.com if self.mass else np.zeros(3)
        return pinocchio.Inertia(self.mass, com, self.inertia_com)

    # -- geometry ---------------------------------------------------------------------------------------------
    def transformed(self, rotation: ArrayLike, translation: ArrayLike) -> InertialParameters:
        """The same body seen from another frame, in which this one has rotation R (3, 3) and origin p (3,) [m]:
        `r_other = R r + p`.
        """
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation, translation
        return self.from_pseudo_inertia(T @ self.pseudo_inertia @ T.T)

    def shifted(self, translation: ArrayLike) -> InertialParameters:
        """The same body seen from parallel axes, this frame's origin lying at `translation` [m] in the other."""
        return self.transformed(np.eye(3), translation)

    def __add__(self, other: InertialParameters) -> InertialParameters:
        return InertialParameters(self.vector + other.vector)

    def __sub__(self, other: InertialParameters) -> InertialParameters:
        return InertialParameters(self.vector - other.vector)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, InertialParameters) and bool(np.array_equal(self.vector, other.vector))

    def __hash__(self) -> int:
        return hash((self.vector + 0.0).tobytes())  # -0.0 equals 0.0

    # -- physics ----------------------------------------------------------------------------------------------
    def is_physical(self, tolerance: float = 1e-9) -> bool:
        """Whether some non-negative mass density has these moments (J positive semidefinite). `tolerance`: how far
        below zero the smallest eigenvalue may lie, in units such that the mass and the trace of the second moment are
        one.
        """
        J = self.pseudo_inertia
        second, mass = abs(float(np.trace(J[:3, :3]))), abs(self.mass)
        scale = np.sqrt([second or 1.0] * 3 + [mass or 1.0])
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = J / np.outer(scale, scale)
        # no element of a semidefinite matrix exceeds its largest diagonal one, here 1; absurd ones have no eigenvalues
        return bool(np.abs(scaled).max() < 2.0) and bool(np.linalg.eigvalsh(scaled).min() >= -tolerance)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers by name, for JSON."""
        return dict(zip(ORDER, self.vector.tolist(), strict=True))


def parameter_map(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """The map (10, 10) by which `InertialParameters.transformed` takes ten parameters to another frame."""
    moved = [InertialParameters(unit).transformed(rotation, translation).vector for unit in np.eye(10)]
    return np.column_stack(moved)
