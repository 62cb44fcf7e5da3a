"""Where bodies and tendons are in each frame of a solution, for what draws them by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.viewing.frames import Frames

Array = NDArray[np.float64]

_SHORT = 1e-7  # m: a shorter piece of a tendon has no direction


@dataclass(frozen=True, eq=False)
class Poses:
    """Bodies and tendons over frames.

    Tendons are straight pieces; a frame that has fewer than others has pieces of length 0.

    Attributes:
        body_position: (n, nbody, 3) m.
        body_quat: (n, nbody, 4).
        ghost_position: (n, nbody, 3) m, of the desired motion.
        ghost_quat: (n, nbody, 4).
        middle: (n, pieces, 3) m.
        quat: (n, pieces, 4) that turns z along the piece.
        length: (n, pieces) m.
        tendon: (n, pieces) which tendon each belongs to; -1: none.
        colour: (n, pieces, 3) 0 .. 255, see `Frames.tendon_rgba`.
    """

    body_position: Array
    body_quat: Array
    ghost_position: Array
    ghost_quat: Array
    middle: Array
    quat: Array
    length: Array
    tendon: NDArray[np.intp]
    colour: NDArray[np.uint8]

    @classmethod
    def of(cls, frames: Frames, magnified: float = 1.0, pieces: int = 0) -> Poses:
        """Of each frame.

        Args:
            frames: the solution's frames.
            magnified: how many times its distance from the model the ghost is away from it.
            pieces: at least so many of tendons.
        """
        n = len(frames)
        paths = [_pieces(frames.paths(k)) for k in range(n)]
        most = max(pieces, *(len(owner) for _, owner in paths), 0)
        ends, tendon = np.zeros((n, most, 2, 3)), np.full((n, most), -1, dtype=np.intp)
        colour = np.zeros((n, most, 3), dtype=np.uint8)
        for k, (own, owner) in enumerate(paths):
            ends[k, : len(owner)], tendon[k, : len(owner)] = own, owner
            colour[k, : len(owner)] = np.rint(255 * frames.tendon_rgba(k)[owner, :3])
        way = ends[:, :, 1] - ends[:, :, 0]
        length = np.linalg.norm(way, axis=-1)
        length[length < _SHORT] = 0.0
        bodies, ghost = _bodies(frames.model, frames.qpos), ghost_bodies(frames, magnified)
        return cls(*bodies, *ghost, ends.mean(axis=2), _from_z(way, length), length, tendon, colour)


def ghost_bodies(frames: Frames, magnified: float = 1.0) -> tuple[Array, Array]:
    """Positions (n, nbody, 3) m and quaternions (n, nbody, 4) of the desired motion, its distance magnified."""
    if magnified == 1:
        return _bodies(frames.model, frames.desired)
    m, away = frames.model, np.zeros(frames.model.nv)
    shown = np.array(frames.qpos)
    for row, desired in zip(shown, frames.desired, strict=True):
        mujoco.mj_differentiatePos(m, away, 1.0, row, desired)
        mujoco.mj_integratePos(m, row, away, magnified)
    return _bodies(m, shown)


def _bodies(model: Any, qpos: Array) -> tuple[Array, Array]:
    """Positions (n, nbody, 3) and quaternions (n, nbody, 4) at rows of qpos (n, nq)."""
    data = mujoco.MjData(model)
    position, quat = (np.empty((len(qpos), model.nbody, size)) for size in (3, 4))
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        position[k], quat[k] = data.xpos, data.xquat
    return position, quat


def _pieces(paths: tuple[Array, ...]) -> tuple[Array, NDArray[np.intp]]:
    """(k, 2, 3) ends of the straight pieces, and (k,) the tendons they belong to."""
    ends = [np.stack([path[:-1], path[1:]], axis=1) for path in paths]
    owner = np.repeat(np.arange(len(paths)), [len(own) for own in ends])
    together = np.concatenate(ends) if ends else np.zeros((0, 2, 3))
    whole = np.isfinite(together).all(axis=(1, 2))
    return together[whole], owner[whole].astype(np.intp)


def _from_z(way: Array, length: Array) -> Array:
    """Quaternions that turn the z axis along (..., 3), up or down: pieces look the same from both ends."""
    there = np.divide(way, length[..., None], out=np.zeros_like(way), where=length[..., None] > 0)
    there[length == 0] = (0.0, 0.0, 1.0)
    there[there[..., 2] < 0] *= -1
    x, y, z = np.moveaxis(there, -1, 0)
    quat = np.stack([1 + z, -y, x, np.zeros_like(z)], axis=-1)  # half way between z and there
    return np.asarray(quat / np.linalg.norm(quat, axis=-1, keepdims=True))
