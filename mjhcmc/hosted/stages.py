"""Between MuJoCo's batch and Hill muscles: compiled, one simulation after the other."""

import numba
import numpy as np

from mjhcmc.activation import rate_of
from mjhcmc.hosted.muscle import COMPLIANT, compliant_force, fiber_velocity, gain_and_bias, rigid_fiber, rigid_force
from mjhcmc.lockstep_kernels import fill_inertia, fill_moment_arms
from mjhcmc.small_linear import solve_in_place

_NUDGE = 1e-6  # optimal fiber lengths, for slopes


@numba.njit(cache=True, error_model="numpy", nogil=True)
def pull(first, last, at, kind, curves, p, activation, fiber, length, velocity, moment, rownnz, rowadr, colind, rows, force, tau):  # type: ignore[no-untyped-def]  # fmt: skip  # noqa: E501
    """Fill the tendon forces of simulations first to last, and what they do at the joints.

    Args:
        first: of the simulations of the call.
        last: past the last one.
        at: (b,) where each stands in MuJoCo's batch.
        kind: the tendons.
        curves: see `hosted.curves`.
        p: (b, n, 6) muscles.
        activation: (b, n).
        fiber: (b, n) m, or (b, 0).
        length: (nsim, nu) m, MuJoCo's actuator lengths.
        velocity: (nsim, nu) m/s.
        moment: (nsim, nJ) MuJoCo's actuator moments, with rownnz, rowadr and colind.
        rownnz: see moment.
        rowadr: see moment.
        colind: see moment.
        rows: (n,) of the muscles among the actuators.
        force: (b, n) N, filled.
        tau: (b, nv) N m, filled.
    """
    for s in range(first, last):
        k = at[s]
        for j in range(tau.shape[1]):
            tau[s, j] = 0.0
        for i in range(rows.size):
            row = rows[i]
            L = length[k, row]
            if kind == COMPLIANT:
                force[s, i] = compliant_force(curves, p[s, i], fiber[s, i], L)
            else:
                force[s, i] = rigid_force(curves, p[s, i], activation[s, i], L, velocity[k, row])
            start = rowadr[k, row]
            for e in range(start, start + rownnz[k, row]):
                tau[s, colind[k, e]] -= moment[k, e] * force[s, i]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def accelerate(first, last, at, tau, packed, rownnz, rowadr, colind, n_constraint, qacc, out):  # type: ignore[no-untyped-def]
    """Fill out (b, nv): MuJoCo's qacc (nsim, nv), with M^-1 tau added where no constraint acts (else it is in qacc)."""
    nv = tau.shape[1]
    M, x = np.empty((nv, nv)), np.empty((nv, 1))
    for s in range(first, last):
        k = at[s]
        for j in range(nv):
            out[s, j] = qacc[k, j]
        if n_constraint[k] > 0:
            continue
        fill_inertia(packed[k], rownnz, rowadr, colind, M)
        for j in range(nv):
            x[j, 0] = tau[s, j]
        solve_in_place(M, x)
        for j in range(nv):
            out[s, j] += x[j, 0]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def advance_stage(  # type: ignore[no-untyped-def]
    first, last, at, stage, h, t0, q0, v0, w0, act, f0, kind, curves, p, prm, u, qacc, length, rows, start, now, total,
    state,
):  # fmt: skip
    """Take in one Runge-Kutta stage, and put the next one, or the step's end, into MuJoCo's rows and ours.

    Args:
        first: as `pull`, as the rest that is not named here.
        last: past the last one.
        at: (b,).
        stage: 0 to 3.
        h: s.
        t0: column of the time in a row.
        q0: column of the positions.
        v0: column of the velocities.
        w0: column of the constraint solver's start.
        act: (n,) columns of the activations.
        f0: column of the fibers in our rows.
        kind: the tendons.
        curves: see `hosted.curves`.
        p: (b, n, 6).
        prm: (b, n, 3) activation dynamics.
        u: (b, n) excitation.
        qacc: (b, nv) at this stage.
        length: (nsim, nu) m.
        rows: (n,).
        start: (b, n_row) at the step's start.
        now: (b, n_row) at this stage; becomes the next.
        total: (b, 2 nv + 2 n) weighted derivatives so far.
        state: (nsim, n_state) MuJoCo's rows.
    """
    nv, n, n_state = qacc.shape[1], rows.size, state.shape[1]
    weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
    ahead = h if stage == 2 else 0.5 * h
    for s in range(first, last):
        k = at[s]
        x, x0, sums = now[s], start[s], total[s]
        if stage == 0:
            for c in range(sums.size):
                sums[c] = 0.0
        for j in range(nv):
            v, a = x[v0 + j], qacc[s, j]
            sums[j] += weight * v
            sums[nv + j] += weight * a
            if stage < 3:
                x[q0 + j] = x0[q0 + j] + ahead * v
                x[v0 + j] = x0[v0 + j] + ahead * a
            else:
                x[q0 + j] = x0[q0 + j] + h * sums[j]
                x[v0 + j] = x0[v0 + j] + h * sums[nv + j]
            x[w0 + j] = a
        for i in range(n):
            c, a = 2 * nv + i, x[act[i]]
            rate = rate_of(a, u[s, i], prm[s, i, 0], prm[s, i, 1], prm[s, i, 2])
            sums[c] += weight * rate
            x[act[i]] = x0[act[i]] + (ahead * rate if stage < 3 else h * sums[c])
            if kind == COMPLIANT:
                d, f = c + n, f0 + i
                rate = fiber_velocity(curves, p[s, i], a, x[f], length[k, rows[i]])
                sums[d] += weight * rate
                x[f] = x0[f] + (ahead * rate if stage < 3 else h * sums[d])
        if stage == 3:
            x[t0] = x0[t0] + h
        for c in range(n_state):
            state[k, c] = x[c]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def muscles_at(kind, curves, p, activation, fiber, length, velocity, force, gain, bias, slopes):  # type: ignore[no-untyped-def]
    """Fill tendon force, gain and bias, and the slopes of force and fiber velocity, of n muscles.

    Args:
        kind: the tendons.
        curves: see `hosted.curves`.
        p: (n, 6).
        activation: (n,).
        fiber: (n,) m, of compliant muscles.
        length: (n,) m, of the musculotendons.
        velocity: (n,) m/s.
        force: (n,) N, filled.
        gain: (n,) N, filled, see `hosted.muscle.gain_and_bias`.
        bias: (n,) N, filled.
        slopes: (n, 4) filled: dF/dl (N/m), dF/dL (N/m), dv/dl (1/s), dv/dL (1/s); 0 where tendons are rigid.
    """
    for i in range(force.size):
        m, L, V, a = p[i], length[i], velocity[i], activation[i]
        for c in range(4):
            slopes[i, c] = 0.0
        if kind == COMPLIANT:
            l, step = fiber[i], _NUDGE * m[1]  # noqa: E741
            pulling, v = compliant_force(curves, m, l, L), fiber_velocity(curves, m, a, l, L)
            slopes[i, 0] = (compliant_force(curves, m, l + step, L) - pulling) / step
            slopes[i, 1] = (compliant_force(curves, m, l, L + step) - pulling) / step
            slopes[i, 2] = (fiber_velocity(curves, m, a, l + step, L) - v) / step
            slopes[i, 3] = (fiber_velocity(curves, m, a, l, L + step) - v) / step
        else:
            l = rigid_fiber(m, L)  # noqa: E741
            pulling = rigid_force(curves, m, a, L, V)
        force[i] = pulling
        gain[i], bias[i] = gain_and_bias(curves, m, l, L, V)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def read_muscles(  # type: ignore[no-untyped-def]
    first, last, at, kind, curves, p, activation, fiber, length, velocity, rows, path, force, gain, bias, slopes
):
    """Fill musculotendon length and velocity, path (b, n, 2), and what `muscles_at` tells, of simulations.

    The rest as `pull` and `muscles_at`.
    """
    L, V = np.empty(rows.size), np.empty(rows.size)
    for s in range(first, last):
        k = at[s]
        for i in range(rows.size):
            L[i], V[i] = length[k, rows[i]], velocity[k, rows[i]]
            path[s, i, 0], path[s, i, 1] = L[i], V[i]
        muscles_at(kind, curves, p[s], activation[s], fiber[s], L, V, force[s], gain[s], bias[s], slopes[s])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def read_slopes_around(  # type: ignore[no-untyped-def]
    ids, copies, step, packed, rownnz, rowadr, colind, moment, m_rownnz, m_rowadr, m_colind, rows, smooth, tau, M, R,
    slope,
):  # fmt: skip
    """Fill M and R at the first of each simulation's copies, and slope: minus the change of all smooth forces.

    tau (b copies, nv) is what the muscles do, in the order of the call; MuJoCo's arrays are those of all copies.
    """
    nv = M.shape[1]
    for s in range(ids.size):
        at, mine = ids[s] * copies, s * copies
        fill_inertia(packed[at], rownnz, rowadr, colind, M[s])
        fill_moment_arms(moment[at], m_rownnz[at], m_rowadr[at], m_colind[at], rows, R[s])
        for i in range(nv):
            for j in range(nv):
                other = smooth[at + copies - nv + j, i] + tau[mine + copies - nv + j, i]
                slope[s, i, j] = (smooth[at, i] + tau[mine, i] - other) / step
