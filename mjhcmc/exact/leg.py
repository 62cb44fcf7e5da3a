"""The planar leg in closed form: hinges in a row with parallel axes, on any scalar type.

Lagrange's equations in the segments' absolute angles theta (theta_i is the sum of the joint angles down to body i). In
the plane across the axes, with complex numbers for vectors, the centre of mass of body l is at
p_l = const + sum_k W_lk e^{i theta_k}: W_lk is the segment from joint k to joint k + 1 for k < l, to the centre of mass
for k = l, and 0 beyond. With K_ij = sum_l m_l conj(W_li) W_lj and G_i = sum_l m_l W_li:

    M_ij = Re(K_ij e^{i(theta_j - theta_i)}) + delta_ij I_i
         = a_ij cos(theta_j - theta_i) - b_ij sin(theta_j - theta_i) + delta_ij I_i,  K_ij = a_ij + i b_ij
    sum_j [M_ij theta_j'' - (a_ij sin(theta_j - theta_i) + b_ij cos(theta_j - theta_i)) theta_j'^2]
        - Re(conj(g) i G_i e^{i theta_i}) = Q_i

The joints' equations follow from theta = S q. Two ways to the same equations: `dynamics` knows no angles' sums, this no
recursion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from mjhcmc.errors import ModelError, SettingsError
from mjhcmc.exact.chain import Chain, chain_of
from mjhcmc.exact.dynamics import Numbers, numbers_of, solve, to_numbers
from mjhcmc.exact.scalars import Number, Scalars
from mjhcmc.exact.vectors import Mat, Vec, cross, dot, product, times

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

__all__ = ["PlanarLeg", "acceleration", "bias", "forward_dynamics", "inverse_dynamics", "mass_matrix", "planar_leg_of"]

_PARALLEL = 1e-12  # sine of the angle between axes that count as parallel


@dataclass(frozen=True)
class PlanarLeg:
    """Hinges in a row with parallel axes.

    Attributes:
        chain: the bodies and joints; see `planar_leg_of`.
    """

    chain: Chain

    @property
    def n(self) -> int:
        """Segments, which is joints."""
        return self.chain.n


def planar_leg_of(model: MuscleModel | Chain | Any) -> PlanarLeg:
    """The closed form of a model whose joints are hinges in a row with parallel axes.

    Args:
        model: a `MuscleModel`, a compiled ``mujoco.MjModel`` or a `Chain`.

    Raises:
        ModelError: a slide, a branch, an axis that is not parallel to the first; or as `chain.chain_of`.
    """
    chain = model if isinstance(model, Chain) else chain_of(model)
    turn = np.eye(3)
    first = np.zeros(3)
    for i, joint in enumerate(chain.joint_names):
        if chain.is_slide[i]:
            raise ModelError(f"chain {chain.name!r}: joint {joint!r} is a slide: the closed form needs hinges")
        if chain.parent[i] != i - 1:
            raise ModelError(
                f"chain {chain.name!r}: joint {joint!r} does not hang from the one before: the closed form needs a row"
            )
        turn = turn @ chain.body_rotation[i]
        axis = turn @ np.array(chain.joint_axis[i])
        axis /= np.linalg.norm(axis)
        first = axis if i == 0 else first
        off = float(np.linalg.norm(np.cross(first, axis)))
        if off > _PARALLEL:
            raise ModelError(
                f"chain {chain.name!r}: the axis of joint {joint!r} is {np.rad2deg(np.arcsin(min(off, 1.0))):.3g} deg "
                f"off that of {chain.joint_names[0]!r}: the closed form needs parallel axes; exact.dynamics does not"
            )
    return PlanarLeg(chain)


def mass_matrix(leg: PlanarLeg, q: Numbers, scalars: Scalars) -> Mat:
    """M(q) with armature, (n, n) kg m^2.

    Args:
        leg: n segments.
        q: (n,) rad.
        scalars: the type to compute on; floats in q are converted, exactly.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        (x,) = _values(leg, scalars, q=q)
        k = _constants(leg.chain, scalars)
        return _mass_matrix(k, *_turns(k, x))


def bias(leg: PlanarLeg, q: Numbers, v: Numbers, scalars: Scalars) -> Vec:
    """Centrifugal and gravity terms, MuJoCo's qfrc_bias, (n,) N m.

    Args:
        leg: n segments.
        q: (n,) rad.
        v: (n,) rad/s.
        scalars: the type to compute on.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        x, y = _values(leg, scalars, q=q, v=v)
        k = _constants(leg.chain, scalars)
        return _bias(k, *_turns(k, x), y)


def inverse_dynamics(leg: PlanarLeg, q: Numbers, v: Numbers, a: Numbers, scalars: Scalars) -> Vec:
    """The torque that gives acceleration a: M a + bias + damping v, (n,) N m.

    Args:
        leg: n segments.
        q: (n,) rad.
        v: (n,) rad/s.
        a: (n,) rad/s^2.
        scalars: the type to compute on.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        x, y, z = _values(leg, scalars, q=q, v=v, a=a)
        k = _constants(leg.chain, scalars)
        s, c = _turns(k, x)
        M, h = _mass_matrix(k, s, c), _bias(k, s, c, y)
        return [sum((M[i][j] * z[j] for j in range(leg.n)), h[i] + k.damping[i] * y[i]) for i in range(leg.n)]


def forward_dynamics(leg: PlanarLeg, q: Numbers, v: Numbers, torque: Numbers, scalars: Scalars) -> Vec:
    """The acceleration q'' under a torque, (n,) rad/s^2.

    Args:
        leg: n segments.
        q: (n,) rad.
        v: (n,) rad/s.
        torque: (n,) N m.
        scalars: the type to compute on.

    Raises:
        SettingsError: not n values.
    """
    with scalars.working():
        x, y, z = _values(leg, scalars, q=q, v=v, torque=torque)
        return acceleration(leg, scalars)(x, y, z)


def acceleration(leg: PlanarLeg, scalars: Scalars) -> Callable[[Numbers, Numbers, Numbers], Vec]:
    """`forward_dynamics` as a function of (q, v, torque) for loops, without checks, within `Scalars.working`."""
    k = _constants(leg.chain, scalars)

    def of(q: Numbers, v: Numbers, torque: Numbers) -> Vec:
        s, c = _turns(k, q)
        force = _bias(k, s, c, v)
        return solve(_mass_matrix(k, s, c), [torque[i] - force[i] - k.damping[i] * v[i] for i in range(k.n)])

    return of


@dataclass(frozen=True)
class _Constants:
    """K, G and I of the equations above, on a scalar type."""

    n: int
    scalars: Scalars
    sign: Vec
    even: Mat
    odd: Mat
    along: Vec
    across: Vec
    inertia: Vec
    armature: Vec
    damping: Vec
    reference: Vec


@lru_cache(maxsize=32)
def _constants(chain: Chain, scalars: Scalars) -> _Constants:
    number, n = scalars.number, chain.n
    with scalars.working():
        k = numbers_of(chain, scalars)
        one, zero = number(1.0), number(0.0)
        turn: Mat = [[one if i == j else zero for j in range(3)] for i in range(3)]
        plane: list[Vec] = []
        normal: Vec = []
        sign, inertia = [], []
        segment: list[tuple[Number, Number]] = []
        com: list[tuple[Number, Number]] = []
        for i in range(n):
            if i:
                segment.append(_in_plane(plane, times(turn, k.offset[i])))
            turn = product(turn, k.rotation[i])
            axis = times(turn, k.axis[i])
            if i == 0:
                normal = axis
                plane = _across(axis, scalars)
            back = np.dot([scalars.real(x) for x in axis], [scalars.real(x) for x in normal]) < 0
            sign.append(-one if back else one)
            com.append(_in_plane(plane, times(turn, k.com[i])))
            inertia.append(dot(k.axis[i], times(k.inertia[i], k.axis[i])))
        W = [[segment[j] if j < i else com[i] if j == i else (zero, zero) for j in range(n)] for i in range(n)]
        even = [[zero] * n for _ in range(n)]
        odd = [[zero] * n for _ in range(n)]
        along, across = [zero] * n, [zero] * n
        gx, gy = _in_plane(plane, list(k.gravity))
        for i in range(n):
            for j in range(n):
                for body in range(max(i, j), n):
                    (ax, ay), (bx, by), m = W[body][i], W[body][j], k.mass[body]
                    even[i][j] = even[i][j] + m * (ax * bx + ay * by)
                    odd[i][j] = odd[i][j] + m * (ax * by - ay * bx)
            for body in range(i, n):
                (wx, wy), m = W[body][i], k.mass[body]
                along[i] = along[i] + m * (gx * wx + gy * wy)
                across[i] = across[i] + m * (gx * wy - gy * wx)
        return _Constants(
            n, scalars, sign, even, odd, along, across, inertia, list(k.armature), list(k.damping), list(k.reference)
        )


def _turns(k: _Constants, q: Numbers) -> tuple[Vec, Vec]:
    """Sines and cosines of the segments' absolute angles."""
    s, c, theta = [], [], 0
    for i in range(k.n):
        theta = theta + k.sign[i] * (q[i] - k.reference[i])
        s.append(k.scalars.sin(theta))
        c.append(k.scalars.cos(theta))
    return s, c


def _mass_matrix(k: _Constants, s: Vec, c: Vec) -> Mat:
    n = k.n
    M: Mat = [[0] * n for _ in range(n)]
    for i in range(n):
        M[i][i] = k.even[i][i] + k.inertia[i]
        for j in range(i + 1, n):
            difference_c, difference_s = c[j] * c[i] + s[j] * s[i], s[j] * c[i] - c[j] * s[i]
            M[i][j] = M[j][i] = k.even[i][j] * difference_c - k.odd[i][j] * difference_s
    # S^T M S, S lower triangular of the signs: sums over all bodies beyond each joint
    for i in reversed(range(n - 1)):
        M[i] = [M[i][j] + M[i + 1][j] for j in range(n)]
    for j in reversed(range(n - 1)):
        for i in range(n):
            M[i][j] = M[i][j] + M[i][j + 1]
    return [[k.sign[i] * k.sign[j] * M[i][j] + (k.armature[i] if i == j else 0) for j in range(n)] for i in range(n)]


def _bias(k: _Constants, s: Vec, c: Vec, v: Numbers) -> Vec:
    n = k.n
    squares, speed = [], 0
    for i in range(n):
        speed = speed + k.sign[i] * v[i]
        squares.append(speed * speed)
    out: Vec = []
    for i in range(n):
        # -Re(conj(g) i G e^{i theta}), conj(g) G = along + i across
        force = k.along[i] * s[i] + k.across[i] * c[i]
        for j in range(n):
            if j != i:
                difference_c, difference_s = c[j] * c[i] + s[j] * s[i], s[j] * c[i] - c[j] * s[i]
                force = force - (k.even[i][j] * difference_s + k.odd[i][j] * difference_c) * squares[j]
        out.append(force)
    for i in reversed(range(n - 1)):
        out[i] = out[i] + out[i + 1]
    return [k.sign[i] * out[i] for i in range(n)]


def _across(axis: Vec, scalars: Scalars) -> list[Vec]:
    """Two unit vectors that with the axis make a right-handed frame."""
    sizes = [abs(scalars.real(x)) for x in axis]
    i = sizes.index(min(sizes))
    e = [(1 if j == i else 0) - axis[i] * axis[j] for j in range(3)]
    length = scalars.sqrt(dot(e, e))
    x = [part / length for part in e]
    return [x, cross(axis, x)]


def _in_plane(plane: list[Vec], a: Vec) -> tuple[Number, Number]:
    return dot(plane[0], a), dot(plane[1], a)


def _values(leg: PlanarLeg, scalars: Scalars, **given: Numbers) -> list[Vec]:
    for name, values in given.items():
        if len(values) != leg.n:
            raise SettingsError(f"{name} has {len(values)} values; leg {leg.chain.name!r} has {leg.n} joints")
    return [to_numbers(values, scalars) for values in given.values()]
