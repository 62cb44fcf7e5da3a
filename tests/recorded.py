"""Solutions that nobody solved: nodes in given states."""

import numpy as np

import mjhcmc


def recorded(model, qpos, qvel=None, activation=0.0, reserve=None):
    """A solution whose nodes have these states, solved by nobody."""
    qpos = np.atleast_2d(np.asarray(qpos, dtype=float))
    n, zero = len(qpos), np.zeros((len(qpos), model.nv))
    qvel = zero if qvel is None else np.broadcast_to(qvel, zero.shape).astype(float)
    reserve = zero[1:] if reserve is None else np.broadcast_to(reserve, zero[1:].shape).astype(float)
    a = np.zeros((n, model.n_muscle)) + activation
    return mjhcmc.Solution(
        time=0.01 * np.arange(n), excitation=a[1:], activation=a, qpos=qpos, qpos_desired=qpos, qvel=qvel,
        tracking_error=zero, net_joint_moment=zero, external_load=zero, muscle_force=0 * a, reserve=reserve,
        shortfall=reserve, status=np.zeros(n - 1, dtype=int), muscle_names=model.muscle_names,
        dof_names=model.dof_names, dof_is_rotation=model.joint_is_rotation, settings={"dt": 0.01}, model=model,
    )  # fmt: skip


def reserve_at_nodes(solution):
    return np.vstack([solution.reserve, solution.reserve[-1:]])
