"""A robot whose joints outside the legs move: in the plant they are joints of its tree as any others."""

from dataclasses import replace

import numpy as np

from stadera.errors import ModelError
from stadera.robot.limbs import place_of
from stadera.robot.model import JointDynamics, JointLimits, Robot, Tree
from stadera.types import Array


def whole_robot(robot: Robot) -> Robot:
    """The robot with its joints outside the legs in its tree, after those of the legs; the same one without any. Raises
    ModelError: one of them slides.
    """
    extra, tree = robot.extra, robot.tree
    if extra is None:
        return robot
    if any(extra.sliding):
        raise ModelError(f"robot {robot.name}: joint {extra.joints[extra.sliding.index(True)]!r} slides")
    count = len(tree.joints)
    grown = Tree(
        links=tree.links + extra.links,
        joints=tree.joints + extra.joints,
        parents=tree.parents + tuple(count + 1 + parent if parent >= 0 else 0 for parent in extra.parents),
        rotations=np.concatenate([tree.rotations, extra.rotations]),
        translations=np.concatenate([tree.translations, extra.translations]),
        axes=np.concatenate([tree.axes, extra.axes]),
    )
    limits = {joint: JointLimits(effort=most) for joint, most in zip(extra.joints, extra.effort, strict=True)}
    return replace(
        robot,
        tree=grown,
        inertias={
            **robot.inertias,
            robot.trunk: robot.inertias[robot.trunk] - extra.lumped,
            **dict(zip(extra.links, extra.bodies, strict=True)),
        },
        dynamics={**robot.dynamics, **dict.fromkeys(extra.joints, JointDynamics())},
        limits={**robot.limits, **limits},
        extra=None,
    )


def as_loaded(whole: Robot, robot: Robot) -> Robot:
    """The `robot` with the bodies and drives of a `whole` one: what an estimator of that robot would load."""
    if robot.extra is None:
        return whole
    extra = replace(robot.extra, bodies=tuple(whole.inertias[link] for link in robot.extra.links))
    inertias = {link: whole.inertias[link] for link in robot.tree.links}
    inertias[robot.trunk] = inertias[robot.trunk] + extra.lumped
    dynamics = {joint: whole.dynamics[joint] for joint in robot.tree.joints}
    return replace(robot, inertias=inertias, dynamics=dynamics, extra=extra)


def on_link(robot: Robot, name: str) -> tuple[str, Array, Array]:
    """The moving link of a link or frame, and the frame's rotation and origin [m] in it."""
    place = place_of(robot, name)
    links = (*robot.tree.links[1:], *(robot.extra.links if robot.extra is not None else ()))
    link = robot.trunk if place.body < 0 else links[place.body]
    return link, np.asarray(place.rotation), np.asarray(place.translation)
