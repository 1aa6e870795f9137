"""Prior on the parameters: the CAD values, and how far from them a value is plausible.

A link's prior is expressed in coordinates that do not depend on the choice of its frame or units. With the prior
pseudo-inertia J0 = U Uᵀ (U upper triangular), any other J is written::

    J = U (1 + D) Uᵀ,     D symmetric 4x4

A change of frame T turns J0 into T J0 Tᵀ and leaves ‖D‖ as it is (D only rotates), so ‖D‖² is an invariant distance:
the affine-invariant metric on pseudo-inertias at J0 (Lee, Wensing, Park 2019). D's last entry is the mass's
relative change, since J's last entry is the mass and U's last row is (0, 0, 0, √m). Hence a mass can be fixed, or given
a narrower prior than the rest of D, without losing the invariance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stadera.constants import GRAVITY
from stadera.errors import IdentificationError, require_positive
from stadera.inertia import ORDER, PSEUDO_BASIS, InertialParameters
from stadera.robot.model import JointDynamics, Robot
from stadera.trunk.settings import ModelErrors
from stadera.types import Array

_SYMMETRIC_BASIS = np.zeros_like(PSEUDO_BASIS)
_UPPER = tuple(zip(*np.triu_indices_from(PSEUDO_BASIS[0]), strict=True))
for _k, (_i, _j) in enumerate(_UPPER):
    _SYMMETRIC_BASIS[_k, _i, _j] = _SYMMETRIC_BASIS[_k, _j, _i] = 1.0 if _i == _j else np.sqrt(0.5)
_MASS_COORDINATE = _UPPER.index((3, 3))
_FROM_PSEUDO = np.linalg.pinv(PSEUDO_BASIS.reshape(10, 16).T)  # (10, 16): parameters of a flattened pseudo-inertia


@dataclass(frozen=True)
class PriorWidth:
    """Relative standard deviations of the true parameters from the model's."""

    shape: float = 0.5  # of a link's pseudo-inertia in the invariant metric, for each coordinate of D except the mass's
    mass: float = 0.1  # of a link's mass
    # of friction and offset torques (viscous: at 1 rad/s), relative to a quarter of the robot's weight times the leg's
    # length
    torque: float = 0.2
    armature: float = 1.0  # of rotor inertias, relative to the leg's mass at half its length
    # by which Coulomb friction varies with position, relative to the same torque: about as large as friction itself
    varying: float = 0.02
    load: float = ModelErrors.load_friction  # of the share of the carried torque that friction takes
    # of the torques' scale, which no log shows: a joint's own, and that of all together (`stadera.trunk.ModelErrors`)
    gain: float = float(np.hypot(ModelErrors.gain, ModelErrors.common_gain))

    def __post_init__(self) -> None:
        require_positive("prior width", self, self.__dataclass_fields__)


@dataclass(frozen=True, eq=False)
class Prior:
    """The prior on the parameters `columns`: θ = values + root @ x with x ~ N(0, 1)."""

    columns: tuple[str, ...]  # names of the n parameters
    values: Array  # (n,), in the parameters' own units
    root: Array  # (n, n), block diagonal by link and joint; invertible
    links: tuple[str, ...]  # the links whose ten parameters are all among the columns
    # for each such link (10, 4, 4): the matrices B_k with D = Σ_k x_k B_k over the link's ten x
    coordinates: Mapping[str, Array]

    @cached_property
    def scales(self) -> Array:
        """Prior standard deviation of each parameter, (n,)."""
        return np.asarray(np.linalg.norm(self.root, axis=1))

    @property
    def mass_coordinates(self) -> dict[str, int]:
        """For each link, the index of the x that is the relative change of its mass."""
        return {link: self.block(link).start + _MASS_COORDINATE for link in self.links}

    def first(self, n: int) -> Prior:
        """The prior on the first n parameters alone, which end with a link or joint term."""
        return replace(self, columns=self.columns[:n], values=self.values[:n], root=self.root[:n, :n])

    def block(self, link: str) -> slice:
        """Index range of a link's ten parameters (and of its ten x)."""
        at = self.columns.index(f"{link}.{ORDER[0]}")
        return slice(at, at + 10)


def robot_prior(robot: Robot, columns: tuple[str, ...], width: PriorWidth | None = None) -> Prior:
    """Makes the prior on parameters, whole links (`<link>.m` ... in order) and joint terms (`<joint>.armature`, ...),
    from a robot's model. Raises IdentificationError: `columns` holds only part of a link's parameters.
    """
    width = width or PriorWidth()
    values, root = np.zeros(len(columns)), np.zeros((len(columns), len(columns)))
    links: list[str] = []
    coordinates: dict[str, Array] = {}
    at = 0
    while at < len(columns):
        owner, term = columns[at].rsplit(".", 1)
        if term == ORDER[0] and owner in robot.inertias:
            if columns[at : at + 10] != tuple(f"{owner}.{name}" for name in ORDER):
                raise IdentificationError(f"the prior needs all ten parameters of link {owner!r}, in order")
            body = positive_definite(robot.inertias[owner])
            values[at : at + 10] = body.vector
            widths = np.full(10, width.shape)
            widths[_MASS_COORDINATE] = width.mass
            root[at : at + 10, at : at + 10] = _link_map(body) * widths
            coordinates[owner] = _SYMMETRIC_BASIS * widths[:, None, None]
            links.append(owner)
            at += 10
        elif owner in robot.dynamics and term in JointDynamics.__dataclass_fields__:
            values[at] = getattr(robot.dynamics[owner], term)
            inertia, torque = _joint_scales(robot, owner)
            root[at, at] = width.armature * inertia if term == "armature" else width.torque * torque
            at += 1
        elif owner in robot.dynamics and term.startswith("coulomb_"):  # terms by which it varies, zero in a model
            root[at, at] = width.load if term == "coulomb_load" else width.varying * _joint_scales(robot, owner)[1]
            at += 1
        else:
            raise IdentificationError(f"no prior for parameter {columns[at]!r} of robot {robot.name}")
    return Prior(columns, values, root, tuple(links), coordinates)


def positive_definite(inertia: InertialParameters, floor: float = 1e-4, thinnest: float = 1e-3) -> InertialParameters:
    """Nearest body whose density has extent in all directions; the body itself if it has.

    A point mass or a flat plate has a singular pseudo-inertia, and a model file may hold an impossible one, but the
    metric needs a regular one. The eigenvalues of the second moment about the centre of mass are raised to `floor`
    times the largest, and to a radius of gyration of `thinnest` [m].
    """
    second = inertia.shifted(-inertia.com).pseudo_inertia[:3, :3]
    lam, V = np.linalg.eigh(second)
    lifted = np.maximum(lam, max(floor * lam.max(), thinnest**2 * inertia.mass))
    if np.array_equal(lifted, lam):
        return inertia
    about_com = np.zeros_like(inertia.pseudo_inertia)
    about_com[:3, :3], about_com[3, 3] = (V * lifted) @ V.T, inertia.mass
    return InertialParameters.from_pseudo_inertia(about_com).shifted(inertia.com)


def _link_map(inertia: InertialParameters) -> Array:
    """Change of the parameters for each unit coordinate of D, (10, 10)."""
    J = inertia.pseudo_inertia
    U = np.linalg.cholesky(J[::-1, ::-1])[::-1, ::-1]
    changes = U @ _SYMMETRIC_BASIS @ U.T
    return np.asarray(_FROM_PSEUDO @ changes.reshape(10, 16).T)


def _joint_scales(robot: Robot, joint: str) -> tuple[float, float]:
    """Scales of inertia [kg·m²] and torque [N·m] of a leg's drives, the same for all joints of a leg.

    Drives are sized by the robot's weight instead of the links that the joint moves: friction and rotor inertia of a
    geared knee exceed the scale of its shank. Torque: a quarter of the robot's weight times the leg's length; inertia:
    the leg's mass at half its length.
    """
    tree = robot.tree
    root = tree.ancestors(tree.joints.index(joint))[0]
    carried = [i for i in range(len(tree.joints)) if root in tree.ancestors(i)]
    bodies = [robot.inertias[tree.links[i + 1]] for i in carried]
    length = sum(float(np.linalg.norm(tree.translations[i])) for i in carried if i != root)
    length += float(np.linalg.norm(bodies[-1].com))
    mass = sum(body.mass for body in bodies)
    return mass * (0.5 * length) ** 2, GRAVITY * 0.25 * robot.mass * length
