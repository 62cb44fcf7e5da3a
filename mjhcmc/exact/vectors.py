"""Vectors and 3 x 3 matrices as lists of scalars of any type."""

from __future__ import annotations

from collections.abc import Sequence

from mjhcmc.exact.scalars import Number, Scalars

Vec = list[Number]
Mat = list[Vec]


def about(axis: Vec, s: Number, c: Number) -> Mat:
    """Rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    u = 1 - c
    return [
        [c + x * x * u, x * y * u - z * s, x * z * u + y * s],
        [x * y * u + z * s, c + y * y * u, y * z * u - x * s],
        [x * z * u - y * s, y * z * u + x * s, c + z * z * u],
    ]


def rotation(quat: Vec) -> Mat:
    """Rotation matrix of a quaternion w x y z of any length."""
    w, x, y, z = quat
    k = 2 / (w * w + x * x + y * y + z * z)
    return [
        [1 - k * (y * y + z * z), k * (x * y - w * z), k * (x * z + w * y)],
        [k * (x * y + w * z), 1 - k * (x * x + z * z), k * (y * z - w * x)],
        [k * (x * z - w * y), k * (y * z + w * x), 1 - k * (x * x + y * y)],
    ]


def unit(a: Vec, scalars: Scalars) -> Vec:
    """Of length 1."""
    length = scalars.sqrt(dot(a, a))
    return [x / length for x in a]


def add(a: Sequence[Number], b: Sequence[Number]) -> Vec:
    """a + b."""
    return [a[0] + b[0], a[1] + b[1], a[2] + b[2]]


def subtract(a: Sequence[Number], b: Sequence[Number]) -> Vec:
    """a - b."""
    return [a[0] - b[0], a[1] - b[1], a[2] - b[2]]


def scale(a: Vec, s: Number) -> Vec:
    """s a."""
    return [a[0] * s, a[1] * s, a[2] * s]


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[Number], b: Sequence[Number]) -> Vec:
    """Vector product a x b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def times(A: Mat, b: Vec) -> Vec:
    """A b."""
    return [dot(A[0], b), dot(A[1], b), dot(A[2], b)]


def transposed(A: Mat, b: Vec) -> Vec:
    """A^T b."""
    return [A[0][i] * b[0] + A[1][i] * b[1] + A[2][i] * b[2] for i in range(3)]


def product(A: Mat, B: Mat) -> Mat:
    """A B."""
    columns = list(zip(*B, strict=True))
    return [[dot(row, column) for column in columns] for row in A]
