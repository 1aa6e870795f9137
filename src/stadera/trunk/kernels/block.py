"""Sums of one block of samples, compiled: `RowMaker.block` of `stadera.trunk.rows` up to its rows, with
`BaseWrenchRegressor.at` and `by_links` of `stadera.legs.base_wrench`, whose docstrings derive the equations.

One pass over samples and legs adds up what the numpy code stores by sample and multiplies afterwards. Vectors are
tuples of three numbers, rotations tuples of three columns, wrenches (force, moment about the trunk's origin); all in
trunk axes.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt, tanh

import numpy as np
from numpy.typing import NDArray

from stadera.compiled import compiled, part
from stadera.types import Array

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

# as in `stadera.trunk.rows` and `stadera.trunk.noise`
KNOWN, KNOWN_STD, MOST_LIGHT = 7, 43, 79  # places of the joints' errors and of the robot's weight squared in `limits`
STEP = 1e-4  # rad, of the differences by joint positions
STANDING = 0.05  # smoothing factor of each foot's usual height
UP, DOWN = exp(0.03), exp(-0.09)  # factors on a variance whose block lies above and below the lower quartile
LEAST, MOST = 0.05**2, 20.0**2  # times the prior variance
OVERLAP, TELESCOPED = 4.0 / 3.0, 0.5  # correlation of neighbouring windows' noise
MOVES = 3.0  # times its noise: root mean square of the velocity of a joint that moves
MEMORY, BEYOND_NOISE = 1.0, 2.0  # s, of ground and accelerations; times the variance of noise
BELIEF = 1e-3  # weight of the vertical against one second of lines between feet
WILD, SPIKE_MEMORY, LEARNT = 10.0, 100.0, 5.0  # times the usual noise; blocks; blocks before a spike is replaced

# state of what comes before the rows: blocks seen by the filter of spikes; lines between feet, vertical, if it is known
BLOCKS, LINES, UPWARDS, UP_KNOWN, STATE = 0, 1, 10, 13, 14


# -- vectors -----------------------------------------------------------------------------------------------------------
@part
def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@part
def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@part
def times(s: float, a: Vector) -> Vector:
    return s * a[0], s * a[1], s * a[2]


@part
def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def rotated(R: Rotation, v: Vector) -> Vector:
    """R v."""
    return plus(plus(times(v[0], R[0]), times(v[1], R[1])), times(v[2], R[2]))


@part
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


# -- a leg at one sample -----------------------------------------------------------------------------------------------
@part
def inertial(body: Array, turn: Rotation, origin: Vector, omega: Vector, alpha: Vector, a: Vector) -> Wrench:
    """Inertial wrench of a link whose origin has the specific force a."""
    h = rotated(turn, vector(body, MOMENT))
    force = plus(times(body[MASS], a), plus(cross(alpha, h), cross(omega, cross(omega, h))))
    tensor = (vector(body, TENSOR), vector(body, TENSOR + 3), vector(body, TENSOR + 6))
    own_omega, own_alpha = rotated_back(turn, omega), rotated_back(turn, alpha)
    own = plus(rotated(tensor, own_alpha), cross(own_omega, rotated(tensor, own_omega)))
    return force, plus(plus(cross(h, a), rotated(turn, own)), cross(origin, force))


@part
def link(
    body: Array,
    turn: Rotation,
    origin: Vector,
    omega: Vector,
    alpha: Vector,
    a: Vector,
    q: float,
    velocity: float,
    acceleration: float,
) -> Link:
    """A link from the previous one, or the trunk: its rotation, origin, joint axis, ω, α, a, and inertial wrench."""
    s, c = sin(q), 1.0 - cos(q)
    local = (
        plus(plus(vector(body, 0), times(s, vector(body, 9))), times(c, vector(body, 18))),
        plus(plus(vector(body, 3), times(s, vector(body, 12))), times(c, vector(body, 21))),
        plus(plus(vector(body, 6), times(s, vector(body, 15))), times(c, vector(body, 24))),
    )
    arm = rotated(turn, vector(body, ARM))
    turn = (rotated(turn, local[0]), rotated(turn, local[1]), rotated(turn, local[2]))
    origin = plus(origin, arm)
    axis = rotated(turn, vector(body, AXIS))
    a = plus(a, plus(cross(alpha, arm), cross(omega, cross(omega, arm))))
    spin = times(velocity, axis)
    alpha = plus(alpha, plus(cross(omega, spin), times(acceleration, axis)))
    omega = plus(omega, spin)
    return turn, origin, axis, omega, alpha, a, inertial(body, turn, origin, omega, alpha, a)


@part
def carried(one: Link, two: Link, three: Link, w: Wrench, v: Wrench, u: Wrench) -> tuple[Vector, Wrench]:
    """Joint torques (3) that wrenches w, v, u on the three links need, and the wrenches' sum."""
    t2 = dot(three[2], minus(u[1], cross(three[1], u[0])))
    force, moment = plus(u[0], v[0]), plus(u[1], v[1])
    t1 = dot(two[2], minus(moment, cross(two[1], force)))
    force, moment = plus(force, w[0]), plus(moment, w[1])
    t0 = dot(one[2], minus(moment, cross(one[1], force)))
    return (t0, t1, t2), (force, moment)


@part
def leg_at(
    links: Array, foot: Array, q: Array, v: Array, acc: Array, omega: Vector, alpha: Vector, a: Vector, normal: Vector
) -> Leg:
    """One leg at one sample: links, centre of the foot, E by joint, J by joint, torques of rigid bodies and rotors,
    inertial wrench, det J.

    Args:
        links: (3, ...) constants. foot: (4,) [m], in the last link, and radius. q, v, acc: (3,).
    """
    one = link(links[0], UNIT, ZERO, omega, alpha, a, q[0], v[0], acc[0])
    two = link(links[1], one[0], one[1], one[3], one[4], one[5], q[1], v[1], acc[1])
    three = link(links[2], two[0], two[1], two[3], two[4], two[5], q[2], v[2], acc[2])
    torque, wrench = carried(one, two, three, one[6], two[6], three[6])
    torque = plus(torque, (links[0, ROTOR] * acc[0], links[1, ROTOR] * acc[1], links[2, ROTOR] * acc[2]))
    centre = plus(three[1], rotated(three[0], vector(foot, 0)))
    contact = minus(centre, times(foot[3], normal))
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


@part
def target(E: tuple[Wrench, Wrench, Wrench], left: Vector, inertia: Wrench) -> Wrench:
    """b of a leg: Σ_k E_k (h_k - τ_k) - w."""
    force = plus(plus(times(left[0], E[0][0]), times(left[1], E[1][0])), times(left[2], E[2][0]))
    moment = plus(plus(times(left[0], E[0][1]), times(left[1], E[1][1])), times(left[2], E[2][1]))
    return minus(force, inertia[0]), minus(moment, inertia[1])


# -- sums --------------------------------------------------------------------------------------------------------------
@part
def add(out: Array, at: int, rising: float, falling: float, wrench: Wrench) -> None:
    """Adds a wrench to the sums of both halves."""
    force, moment = wrench
    out[at] += rising * force[0]
    out[at + 1] += rising * force[1]
    out[at + 2] += rising * force[2]
    out[at + 3] += rising * moment[0]
    out[at + 4] += rising * moment[1]
    out[at + 5] += rising * moment[2]
    at += SUMS
    out[at] += falling * force[0]
    out[at + 1] += falling * force[1]
    out[at + 2] += falling * force[2]
    out[at + 3] += falling * moment[0]
    out[at + 4] += falling * moment[1]
    out[at + 5] += falling * moment[2]


@part
def add_number(out: Array, at: int, rising: float, falling: float, value: float) -> None:
    """Adds a number to the sums of both halves."""
    out[at] += rising * value
    out[SUMS + at] += falling * value


@part
def add_squared(out: Array, rising: float, falling: float, variance: float, E: Wrench) -> None:
    """Adds the variances of the six rows due to white noise of one torque."""
    r, f = rising * rising * variance, falling * falling * variance
    for c in range(3):
        out[SQUARED + c] += r * E[0][c] ** 2
        out[SQUARED + 3 + c] += r * E[1][c] ** 2
        out[SUMS + SQUARED + c] += f * E[0][c] ** 2
        out[SUMS + SQUARED + 3 + c] += f * E[1][c] ** 2


@part
def add_link(
    out: Array,
    at: int,
    rising: float,
    falling: float,
    body: Array,
    leg: Leg,
    which: int,
    E: tuple[Wrench, Wrench, Wrench],
) -> None:
    """Adds the effect of errors of one link's mass and centre of mass, `BaseWrenchRegressor.by_links`."""
    one, two, three = leg[0], leg[1], leg[2]
    state = one if which == 0 else two if which == 1 else three
    turn, origin, _, omega, alpha, _, wrench = state
    mass = body[MASS]
    centre = plus(origin, times(1.0 / mass, rotated(turn, vector(body, MOMENT))))
    for effect in range(4):
        if effect == 0:
            force, moment = wrench
        else:
            axis = turn[0] if effect == 1 else turn[1] if effect == 2 else turn[2]
            force = times(mass, plus(cross(alpha, axis), cross(omega, cross(omega, axis))))
            moment = plus(cross(axis, wrench[0]), cross(centre, force))
        g0 = dot(one[2], minus(moment, cross(one[1], force)))
        g1 = dot(two[2], minus(moment, cross(two[1], force))) if which > 0 else 0.0
        g2 = dot(three[2], minus(moment, cross(three[1], force))) if which > 1 else 0.0
        add(out, at + 6 * effect, rising, falling, target(E, (g0, g1, g2), (force, moment)))


@part
def probe(links: Array, leg: Leg, a: Vector, alpha: Vector, joint: int) -> Wrench:
    """b of a leg for an acceleration alone: of the trunk (a, α), or of one joint (0 to 2, else -1)."""
    one, two, three, _, E = leg[0], leg[1], leg[2], leg[3], leg[4]
    at = ZERO
    if joint >= 0:
        moving = one if joint == 0 else two if joint == 1 else three
        alpha, at = moving[2], moving[1]
    w = v = u = (ZERO, ZERO)
    if joint < 1:
        w = inertial(links[0], one[0], one[1], ZERO, alpha, plus(a, cross(alpha, minus(one[1], at))))
    if joint < 2:
        v = inertial(links[1], two[0], two[1], ZERO, alpha, plus(a, cross(alpha, minus(two[1], at))))
    u = inertial(links[2], three[0], three[1], ZERO, alpha, plus(a, cross(alpha, minus(three[1], at))))
    torque, wrench = carried(one, two, three, w, v, u)
    if joint == 0:
        torque = (torque[0] + links[0, ROTOR], torque[1], torque[2])
    elif joint == 1:
        torque = (torque[0], torque[1] + links[1, ROTOR], torque[2])
    elif joint == 2:
        torque = (torque[0], torque[1], torque[2] + links[2, ROTOR])
    return target(E, torque, wrench)


@part
def put(out: Array, at: int, columns: int, wrench: Wrench) -> None:
    """Adds a wrench to a column of a matrix with six rows."""
    force, moment = wrench
    out[at] += force[0]
    out[at + columns] += force[1]
    out[at + 2 * columns] += force[2]
    out[at + 3 * columns] += moment[0]
    out[at + 4 * columns] += moment[1]
    out[at + 5 * columns] += moment[2]


@part
def add_probes(out: Array, links: Array, leg: Leg, which: int) -> None:
    """Adds a leg's derivatives of b by a (6, 3), by α (6, 3) and by the joints' accelerations (6, 12)."""
    for axis in range(3):
        put(out, BY_A + axis, 3, probe(links, leg, UNIT[axis], ZERO, -1))
        put(out, BY_ALPHA + axis, 3, probe(links, leg, ZERO, UNIT[axis], -1))
        put(out, BY_JOINTS + 3 * which + axis, 12, probe(links, leg, ZERO, ZERO, axis))


@part
def add_middle(
    out: Array,
    links: Array,
    foot: Array,
    which: int,
    q: Array,
    v: Array,
    acc: Array,
    left_out: Array,
    omega: Vector,
    alpha: Vector,
    a: Vector,
    normal: Vector,
    flat: float,
) -> bool:
    """Writes a leg's derivatives of b by its joints' and its contact point's positions, as `RowMaker._middle`.

    Args:
        left_out: (3,) friction and offsets minus actuator torques. flat: least det J.

    Returns:
        True if the leg is near-singular at one of the positions.
    """
    here = leg_at(links, foot, q, v, acc, omega, alpha, a, normal)
    E, other = here[4], (left_out[0], left_out[1], left_out[2])
    left = plus(here[6], other)
    force, moment = target(E, left, here[7])
    singular = abs(here[8]) < flat
    moved = q.copy()
    for joint in range(3):
        moved[joint] = q[joint] + STEP
        there = leg_at(links, foot, moved, v, acc, omega, alpha, a, normal)
        moved[joint] = q[joint]
        singular |= abs(there[8]) < flat
        f, m = target(there[4], plus(there[6], other), there[7])
        slope = (times(1.0 / STEP, minus(f, force)), times(1.0 / STEP, minus(m, moment)))
        put(out, MIDDLE + 3 * which + joint, 24, slope)
    f, _ = target(E, left, (ZERO, ZERO))
    s0, s1, s2 = cross(f, here[0][2]), cross(f, here[1][2]), cross(f, here[2][2])
    for axis in range(3):
        turning = (-s0[axis], -s1[axis], -s2[axis])
        put(out, MIDDLE + 12 + 3 * which + axis, 24, target(E, turning, (ZERO, cross(f, UNIT[axis]))))
    return singular


# -- motion ------------------------------------------------------------------------------------------------------------
@part
def third_difference_squared(table: Array, column: int) -> float:
    """Mean square of a column's third differences over its gain of 20, of at least four samples."""
    n, total = len(table) - 3, 0.0
    for k in range(n):
        first, last = table[k + 1, column] - table[k, column], table[k + 3, column] - table[k + 2, column]
        middle = table[k + 2, column] - table[k + 1, column]
        total += (last - 2.0 * middle + first) ** 2
    return total / (20.0 * n)


@part
def learn_noise(
    table: Array, columns: NDArray[np.intp], joints: int, quartile: float, prior: Array, out: Array
) -> None:
    """`WhiteNoise.learn`, on variances (30,) `out`. The table has the joints' efforts from column 1 + 2 `joints`."""
    for channel in range(30):
        if channel < 12:
            at = 1 + 2 * joints + columns[channel]
        elif channel < 24:
            at = 1 + joints + columns[channel - 12]
        else:
            at = 1 + 3 * joints + channel - 24
        out[channel] *= UP if third_difference_squared(table, at) > quartile * out[channel] else DOWN
        out[channel] = min(max(out[channel], LEAST * prior[channel]), MOST * prior[channel])


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
def in_the_air(height: Array, along: Array, heavy: Array, limits: Array, standing: Array, out: Array) -> None:
    """Writes 1 for the legs in the air throughout the block and updates `standing`, as `RowMaker._in_the_air`.

    Args:
        height, along: (n, 4), of the feet, and of the forces along the normal.
        heavy: (n, 4), by how much the squared force exceeds that of a light foot.
        limits: see `block`.
    """
    n, moved = len(height), np.zeros(4)
    for leg in range(4):
        air = stands = True
        mean = 0.0
        for k in range(n):
            carried = pressed = level = 0.0
            for other in range(4):
                if other != leg:
                    carried += along[k, other]
                    pressed += max(along[k, other], 0.0)
                    level += max(along[k, other], 0.0) * (height[k, other] - standing[other])
            lifted = height[k, leg] - standing[leg] - level / max(pressed, 1e-9)
            up = lifted > limits[3]
            air &= up and heavy[k, leg] < 0.0 and carried > limits[2]
            stands &= not up and along[k, leg] > limits[6]
            mean += lifted / n
        out[AIR + leg] = 1.0 if air else 0.0
        moved[leg] = STANDING * mean if stands else 0.0
    for leg in range(4):
        standing[leg] += moved[leg]


# -- before the rows ---------------------------------------------------------------------------------------------------
@part
def clean(table: Array, usual: Array, state: Array, out: Array) -> None:
    """Writes the samples without spikes, as `SpikeFilter.clean`; `state[BLOCKS]` counts the blocks before."""
    n = len(table)
    out[:] = table
    if n < 4:
        return
    state[BLOCKS] += 1.0
    blocks = state[BLOCKS]
    for c in range(1, table.shape[1]):
        if blocks > LEARNT:
            limit = WILD * sqrt(usual[c])
            for k in range(n):
                if k == 0:
                    expected = 2.0 * table[1, c] - table[2, c]
                    away = 0.5 * abs((table[1, c] - table[0, c]) - (table[2, c] - table[1, c]))
                elif k == n - 1:
                    expected = 2.0 * table[n - 2, c] - table[n - 3, c]
                    away = 0.5 * abs((table[k, c] - table[k - 1, c]) - (table[k - 1, c] - table[k - 2, c]))
                else:
                    before, after = table[k, c] - table[k - 1, c], table[k + 1, c] - table[k, c]
                    expected = 0.5 * (table[k - 1, c] + table[k + 1, c])
                    away = min(abs(before), abs(after)) if before * after < 0.0 else 0.0
                if away > limit:
                    out[k, c] = expected
        square = third_difference_squared(out, c) + 1e-12
        usual[c] += (square - usual[c]) / min(blocks, SPIKE_MEMORY)


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
def sums(
    table: Array,
    joints: int,
    columns: NDArray[np.intp],
    links: Array,
    feet: Array,
    to_imu: Vector,
    up: Vector,
    window: Array,
    variance: Array,
    prior: Array,
    quartile: float,
    standing: Array,
    limits: Array,
    out: Array,
) -> int:
    """Sums of one block without spikes, as `RowMaker.block` until its rows; arguments and result as of `block`, with
    the ground's normal `up`.
    """
    n = len(table) - 2
    out[:] = 0.0
    joint = np.empty((6, n, 12))
    q, v, acc, tau, rate, jerk = joint[0], joint[1], joint[2], joint[3], joint[4], joint[5]
    mean, left, singular = np.zeros(12), np.empty(12), 4
    for k in range(n):
        span = 1.0 / (table[k + 2, 0] - table[k, 0])
        for j in range(12):
            at = 1 + columns[j]
            q[k, j] = table[k + 1, at]
            before, now, after = table[k, at + joints], table[k + 1, at + joints], table[k + 2, at + joints]
            v[k, j], acc[k, j] = now, (after - before) * span
            jerk[k, j] = (after - 2.0 * now + before) * (4.0 * span * span)
            mean[j] += acc[k, j] / n
            at += 2 * joints
            tau[k, j], rate[k, j] = table[k + 1, at], (table[k + 2, at] - table[k, at]) * span
    sliding = fitted_lines(v)
    noise = variance.copy()
    if quartile > 0.0:
        learn_noise(table, columns, joints, quartile, prior, noise)
    height, along, heavy = np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 4))
    for k in range(n):
        rising, falling = window[k], window[n - 1 - k]
        # alternating: + at a block's end, - where the next one begins
        plus_minus, minus_plus = rising if (n - 1 - k) % 2 == 0 else -rising, falling if k % 2 == 1 else -falling
        span = 1.0 / (table[k + 2, 0] - table[k, 0])
        omega, alpha, a = trunk_at(table, k + 1, joints, to_imu, span)
        for c in range(3):
            add_number(out, SIGNALS + c, rising, falling, a[c])
            add_number(out, SIGNALS + 3 + c, rising, falling, alpha[c])
            add_number(out, ALTERNATING + c, plus_minus, minus_plus, a[c])
            add_number(out, ALTERNATING + 3 + c, plus_minus, minus_plus, alpha[c])
            at = 1 + 3 * joints + c
            turning = (table[k + 2, at] - 2.0 * table[k + 1, at] + table[k, at]) * (4.0 * span * span)
            add_number(out, JERK + 12 + c, rising, falling, turning)
            out[OMEGA + c] += omega[c] / n
        products = (
            (omega[0] * omega[0], omega[0] * omega[1], omega[0] * omega[2]),
            (omega[1] * omega[1], omega[1] * omega[2], omega[2] * omega[2]),
        )
        add(out, SIGNALS + 6, rising, falling, products)
        add(out, ALTERNATING + 6, plus_minus, minus_plus, products)
        for which in range(4):
            here = slice(3 * which, 3 * which + 3)
            leg = leg_at(links[which], feet[which], q[k, here], v[k, here], acc[k, here], omega, alpha, a, up)
            E, rigid = leg[4], leg[6]
            if abs(leg[8]) < limits[0]:
                singular = min(singular, which)
            for i in range(3):
                j = 3 * which + i
                body, e = links[which, i], E[i]
                sure = tanh(sliding[k, j] / limits[4])
                friction = body[VISCOUS] * v[k, j] + body[OFFSET] + body[COULOMB] * sure
                left[j] = rigid[i] + friction - tau[k, j]
                stuck = sqrt(max(1.0 - sure * sure, 0.0))
                at = BY_TERMS + 36 * j
                add(out, at, rising * acc[k, j], falling * acc[k, j], e)
                add(out, at + 6, rising * v[k, j], falling * v[k, j], e)
                add(out, at + 12, rising * sure, falling * sure, e)
                add(out, at + 18, rising, falling, e)
                add(out, at + 24, rising * tau[k, j], falling * tau[k, j], e)
                add(out, at + 30, rising * stuck, falling * stuck, e)
                add(out, BY_RATE, rising * rate[k, j], falling * rate[k, j], e)
                add_squared(out, rising, falling, noise[j], e)
                add_number(out, JERK + j, rising, falling, jerk[k, j])
                add_number(out, JOINT + j, rising, falling, acc[k, j])
                add_number(out, JOINT + 12 + j, rising, falling, v[k, j])
                add_number(out, JOINT + 24 + j, rising, falling, sure)
                add_number(out, JOINT + 36 + j, rising, falling, 1.0)
                add_number(out, JOINT + 48 + j, rising, falling, rate[k, j])
                add_number(out, JOINT + 60 + j, rising, falling, left[j])
                add_link(out, BY_LINKS + 24 * j, rising, falling, body, leg, i, E)
            torque = (left[3 * which], left[3 * which + 1], left[3 * which + 2])
            left_over = target(E, torque, leg[7])
            add(out, TARGET, rising, falling, left_over)
            add(out, ALTERNATING + 12, plus_minus, minus_plus, left_over)
            force, _ = target(E, torque, (ZERO, ZERO))
            if k == n - 1:
                for c in range(3):
                    out[FEET + 4 * c + which], out[FORCE + 4 * c + which] = leg[3][c], force[c]
                add_probes(out, links[which], leg, which)
            light = limits[1]
            for i in range(3):
                j = 3 * which + i
                extra = spread = 0.0
                for t in range(3):
                    term = (acc[k, j], v[k, j], tanh(sliding[k, j] / limits[4]))[t]
                    extra += limits[KNOWN + 12 * t + j] * term
                    spread += (limits[KNOWN_STD + 12 * t + j] * term) ** 2
                force = plus(force, times(extra, E[i][0]))
                light += dot(E[i][0], E[i][0]) * spread
            height[k, which], along[k, which] = dot(leg[3], up), dot(force, up)
            heavy[k, which] = dot(force, force) - min(light, limits[MOST_LIGHT])
    k = n // 2
    omega, alpha, a = trunk_at(table, k + 1, joints, to_imu, 1.0 / (table[k + 2, 0] - table[k, 0]))
    for which in range(4):
        for i in range(3):
            j, body = 3 * which + i, links[which, i]
            friction = body[VISCOUS] * v[k, j] + body[OFFSET] + body[COULOMB] * tanh(v[k, j] / limits[4])
            left[j] = friction - tau[k, j]
        here = slice(3 * which, 3 * which + 3)
        if add_middle(
            out,
            links[which],
            feet[which],
            which,
            q[k, here],
            v[k, here],
            mean[here],
            left[here],
            omega,
            alpha,
            a,
            up,
            limits[0],
        ):
            singular = min(singular, which)
    if singular < 4:
        return singular
    variance[:] = noise
    in_the_air(height, along, heavy, limits, standing, out)
    step = (table[n, 0] - table[1, 0]) / (n - 1) if n > 1 else 0.02
    for k in range(n):
        out[AVERAGED] += window[k] ** 2
    out[DIFFERENTIATED] = (np.pi / (2.0 * n * n * step)) ** 2 * n / 2.0
    out[END] = table[n, 0]
    return -1


@compiled(
    "int64(float64[:,::1], int64, int64[::1], float64[:,:,::1], float64[:,::1], float64[::1], float64[::1], "
    "float64[::1], float64[::1], float64, float64[::1], float64[::1], float64[::1], float64[::1], float64[:,::1], "
    "float64[::1])"
)
def block(
    raw: Array,
    joints: int,
    columns: NDArray[np.intp],
    links: Array,
    feet: Array,
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
        links: (4, 3, 50), constants of the links. feet: (4, 4) [m], each in its last link, and its radius.
        lever: (3,) [m], of the IMU.
        window: (n,), its rising half.
        variance, prior: (30,), of white noise; the first is updated. quartile: see `WhiteNoise`; 0 for too few samples.
        limits: (80,), det J [m³], squared force of a light foot [N²], force that the others must carry [N], height of a
            lifted foot [m], velocity of the friction law [rad/s], loads of a foot for the ground's normal and of one
            that stands [N]; from `KNOWN` on rotor inertia, viscous and Coulomb friction of the joints, (3, 12), from
            `KNOWN_STD` on their standard deviations; the robot's weight squared [N²].
        standing: (4,) [m], usual heights of the feet, updated.
        usual: squared noise of each column of the table, updated. state: (STATE,), updated.
        table: as `raw`, the samples without spikes. out: (HALF,), the half window.

    Returns:
        The first near-singular leg, with no change but of the outputs and the ground's normal; 4 for an accelerometer
        that reads zero; -1 for neither.
    """
    clean(raw, usual, state, table)
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
        links,
        feet,
        vector(lever, 0),
        normal,
        window,
        variance,
        prior,
        quartile,
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
    before = vector(state, 7)
    for c in range(3):
        carried = turn[c, 0] * before[0] + turn[c, 1] * before[1] + turn[c, 2] * before[2]
        state[7 + c] = carried + share * (total[SIGNALS + c] - carried)
    removed = np.zeros(3)
    for c in range(6):
        mean = state[7 + c] if c < 3 else 0.0
        away = total[SIGNALS + c] - mean
        state[1 + c] += share * (away * away - state[1 + c])
        gain = 1.0 - imu[c] / state[1 + c] if state[1 + c] > BEYOND_NOISE * imu[c] else 0.0
        signals[c] = mean + gain * away
        if c >= 3:
            removed[c - 3] = (1.0 - gain) * away
    signals[6:] = total[SIGNALS + 6 : SIGNALS + 12]
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


@compiled(
    "float64(float64[::1], float64[::1], float64[::1], float64[::1], float64[:,::1], float64[::1], float64[::1], "
    "float64[:,::1], int64, int64[::1], float64[::1], float64[:,::1], float64[::1])"
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
    total: Array,
    columns: Array,
    white: Array,
) -> float:
    """Six rows A θ + C p = b from two neighbouring blocks, as `RowMaker._rows`. Returns the time since the first.

    Args:
        first, second: (HALF,), the half windows.
        trunk: (10,), parameters at which errors of the IMU are linearised. lever: (3,) [m], of the IMU.
        trunk_map: (60, 12), `TRUNK_MAP`. variance: (30,), of white noise.
        calibration: (10,), state of `calibrate`. speeds, count: see `still`.
        places: (18,), first of each error's columns, in the order of `stadera.trunk.compiled_rows.NAMES`.
        total: (SUMS,), the window's sums. columns: (6, 11 + errors), of A, b and C. white: (6,), variances.
    """
    elapsed: float = second[END] - first[END]
    total[:] = first[:SUMS] + second[SUMS : 2 * SUMS]
    averaged, differentiated = first[AVERAGED] + second[AVERAGED], first[DIFFERENTIATED] + second[DIFFERENTIATED]
    gyro = (variance[24] + variance[25] + variance[26]) / 3.0
    accelerometer = (variance[27] + variance[28] + variance[29]) / 3.0
    imu, signals, sticks = np.empty(6), np.empty(12), np.empty(12)
    imu[3:] = differentiated * gyro
    imu[:3] = averaged * accelerometer + imu[3] * (lever[0] ** 2 + lever[1] ** 2 + lever[2] ** 2)
    turn = turned(vector(second, OMEGA), elapsed)
    removed = calibrate(total, imu, turn, elapsed, calibration, signals)
    still(total, averaged, variance, speeds, count, sticks)
    a, alpha = vector(total, SIGNALS), vector(total, SIGNALS + 3)
    # of the whole robot, ∂(inertial wrench)/∂a and ∂/∂α, and ∂b/∂q̈
    K, L, G = np.zeros((6, 3)), np.zeros((6, 3)), np.empty((6, 12))
    h, weight = (trunk[1], trunk[2], trunk[3]), trunk[0]
    inertia = ((trunk[4], trunk[5], trunk[6]), (trunk[5], trunk[7], trunk[8]), (trunk[6], trunk[8], trunk[9]))
    for axis in range(3):
        along, own = cross(h, UNIT[axis]), inertia[axis]
        K[axis, axis] = weight
        for c in range(3):
            K[3 + c, axis], L[c, axis], L[3 + c, axis] = along[c], -along[c], own[c]
    for c in range(6):
        for axis in range(3):
            # the regression errors see the trunk alone
            columns[c, places[16] + axis] = L[c, axis] * removed[axis]
            K[c, axis] -= 0.5 * (first[BY_A + 3 * c + axis] + second[BY_A + 3 * c + axis])
            L[c, axis] -= 0.5 * (first[BY_ALPHA + 3 * c + axis] + second[BY_ALPHA + 3 * c + axis])
        for j in range(12):
            G[c, j] = 0.5 * (first[BY_JOINTS + 12 * c + j] + second[BY_JOINTS + 12 * c + j])
    for c in range(6):
        alternating = -total[ALTERNATING + 12 + c]
        for j in range(10):
            value = 0.0
            for s in range(12):
                value += trunk_map[10 * c + j, s] * signals[s]
                alternating += trunk_map[10 * c + j, s] * total[ALTERNATING + s] * trunk[j]
            columns[c, j] = value
        columns[c, 10] = total[TARGET + c]
        columns[c, places[17]] = alternating
    # signs such that positive static friction lifts the trunk
    for j in range(12):
        at = BY_TERMS + 36 * j
        lifts = dot(vector(total, SIGNALS), vector(total, at + 18))
        sign = 1.0 if lifts > 0.0 else -1.0 if lifts < 0.0 else 0.0
        for c in range(6):
            moves = 1.0 - sticks[j]
            columns[c, places[0] + j] = -total[at + c] * moves
            columns[c, places[1] + j] = -total[at + 6 + c] * moves
            columns[c, places[2] + j] = -total[at + 12 + c] * moves
            columns[c, places[3] + j] = -total[at + 18 + c]
            columns[c, places[5] + j] = -total[at + 24 + c]
            columns[c, places[6] + j] = -total[at + 30 + c] * sign * sticks[j]
            columns[c, places[7] + j] = 0.5 * (first[MIDDLE + 24 * c + j] + second[MIDDLE + 24 * c + j])
            columns[c, places[8] + j] = -0.5 * (first[MIDDLE + 24 * c + 12 + j] + second[MIDDLE + 24 * c + 12 + j])
            by_link = BY_LINKS + 24 * j + c
            columns[c, places[9] + j] = -total[by_link]
            for axis in range(3):
                columns[c, places[10] + 12 * axis + j] = -total[by_link + 6 * (1 + axis)]
    xx, xy, xz, yy, yz, zz = (
        total[SIGNALS + 6],
        total[SIGNALS + 7],
        total[SIGNALS + 8],
        total[SIGNALS + 9],
        total[SIGNALS + 10],
        total[SIGNALS + 11],
    )
    for c in range(6):
        columns[c, places[4]] = total[BY_RATE + c]
        gain = late = 0.0
        for j in range(12):
            gain += columns[c, places[5] + j]
            late -= G[c, j] * total[JERK + j]
        for axis in range(3):
            late += L[c, axis] * total[JERK + 12 + axis]
        columns[c, places[15]] = gain
        columns[c, places[14]] = late
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
        from_gyro = plus(by_alpha, cross(by_a, vector(lever, 0)))
        for axis in range(3):
            columns[c, places[11] + axis] = -by_place[axis]
            columns[c, places[12] + axis] = by_turn[axis]
            columns[c, places[13] + axis] = -by_a[axis]
        by_velocity = 0.0
        for j in range(12):
            by_velocity += G[c, j] ** 2 * variance[12 + j]
        noise = total[SQUARED + c] + averaged * accelerometer * dot(by_a, by_a)
        white[c] = OVERLAP * noise + TELESCOPED * differentiated * (gyro * dot(from_gyro, from_gyro) + by_velocity)
    return elapsed
