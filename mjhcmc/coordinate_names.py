"""Which coordinates belong to which degrees of freedom, told by their names alone: no model is needed.

A hinge or slide has one of each, of the same name. A ball has the coordinates JOINT_qw, _qx, _qy, _qz (a unit
quaternion) and the degrees of freedom JOINT_rx, _ry, _rz; a free joint has JOINT_tx, _ty, _tz of both before those.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import OutputError

Array = NDArray[np.float64]

_QUATERNION, _TURN = ("_qw", "_qx", "_qy", "_qz"), ("_rx", "_ry", "_rz")


class NamedCoordinates:
    """Coordinates and degrees of freedom side by side; where there are as many of both, they go one by one.

    Args:
        coordinates: (nq,) names, in the order of qpos.
        dofs: (nv,) names, in the order of qvel.

    Raises:
        OutputError: they do not fit each other.
    """

    def __init__(self, coordinates: Sequence[str], dofs: Sequence[str]) -> None:
        one_by_one = list(range(len(dofs))) if len(coordinates) == len(dofs) else []
        scalar_q, scalar_v, turns = one_by_one.copy(), one_by_one.copy(), []
        i = j = len(one_by_one)
        while i < len(coordinates) or j < len(dofs):
            own, other = "".join(coordinates[i : i + 1]), "".join(dofs[j : j + 1])
            joint = other.removesuffix(_TURN[0])
            if own and own == other:
                scalar_q.append(i)
                scalar_v.append(j)
                i, j = i + 1, j + 1
            elif (
                tuple(coordinates[i : i + 4]) == tuple(joint + end for end in _QUATERNION)
                and tuple(dofs[j : j + 3]) == tuple(joint + end for end in _TURN)
            ):  # fmt: skip
                turns.append((i, j))
                i, j = i + 4, j + 3
            else:
                raise OutputError(
                    f"solution: coordinate {i + 1} is {_told(own)} and degree of freedom {j + 1} {_told(other)}, which "
                    "do not belong together: name both in the model's order"
                )
        self._q, self._v = np.array(scalar_q, dtype=np.intp), np.array(scalar_v, dtype=np.intp)
        self._turns, self._nv = turns, len(dofs)

    @property
    def flat(self) -> bool:
        """Whether there are no quaternions: coordinate j belongs to degree of freedom j."""
        return not self._turns

    def difference(self, to: Array, start: Array) -> Array:
        """(n, nv) the way from positions (n, nq) to positions (n, nq), as `Coordinates.difference`, bit for bit."""
        if self.flat:
            return to - start
        return self._along(to - start, to, start)

    def shown(self, qpos: Array, start: Array) -> Array:
        """(n, nv) rad or m: positions as a person sees them.

        Coordinates of hinges and slides as they are; balls by the turn from where they start, as rotation vectors (axis
        times angle, in the axes that the body has there).

        Args:
            qpos: (n, nq).
            start: (nq,) where balls start.
        """
        return qpos if self.flat else self._along(qpos, qpos, np.broadcast_to(start, qpos.shape))

    def _along(self, scalars: Array, to: Array, start: Array) -> Array:
        """(n, nv) with the scalar coordinates of the first, and turns from the last to the second."""
        import mujoco

        way, turn = np.empty((len(to), self._nv)), np.empty(3)
        way[:, self._v] = scalars[:, self._q]
        for i, j in self._turns:
            for k in range(len(to)):
                mujoco.mju_subQuat(turn, to[k, i : i + 4].copy(), start[k, i : i + 4].copy())
                way[k, j : j + 3] = turn
        return way


def _told(name: str) -> str:
    return repr(name) if name else "missing"
