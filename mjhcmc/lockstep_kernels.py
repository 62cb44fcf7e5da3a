"""Between MuJoCo's batch and dense matrices: states to look at, and what derived quantities there tell."""

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def fill_inertia(packed, rownnz, rowadr, colind, M):  # type: ignore[no-untyped-def]
    """Fill M (nv, nv), symmetric, from its lower triangle in MuJoCo's rows, packed (nM)."""
    for i in range(rownnz.size):
        for k in range(rownnz.size):
            M[i, k] = 0.0
    for i in range(rownnz.size):
        for k in range(rowadr[i], rowadr[i] + rownnz[i]):
            M[i, colind[k]] = M[colind[k], i] = packed[k]


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def fill_moment_arms(moment, rownnz, rowadr, colind, rows, R):  # type: ignore[no-untyped-def]
    """Fill R (n_muscle, nv), -dL/dq, from rows of MuJoCo's actuator_moment (nJ), which is +dL/dq."""
    for i in range(rows.size):
        row = rows[i]
        for j in range(R.shape[1]):
            R[i, j] = 0.0
        for k in range(rowadr[row], rowadr[row] + rownnz[row]):
            R[i, colind[k]] = -moment[k]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def fill_nodes(packed, rownnz, rowadr, colind, moment, m_rownnz, m_rowadr, m_colind, rows, M, R):  # type: ignore[no-untyped-def]
    """Fill M (k, nv, nv) and R (k, n_muscle, nv) of several states."""
    for s in range(M.shape[0]):
        fill_inertia(packed[s], rownnz, rowadr, colind, M[s])
        fill_moment_arms(moment[s], m_rownnz[s], m_rowadr[s], m_colind[s], rows, R[s])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def put_around(probe, ids, start, activation, first, nv, step):  # type: ignore[no-untyped-def]
    """Put states to look at into a probe, 2 + nv rows a simulation.

    The start; it with activations far from those there; and it with each of nv columns from ``first`` a step further.

    Args:
        probe: (count (2 + nv), n_row) the rows.
        ids: (b,) the simulations.
        start: (b, n_row) their states.
        activation: (n_muscle,) columns.
        first: column.
        nv: number of columns.
        step: of a position or velocity.
    """
    for s in range(ids.size):
        row = ids[s] * (2 + nv)
        for c in range(2 + nv):
            for i in range(start.shape[1]):
                probe[row + c, i] = start[s, i]
            if c > 1:
                probe[row + c, first + c - 2] += step
        for i in activation:
            probe[row + 1, i] = 1.0 if start[s, i] < 0.5 else 0.0


@numba.njit(cache=True, error_model="numpy", nogil=True)
def read_around(  # type: ignore[no-untyped-def]
    probe, ids, activation, step, all_qacc, packed, rownnz, rowadr, colind, moment, m_rownnz, m_rowadr, m_colind, rows,
    actuator_force, smooth, qacc, M, B, gain, bias, D,
):  # fmt: skip
    """Fill what a probe tells of the simulations ids, see `lockstep.Linearization`."""
    nv, n = B.shape[1:]
    for s in range(ids.size):
        at = ids[s] * (2 + nv)
        fill_inertia(packed[at], rownnz, rowadr, colind, M[s])
        for i in range(n):
            # force is affine in activation: a second one, far enough away, gives gain and bias
            a, other = probe[at, activation[i]], probe[at + 1, activation[i]]
            force = -actuator_force[at, rows[i]]
            gain[s, i] = (-actuator_force[at + 1, rows[i]] - force) / (other - a)
            bias[s, i] = force - gain[s, i] * a
            row = rows[i]
            for j in range(nv):
                B[s, j, i] = 0.0
            for k in range(m_rowadr[at, row], m_rowadr[at, row] + m_rownnz[at, row]):
                B[s, m_colind[at, k], i] = -moment[at, k] * gain[s, i]
        for i in range(nv):
            qacc[s, i] = all_qacc[at, i]
            for j in range(nv):
                D[s, i, j] = (smooth[at, i] - smooth[at + 2 + j, i]) / step


@numba.njit(cache=True, error_model="numpy", nogil=True)
def read_slopes(ids, step, smooth, K):  # type: ignore[no-untyped-def]
    """Fill K (b, nv, nv), minus the change of the smooth forces with a step of each position."""
    nv = K.shape[1]
    for s in range(ids.size):
        at = ids[s] * (2 + nv)
        for i in range(nv):
            for j in range(nv):
                K[s, i, j] = (smooth[at, i] - smooth[at + 2 + j, i]) / step


@numba.njit(cache=True, error_model="numpy", nogil=True)
def put_beside(probe, ids, start, activation, q0, v0, change, qpos):  # type: ignore[no-untyped-def]
    """Put states beside each of b into a probe, four rows a simulation: of a large model there are no more.

    One with activations far from those there; one with another velocity; one with another position, where asked for;
    and the state itself.

    Args:
        probe: (4 count, n_row) the rows.
        ids: (b,) the simulations.
        start: (b, n_row) their states.
        activation: (n_muscle,) columns.
        q0: column of the positions.
        v0: column of the velocities.
        change: (nv,) of the velocities.
        qpos: (b, nq) the other positions; (0, nq): not asked for.
    """
    for s in range(ids.size):
        row = 4 * ids[s]
        for c in range(4):
            for i in range(start.shape[1]):
                probe[row + c, i] = start[s, i]
        for i in activation:
            probe[row, i] = 1.0 if start[s, i] < 0.5 else 0.0
        for j in range(change.size):
            probe[row + 1, v0 + j] += change[j]
        if len(qpos):
            for j in range(qpos.shape[1]):
                probe[row + 2, q0 + j] = qpos[s, j]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def read_beside(  # type: ignore[no-untyped-def]
    start, ids, activation, packed, rownnz, rowadr, colind, moment, m_rownnz, m_rowadr, m_colind, rows, force, length,
    velocity, beside_force, beside_length, beside_velocity, qvel, damping, damping_poly, stiff, stiffness, qacc,
    all_qacc, M, B, gain, bias, D, K,
):  # fmt: skip
    """Fill what states beside those of the simulations ids tell, see `lockstep.Linearization`.

    An actuator's force depends on velocities and positions through its own velocity and length: one state beside gives
    the slopes of all. D = sum dF/dV R'R + damping of the joints, K = sum dF/dL R'R + stiffness of the joints; how the
    bodies' own velocities and moment arms change is left out.
    """
    nv, n = B.shape[1:]
    full = np.empty(nv)
    for s in range(ids.size):
        k, at = ids[s], 4 * ids[s]
        fill_inertia(packed[k], rownnz, rowadr, colind, M[s])
        for i in range(nv):
            qacc[s, i] = all_qacc[k, i]
            for j in range(nv):
                D[s, i, j] = 0.0
                if stiffness:
                    K[s, i, j] = 0.0
            v = qvel[s, i]
            D[s, i, i] = damping[i] + 2.0 * damping_poly[i, 0] * abs(v) + 3.0 * damping_poly[i, 1] * v * v
            if stiffness:
                K[s, i, i] = stiff[i]
        for i in range(n):
            row = rows[i]
            a = start[s, activation[i]]
            other = 1.0 if a < 0.5 else 0.0
            pull = -force[k, row]
            gain[s, i] = (-beside_force[at, row] - pull) / (other - a)
            bias[s, i] = pull - gain[s, i] * a
            for j in range(nv):
                B[s, j, i] = 0.0
            for e in range(m_rowadr[k, row], m_rowadr[k, row] + m_rownnz[k, row]):
                B[s, m_colind[k, e], i] = -moment[k, e] * gain[s, i]
        for row in range(force.shape[1]):
            first, last = m_rowadr[k, row], m_rowadr[k, row] + m_rownnz[k, row]
            change = beside_velocity[at + 1, row] - velocity[k, row]
            slope = 0.0 if abs(change) < 1e-12 else (force[k, row] - beside_force[at + 1, row]) / change
            tight = 0.0
            if stiffness:
                change = beside_length[at + 2, row] - length[k, row]
                tight = 0.0 if abs(change) < 1e-12 else (force[k, row] - beside_force[at + 2, row]) / change
            if slope == 0.0 and tight == 0.0:
                continue
            for e in range(first, last):
                full[m_colind[k, e]] = moment[k, e]
            for e in range(first, last):
                i = m_colind[k, e]
                for f in range(first, last):
                    j = m_colind[k, f]
                    D[s, i, j] += slope * full[i] * full[j]
                    if stiffness:
                        K[s, i, j] += tight * full[i] * full[j]
