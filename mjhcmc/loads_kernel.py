"""Measured forces on bodies, as MuJoCo takes them: force and torque about the centre of mass."""

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy", nogil=True)
def push(  # type: ignore[no-untyped-def]
    rows, first, at, ids, force, torque, point, ahead, roots, xpos, xmat, xipos, cvel, subtree_com
):  # fmt: skip
    """Fill the forces on bodies in rows (b, n_row), from column ``first``, six a body: force, then torque.

    torque = free torque + (point - centre of mass) x force, with the body, and whatever body a load is expressed in,
    where their velocities take them in ``ahead`` s.

    Args:
        rows: (b, n_row), changed.
        first: column.
        at: (b,) rows of MuJoCo's arrays.
        ids: (b, 3, k) body that is acted on (-1: none), body that force and torque are expressed in, body that the
            point is expressed in (0: the world).
        force: (b, k, 3) N.
        torque: (b, k, 3) N m.
        point: (b, k, 3) m.
        ahead: s.
        roots: (nbody,) root of each body's tree.
        xpos: (nsim, nbody, 3) m.
        xmat: (nsim, nbody, 9).
        xipos: (nsim, nbody, 3) m.
        cvel: (nsim, nbody, 6) rad/s and m/s, at the tree's centre of mass.
        subtree_com: (nsim, nbody, 3) m.
    """
    nbody = roots.size
    F, T, P, C, w = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for s in range(rows.shape[0]):
        row, k = rows[s], at[s]
        for c in range(first, first + 6 * nbody):
            row[c] = 0.0
        for i in range(ids.shape[2]):
            body = ids[s, 0, i]
            if body < 0:
                continue
            for c in range(3):
                F[c], T[c], P[c], C[c] = force[s, i, c], torque[s, i, c], point[s, i, c], xipos[k, body, c]
            frame = ids[s, 1, i]
            if frame > 0:
                _turn(xmat[k, frame], F)
                _turn(xmat[k, frame], T)
                for c in range(3):
                    w[c] = cvel[k, frame, c]
                _add_cross(F, w, F, ahead)
                _add_cross(T, w, T, ahead)
            frame = ids[s, 2, i]
            if frame > 0:
                _turn(xmat[k, frame], P)
                for c in range(3):
                    P[c] += xpos[k, frame, c]
                _go_on(P, cvel[k, frame], subtree_com[k, roots[frame]], ahead)
            _go_on(C, cvel[k, body], subtree_com[k, roots[body]], ahead)
            for c in range(3):
                w[c] = P[c] - C[c]
            _add_cross(T, w, F, 1.0)
            for c in range(3):
                row[first + 6 * body + c] += F[c]
                row[first + 6 * body + 3 + c] += T[c]


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def _turn(R, x):  # type: ignore[no-untyped-def]
    """Take x out of a body's frame, R (9,) its axes."""
    a, b, c = x[0], x[1], x[2]
    for i in range(3):
        x[i] = R[3 * i] * a + R[3 * i + 1] * b + R[3 * i + 2] * c


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def _add_cross(x, a, b, times):  # type: ignore[no-untyped-def]
    """Add times a x b to x."""
    p = a[1] * b[2] - a[2] * b[1]
    q = a[2] * b[0] - a[0] * b[2]
    r = a[0] * b[1] - a[1] * b[0]
    x[0] += times * p
    x[1] += times * q
    x[2] += times * r


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def _go_on(x, velocity, centre, ahead):  # type: ignore[no-untyped-def]
    """Move a point of a body on, along velocity (6,): turning, and that of the tree's centre of mass."""
    a, b, c = x[0] - centre[0], x[1] - centre[1], x[2] - centre[2]
    x[0] += ahead * (velocity[3] + velocity[1] * c - velocity[2] * b)
    x[1] += ahead * (velocity[4] + velocity[2] * a - velocity[0] * c)
    x[2] += ahead * (velocity[5] + velocity[0] * b - velocity[1] * a)
