"""Roles: what each degree of freedom is to a solve - tracked, dependent, prescribed or free."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError

_POSES = 4  # looked at for moment arms: the reference pose and some drawn within the joints' ranges
_ARM = 1e-9  # m: a shorter moment arm is none
_WIDE = 1.0  # rad or m, to either side, where a joint has no range


class Role(StrEnum):
    """What a degree of freedom is to a solve."""

    TRACKED = "tracked"
    DEPENDENT = "dependent"
    PRESCRIBED = "prescribed"
    FREE = "free"

    @property
    def meaning(self) -> str:
        """In words."""
        return _MEANINGS[self]


_MEANINGS = {
    Role.TRACKED: "follows the motion by its muscles, and reserves where they do not suffice",
    Role.DEPENDENT: "an equality constraint ties it to others",
    Role.PRESCRIBED: "moved along the motion whatever it takes; that force is reported as residual",
    Role.FREE: "nothing leads it: it moves as the forces on it say",
}


@dataclass(frozen=True, eq=False)
class Roles:
    """The role of each degree of freedom.

    Attributes:
        of: (nv,) the roles, in the order of the degrees of freedom.
        is_root: (nv,) True between the world and the first joint that muscles move.
        follows: of dependent degrees of freedom, those that they follow in the reference pose, for messages.
        tracked: (nz,) indices of those that are tracked.
        dependent: (nd,) of those that are dependent.
        prescribed: (np,) of those that are prescribed.
        free: (nf,) of those that are free.
    """

    of: tuple[Role, ...]
    is_root: NDArray[np.bool_]
    follows: Mapping[int, tuple[int, ...]] = field(default_factory=dict)

    def _which(self, role: Role) -> NDArray[np.intp]:
        return np.flatnonzero([own == role for own in self.of]).astype(np.intp)

    def __post_init__(self) -> None:
        """Sort the degrees of freedom by role."""
        for role in Role:
            object.__setattr__(self, role.value, self._which(role))

    tracked: NDArray[np.intp] = None  # type: ignore[assignment]
    dependent: NDArray[np.intp] = None  # type: ignore[assignment]
    prescribed: NDArray[np.intp] = None  # type: ignore[assignment]
    free: NDArray[np.intp] = None  # type: ignore[assignment]

    @property
    def all_tracked(self) -> bool:
        """Whether there is nothing but tracked degrees of freedom."""
        return len(self.tracked) == len(self.of)

    def changed(self, changes: Mapping[Role, Iterable[int]]) -> Roles:
        """The same with other roles for some degrees of freedom."""
        of = list(self.of)
        for role, dofs in changes.items():
            for i in dofs:
                of[i] = role
        return Roles(tuple(of), self.is_root, self.follows)


def find_roles(m: Any, muscles: NDArray[np.intp]) -> Roles:
    """The roles that follow from a compiled model.

    Dependent is the first joint of each active joint equality, and for other equalities (tendon, connect, weld) as many
    degrees of freedom as they take away, preferably such that no muscle moves. The bodies between the world and the
    first joint that a muscle moves are the root: its joints are prescribed. Degrees of freedom of trees that no muscle
    moves at all are free. The rest is tracked.

    Args:
        m: a ``mujoco.MjModel``.
        muscles: (n_muscle,) actuator index of each muscle.
    """
    moved = moved_by_muscles(m, muscles)
    dependent = list(dependent_dofs(m, moved, _root(m, moved)))
    if dependent:  # what is tied to a joint moves it, too
        moved = moved_by_muscles(m, muscles, dependent)
    roles = [Role.TRACKED] * m.nv
    trees = _together(m, dependent)
    root = _root(m, moved)
    for i in range(m.nv):
        if not moved[trees == trees[i]].any():
            roles[i] = Role.FREE
        elif root[i]:
            roles[i] = Role.PRESCRIBED
    for i in dependent:
        roles[i] = Role.DEPENDENT
        root[i] = False
    return Roles(tuple(roles), root, _follows(m, dependent))


def _follows(m: Any, dependent: Sequence[int]) -> dict[int, tuple[int, ...]]:
    """The independent degrees of freedom that move each dependent one, in the reference pose."""
    if not dependent:
        return {}
    J, others = equality_jacobian(*_at_reference(m)), np.setdiff1d(np.arange(m.nv), dependent)
    share = np.linalg.lstsq(J[:, dependent], J[:, others], rcond=None)[0]
    return {i: tuple(others[np.abs(row) > _ARM].tolist()) for i, row in zip(dependent, share, strict=True)}


def moved_by_muscles(m: Any, muscles: NDArray[np.intp], dependent: Sequence[int] = ()) -> NDArray[np.bool_]:
    """(nv,) True where some muscle has a moment arm, in the reference pose or one of a few others.

    Args:
        m: a ``mujoco.MjModel``.
        muscles: (n_muscle,) actuator index of each muscle.
        dependent: degrees of freedom whose moment arms count at those that move them.
    """
    d = mujoco.MjData(m)
    rng = np.random.default_rng(0)
    dense, moved = np.empty((m.nout, m.nv)), np.zeros(m.nv, dtype=bool)
    rows = m.actuator_outadr[muscles]
    scalar = np.isin(m.jnt_type, [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)])
    at = m.jnt_qposadr[scalar]
    limited = m.jnt_limited[scalar].astype(bool)
    low = np.where(limited, m.jnt_range[scalar, 0], m.qpos0[at] - _WIDE)
    high = np.where(limited, m.jnt_range[scalar, 1], m.qpos0[at] + _WIDE)
    for pose in range(_POSES):
        d.qpos[:] = m.qpos0
        if pose:
            d.qpos[at] = rng.uniform(low, high)
        mujoco.mj_fwdPosition(m, d)
        mujoco.mju_sparse2dense(dense, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
        arms = dense[rows]
        if len(dependent):
            J, others = equality_jacobian(m, d), np.setdiff1d(np.arange(m.nv), dependent)
            arms[:, others] -= arms[:, dependent] @ np.linalg.lstsq(J[:, dependent], J[:, others], rcond=None)[0]
        moved |= (np.abs(arms) > _ARM).any(axis=0)
    return moved


def _together(m: Any, dependent: Sequence[int]) -> NDArray[np.intp]:
    """(nv,) a number for the tree of each degree of freedom, one for trees that equalities tie to each other."""
    trees: NDArray[np.intp] = m.dof_treeid.astype(np.intp)
    if len(dependent):
        for row in equality_jacobian(*_at_reference(m)):
            tied = np.unique(trees[np.abs(row) > 0])
            trees[np.isin(trees, tied)] = tied.min(initial=0)
    return trees


def _root(m: Any, moved: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(nv,) True for the joints of bodies above which, up to the world, and at which no muscle acts."""
    root = np.zeros(m.nv, dtype=bool)
    clean = np.zeros(m.nbody, dtype=bool)
    clean[0] = True
    for b in range(1, m.nbody):  # parents come first
        dofs = np.arange(m.body_dofadr[b], m.body_dofadr[b] + m.body_dofnum[b])
        clean[b] = clean[m.body_parentid[b]] and not moved[dofs].any()
        if clean[b] and _carries(m, b, moved):
            root[dofs] = True
    return root


def _carries(m: Any, body: int, moved: NDArray[np.bool_]) -> bool:
    """Whether muscles move something beyond a body."""
    below = np.zeros(m.nbody, dtype=bool)
    below[body] = True
    for b in range(body + 1, m.nbody):
        below[b] = below[m.body_parentid[b]]
    return bool(moved[below[m.dof_bodyid]].any())


def dependent_dofs(m: Any, moved: NDArray[np.bool_], root: NDArray[np.bool_]) -> Iterator[int]:
    """The degrees of freedom that active equalities take away; see `find_roles`."""
    active = np.flatnonzero(m.eq_active0)
    if not active.size:
        return
    taken: list[int] = []
    for e in active[m.eq_type[active] == int(mujoco.mjtEq.mjEQ_JOINT)]:
        dof = int(m.jnt_dofadr[m.eq_obj1id[e]])
        if dof not in taken:
            taken.append(dof)
    J = equality_jacobian(*_at_reference(m))
    # what is left of the rows when the joint equalities are met
    rank = int(np.linalg.matrix_rank(J)) if J.size else 0
    if len(taken) < rank:
        from scipy.linalg import qr

        driven = np.isin(m.dof_treeid, m.dof_treeid[moved])  # what is held by a limb goes with it, not the limb with it
        weight = np.where(root, 1e-6, np.where(moved, 1.0, np.where(driven, 1e3, 1e6)))
        weight[taken] = 0.0
        basis = np.linalg.qr(J[:, taken], mode="complete")[0] if taken else np.eye(len(J))
        left = basis[:, len(taken) :].T @ J
        order = qr(left * weight, mode="r", pivoting=True)[1]
        taken += [int(i) for i in order[: rank - len(taken)]]
    yield from taken


def equality_jacobian(m: Any, d: Any) -> NDArray[np.float64]:
    """(ne, nv) of the active equalities at the data's position, up to date after ``mj_fwdPosition``."""
    J = np.zeros((d.nefc, m.nv))
    if not d.nefc:
        return J
    if mujoco.mj_isSparse(m):
        mujoco.mju_sparse2dense(J, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
    else:
        J[:] = np.asarray(d.efc_J)[: J.size].reshape(J.shape)  # its memory may be longer
    return J[: d.ne]


def _at_reference(m: Any) -> tuple[Any, Any]:
    d = mujoco.MjData(m)
    mujoco.mj_fwdPosition(m, d)
    return m, d


def roles_by_name(
    roles: Roles, dofs_of: Mapping[str, NDArray[np.intp]], model: str, asked: Mapping[Role, Iterable[str]]
) -> Roles:
    """Roles with what a user asks for.

    Args:
        roles: the model's own.
        dofs_of: degrees of freedom by the name of a joint, or of one of its degrees of freedom.
        model: the model's name, for messages.
        asked: names by role.

    Raises:
        SettingsError: an unknown name, a name under two roles, or a dependent degree of freedom.
    """
    seen: dict[str, Role] = {}
    changes: dict[Role, list[int]] = {}
    for role, names in asked.items():
        if isinstance(names, str):
            raise SettingsError(f"{role}: give a list of joint names; got {names!r}: write [{names!r}]")
        for name in names:
            if name not in dofs_of:
                raise SettingsError(
                    f"{role}: model {model!r} has no joint {name!r}: its joints are {', '.join(dofs_of)}"
                )
            if name in seen and seen[name] != role:
                raise SettingsError(f"joint {name!r} is asked to be {seen[name]} and {role}: choose one")
            seen[name] = role
            dofs = dofs_of[name].tolist()
            if any(roles.of[i] == Role.DEPENDENT for i in dofs):
                leads = {lead for i in dofs for lead in roles.follows.get(i, ())}
                led_by = [repr(own) for own, its in dofs_of.items() if len(its) == 1 and its[0] in leads]
                instead = f"{' and '.join(led_by)}, which it follows" if led_by else "the joint that it follows"
                raise SettingsError(
                    f"{role}: an equality constraint ties joint {name!r} to others: name {instead}, or remove the "
                    "equality"
                )
            changes.setdefault(role, []).extend(dofs)
    return roles.changed(changes)
