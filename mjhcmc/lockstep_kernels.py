"""Between MuJoCo's batch and dense matrices: states to look at, and what derived quantities there tell."""

import numba


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
