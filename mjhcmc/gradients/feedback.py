"""The feedback gains of a window, and how they answer to where it begins; see `HcmcDriver._aim`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjhcmc.gradients.along import Nodes

Array = NDArray[np.float64]


class Gains(NamedTuple):
    """kp (nv,) 1/s^2 and kv (nv,) 1/s of a window, and their derivatives (nv, p)."""

    kp: Array
    kv: Array
    kp_slopes: Array
    kv_slopes: Array


class Errors(NamedTuple):
    """Desired less actual at a window's start, (nv,), and the derivatives of both, (nv, p)."""

    qpos: Array
    qvel: Array
    qpos_slopes: Array
    qvel_slopes: Array


def gains(
    nodes: Nodes,
    k: int,
    errors: Errors,
    start: tuple[Array, Array],
    least: tuple[Array, Array],
    authority: float,
    gain: float,
    h: float,
) -> Gains:
    """Differentiate the gains of the window that begins at a node.

    Args:
        nodes: along the solution.
        k: the node.
        errors: there.
        start: (nv, p) tangents of position and velocity there.
        least: (nv,) acceleration that feedback may ask for in any case, and its derivative (nv, p).
        authority: see `hcmc`.
        gain: likewise.
        h: s, the window.
    """
    M, B = nodes.M[k], nodes.B[k]
    nv, p = errors.qpos_slopes.shape
    reach = np.linalg.solve(M, B)
    up, down = np.maximum(reach, 0).sum(axis=1), np.maximum(-reach, 0).sum(axis=1)
    weaker = np.where(up <= down, 1.0, -1.0)
    alpha = np.maximum(authority * np.minimum(up, down), least[0])
    e, rate = np.abs(errors.qpos), np.abs(errors.qvel)
    root = np.sqrt(rate**2 + alpha * e)
    denominator = rate + root
    with np.errstate(divide="ignore", invalid="ignore"):
        limited = (denominator > 0) & (alpha > 0) & (alpha / denominator < gain / h)
    w, damped = np.full(nv, gain / h), np.full(nv, 1 - gain / 6)
    w_slopes = np.zeros((nv, p))
    if limited.any():
        w[limited], damped[limited] = (alpha / np.where(limited, denominator, 1.0))[limited], 1.0
        both = np.vstack(start)

        def total(slopes: Array) -> Array:
            return np.asarray(slopes[..., : 2 * nv] @ both + slopes[..., 2 * nv :])

        turned = np.linalg.solve(
            M, (total(nodes.B_slopes[k]) - np.einsum("jic,im->jmc", total(nodes.M_slopes[k]), reach)).reshape(nv, -1)
        ).reshape(nv, B.shape[1], p)  # fmt: skip
        counts = weaker[:, None] * reach > 0
        alpha_slopes = authority * weaker[:, None] * (turned * counts[:, :, None]).sum(axis=1)
        by_least = authority * np.minimum(up, down) < least[0]
        alpha_slopes[by_least] = least[1][by_least]
        e_slopes = np.sign(errors.qpos)[:, None] * errors.qpos_slopes
        rate_slopes = np.sign(errors.qvel)[:, None] * errors.qvel_slopes
        safe = np.where(root > 0, root, 1.0)[:, None]
        root_slopes = (
            2 * rate[:, None] * rate_slopes + alpha_slopes * e[:, None] + alpha[:, None] * e_slopes
        ) / (2 * safe)  # fmt: skip
        denominator_slopes = rate_slopes + root_slopes
        found = (alpha_slopes - w[:, None] * denominator_slopes) / np.where(limited, denominator, 1.0)[:, None]
        w_slopes[limited] = found[limited]
    return Gains(w**2, 2 * w * damped, 2 * w[:, None] * w_slopes, 2 * damped[:, None] * w_slopes)
