"""The source's sliding knee, as a fixed hinge or as slides that follow the knee's angle by polynomials.

MuJoCo ties a joint to another by a polynomial of the fourth degree at most, and one such polynomial cannot follow the
bends of the knee's splines closely enough for their second derivatives, which accelerate the shank. So the forward
slide is split in two: one follows the knee's angle by a polynomial, the other follows a third slide (the cam) that
follows the knee's angle in its turn. The cam shifts the shank up, and the upward slide takes that back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]

KNEE_SLIDES: tuple[str, ...] = ("knee_tx", "knee_ty", "knee_cam", "knee_tx_cam")
"""The slides of a moving knee: forward, up, up, forward in the thigh. The last follows the third, the others the knee.

The tibia's place is the sum: forward knee_tx + knee_tx_cam, up knee_ty + knee_cam.
"""

_CAM_START = (-3.3, -3.8, -1.0)  # near the optimum for gait10dof18musc's knee, which scaling does not move
_CAM_REACH = 0.005  # the cam's farthest way from its place at zero angle, m
# What deviations (m), and those of the first and second derivatives (m/rad, m/rad^2), weigh: about the force per mass
# of the shank that they cost, by gravity, by the load of stance, and by the squared knee velocity of walking.
_WEIGHTS = (10.0, 130.0, 10.0)
_MARGIN = math.radians(2.0)  # that a knee may be bent beyond its range, against its soft limits
_STEP = 1e-3  # of the difference quotients, rad

KneePath = Callable[[Array], Array]
"""Place of the tibia's origin in the femur (n, 3), m, at knee angles (n,), rad."""


@dataclass(frozen=True)
class KneeMotion:
    """A sliding knee as four polynomials.

    Attributes:
        place: Where the tibia's origin is in the femur at zero angle (x, y, z), m.
        coefficients: For each of `KNEE_SLIDES`, those of the first to the fourth power of what it follows, m.
    """

    place: tuple[float, float, float]
    coefficients: tuple[tuple[float, ...], ...]

    def path(self, angle: Array) -> Array:
        """Where the polynomials put the tibia's origin in the femur at knee angles (n,), rad: (n, 2), x and y, m."""
        forward, up, cam, rest = (Polynomial([0.0, *own]) for own in self.coefficients)
        moved = cam(angle)
        place = np.asarray(self.place[:2])
        path: Array = place + np.stack([forward(angle) + rest(moved), up(angle) + moved], axis=1)
        return path


def fit_knee_motion(path: KneePath, low: float, high: float) -> KneeMotion:
    """Fit the four polynomials to a sliding knee.

    Least squares over place, first and second derivative by the knee's angle; linear, but for the cam's shape.

    Args:
        path: Where the tibia's origin is in the femur.
        low: Lower end of the knee's range, rad.
        high: Upper end of the knee's range, rad.
    """
    from scipy.optimize import least_squares

    angle = np.linspace(low - _MARGIN, high + _MARGIN, 281)
    before, at, after = (path(angle + shift)[:, :2] for shift in (-_STEP, 0.0, _STEP))
    target = np.concatenate([at, (after - before) / (2 * _STEP), (after - 2 * at + before) / _STEP**2])
    weight = np.repeat(_WEIGHTS, len(angle))[:, None]
    powers = _rows(Polynomial([0.0, 1.0]), angle)

    def cam(shape: Sequence[float]) -> Polynomial:
        own = Polynomial([0.0, 1.0, *shape])
        return Polynomial(own.coef * (_CAM_REACH / np.abs(own(angle)).max()))

    def basis(shape: Sequence[float]) -> Array:
        rows = _rows(Polynomial(np.asarray(cam(shape).coef, float) / _CAM_REACH), angle)
        return np.asarray(np.concatenate([powers, rows[:, 1:]], axis=1) * weight)

    def solve(shape: Sequence[float]) -> tuple[Array, Array]:
        rows, wanted = basis(shape), target[:, 0] * weight[:, 0]
        found = np.linalg.lstsq(rows, wanted, rcond=1e-12)[0]
        return found, rows @ found - wanted

    best = least_squares(lambda shape: solve(shape)[1], _CAM_START, max_nfev=100)
    forward, moved = solve(best.x)[0], cam(best.x)
    up = np.linalg.lstsq(powers * weight, target[:, 1] * weight[:, 0], rcond=None)[0]
    rest = forward[5:] / _CAM_REACH ** np.arange(1, 5)
    place = (float(forward[0]), float(up[0]), float(path(np.zeros(1))[0, 2]))
    coefficients = (forward[1:5], up[1:] - moved.coef[1:], moved.coef[1:], rest)
    return KneeMotion(place, tuple(tuple(float(value) for value in own) for own in coefficients))


def _rows(argument: Polynomial, angle: Array) -> Array:
    """Powers 0 to 4 of a polynomial of the angle, under them their first and their second derivatives."""
    columns = [argument**power for power in range(5)]
    return np.concatenate([np.stack([c.deriv(order)(angle) for c in columns], axis=1) for order in range(3)])


def fit_knee_axis(path: KneePath, low: float, high: float) -> tuple[float, float, float]:
    """The fixed hinge's place in the femur (x, y, z), m, about which the shank moves most nearly as the sliding knee's.

    Least squares over the deviation of the shank's place and its derivative by the knee's angle; linear.

    Args:
        path: Where the tibia's origin is in the femur.
        low: Lower end of the angles that matter, rad.
        high: Upper end of them, rad.
    """
    angle = np.linspace(low, high, 181)
    zero = path(np.zeros(1))[0]
    before, at, after = (path(angle + shift)[:, :2] for shift in (-_STEP, 0.0, _STEP))
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    slope = np.array([[-sine, -cosine], [cosine, -sine]])
    # A hinge at c puts the tibia's origin at c + R(angle) (zero - c).
    rows, wanted = [], []
    for matrix, unit, goal in ((turn, np.eye(2), at), (slope, np.zeros((2, 2)), (after - before) / (2 * _STEP))):
        rows.append((unit[:, :, None] - matrix).transpose(2, 0, 1).reshape(-1, 2))
        wanted.append((goal - np.einsum("ijn,j->ni", matrix, zero[:2])).ravel())
    x, y = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=None)[0]
    return float(x), float(y), float(zero[2])
