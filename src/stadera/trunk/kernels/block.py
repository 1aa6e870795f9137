"""Sums of one block of samples, compiled: `RowMaker.block` of `stadera.trunk.rows` up to its rows, with
`BaseWrenchRegressor.at` and `by_links` of `stadera.legs.base_wrench`, whose docstrings derive the equations.

One pass over the samples adds up what the numpy code stores by sample and multiplies afterwards. A workspace has rows
of four numbers, one a leg, and a loop over the legs that contains nothing but arithmetic on its rows is compiled to
instructions on four numbers at once. Vectors are tuples of three numbers, rotations tuples of three columns, wrenches
(force, moment about the trunk's origin); all in trunk axes.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt, tanh

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, lane, part
from stadera.constants import GRAVITY
from stadera.types import Array, Bools

Vector = tuple[float, float, float]
Rotation = tuple[Vector, Vector, Vector]
Wrench = tuple[Vector, Vector]
Link = tuple[Rotation, Vector, Vector, Vector, Vector, Vector, Wrench]
Leg = tuple[
    Link, Link, Link, Vector, tuple[Wrench, Wrench, Wrench], tuple[Vector, Vector, Vector], Vector, Wrench, float
]

ZERO, X, Y, Z = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
UNIT = (X, Y, Z)

# columns of a link's constants, `link_constants` of `stadera.trunk.compiled_rows`
ARM, AXIS, MASS, MOMENT, TENSOR, ROTOR, VISCOUS, COULOMB, OFFSET = 27, 30, 33, 34, 37, 46, 47, 48, 49

# a half window: sums weighted by its rising half, the same by its falling half, and what is not weighted
SIGNALS, TARGET, BY_RATE, JERK, JOINT, SQUARED, BY_TERMS, BY_LINKS = 0, 12, 18, 24, 39, 111, 117, 549
ALTERNATING, SUMS = 837, 855
BY_A, BY_ALPHA, BY_JOINTS, MIDDLE, OMEGA, AIR = 1710, 1728, 1746, 1818, 1962, 1965
AVERAGED, DIFFERENTIATED, END, FEET, FORCE, HALF = 1969, 1970, 1971, 1972, 1984, 1996

# rows of the workspace, four numbers each, one a leg: constants of three links and the foot; joints' errors and noise
LINK, FOOT, ERRORS_KNOWN, NOISE = 50, 150, 154, 172
# of one sample, three joints each: inputs; contact force and centre of the foot; what tells whether it is in the air
SINE, COSINE, VELOCITY, ACCELERATION, SURE, STUCK, TORQUE, RATE, SNAP = 175, 178, 181, 184, 187, 190, 193, 196, 199
FOOT_FORCE, SEEN = 202, 208
# what tells whether it is in the air: contact force, velocity and height of the foot, the force's variance; and det J
FELT, PACE, LEVEL, DOUBT, VOLUME = SEEN, SEEN + 3, SEEN + 6, SEEN + 7, SEEN + 8
# sums of one half window, the other half's follow after EACH rows; derivatives at the last and the middle sample
SUM_TERMS, SUM_LINKS, SUM_TARGET, SUM_ALTERNATING, SUM_RATE, SUM_SQUARED, SUM_JOINT = 217, 325, 397, 403, 409, 415, 421
EACH, PROBES, MIDDLES, ROOM = 225, 667, 721, 821

# as in `stadera.trunk.rows` and `stadera.trunk.noise`
# places in `limits`: of the joints' errors, of the robot's weight squared, and see `block`
KNOWN, KNOWN_STD, MOST_LIGHT, FASTER, PART = 7, 43, 79, 80, 81
STEP = 1e-4  # rad, of the differences by joint positions
STANDING = 0.05  # smoothing factor of each foot's usual height
UP, DOWN = exp(0.03), exp(-0.09)  # factors on a variance whose block lies above and below the lower quartile
LEAST, MOST = 0.05**2, 20.0**2  # times the prior variance
OVERLAP, TELESCOPED = 4.0 / 3.0, 0.5  # correlation of neighbouring windows' noise
MOVES = 3.0  # times its noise: root mean square of the velocity of a joint that moves
MEMORY, BEYOND_NOISE = 1.0, 2.0  # s, of ground and accelerations; times the variance of noise
STRUCK = 0.5 * GRAVITY  # m/s², most that a block counts in the average of the specific force
BELIEF = 1e-3  # weight of the vertical against one second of lines between feet
WILD, RESTLESS, FASTEST = 10.0, 4.0, 30.0  # times the usual noise, twice; rad/s
SPIKE_MEMORY, LEARNT = 100.0, 5.0  # blocks; blocks before a spike is replaced

# state of what comes before the rows: blocks seen by the filter of spikes, and samples that it replaced; lines between
# feet, vertical, if it is known
BLOCKS, SPIKES, LINES, UPWARDS, UP_KNOWN, STATE = 0, 1, 2, 11, 14, 15


# -- vectors -----------------------------------------------------------------------------------------------------------
@lane
def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@lane
def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@lane
def times(s: float, a: Vector) -> Vector:
    return s * a[0], s * a[1], s * a[2]


@lane
def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@lane
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@lane
def rotated(R: Rotation, v: Vector) -> Vector:
    """R v."""
    return plus(plus(times(v[0], R[0]), times(v[1], R[1])), times(v[2], R[2]))


@lane
def rotated_back(R: Rotation, v: Vector) -> Vector:
    """Rᵀ v."""
    return dot(R[0], v), dot(R[1], v), dot(R[2], v)


@part
def vector(values: Array, at: int) -> Vector:
    """Three entries of an array."""
    return values[at], values[at + 1], values[at + 2]


@part
def turned(omega: Vector, duration: float) -> Array:
    """`stadera.trunk.ground.turned`."""
    x, y, z = -duration * omega[0], -duration * omega[1], -duration * omega[2]
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - 0.5 * (y * y + z * z), 0.5 * x * y - z, 0.5 * x * z + y
    out[1, 0], out[1, 1], out[1, 2] = 0.5 * x * y + z, 1.0 - 0.5 * (x * x + z * z), 0.5 * y * z - x
    out[2, 0], out[2, 1], out[2, 2] = 0.5 * x * z - y, 0.5 * y * z + x, 1.0 - 0.5 * (x * x + y * y)
    return out


# -- four legs at one sample, one in each lane ------------------------------------------------------------------------
@lane
def entry(ws: Array, at: int, leg: int) -> float:
    """A leg's number in a row of the workspace."""
    value: float = ws[4 * at + leg]
    return value


@lane
def triple(ws: Array, at: int, leg: int) -> Vector:
    """A leg's numbers in three rows."""
    return ws[4 * at + leg], ws[4 * at + 4 + leg], ws[4 * at + 8 + leg]


@lane
def put(ws: Array, at: int, leg: int, wrench: Wrench) -> None:
    """Writes a leg's wrench into six rows."""
    force, moment = wrench
    ws[4 * at + leg], ws[4 * at + 4 + leg], ws[4 * at + 8 + leg] = force
    ws[4 * at + 12 + leg], ws[4 * at + 16 + leg], ws[4 * at + 20 + leg] = moment


@lane
def add_number(ws: Array, at: int, leg: int, rising: float, falling: float, value: float) -> None:
    """Adds a leg's number to the sums of both halves."""
    ws[4 * at + leg] += rising * value
    ws[4 * (EACH + at) + leg] += falling * value


@lane
def add(ws: Array, at: int, leg: int, rising: float, falling: float, wrench: Wrench) -> None:
    """Adds a leg's wrench to the sums of both halves."""
    force, moment = wrench
    add_number(ws, at, leg, rising, falling, force[0])
    add_number(ws, at + 1, leg, rising, falling, force[1])
    add_number(ws, at + 2, leg, rising, falling, force[2])
    add_number(ws, at + 3, leg, rising, falling, moment[0])
    add_number(ws, at + 4, leg, rising, falling, moment[1])
    add_number(ws, at + 5, leg, rising, falling, moment[2])


@lane
def inertial(
    ws: Array, body: int, leg: int, turn: Rotation, origin: Vector, omega: Vector, alpha: Vector, a: Vector
) -> Wrench:
    """Inertial wrench of a link whose origin has the specific force a."""
    h = rotated(turn, triple(ws, body + MOMENT, leg))
    force = plus(times(entry(ws, body + MASS, leg), a), plus(cross(alpha, h), cross(omega, cross(omega, h))))
    tensor = (triple(ws, body + TENSOR, leg), triple(ws, body + TENSOR + 3, leg), triple(ws, body + TENSOR + 6, leg))
    own_omega, own_alpha = rotated_back(turn, omega), rotated_back(turn, alpha)
    own = plus(rotated(tensor, own_alpha), cross(own_omega, rotated(tensor, own_omega)))
    return force, plus(plus(cross(h, a), rotated(turn, own)), cross(origin, force))


@lane
def turned_by(ws: Array, at: int, leg: int, s: float, c: float) -> Vector:
    """A column of a link's rotation by an angle of sine s, and one minus its cosine c."""
    return plus(plus(triple(ws, at, leg), times(s, triple(ws, at + 9, leg))), times(c, triple(ws, at + 18, leg)))


@lane
def link(
    ws: Array, which: int, leg: int, turn: Rotation, origin: Vector, omega: Vector, alpha: Vector, a: Vector
) -> Link:
    """A link from the previous one, or the trunk: its rotation, origin, joint axis, ω, α, a, and inertial wrench."""
    body, s, c = LINK * which, entry(ws, SINE + which, leg), entry(ws, COSINE + which, leg)
    local = (turned_by(ws, body, leg, s, c), turned_by(ws, body + 3, leg, s, c), turned_by(ws, body + 6, leg, s, c))
    arm = rotated(turn, triple(ws, body + ARM, leg))
    axis_before = triple(ws, body + AXIS, leg)
    turn = (rotated(turn, local[0]), rotated(turn, local[1]), rotated(turn, local[2]))
    origin = plus(origin, arm)
    axis = rotated(turn, axis_before)
    a = plus(a, plus(cross(alpha, arm), cross(omega, cross(omega, arm))))
    spin = times(entry(ws, VELOCITY + which, leg), axis)
    alpha = plus(alpha, plus(cross(omega, spin), times(entry(ws, ACCELERATION + which, leg), axis)))
    omega = plus(omega, spin)
    return turn, origin, axis, omega, alpha, a, inertial(ws, body, leg, turn, origin, omega, alpha, a)


@lane
def torque_of(link: Link, force: Vector, moment: Vector) -> float:
    """Torque of a link's joint that a wrench needs."""
    return dot(link[2], minus(moment, cross(link[1], force)))


@lane
def carried(one: Link, two: Link, three: Link, w: Wrench, v: Wrench, u: Wrench) -> tuple[Vector, Wrench]:
    """Joint torques (3) that wrenches w, v, u on the three links need, and the wrenches' sum."""
    t2 = torque_of(three, u[0], u[1])
    force, moment = plus(u[0], v[0]), plus(u[1], v[1])
    t1 = torque_of(two, force, moment)
    force, moment = plus(force, w[0]), plus(moment, w[1])
    return (torque_of(one, force, moment), t1, t2), (force, moment)


@lane
def leg_at(ws: Array, leg: int, omega: Vector, alpha: Vector, a: Vector, normal: Vector) -> Leg:
    """One leg: links, centre of the foot, E by joint, J by joint, torques of rigid bodies and rotors, inertial wrench,
    det J.
    """
    one = link(ws, 0, leg, UNIT, ZERO, omega, alpha, a)
    two = link(ws, 1, leg, one[0], one[1], one[3], one[4], one[5])
    three = link(ws, 2, leg, two[0], two[1], two[3], two[4], two[5])
    torque, wrench = carried(one, two, three, one[6], two[6], three[6])
    rotor = (entry(ws, ROTOR, leg), entry(ws, LINK + ROTOR, leg), entry(ws, 2 * LINK + ROTOR, leg))
    acc = triple(ws, ACCELERATION, leg)
    torque = plus(torque, (rotor[0] * acc[0], rotor[1] * acc[1], rotor[2] * acc[2]))
    centre = plus(three[1], rotated(three[0], triple(ws, FOOT, leg)))
    contact = minus(centre, times(entry(ws, FOOT + 3, leg), normal))
    J = (
        cross(one[2], minus(contact, one[1])),
        cross(two[2], minus(contact, two[1])),
        cross(three[2], minus(contact, three[1])),
    )
    e0, e1, e2 = cross(J[1], J[2]), cross(J[2], J[0]), cross(J[0], J[1])
    volume = dot(J[0], e0)
    e0, e1, e2 = times(1.0 / volume, e0), times(1.0 / volume, e1), times(1.0 / volume, e2)
    E = ((e0, cross(contact, e0)), (e1, cross(contact, e1)), (e2, cross(contact, e2)))
    return one, two, three, centre, E, J, torque, wrench, volume


@lane
def target(E: tuple[Wrench, Wrench, Wrench], left: Vector, inertia: Wrench) -> Wrench:
    """b of a leg: Σ_k E_k (h_k - τ_k) - w."""
    force = plus(plus(times(left[0], E[0][0]), times(left[1], E[1][0])), times(left[2], E[2][0]))
    moment = plus(plus(times(left[0], E[0][1]), times(left[1], E[1][1])), times(left[2], E[2][1]))
    return minus(force, inertia[0]), minus(moment, inertia[1])


@lane
def unexplained(ws: Array, joint: int, leg: int, rigid: float) -> float:
    """Torque that a joint needs for rigid bodies, rotor and friction, minus the measured one."""
    body = LINK * joint
    friction = entry(ws, body + VISCOUS, leg) * entry(ws, VELOCITY + joint, leg) + entry(ws, body + OFFSET, leg)
    friction += entry(ws, body + COULOMB, leg) * entry(ws, SURE + joint, leg)
    return rigid + friction - entry(ws, TORQUE + joint, leg)


@lane
def add_joint(ws: Array, joint: int, leg: int, rising: float, falling: float, e: Wrench, left: float) -> None:
    """Adds what a joint's own terms are multiplied by, and the terms themselves."""
    at, numbers = SUM_TERMS + 36 * joint, SUM_JOINT + joint
    acc, speed = entry(ws, ACCELERATION + joint, leg), entry(ws, VELOCITY + joint, leg)
    sure, rate = entry(ws, SURE + joint, leg), entry(ws, RATE + joint, leg)
    torque, stuck = entry(ws, TORQUE + joint, leg), entry(ws, STUCK + joint, leg)
    add(ws, at, leg, rising * acc, falling * acc, e)
    add(ws, at + 6, leg, rising * speed, falling * speed, e)
    add(ws, at + 12, leg, rising * sure, falling * sure, e)
    add(ws, at + 18, leg, rising, falling, e)
    add(ws, at + 24, leg, rising * torque, falling * torque, e)
    add(ws, at + 30, leg, rising * stuck, falling * stuck, e)
    add(ws, SUM_RATE, leg, rising * rate, falling * rate, e)
    add_number(ws, numbers, leg, rising, falling, acc)
    add_number(ws, numbers + 3, leg, rising, falling, speed)
    add_number(ws, numbers + 6, leg, rising, falling, sure)
    add_number(ws, numbers + 9, leg, rising, falling, 1.0)
    add_number(ws, numbers + 12, leg, rising, falling, rate)
    add_number(ws, numbers + 15, leg, rising, falling, left)
    add_number(ws, numbers + 18, leg, rising, falling, entry(ws, SNAP + joint, leg))
    noise = entry(ws, NOISE + joint, leg)
    force, moment = e
    squared = (
        (force[0] * force[0], force[1] * force[1], force[2] * force[2]),
        (moment[0] * moment[0], moment[1] * moment[1], moment[2] * moment[2]),
    )
    add(ws, SUM_SQUARED, leg, rising * rising * noise, falling * falling * noise, squared)


@lane
def add_effect(
    ws: Array, at: int, which: int, leg: int, rising: float, falling: float, state: Leg, force: Vector, moment: Vector
) -> None:
    """Adds what a wrench on a link changes in b."""
    g0 = torque_of(state[0], force, moment)
    g1 = torque_of(state[1], force, moment) if which > 0 else 0.0
    g2 = torque_of(state[2], force, moment) if which > 1 else 0.0
    add(ws, at, leg, rising, falling, target(state[4], (g0, g1, g2), (force, moment)))


@lane
def displaced(mass: float, axis: Vector, centre: Vector, omega: Vector, alpha: Vector, force: Vector) -> Wrench:
    """Derivative of a link's wrench by its centre of mass along an axis; `force` is its inertial force."""
    more = times(mass, plus(cross(alpha, axis), cross(omega, cross(omega, axis))))
    return more, plus(cross(axis, force), cross(centre, more))


@lane
def add_link(ws: Array, which: int, leg: int, rising: float, falling: float, moving: Link, state: Leg) -> None:
    """Adds the effect of errors of one link's mass and centre of mass, `BaseWrenchRegressor.by_links`."""
    turn, origin, _, omega, alpha, _, wrench = moving
    at, mass = SUM_LINKS + 24 * which, entry(ws, LINK * which + MASS, leg)
    centre = plus(origin, times(1.0 / mass, rotated(turn, triple(ws, LINK * which + MOMENT, leg))))
    add_effect(ws, at, which, leg, rising, falling, state, wrench[0], wrench[1])
    f, m = displaced(mass, turn[0], centre, omega, alpha, wrench[0])
    add_effect(ws, at + 6, which, leg, rising, falling, state, f, m)
    f, m = displaced(mass, turn[1], centre, omega, alpha, wrench[0])
    add_effect(ws, at + 12, which, leg, rising, falling, state, f, m)
    f, m = displaced(mass, turn[2], centre, omega, alpha, wrench[0])
    add_effect(ws, at + 18, which, leg, rising, falling, state, f, m)


@lane
def doubt(ws: Array, joint: int, leg: int) -> tuple[float, float]:
    """Torque of a joint's known errors, and its variance."""
    acc, speed = entry(ws, ACCELERATION + joint, leg), entry(ws, VELOCITY + joint, leg)
    sure, at = entry(ws, SURE + joint, leg), ERRORS_KNOWN + joint
    extra = entry(ws, at, leg) * acc + entry(ws, at + 3, leg) * speed + entry(ws, at + 6, leg) * sure
    one, two, three = entry(ws, at + 9, leg) * acc, entry(ws, at + 12, leg) * speed, entry(ws, at + 15, leg) * sure
    return extra, one * one + two * two + three * three


@part
def add_sample(
    ws: Array,
    omega: Vector,
    alpha: Vector,
    a: Vector,
    up: Vector,
    rising: float,
    falling: float,
    odd: float,
    even: float,
) -> None:
    """Adds one sample of all legs to their sums, and writes what `in_the_air` needs.

    Args:
        rising, falling: weights in both halves. odd, even: the same with alternating signs.
    """
    for leg in range(4):
        state = leg_at(ws, leg, omega, alpha, a, up)
        one, two, three, centre, E, _, rigid, wrench, volume = state
        left = (
            unexplained(ws, 0, leg, rigid[0]),
            unexplained(ws, 1, leg, rigid[1]),
            unexplained(ws, 2, leg, rigid[2]),
        )
        add_joint(ws, 0, leg, rising, falling, E[0], left[0])
        add_joint(ws, 1, leg, rising, falling, E[1], left[1])
        add_joint(ws, 2, leg, rising, falling, E[2], left[2])
        add_link(ws, 0, leg, rising, falling, one, state)
        add_link(ws, 1, leg, rising, falling, two, state)
        add_link(ws, 2, leg, rising, falling, three, state)
        left_over = target(E, left, wrench)
        add(ws, SUM_TARGET, leg, rising, falling, left_over)
        add(ws, SUM_ALTERNATING, leg, odd, even, left_over)
        force, _ = target(E, left, (ZERO, ZERO))
        put(ws, FOOT_FORCE, leg, (force, centre))
        x0, d0 = doubt(ws, 0, leg)
        x1, d1 = doubt(ws, 1, leg)
        x2, d2 = doubt(ws, 2, leg)
        force = plus(force, plus(times(x0, E[0][0]), plus(times(x1, E[1][0]), times(x2, E[2][0]))))
        light = dot(E[0][0], E[0][0]) * d0 + dot(E[1][0], E[1][0]) * d1 + dot(E[2][0], E[2][0]) * d2
        speed = triple(ws, VELOCITY, leg)
        pace = plus(cross(omega, centre), times(speed[0], cross(one[2], minus(centre, one[1]))))
        pace = plus(pace, times(speed[1], cross(two[2], minus(centre, two[1]))))
        pace = plus(pace, times(speed[2], cross(three[2], minus(centre, three[1]))))
        put(ws, FELT, leg, (force, pace))
        ws[4 * LEVEL + leg], ws[4 * DOUBT + leg], ws[4 * VOLUME + leg] = dot(centre, up), light, volume


@lane
def put_probe(ws: Array, at: int, leg: int, state: Leg, a: Vector, alpha: Vector, joint: int) -> None:
    """Writes b of a leg for an acceleration alone: of the trunk (a, α), or of one joint (0 to 2, else -1)."""
    one, two, three = state[0], state[1], state[2]
    pivot = ZERO
    if joint >= 0:
        moving = one if joint == 0 else two if joint == 1 else three
        alpha, pivot = moving[2], moving[1]
    w = v = (ZERO, ZERO)
    if joint < 1:
        w = inertial(ws, 0, leg, one[0], one[1], ZERO, alpha, plus(a, cross(alpha, minus(one[1], pivot))))
    if joint < 2:
        v = inertial(ws, LINK, leg, two[0], two[1], ZERO, alpha, plus(a, cross(alpha, minus(two[1], pivot))))
    u = inertial(ws, 2 * LINK, leg, three[0], three[1], ZERO, alpha, plus(a, cross(alpha, minus(three[1], pivot))))
    torque, wrench = carried(one, two, three, w, v, u)
    if joint == 0:
        torque = (torque[0] + entry(ws, ROTOR, leg), torque[1], torque[2])
    elif joint == 1:
        torque = (torque[0], torque[1] + entry(ws, LINK + ROTOR, leg), torque[2])
    elif joint == 2:
        torque = (torque[0], torque[1], torque[2] + entry(ws, 2 * LINK + ROTOR, leg))
    put(ws, at, leg, target(state[4], torque, wrench))


@part
def write_probes(ws: Array, omega: Vector, alpha: Vector, a: Vector, up: Vector) -> None:
    """Writes the legs' derivatives of b by a, by α and by the joints' accelerations, six rows each."""
    for leg in range(4):
        state = leg_at(ws, leg, omega, alpha, a, up)
        put_probe(ws, PROBES, leg, state, X, ZERO, -1)
        put_probe(ws, PROBES + 6, leg, state, Y, ZERO, -1)
        put_probe(ws, PROBES + 12, leg, state, Z, ZERO, -1)
        put_probe(ws, PROBES + 18, leg, state, ZERO, X, -1)
        put_probe(ws, PROBES + 24, leg, state, ZERO, Y, -1)
        put_probe(ws, PROBES + 30, leg, state, ZERO, Z, -1)
        put_probe(ws, PROBES + 36, leg, state, ZERO, ZERO, 0)
        put_probe(ws, PROBES + 42, leg, state, ZERO, ZERO, 1)
        put_probe(ws, PROBES + 48, leg, state, ZERO, ZERO, 2)


@lane
def put_contact(ws: Array, at: int, leg: int, state: Leg, turning: Vector, moment: Vector) -> None:
    """Writes the derivative of b by a contact point's position along an axis."""
    put(ws, at, leg, target(state[4], times(-1.0, turning), (ZERO, moment)))


@part
def write_target(ws: Array, at: int, omega: Vector, alpha: Vector, a: Vector, up: Vector) -> None:
    """Writes b of the legs, six rows, det J, and its derivatives by the contact points' positions, as
    `RowMaker._middle`.
    """
    for leg in range(4):
        state = leg_at(ws, leg, omega, alpha, a, up)
        rigid = state[6]
        left = (
            unexplained(ws, 0, leg, rigid[0]),
            unexplained(ws, 1, leg, rigid[1]),
            unexplained(ws, 2, leg, rigid[2]),
        )
        put(ws, at, leg, target(state[4], left, state[7]))
        ws[4 * (at + 6) + leg] = state[8]
        f, _ = target(state[4], left, (ZERO, ZERO))
        s0, s1, s2 = cross(f, state[0][2]), cross(f, state[1][2]), cross(f, state[2][2])
        put_contact(ws, at + 7, leg, state, (s0[0], s1[0], s2[0]), cross(f, X))
        put_contact(ws, at + 13, leg, state, (s0[1], s1[1], s2[1]), cross(f, Y))
        put_contact(ws, at + 19, leg, state, (s0[2], s1[2], s2[2]), cross(f, Z))


@part
def set_inputs(ws: Array, given: Array) -> None:
    """Writes the legs' inputs of one sample."""
    for k in range(len(given)):
        ws[4 * SINE + k] = given[k]


@part
def add_middle(ws: Array, q: Array, omega: Vector, alpha: Vector, a: Vector, normal: Vector, out: Array) -> None:
    """Writes the legs' derivatives of b by joint and contact positions q (12,), by difference, from the inputs."""
    write_target(ws, MIDDLES, omega, alpha, a, normal)
    for joint in range(3):
        for leg in range(4):
            moved = q[3 * leg + joint] + STEP
            ws[4 * (SINE + joint) + leg], ws[4 * (COSINE + joint) + leg] = sin(moved), 1.0 - cos(moved)
        write_target(ws, MIDDLES + 25 * (1 + joint), omega, alpha, a, normal)
        for leg in range(4):
            still = q[3 * leg + joint]
            ws[4 * (SINE + joint) + leg], ws[4 * (COSINE + joint) + leg] = sin(still), 1.0 - cos(still)
            for c in range(6):
                there, here = ws[4 * (MIDDLES + 25 * (1 + joint) + c) + leg], ws[4 * (MIDDLES + c) + leg]
                out[MIDDLE + 24 * c + 3 * leg + joint] = (1.0 / STEP) * (there - here)
                by_contact = ws[4 * (MIDDLES + 7 + 6 * joint + c) + leg]
                out[MIDDLE + 24 * c + 12 + 3 * leg + joint] = by_contact


@part
def gather(ws: Array, out: Array) -> None:
    """Writes the legs' sums and probes into a half window."""
    for half in range(2):
        to, at = SUMS * half, EACH * half
        for leg in range(4):
            for i in range(3):
                j = 3 * leg + i
                for t in range(36):
                    out[to + BY_TERMS + 36 * j + t] = ws[4 * (at + SUM_TERMS + 36 * i + t) + leg]
                for t in range(24):
                    out[to + BY_LINKS + 24 * j + t] = ws[4 * (at + SUM_LINKS + 24 * i + t) + leg]
                for t in range(6):
                    out[to + JOINT + 12 * t + j] = ws[4 * (at + SUM_JOINT + 3 * t + i) + leg]
                out[to + JERK + j] = ws[4 * (at + SUM_JOINT + 18 + i) + leg]
            for c in range(6):
                out[to + TARGET + c] += ws[4 * (at + SUM_TARGET + c) + leg]
                out[to + ALTERNATING + 12 + c] += ws[4 * (at + SUM_ALTERNATING + c) + leg]
                out[to + BY_RATE + c] += ws[4 * (at + SUM_RATE + c) + leg]
                out[to + SQUARED + c] += ws[4 * (at + SUM_SQUARED + c) + leg]
    for leg in range(4):
        for axis in range(3):
            for c in range(6):
                out[BY_A + 3 * c + axis] += ws[4 * (PROBES + 6 * axis + c) + leg]
                out[BY_ALPHA + 3 * c + axis] += ws[4 * (PROBES + 18 + 6 * axis + c) + leg]
                out[BY_JOINTS + 12 * c + 3 * leg + axis] = ws[4 * (PROBES + 36 + 6 * axis + c) + leg]
            out[FORCE + 4 * axis + leg], out[FEET + 4 * axis + leg] = (
                ws[4 * (FOOT_FORCE + axis) + leg],
                ws[4 * (FOOT_FORCE + 3 + axis) + leg],
            )


# -- motion ------------------------------------------------------------------------------------------------------------
@part
def learn_noise(
    squares: Array, columns: NDArray[np.intp], joints: int, quartile: float, prior: Array, out: Array
) -> None:
    """`WhiteNoise.learn`, on variances (30,) `out`, from the mean square of third differences of each column of the
    table, which has the joints' efforts from column 1 + 2 `joints`.
    """
    for channel in range(30):
        if channel < 12:
            at = 1 + 2 * joints + columns[channel]
        elif channel < 24:
            at = 1 + joints + columns[channel - 12]
        else:
            at = 1 + 3 * joints + channel - 24
        out[channel] *= UP if squares[at] > quartile * out[channel] else DOWN
        out[channel] = min(max(out[channel], LEAST * prior[channel]), MOST * prior[channel])


@part
def collect(out: Array, at: int, rising: float, falling: float, value: float) -> None:
    """Adds a number to the sums of both halves."""
    out[at] += rising * value
    out[SUMS + at] += falling * value


@part
def fitted_lines(velocity: Array) -> Array:
    """A line fitted to each of the velocities (n, 12), as `_fitted` of `stadera.trunk.rows`."""
    n = len(velocity)
    out, square = np.empty((n, 12)), 0.0
    for k in range(n):
        square += (k - 0.5 * (n - 1)) ** 2
    for j in range(12):
        mean = slope = 0.0
        for k in range(n):
            mean += velocity[k, j]
            slope += (k - 0.5 * (n - 1)) * velocity[k, j]
        mean, slope = mean / n, slope / max(square, 1.0)
        for k in range(n):
            out[k, j] = mean + (k - 0.5 * (n - 1)) * slope
    return out


@part
def trunk_at(table: Array, k: int, joints: int, lever: Vector, rate: float) -> tuple[Vector, Vector, Vector]:
    """ω, α and the specific force at the trunk's origin, at a sample between others; `rate` is one over their span."""
    at = 1 + 3 * joints
    omega = vector(table[k], at)
    alpha = times(rate, minus(vector(table[k + 1], at), vector(table[k - 1], at)))
    a = minus(minus(vector(table[k], at + 3), cross(alpha, lever)), cross(omega, cross(omega, lever)))
    return omega, alpha, a


@part
def parts_of(seen: Array, parts: int) -> Array:
    """Means (parts, 32) of consecutive samples (n, 32)."""
    n, out = len(seen), np.zeros((parts, seen.shape[1]))
    for p in range(parts):
        begin, end = p * n // parts, (p + 1) * n // parts
        for k in range(begin, end):
            for c in range(seen.shape[1]):
                out[p, c] += seen[k, c] / (end - begin)
    return out


@part
def of_others(now: Array, leg: int, along: Array, standing: Array) -> tuple[float, float, float, Vector]:
    """Load of the other legs along the normal, of those that press, and sums of heights and velocities weighted by it.

    Args:
        now: (32,), means of rows of the workspace from `SEEN` on. along: (4,), loads. standing: (4,), usual heights.
    """
    carried = pressed = level = 0.0
    others = ZERO
    for other in range(4):
        if other != leg:
            press = max(along[other], 0.0)
            carried += along[other]
            pressed += press
            level += press * (now[4 * (LEVEL - SEEN) + other] - standing[other])
            others = plus(others, times(press, triple(now, PACE - SEEN, other)))
    return carried, max(pressed, 1e-9), level, others


@part
def in_the_air(seen: Array, parts: int, up: Vector, limits: Array, standing: Array, out: Array) -> None:
    """Writes 1 for the legs in the air throughout the block and updates `standing`, as `RowMaker._in_the_air`.

    Args:
        seen: (n, 32), rows of the workspace from `SEEN` on. parts: their number, over which these are averaged.
        up: the ground's normal. limits: see `block`.
    """
    means, moved, along = parts_of(seen, parts), np.zeros(4), np.zeros(4)
    for leg in range(4):
        air = stands = True
        mean = 0.0
        for k in range(parts):
            now = means[k]
            for other in range(4):
                along[other] = dot(triple(now, FELT - SEEN, other), up)
            force, pace = triple(now, FELT - SEEN, leg), triple(now, PACE - SEEN, leg)
            carried, pressed, level, others = of_others(now, leg, along, standing)
            pace = minus(pace, times(1.0 / pressed, others))
            lifted = now[4 * (LEVEL - SEEN) + leg] - standing[leg] - level / pressed
            high = lifted > limits[3]
            light = min(limits[1] + now[4 * (DOUBT - SEEN) + leg], limits[MOST_LIGHT])
            air &= (high or dot(pace, pace) > limits[FASTER]) and dot(force, force) < light and carried > limits[2]
            stands &= not high and along[leg] > limits[6]
            mean += lifted / parts
        out[AIR + leg] = 1.0 if air else 0.0
        moved[leg] = STANDING * mean if stands else 0.0
    for leg in range(4):
        standing[leg] += moved[leg]


# -- before the rows ---------------------------------------------------------------------------------------------------
@part
def squared_differences(table: Array, out: Array) -> None:
    """Mean square of third differences over its gain of 20, of each column of at least four samples."""
    n = len(table) - 3
    out[:] = 0.0
    for k in range(n):
        one, two, three, four = table[k], table[k + 1], table[k + 2], table[k + 3]
        for c in range(len(out)):
            third = (four[c] - three[c]) - 2.0 * (three[c] - two[c]) + (two[c] - one[c])
            out[c] += third * third
    for c in range(len(out)):
        out[c] /= 20.0 * n


@part
def peak(table: Array, k: int, c: int) -> float:
    """By how much sample k of channel c stands out of its neighbours; at the edges half the second difference."""
    at = min(max(k, 1), len(table) - 2)
    before, after = table[at, c] - table[at - 1, c], table[at + 1, c] - table[at, c]
    if at != k:
        return float(0.5 * abs(before - after))
    return float(min(abs(before), abs(after))) if before * after < 0.0 else 0.0


@part
def expected(table: Array, k: int, c: int) -> float:
    """What the neighbours of sample k let expect."""
    if k == 0:
        return float(2.0 * table[1, c] - table[2, c])
    if k == len(table) - 1:
        return float(2.0 * table[k - 1, c] - table[k - 2, c])
    return float(0.5 * (table[k - 1, c] + table[k + 1, c]))


@part
def replace_spikes(table: Array, usual: Array, joints: int, out: Array) -> int:
    """Replaces wild peaks that are alone or in an impossible sample. Returns the number of samples with such peaks,
    without the first and the last one, which belong to other blocks.
    """
    n, channels = table.shape
    restless, around, impossible = np.zeros((n + 2, channels)), np.zeros(n + 2), np.zeros(n)
    replaced = np.zeros(n, dtype=np.int64)
    fastest = FASTEST * (table[1, 0] - table[0, 0])
    for c in range(1, channels):
        limit = RESTLESS * sqrt(usual[c])
        for k in range(n):
            away = peak(table, k, c)
            if away > limit:
                restless[k + 1, c] = 1.0
                around[k + 1] += 1.0
            if c <= joints and away > fastest:
                impossible[k] = 1.0
    for c in range(1, channels):
        limit = WILD * sqrt(usual[c])
        for k in range(n):
            if peak(table, k, c) > limit:
                others = 0.0
                for at in range(k, k + 3):
                    others += around[at] - restless[at, c]
                if others == 0.0 or impossible[k] > 0.0:
                    out[k, c] = expected(table, k, c)
                    replaced[k] = 1
    return int(replaced[1 : n - 1].sum())


@part
def has_spikes(table: Array, usual: Array) -> bool:
    """Whether a sample, the first and the last one included, stands out of its neighbours."""
    n, columns = table.shape
    limit = np.empty(columns)
    limit[0] = np.inf  # time
    for c in range(1, columns):
        limit[c] = WILD * sqrt(usual[c])
    wild = False
    for k in range(1, n - 1):
        before, now, after = table[k - 1], table[k], table[k + 1]
        for c in range(columns):
            rise, fall = now[c] - before[c], after[c] - now[c]
            wild |= rise * fall < 0.0 and min(abs(rise), abs(fall)) > limit[c]
    for end in range(0, n, n - 1):
        for c in range(columns):
            wild |= peak(table, end, c) > limit[c]
    return wild


@part
def clean(table: Array, usual: Array, joints: int, state: Array, out: Array, squares: Array) -> None:
    """Writes the samples without spikes, as `SpikeFilter.clean`, and mean squares of their third differences;
    `state[BLOCKS]` counts the blocks before, `state[SPIKES]` the samples replaced.
    """
    n, columns = table.shape
    for k in range(n):
        for c in range(columns):
            out[k, c] = table[k, c]
    if n < 4:
        return
    state[BLOCKS] += 1.0
    blocks = state[BLOCKS]
    if blocks > LEARNT and has_spikes(table, usual):
        state[SPIKES] += replace_spikes(table, usual, joints, out)
    squared_differences(out, squares)
    for c in range(1, columns):
        usual[c] += (squares[c] + 1e-12 - usual[c]) / min(blocks, SPIKE_MEMORY)


@part
def least_eigenvector(A: Array) -> Vector:
    """Eigenvector of the least eigenvalue of a symmetric matrix (3, 3), which is overwritten: Jacobi's rotations."""
    V = np.eye(3)
    for _ in range(12):
        if abs(A[0, 1]) + abs(A[0, 2]) + abs(A[1, 2]) < 1e-300:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if A[p, q] == 0.0:
                    continue
                theta = (A[q, q] - A[p, p]) / (2.0 * A[p, q])
                t = 1.0 / (abs(theta) + sqrt(theta * theta + 1.0))
                t = -t if theta < 0.0 else t
                c = 1.0 / sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    a, b = A[k, p], A[k, q]
                    A[k, p], A[k, q] = c * a - s * b, s * a + c * b
                    a, b = V[k, p], V[k, q]
                    V[k, p], V[k, q] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = A[p, k], A[q, k]
                    A[p, k], A[q, k] = c * a - s * b, s * a + c * b
    least = 0
    for k in range(1, 3):
        if A[k, k] < A[least, least]:
            least = k
    return V[0, least], V[1, least], V[2, least]


@part
def ahead(force: Vector, omega: Vector, duration: float, state: Array) -> Vector:
    """The ground's normal in the middle of the next block, as `GroundNormal.ahead`; `state` has its lines and `up`."""
    along = times(1.0 / sqrt(dot(force, force)), force)
    lines = state[LINES : LINES + 9].reshape(3, 3)
    if state[UP_KNOWN] == 0.0:
        up = along
        state[UP_KNOWN] = 1.0
    else:
        turn, keep = turned(omega, duration), exp(-duration / MEMORY)
        before = vector(state, UPWARDS)
        up = (
            turn[0, 0] * before[0] + turn[0, 1] * before[1] + turn[0, 2] * before[2],
            turn[1, 0] * before[0] + turn[1, 1] * before[1] + turn[1, 2] * before[2],
            turn[2, 0] * before[0] + turn[2, 1] * before[1] + turn[2, 2] * before[2],
        )
        up = plus(up, times(1.0 - keep, minus(along, up)))
        up = times(1.0 / sqrt(dot(up, up)), up)
        half = np.zeros((3, 3))
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    half[i, j] += turn[i, k] * lines[k, j]
        for i in range(3):
            for j in range(3):
                lines[i, j] = 0.0
                for k in range(3):
                    lines[i, j] += keep * half[i, k] * turn[j, k]
    level = np.empty((3, 3))
    for i in range(3):
        state[UPWARDS + i] = up[i]
        for j in range(3):
            level[i, j] = lines[i, j] - BELIEF * up[i] * up[j]
        level[i, i] += BELIEF
    normal = least_eigenvector(level)
    if dot(normal, up) < 0.0:
        normal = times(-1.0, normal)
    return plus(normal, cross(times(0.5 * duration, omega), normal))


@part
def learn_ground(feet: Array, force: Array, duration: float, least: float, state: Array) -> None:
    """`GroundNormal.learn`: feet and forces (3, 4); `least` [N] is the load of a foot that carries."""
    lines = state[LINES : LINES + 9].reshape(3, 3)
    up = vector(state, UPWARDS)
    for one in range(3):
        if not up[0] * force[0, one] + up[1] * force[1, one] + up[2] * force[2, one] > least:
            continue
        for two in range(one + 1, 4):
            if not up[0] * force[0, two] + up[1] * force[1, two] + up[2] * force[2, two] > least:
                continue
            line = (feet[0, one] - feet[0, two], feet[1, one] - feet[1, two], feet[2, one] - feet[2, two])
            weight = duration / MEMORY / dot(line, line)
            for i in range(3):
                for j in range(3):
                    lines[i, j] += weight * line[i] * line[j]


# -- the block ---------------------------------------------------------------------------------------------------------
@part
def inputs(
    table: Array, columns: NDArray[np.intp], joints: int, velocity: float, given: Array, q: Array, mean: Array
) -> None:
    """Inputs of the legs at each sample, (n + 1, 108): nine rows of three joints by four legs from `SINE` on. The last
    are those in the middle of the block. Also writes its joint positions and the mean accelerations (12,).
    """
    n, middle = len(table) - 2, (len(table) - 2) // 2
    v = np.empty((n, 12))
    for k in range(n):
        span = 1.0 / (table[k + 2, 0] - table[k, 0])
        first, now, last, out = table[k], table[k + 1], table[k + 2], given[k]
        for j in range(12):
            at, to = 1 + columns[j], 4 * (j % 3) + j // 3
            out[to], out[12 + to] = sin(now[at]), 1.0 - cos(now[at])
            if k == middle:
                q[j] = now[at]
            at += joints
            v[k, j] = out[24 + to] = now[at]
            out[36 + to] = (last[at] - first[at]) * span
            out[96 + to] = (last[at] - 2.0 * now[at] + first[at]) * (4.0 * span * span)
            mean[j] += out[36 + to] / n
            at += joints
            out[72 + to], out[84 + to] = now[at], (last[at] - first[at]) * span
    sliding = fitted_lines(v)
    for k in range(n):
        for j in range(12):
            to, sure = 4 * (j % 3) + j // 3, tanh(sliding[k, j] / velocity)
            given[k, 48 + to], given[k, 60 + to] = sure, sqrt(max(1.0 - sure * sure, 0.0))
    for c in range(108):
        given[n, c] = given[middle, c]
    for j in range(12):
        to = 4 * (j % 3) + j // 3
        given[n, 36 + to], given[n, 48 + to] = mean[j], tanh(v[middle, j] / velocity)


@part
def add_trunk(
    table: Array, k: int, joints: int, lever: Vector, weights: tuple[float, float, float, float], out: Array
) -> tuple[Vector, Vector, Vector]:
    """Adds the trunk's signals at a sample to the sums; returns ω, α and the specific force at its origin."""
    n = len(table) - 2
    rising, falling, odd, even = weights
    span = 1.0 / (table[k + 2, 0] - table[k, 0])
    omega, alpha, a = trunk_at(table, k + 1, joints, lever, span)
    for c in range(3):
        collect(out, SIGNALS + c, rising, falling, a[c])
        collect(out, SIGNALS + 3 + c, rising, falling, alpha[c])
        collect(out, ALTERNATING + c, odd, even, a[c])
        collect(out, ALTERNATING + 3 + c, odd, even, alpha[c])
        at = 1 + 3 * joints + c
        turning = (table[k + 2, at] - 2.0 * table[k + 1, at] + table[k, at]) * (4.0 * span * span)
        collect(out, JERK + 12 + c, rising, falling, turning)
        out[OMEGA + c] += omega[c] / n
    products = omega[0] * omega[0], omega[0] * omega[1], omega[0] * omega[2]
    others = omega[1] * omega[1], omega[1] * omega[2], omega[2] * omega[2]
    for c in range(3):
        collect(out, SIGNALS + 6 + c, rising, falling, products[c])
        collect(out, SIGNALS + 9 + c, rising, falling, others[c])
        collect(out, ALTERNATING + 6 + c, odd, even, products[c])
        collect(out, ALTERNATING + 9 + c, odd, even, others[c])
    return omega, alpha, a


@part
def set_joints(ws: Array, noise: Array, limits: Array) -> None:
    """Writes the joints' noise and known errors into the workspace."""
    for leg in range(4):
        for i in range(3):
            ws[4 * (NOISE + i) + leg] = noise[3 * leg + i]
            for t in range(6):
                ws[4 * (ERRORS_KNOWN + 3 * t + i) + leg] = limits[KNOWN + 12 * t + 3 * leg + i]


@part
def first_singular(ws: Array, at: int, flat: float, singular: int) -> int:
    """The first leg whose det J in a row of the workspace is below `flat`, or an earlier one found before."""
    for leg in range(4):
        if abs(ws[4 * at + leg]) < flat:
            singular = min(singular, leg)
    return singular


@part
def sums(
    table: Array,
    joints: int,
    columns: NDArray[np.intp],
    ws: Array,
    to_imu: Vector,
    up: Vector,
    window: Array,
    variance: Array,
    prior: Array,
    quartile: float,
    squares: Array,
    standing: Array,
    limits: Array,
    out: Array,
) -> int:
    """Sums of one block without spikes, as `RowMaker.block` until its rows; arguments and result as of `block`, with
    the ground's normal `up`, and mean squares of third differences.
    """
    n, singular = len(table) - 2, 4
    out[:] = 0.0
    given, q, mean = np.empty((n + 1, 108)), np.empty(12), np.zeros(12)
    inputs(table, columns, joints, limits[4], given, q, mean)
    noise = variance.copy()
    if quartile > 0.0:
        learn_noise(squares, columns, joints, quartile, prior, noise)
    set_joints(ws, noise, limits)
    ws[4 * SUM_TERMS : 4 * (SUM_TERMS + 2 * EACH)] = 0.0
    seen = np.empty((n, 4 * (VOLUME - SEEN)))
    for k in range(n):
        rising, falling = window[k], window[n - 1 - k]
        # alternating: + at a block's end, - where the next one begins
        odd, even = rising if (n - 1 - k) % 2 == 0 else -rising, falling if k % 2 == 1 else -falling
        omega, alpha, a = add_trunk(table, k, joints, to_imu, (rising, falling, odd, even), out)
        set_inputs(ws, given[k])
        add_sample(ws, omega, alpha, a, up, rising, falling, odd, even)
        singular = first_singular(ws, VOLUME, limits[0], singular)
        for c in range(seen.shape[1]):
            seen[k, c] = ws[4 * SEEN + c]
        if k == n - 1:
            write_probes(ws, omega, alpha, a, up)
    gather(ws, out)
    k = n // 2
    omega, alpha, a = trunk_at(table, k + 1, joints, to_imu, 1.0 / (table[k + 2, 0] - table[k, 0]))
    set_inputs(ws, given[n])
    add_middle(ws, q, omega, alpha, a, up, out)
    for moved in range(4):
        singular = first_singular(ws, MIDDLES + 25 * moved + 6, limits[0], singular)
    if singular < 4:
        return singular
    for c in range(len(noise)):
        variance[c] = noise[c]
    step = (table[n, 0] - table[1, 0]) / (n - 1) if n > 1 else 0.02
    in_the_air(seen, min(max(round(n * step / limits[PART]), 1), n), up, limits, standing, out)
    for k in range(n):
        out[AVERAGED] += window[k] ** 2
    for k in range(-1, n):  # of Σ w_k (x_k+1 - x_k-1) / 2T, by x_k
        early, later = window[k - 1] if k > 0 else 0.0, window[min(k + 1, n - 1)]
        out[DIFFERENTIATED] += (0.5 * (early - later) / step) ** 2
    out[END] = table[n, 0]
    return -1


@compiled(
    "int64(float64[:,::1], int64, int64[::1], float64[::1], float64[::1], float64[::1], "
    "float64[::1], float64[::1], float64, float64[::1], float64[::1], float64[::1], float64[::1], float64[:,::1], "
    "float64[::1])"
)
def block(
    raw: Array,
    joints: int,
    columns: NDArray[np.intp],
    ws: Array,
    lever: Array,
    window: Array,
    variance: Array,
    prior: Array,
    quartile: float,
    limits: Array,
    standing: Array,
    usual: Array,
    state: Array,
    table: Array,
    out: Array,
) -> int:
    """Sums of one block, as `Front.block` until its rows.

    Args:
        raw: (n + 2, ...), `Samples.table` of the block with one sample more before and after it.
        joints: their number in the table. columns: (12,), of the legs' among them, by leg.
        ws: (4 ROOM,), workspace with the legs' constants, row by row: of the links, see `link_constants`, and the feet
            [m], each in its last link, and its radius.
        lever: (3,) [m], of the IMU.
        window: (n,), its rising half.
        variance, prior: (30,), of white noise; the first is updated. quartile: see `WhiteNoise`; 0 for too few samples.
        limits: (82,), det J [m³], squared force of a light foot [N²], force that the others must carry [N], height of a
            lifted foot [m], velocity of the friction law [rad/s], loads of a foot for the ground's normal and of one
            that stands [N]; from `KNOWN` on rotor inertia, viscous and Coulomb friction of the joints, (3, 12), from
            `KNOWN_STD` on their standard deviations; the robot's weight squared [N²]; squared speed of a foot that
            moves [m²/s²]; time of an average of what tells a leg in the air [s].
        standing: (4,) [m], usual heights of the feet, updated.
        usual: squared noise of each column of the table, updated. state: (STATE,), updated.
        table: as `raw`, the samples without spikes. out: (HALF,), the half window.

    Returns:
        The first near-singular leg, with no change but of the outputs and the ground's normal; 4 for an accelerometer
        that reads zero; -1 for neither.
    """
    squares = np.zeros(raw.shape[1])
    clean(raw, usual, joints, state, table, squares)
    n, at = len(table) - 2, 1 + 3 * joints
    turning, pulling = ZERO, ZERO
    for k in range(1, n + 1):
        turning, force = plus(turning, vector(table[k], at)), vector(table[k], at + 3)
        pulling = plus(pulling, force)
        if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
            return 4
    duration = table[n + 1, 0] - table[1, 0]
    normal = ahead(times(1.0 / n, pulling), times(1.0 / n, turning), duration, state)
    found = sums(
        table,
        joints,
        columns,
        ws,
        vector(lever, 0),
        normal,
        window,
        variance,
        prior,
        quartile,
        squares,
        standing,
        limits,
        out,
    )
    if found < 0:
        end, force_end = out[FEET : FEET + 12].reshape(3, 4), out[FORCE : FORCE + 12].reshape(3, 4)
        learn_ground(end, force_end, duration, limits[5], state)
    return found


# -- the rows ----------------------------------------------------------------------------------------------------------
@part
def calibrate(total: Array, imu: Array, turn: Array, elapsed: float, state: Array, signals: Array) -> Vector:
    """`SignalCalibration.calibrated` on its state (10,): weight, variances, average. Returns what it removes from α."""
    keep = exp(-elapsed / MEMORY)
    state[0] = keep * state[0] + 1.0 - keep
    share = (1.0 - keep) / state[0]
    before, most = vector(state, 7), STRUCK if share < 1.0 else np.inf  # the first block is all that is known
    for c in range(3):
        carried = turn[c, 0] * before[0] + turn[c, 1] * before[1] + turn[c, 2] * before[2]
        state[7 + c] = carried + share * max(min(total[SIGNALS + c] - carried, most), -most)
    removed = np.zeros(3)
    for c in range(6):
        mean = state[7 + c] if c < 3 else 0.0
        away = total[SIGNALS + c] - mean
        state[1 + c] += share * (away * away - state[1 + c])
        gain = 1.0 - imu[c] / state[1 + c] if state[1 + c] > BEYOND_NOISE * imu[c] else 0.0
        signals[c] = mean + gain * away
        if c >= 3:
            removed[c - 3] = (1.0 - gain) * away
    for c in range(6, 12):
        signals[c] = total[SIGNALS + c]
    return vector(removed, 0)


@part
def still(total: Array, averaged: float, variance: Array, speeds: Array, count: int, out: Array) -> None:
    """Writes 1 for the joints whose speed over the latest blocks does not exceed its noise. Updates the ring `speeds`
    (blocks, 12), of which `count` were written before.
    """
    at, filled = count % len(speeds), min(count + 1, len(speeds))
    for j in range(12):
        speeds[at, j] = total[JOINT + 12 + j] ** 2 / (averaged * variance[12 + j])
        mean = 0.0
        for k in range(filled):
            mean += speeds[k, j] / filled
        out[j] = 1.0 if mean < MOVES**2 else 0.0


@part
def half_sum(first: Array, second: Array, at: int) -> float:
    """Mean of an entry that both half windows have."""
    return float(0.5 * (first[at] + second[at]))


@part
def by_accelerations(first: Array, second: Array, trunk: Array, K: Array, L: Array, own: Array) -> None:
    """Writes ∂(inertial wrench)/∂a and ∂/∂α of the whole robot, (6, 3) each, and the latter of the trunk alone."""
    h = vector(trunk, 1)
    inertia = ((trunk[4], trunk[5], trunk[6]), (trunk[5], trunk[7], trunk[8]), (trunk[6], trunk[8], trunk[9]))
    for axis in range(3):
        along = cross(h, UNIT[axis])
        for c in range(3):
            K[c, axis], own[c, axis] = trunk[0] if c == axis else 0.0, -along[c]
            K[3 + c, axis], own[3 + c, axis] = along[c], inertia[axis][c]
    for c in range(6):
        for axis in range(3):
            K[c, axis] -= half_sum(first, second, BY_A + 3 * c + axis)
            L[c, axis] = own[c, axis] - half_sum(first, second, BY_ALPHA + 3 * c + axis)


@part
def write_trunk(total: Array, signals: Array, trunk: Array, trunk_map: Array, sign: float, at: int, out: Array) -> None:
    """Writes the columns of A, b and, from place `at` on, sampling."""
    for c in range(6):
        alternating = -total[ALTERNATING + 12 + c]
        for j in range(10):
            value = 0.0
            for s in range(12):
                value += trunk_map[10 * c + j, s] * signals[s]
                alternating += trunk_map[10 * c + j, s] * total[ALTERNATING + s] * trunk[j]
            out[c, j] = value
        out[c, 10] = total[TARGET + c]
        out[c, at] = sign * alternating


@part
def write_joints(
    total: Array, first: Array, second: Array, sticks: Array, places: NDArray[np.intp], columns: Array
) -> None:
    """Writes the columns of the errors of joints, contacts and links."""
    for j in range(12):
        at, moves = BY_TERMS + 36 * j, 1.0 - sticks[j]
        # signs such that positive static friction lifts the trunk
        lifts = dot(vector(total, SIGNALS), vector(total, at + 18))
        sign = 1.0 if lifts > 0.0 else -1.0 if lifts < 0.0 else 0.0
        for c in range(6):
            columns[c, places[0] + j] = -total[at + c] * moves
            columns[c, places[1] + j] = -total[at + 6 + c] * moves
            columns[c, places[2] + j] = -total[at + 12 + c] * moves
            columns[c, places[3] + j] = -total[at + 18 + c]
            columns[c, places[5] + j] = -total[at + 24 + c]
            columns[c, places[6] + j] = -total[at + 30 + c] * sign * sticks[j]
            columns[c, places[7] + j] = half_sum(first, second, MIDDLE + 24 * c + j)
            columns[c, places[8] + j] = -half_sum(first, second, MIDDLE + 24 * c + 12 + j)
            by_link = BY_LINKS + 24 * j + c
            columns[c, places[9] + j] = -total[by_link]
            for axis in range(3):
                columns[c, places[10] + 12 * axis + j] = -total[by_link + 6 * (1 + axis)]


@part
def write_imu(
    total: Array,
    moved: Vector,
    removed: Vector,
    K: Array,
    L: Array,
    own: Array,
    places: NDArray[np.intp],
    columns: Array,
) -> None:
    """Writes the columns of the errors of the IMU: place, axes, bias and response to the part of the specific force
    that has `moved` from its average, and what the regression removed.
    """
    a, alpha = vector(total, SIGNALS), vector(total, SIGNALS + 3)
    xx, xy, xz = vector(total, SIGNALS + 6)
    yy, yz, zz = vector(total, SIGNALS + 9)
    for c in range(6):
        by_a, by_alpha = (K[c, 0], K[c, 1], K[c, 2]), (L[c, 0], L[c, 1], L[c, 2])
        by_place = plus(
            cross(by_a, alpha),
            (
                by_a[1] * xy + by_a[2] * xz - by_a[0] * (yy + zz),
                by_a[0] * xy + by_a[2] * yz - by_a[1] * (xx + zz),
                by_a[0] * xz + by_a[1] * yz - by_a[2] * (xx + yy),
            ),
        )
        by_turn = plus(cross(by_a, a), cross(by_alpha, alpha))
        for axis in range(3):
            columns[c, places[11] + axis] = -by_place[axis]
            columns[c, places[12] + axis] = by_turn[axis]
            columns[c, places[13] + axis] = -by_a[axis]
            columns[c, places[18] + axis] = -by_a[axis] * moved[axis]
            # the regression errors see the trunk alone
            columns[c, places[16] + axis] = own[c, axis] * removed[axis]


@part
def write_common(
    total: Array, first: Array, second: Array, L: Array, places: NDArray[np.intp], columns: Array, squared: Array
) -> None:
    """Writes the columns of errors that all joints share: lags and the common gain; and Σ (∂b/∂q̈)² (6, 12)."""
    for c in range(6):
        gain = late = 0.0
        for j in range(12):
            by_joint = half_sum(first, second, BY_JOINTS + 12 * c + j)
            gain += columns[c, places[5] + j]
            late -= by_joint * total[JERK + j]
            squared[c, j] = by_joint**2
        for axis in range(3):
            late += L[c, axis] * total[JERK + 12 + axis]
        columns[c, places[4]] = total[BY_RATE + c]
        columns[c, places[14]], columns[c, places[15]] = late, gain


@compiled(
    "float64(float64[::1], float64[::1], float64[::1], float64[::1], float64[:,::1], float64[::1], float64[::1], "
    "float64[:,::1], int64, int64[::1], float64, float64[::1], float64[:,::1], float64[::1], float64[:,::1], "
    "boolean[::1])"
)
def rows(
    first: Array,
    second: Array,
    trunk: Array,
    lever: Array,
    trunk_map: Array,
    variance: Array,
    calibration: Array,
    speeds: Array,
    count: int,
    places: NDArray[np.intp],
    sign: float,
    total: Array,
    columns: Array,
    white: Array,
    joint: Array,
    air: Bools,
) -> float:
    """Six rows A θ + C p = b from two neighbouring blocks, as `RowMaker._rows`. Returns the time since the first.

    Args:
        first, second: (HALF,), the half windows.
        trunk: (10,), parameters at which errors of the IMU are linearised. lever: (3,) [m], of the IMU.
        trunk_map: (60, 12), `TRUNK_MAP`. variance: (30,), of white noise.
        calibration: (10,), state of `calibrate`. speeds, count: see `still`.
        places: (19,), first of each error's columns, in the order of `stadera.trunk.compiled_rows.NAMES`.
        sign: of alternating sums; 0 for too few samples.
        total: (SUMS,), the window's sums. columns: (6, 11 + errors), of A, b and C. white: (6,), variances.
        joint: (6, 12), q̈, q̇, s, 1, τ̇ and h - τ of the joints. air: (4,), legs in the air throughout.
    """
    elapsed: float = second[END] - first[END]
    for k in range(SUMS):
        total[k] = first[k] + second[SUMS + k]
    averaged, differentiated = first[AVERAGED] + second[AVERAGED], first[DIFFERENTIATED] + second[DIFFERENTIATED]
    gyro = (variance[24] + variance[25] + variance[26]) / 3.0
    accelerometer = (variance[27] + variance[28] + variance[29]) / 3.0
    imu, signals, sticks = np.empty(6), np.empty(12), np.empty(12)
    imu[3:] = differentiated * gyro
    imu[:3] = averaged * accelerometer + imu[3] * (lever[0] ** 2 + lever[1] ** 2 + lever[2] ** 2)
    turn = turned(vector(second, OMEGA), elapsed)
    for j in range(12):
        for t in range(6):
            joint[t, j] = total[JOINT + 12 * t + j]
    for leg in range(4):
        air[leg] = first[AIR + leg] * second[AIR + leg] > 0.0
    removed = calibrate(total, imu, turn, elapsed, calibration, signals)
    still(total, averaged, variance, speeds, count, sticks)
    K, L, own, squared = np.empty((6, 3)), np.empty((6, 3)), np.empty((6, 3)), np.empty((6, 12))
    by_accelerations(first, second, trunk, K, L, own)
    write_trunk(total, signals, trunk, trunk_map, sign, places[17], columns)
    write_joints(total, first, second, sticks, places, columns)
    moved = minus(vector(signals, 0), vector(calibration, 7))
    write_imu(total, moved, removed, K, L, own, places, columns)
    write_common(total, first, second, L, places, columns, squared)
    for c in range(6):
        by_a, by_velocity = (K[c, 0], K[c, 1], K[c, 2]), 0.0
        from_gyro = plus((L[c, 0], L[c, 1], L[c, 2]), cross(by_a, vector(lever, 0)))
        for j in range(12):
            by_velocity += squared[c, j] * variance[12 + j]
        noise = total[SQUARED + c] + averaged * accelerometer * dot(by_a, by_a)
        white[c] = OVERLAP * noise + TELESCOPED * differentiated * (gyro * dot(from_gyro, from_gyro) + by_velocity)
    return elapsed
