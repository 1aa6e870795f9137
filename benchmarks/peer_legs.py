"""Contenders that identify a leg, for `peers.py`: each gets the same signals and gives back a predictor of torques.

All but stadera get position, velocity, acceleration and torque through the same zero-phase low-pass, and no torque lag,
which none of them models. stadera gets the log as it was recorded, which is how it is used.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stadera.body import FrictionModel, JointMotion, JointTorqueRegressor
from stadera.body.friction import direction
from stadera.identify.legs import identify
from stadera.identify.prior import robot_prior
from stadera.identify.settings import IdentifySettings
from stadera.inertia import ORDER, InertialParameters
from stadera.lab.pinocchio import pinocchio_model
from stadera.logs import Recording
from stadera.robot import Robot

Array = NDArray[np.float64]

WINDOW, EVERY, ITERATIONS = 0.25, 1.0, 60  # s, a rollout of mujoco.sysid; s, to the next; cost settles in 25


@dataclass(frozen=True)
class Signals:
    """Processed, (samples, 3) [rad, rad/s, rad/s², N·m], and stamps (samples,) [s]."""

    time: Array
    q: Array
    v: Array
    a: Array
    tau: Array


@dataclass(frozen=True)
class Problem:
    """A leg to identify: the log's first half as recorded, and processed on demand."""

    robot: Robot
    leg: str
    log: Recording
    signals: Callable[[], Signals]


@dataclass(frozen=True)
class Fitted:
    """What a contender found.

    Attributes:
        predict: torques (samples, 3) [N·m] of a motion.
        lag: by how much torques act later than stamped [s].
        physical: whether every link could exist; None where single links' parameters are not given.
        bars: whether it says how sure it is.
        settings: that it was run with.
    """

    predict: Callable[[Array, Array, Array], Array]
    lag: float
    physical: bool | None
    bars: bool
    settings: str


def with_stadera(problem: Problem) -> Fitted:
    """`identify` with its defaults, on all of the given half."""
    settings = IdentifySettings(legs=(problem.leg,), split=1.0)
    result = identify(problem.robot, problem.log, settings)
    leg = result.legs[0]
    regressor = JointTorqueRegressor(problem.robot.leg_tree(problem.leg), FrictionModel.full())
    found = dict(leg.model) | leg.estimate.by_name()
    said = "identify, defaults: physically consistent, cut-off and torque lag from the log"
    return Fitted(
        lambda q, v, a: regressor.predict(JointMotion(q, v, a), found),
        result.torque_lag,
        result.is_physical,
        True,
        said,
    )


def joint_columns(v: Array, a: Array) -> Array:
    """(samples, 3, 12): rotor inertia, viscous and Coulomb friction and offset of each joint by itself."""
    terms = np.stack([a, v, direction(v), np.ones_like(v)], axis=-1)
    return np.asarray((np.eye(3)[None, :, :, None] * terms[:, None]).reshape(len(v), 3, 12))


def _physical(rigid: Array) -> bool:
    """Of the ten of each link, in Pinocchio's order."""
    import pinocchio as pin

    bodies = (pin.Inertia.FromDynamicParameters(x) for x in rigid.reshape(-1, 10))
    return all(x[0] > 0 for x in rigid.reshape(-1, 10)) and all(
        InertialParameters.from_pinocchio(body).is_physical() for body in bodies
    )


def _locked(problem: Problem) -> Any:
    """The leg alone as a fixed-base Pinocchio model."""
    import pinocchio as pin

    full = pinocchio_model(problem.robot)
    leg = problem.robot.leg(problem.leg).joints
    others = [full.getJointId(name) for name in problem.robot.tree.joints if name not in leg]
    return pin.buildReducedModel(full, [1, *others], pin.neutral(full))


def with_pinocchio(problem: Problem) -> Fitted:
    """What most write by hand: the regressor sample by sample, joint terms beside it, normal equations."""
    import pinocchio as pin

    model = _locked(problem)
    data = model.createData()

    def rows(q: Array, v: Array, a: Array) -> Array:
        rigid = np.array([pin.computeJointTorqueRegressor(model, data, *x) for x in zip(q, v, a, strict=True)])
        return np.concatenate([rigid, joint_columns(v, a)], axis=2).reshape(3 * len(q), -1)

    train = problem.signals()
    Y = rows(train.q, train.v, train.a)
    found = np.linalg.lstsq(Y.T @ Y, Y.T @ train.tau.ravel(), rcond=None)[0]
    said = "regressor in a loop, normal equations, minimum norm"
    return Fitted(lambda q, v, a: (rows(q, v, a) @ found).reshape(-1, 3), 0.0, _physical(found[:30]), False, said)


def with_idyntree(problem: Problem) -> Fitted:
    """iDynTree's regressor sample by sample, joint terms beside it, normal equations."""
    import idyntree.bindings as idt

    leg = problem.robot.leg(problem.leg).joints
    loader = idt.ModelLoader()
    loader.loadReducedModelFromFile(str(problem.robot.source), idt.StringVector(list(leg)))
    computations = idt.KinDynComputations()
    computations.loadRobotModel(loader.model())
    regressor = idt.MatrixDynSize(9, 10 * computations.getNrOfLinks())
    base, still, gravity = np.eye(4), np.zeros(6), np.array([0.0, 0.0, -9.81])

    def rows(q: Array, v: Array, a: Array) -> Array:
        rigid = []
        for x, xd, xdd in zip(q, v, a, strict=True):
            computations.setRobotState(base, x, still, xd, gravity)
            computations.inverseDynamicsInertialParametersRegressor(still, xdd, regressor)
            rigid.append(regressor.toNumPy()[6:].copy())
        return np.concatenate([np.array(rigid), joint_columns(v, a)], axis=2).reshape(3 * len(q), -1)

    train = problem.signals()
    Y = rows(train.q, train.v, train.a)
    found = np.linalg.lstsq(Y.T @ Y, Y.T @ train.tau.ravel(), rcond=None)[0]
    said = "regressor in a loop, normal equations, minimum norm; base link's columns zero"
    return Fitted(lambda q, v, a: (rows(q, v, a) @ found).reshape(-1, 3), 0.0, None, False, said)


def with_figaroh(problem: Problem) -> Fitted:
    """FIGAROH's regressor, base parameters by its double QR. Its physical fit needs picos (GPL) and is not run."""
    from figaroh.tools.qrdecomposition import QRDecomposer
    from figaroh.tools.regressor import RegressorBuilder, RegressorConfig

    class Arm:
        model = _locked(problem)
        data = model.createData()

    terms = RegressorConfig(has_friction=True, has_actuator_inertia=True, has_joint_offset=True)
    builder = RegressorBuilder(Arm(), terms)

    def rows(q: Array, v: Array, a: Array) -> Array:
        return np.asarray(builder.build_basic_regressor(q, v, a, {"act_idxv": [0, 1, 2]}))

    train = problem.signals()
    W, tau = rows(train.q, train.v, train.a), train.tau.T.ravel()  # joint by joint
    kept = np.flatnonzero((W**2).sum(axis=0) > 1e-6)  # its own threshold
    found = QRDecomposer().decompose(W[:, kept], [str(k) for k in kept], tau)
    chosen, phi = kept[found.base_indices], found.phi_b
    said = f"friction, rotor and offset columns; {len(chosen)} base parameters by its double QR, least squares"
    return Fitted(lambda q, v, a: (rows(q, v, a)[:, chosen] @ phi).reshape(3, -1).T, 0.0, None, True, said)


def with_mujoco(problem: Problem) -> Fitted:
    """mujoco.sysid: rollouts from measured states under measured torques; pseudo-inertias and joint terms."""
    from mujoco import sysid

    from stadera.lab.plant.model import build_spec

    train, tree = problem.signals(), problem.robot.leg_tree(problem.leg)
    step = float(np.median(np.diff(train.time)))
    spec = build_spec(problem.robot, tree, timestep=step)
    for link in tree.links[1:]:
        _write_inertia(spec.body(link), problem.robot.inertias[link])
    for joint in tree.joints:
        sensor = spec.add_sensor(name=f"{joint}.q", objname=joint)
        sensor.type, sensor.objtype = _position_sensor()
    model = spec.compile()
    params = sysid.ParameterDict()
    for link in tree.links[1:]:
        params.add(sysid.body_inertia_param(spec, model, link, sysid.InertiaType.Pseudo, modifier=_inertia_of(link)))
    for joint in tree.joints:
        for parameter in _joint_parameters(sysid, joint, problem.robot.limits[joint].effort):
            params.add(parameter)
    params.move_off_bounds()  # as it advises
    length = max(2, round(WINDOW / step))
    starts = range(0, len(train.time) - length, round(EVERY / step))
    states = [sysid.create_initial_state(model, train.q[k], train.v[k]) for k in starts]
    controls = [sysid.TimeSeries(step * np.arange(length), train.tau[k : k + length]) for k in starts]
    times = step * np.arange(1, length)
    sensors = [sysid.TimeSeries.from_names(times, train.q[k + 1 : k + length], model) for k in starts]
    sequences = sysid.ModelSequences("leg", spec, [str(k) for k in starts], states, controls, sensors)
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1)
    best, _ = sysid.optimize(initial_params=params, residual_fn=residual, verbose=False, max_iters=ITERATIONS)
    values: dict[str, float] = {}
    for link in tree.links[1:]:
        vector = _parameters_of(best[f"{link}_inertia"].value).vector
        values |= {f"{link}.{name}": float(x) for name, x in zip(ORDER, vector, strict=True)}
    for joint in tree.joints:
        values |= {f"{joint}.{name}": float(best[f"{joint}.{name}"].value[0]) for name in JOINT_TERMS}
    regressor = JointTorqueRegressor(tree, FrictionModel.full())
    said = f"its own optimiser, {ITERATIONS} iterations at most, rollouts of {WINDOW} s every {EVERY} s, positions seen"
    return Fitted(lambda q, v, a: regressor.predict(JointMotion(q, v, a), values), 0.0, True, True, said)


def _write_inertia(body: Any, given: InertialParameters) -> None:
    """Mass, centre of mass, and the inertia by its principal values and axes."""
    principal, axes = np.linalg.eigh(given.inertia_com)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    body.mass, body.ipos, body.inertia = given.mass, given.com, principal
    body.iquat = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    body.explicitinertial = True


def _parameters_of(theta: Array) -> InertialParameters:
    """Of its ten unconstrained coordinates."""
    from mujoco.sysid._src.model_modifier import pi_from_theta

    pi = pi_from_theta(theta)
    return InertialParameters(np.array([*pi[:4], *pi[4:].reshape(3, 3)[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]]))


def _inertia_of(link: str) -> Callable[[Any, Any], None]:
    """Its own modifier of mujoco 4.0 does not compile with more than one body without geoms."""
    return lambda spec, parameter: _write_inertia(spec.body(link), _parameters_of(parameter.value))


JOINT_TERMS = ("armature", "viscous", "coulomb", "offset")


def _position_sensor() -> tuple[Any, Any]:
    import mujoco

    return mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtObj.mjOBJ_JOINT


def _joint_parameters(sysid: Any, joint: str, effort: float) -> list[Any]:
    """Rotor inertia, frictions and offset, between nothing and what no drive has."""
    import mujoco

    def offset(spec: Any, parameter: Any) -> None:
        motor = spec.actuator(joint)
        motor.biastype, motor.biasprm[0] = mujoco.mjtBias.mjBIAS_AFFINE, -parameter.value[0]

    def viscous(spec: Any, parameter: Any) -> None:
        spec.joint(joint).damping = [parameter.value[0], 0.0, 0.0]

    return [
        sysid.Parameter(f"{joint}.armature", 1e-3, 0.0, 1.0, modifier=_setter(joint, "armature")),
        sysid.Parameter(f"{joint}.viscous", 1e-2, 0.0, 0.1 * effort, modifier=viscous),
        sysid.Parameter(f"{joint}.coulomb", 1e-2, 0.0, 0.2 * effort, modifier=_setter(joint, "frictionloss")),
        sysid.Parameter(f"{joint}.offset", 0.0, -0.1 * effort, 0.1 * effort, modifier=offset),
    ]


def _setter(joint: str, name: str) -> Callable[[Any, Any], None]:
    return lambda spec, parameter: setattr(spec.joint(joint), name, float(parameter.value[0]))


CONTENDERS: dict[str, Callable[[Problem], Fitted]] = {
    "stadera": with_stadera,
    "FIGAROH": with_figaroh,
    "iDynTree": with_idyntree,
    "Pinocchio + normal equations": with_pinocchio,
    "mujoco.sysid": with_mujoco,
}


LIBRARIES = {
    "stadera": ("pinocchio", "clarabel", "scipy.signal"),
    "FIGAROH": ("figaroh.tools.qrdecomposition", "figaroh.tools.regressor"),
    "iDynTree": ("idyntree.bindings",),
    "Pinocchio + normal equations": ("pinocchio",),
    "mujoco.sysid": ("mujoco", "mujoco.sysid._src.optimize"),
}
"""Of each contender."""


def truth_predictor(robot: Robot, leg: str) -> Callable[[Array, Array, Array], Array]:
    """Of a robot whose parameters are true."""
    regressor = JointTorqueRegressor(robot.leg_tree(leg), FrictionModel.full())
    columns = regressor.columns
    values = dict(zip(columns, robot_prior(robot, columns).values.tolist(), strict=True))
    return lambda q, v, a: regressor.predict(JointMotion(q, v, a), values)
