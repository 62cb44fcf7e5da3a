"""Dynamics of a chain on any scalar type: M(q) q'' + bias(q, q') + damping q' = torque, with MuJoCo's signs.

The bias is found by recursive Newton-Euler (Luh, Walker & Paul 1980, doi 10.1115/1.3149599), the mass matrix by
composite rigid bodies (Walker & Orin 1982, doi 10.1115/1.3139699), both on lists of scalars with ``+ - * /`` only, and
with sines and cosines of the hinge angles. Nothing branches on a value: complex steps and symbols pass through.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from mjhcmc.errors import SettingsError
from mjhcmc.exact.chain import Chain
from mjhcmc.exact.scalars import Number, Scalars
from mjhcmc.exact.vectors import (
    Mat,
    Vec,
    about,
    add,
    cross,
    dot,
    product,
    rotation,
    scale,
    subtract,
    times,
    transposed,
    unit,
)

__all__ = ["acceleration", "bias", "forward_dynamics", "inverse_dynamics", "mass_matrix", "solve", "total_energy"]

Numbers = Sequence[Number]


def mass_matrix(chain: Chain, q: Numbers, scalars: Scalars) -> Mat:
    """M(q) with armature, (n, n), kg m^2 (kg where a slide is met).

    Args:
        chain: n bodies.
        q: (n,) rad or m.
        scalars: the type to compute on; floats in q are converted, exactly.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        (x,) = _values(chain, scalars, q=q)
        numbers = numbers_of(chain, scalars)
        return _mass_matrix(numbers, _pose(numbers, x))


def bias(chain: Chain, q: Numbers, v: Numbers, scalars: Scalars) -> Vec:
    """Coriolis, centrifugal and gravity terms, MuJoCo's qfrc_bias, (n,) N m or N; damping is not in it.

    Args:
        chain: n bodies.
        q: (n,) rad or m.
        v: (n,) rad/s or m/s.
        scalars: the type to compute on.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        x, y = _values(chain, scalars, q=q, v=v)
        numbers = numbers_of(chain, scalars)
        return _newton_euler(numbers, _pose(numbers, x), y, None)


def inverse_dynamics(chain: Chain, q: Numbers, v: Numbers, a: Numbers, scalars: Scalars) -> Vec:
    """The torque that gives acceleration a: M a + bias + damping v, (n,) N m or N.

    Args:
        chain: n bodies.
        q: (n,) rad or m.
        v: (n,) rad/s or m/s.
        a: (n,) rad/s^2 or m/s^2.
        scalars: the type to compute on.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        x, y, z = _values(chain, scalars, q=q, v=v, a=a)
        numbers = numbers_of(chain, scalars)
        force = _newton_euler(numbers, _pose(numbers, x), y, z)
        return [force[i] + numbers.armature[i] * z[i] + numbers.damping[i] * y[i] for i in range(chain.n)]


def forward_dynamics(chain: Chain, q: Numbers, v: Numbers, torque: Numbers, scalars: Scalars) -> Vec:
    """The acceleration q'' under a torque, (n,) rad/s^2 or m/s^2.

    Args:
        chain: n bodies.
        q: (n,) rad or m.
        v: (n,) rad/s or m/s.
        torque: (n,) N m or N.
        scalars: the type to compute on.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        x, y, z = _values(chain, scalars, q=q, v=v, torque=torque)
        return acceleration(chain, scalars)(x, y, z)


def acceleration(chain: Chain, scalars: Scalars) -> Callable[[Numbers, Numbers, Numbers], Vec]:
    """`forward_dynamics` as a function of (q, v, torque) for loops, without checks, within `Scalars.working`."""
    numbers = numbers_of(chain, scalars)

    def of(q: Numbers, v: Numbers, torque: Numbers) -> Vec:
        pose = _pose(numbers, q)
        force = _newton_euler(numbers, pose, v, None)
        right = [torque[i] - force[i] - numbers.damping[i] * v[i] for i in range(len(q))]
        return solve(_mass_matrix(numbers, pose), right)

    return of


def total_energy(chain: Chain, q: Numbers, v: Numbers, scalars: Scalars) -> Number:
    """Kinetic (with armature) and potential energy, J; the latter is 0 where all is at the world's origin.

    Args:
        chain: n bodies.
        q: (n,) rad or m.
        v: (n,) rad/s or m/s.
        scalars: the type to compute on.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        x, y = _values(chain, scalars, q=q, v=v)
        k = numbers_of(chain, scalars)
        zero = scalars.number(0.0)
        energy = zero
        at: list[Vec] = []
        turn: list[Mat] = []
        spin: list[Vec] = []
        speed: list[Vec] = []
        for i, (E, r) in enumerate(_pose(k, x)):
            p = k.parent[i]
            if p < 0:
                where, axes, w, u = r, E, [zero] * 3, [zero] * 3
            else:
                where = add(at[p], times(turn[p], r))
                axes = product(turn[p], E)
                w, u = transposed(E, spin[p]), transposed(E, add(speed[p], cross(spin[p], r)))
            own = scale(k.axis[i], y[i])
            w, u = (w, add(u, own)) if k.is_slide[i] else (add(w, own), u)
            at.append(where)
            turn.append(axes)
            spin.append(w)
            speed.append(u)
            velocity = add(u, cross(w, k.com[i]))
            kinetic = k.mass[i] * dot(velocity, velocity) + dot(w, times(k.inertia[i], w))
            potential = k.mass[i] * dot(k.gravity, add(where, times(axes, k.com[i])))
            energy = energy + (kinetic + k.armature[i] * y[i] * y[i]) / 2 - potential
        return energy


def solve(matrix: Mat, right: Vec) -> Vec:
    """x of matrix x = right, for a symmetric positive definite matrix: L D L^T, no pivots, no roots."""
    n = len(right)
    L: Mat = [[0] * n for _ in range(n)]
    d: Vec = []
    x: Vec = []
    for i in range(n):
        scaled: Vec = []
        for j in range(i):
            s = matrix[i][j]
            for k in range(j):
                s = s - scaled[k] * L[j][k]
            scaled.append(s)
            L[i][j] = s / d[j]
        s, y = matrix[i][i], right[i]
        for k in range(i):
            s = s - scaled[k] * L[i][k]
            y = y - L[i][k] * x[k]
        d.append(s)
        x.append(y)
    x = [x[i] / d[i] for i in range(n)]
    for i in reversed(range(n)):
        for k in range(i + 1, n):
            x[i] = x[i] - L[k][i] * x[k]
    return x


@dataclass(frozen=True)
class Constants:
    """A chain's constants on a scalar type, in frames whose origins are the joints' anchors."""

    scalars: Scalars
    is_slide: tuple[bool, ...]
    parent: tuple[int, ...]
    rotation: list[Mat]
    offset: list[Vec]
    along: list[Vec]
    axis: list[Vec]
    mass: Vec
    com: list[Vec]
    inertia: list[Mat]
    armature: Vec
    damping: Vec
    reference: Vec
    gravity: Vec


@lru_cache(maxsize=32)
def numbers_of(chain: Chain, scalars: Scalars) -> Constants:
    """The chain's constants; axes and quaternions are normalised to all the type's digits."""
    number = scalars.number
    with scalars.working():

        def vector(values: Sequence[float]) -> Vec:
            return [number(value) for value in values]

        turned = [rotation(vector(quat)) for quat in chain.body_quaternion]
        axis = [unit(vector(values), scalars) for values in chain.joint_axis]
        anchor = [vector(values) for values in chain.joint_position]
        offset = []
        for i, p in enumerate(chain.parent):
            r = add(vector(chain.body_position[i]), times(turned[i], anchor[i]))
            offset.append(r if p < 0 else subtract(r, anchor[p]))
        return Constants(
            scalars=scalars,
            is_slide=chain.is_slide,
            parent=chain.parent,
            rotation=turned,
            offset=offset,
            along=[times(turned[i], axis[i]) for i in range(chain.n)],
            axis=axis,
            mass=vector(chain.mass),
            com=[subtract(vector(chain.com[i]), anchor[i]) for i in range(chain.n)],
            inertia=[[vector(row) for row in inertia] for inertia in chain.inertia],
            armature=vector(chain.armature),
            damping=vector(chain.damping),
            reference=vector(chain.reference),
            gravity=vector(chain.gravity),
        )


def _pose(k: Constants, q: Numbers) -> list[tuple[Mat, Vec]]:
    """Each body's rotation to its parent's axes, and its anchor from the parent's, in the parent's axes."""
    found = []
    for i in range(len(k.parent)):
        x = q[i] - k.reference[i]
        if k.is_slide[i]:
            found.append((k.rotation[i], add(k.offset[i], scale(k.along[i], x))))
        else:
            turn = about(k.axis[i], k.scalars.sin(x), k.scalars.cos(x))
            found.append((product(k.rotation[i], turn), k.offset[i]))
    return found


def _newton_euler(k: Constants, pose: list[tuple[Mat, Vec]], v: Numbers, a: Numbers | None) -> Vec:
    """Joint forces of the acceleration a (none: 0) without armature and damping."""
    n = len(pose)
    lift = [-g for g in k.gravity]
    spin: list[Vec] = []
    gain: list[Vec] = []
    lin: list[Vec] = []
    force: list[Vec] = []
    moment: list[Vec] = []
    for i, (E, r) in enumerate(pose):
        p, axis = k.parent[i], k.axis[i]
        own = scale(axis, v[i])
        push = None if a is None else scale(axis, a[i])
        if p < 0:
            at = transposed(E, lift)
            w, dw = ([0 * x for x in own], [0 * x for x in own])
        else:
            w, dw = transposed(E, spin[p]), transposed(E, gain[p])
            at = transposed(E, add(lin[p], _field(spin[p], gain[p], r)))
        if k.is_slide[i]:
            at = add(at, scale(cross(w, own), 2))
            at = at if push is None else add(at, push)
        else:
            dw = add(dw, cross(w, own))
            dw = dw if push is None else add(dw, push)
            w = add(w, own)
        spin.append(w)
        gain.append(dw)
        lin.append(at)
        f = scale(add(at, _field(w, dw, k.com[i])), k.mass[i])
        net = add(times(k.inertia[i], dw), cross(w, times(k.inertia[i], w)))
        force.append(f)
        moment.append(add(net, cross(k.com[i], f)))
    joint: Vec = [0] * n
    for i in reversed(range(n)):
        E, r = pose[i]
        joint[i] = dot(k.axis[i], force[i] if k.is_slide[i] else moment[i])
        p = k.parent[i]
        if p >= 0:
            f = times(E, force[i])
            force[p] = add(force[p], f)
            moment[p] = add(moment[p], add(times(E, moment[i]), cross(r, f)))
    return joint


def _mass_matrix(k: Constants, pose: list[tuple[Mat, Vec]]) -> Mat:
    """By composite bodies: mass, first moment and inertia about the anchor of each body and all that hangs from it."""
    n = len(pose)
    zero = k.scalars.number(0.0)
    mass = list(k.mass)
    first = [scale(k.com[i], k.mass[i]) for i in range(n)]
    second = [_shifted(k.inertia[i], first[i], k.com[i]) for i in range(n)]
    M: Mat = [[zero] * n for _ in range(n)]
    for i in reversed(range(n)):
        E, r = pose[i]
        axis, p = k.axis[i], k.parent[i]
        if k.is_slide[i]:
            f, torque = scale(axis, mass[i]), cross(first[i], axis)
            M[i][i] = dot(axis, f) + k.armature[i]
        else:
            f, torque = cross(axis, first[i]), times(second[i], axis)
            M[i][i] = dot(axis, torque) + k.armature[i]
        j, via = p, i
        while j >= 0:
            turn, arm = pose[via]
            f = times(turn, f)
            torque = add(times(turn, torque), cross(arm, f))
            M[i][j] = M[j][i] = dot(k.axis[j], f if k.is_slide[j] else torque)
            j, via = k.parent[j], j
        if p >= 0:
            h = times(E, first[i])
            J = product(product(E, second[i]), [list(column) for column in zip(*E, strict=True)])
            moved = scale(r, mass[i])
            mass[p] = mass[p] + mass[i]
            first[p] = add(first[p], add(h, moved))
            # about the parent's anchor: J + [terms of h and r] + m [terms of r and r]
            J = _shifted(_shifted(J, h, r), r, h)
            second[p] = [add(row, more) for row, more in zip(second[p], _shifted(J, moved, r), strict=True)]
    return M


def _shifted(J: Mat, h: Vec, r: Vec) -> Mat:
    """J + (h . r) 1 - h r^T."""
    s = dot(h, r)
    return [[J[i][j] + s - h[i] * r[j] if i == j else J[i][j] - h[i] * r[j] for j in range(3)] for i in range(3)]


def _field(w: Vec, dw: Vec, r: Vec) -> Vec:
    """Acceleration of a point at r in a body that turns: w' x r + w x (w x r)."""
    return add(cross(dw, r), cross(w, cross(w, r)))


def _values(chain: Chain, scalars: Scalars, **given: Numbers) -> list[Vec]:
    """What was given as this type's numbers; floats are converted, exactly."""
    for name, values in given.items():
        if len(values) != chain.n:
            raise SettingsError(f"{name} has {len(values)} values; chain {chain.name!r} has {chain.n} joints")
    return [to_numbers(values, scalars) for values in given.values()]


def to_numbers(values: Numbers, scalars: Scalars) -> Vec:
    """Floats, integers and decimal strings become this type's numbers; its own stay as they are."""
    return [scalars.number(x if isinstance(x, str) else float(x)) if _plain(x) else x for x in values]


def _plain(x: Number) -> bool:
    return isinstance(x, (str, int, float))  # numpy.float64 is a float
