"""Contacts at the start of a motion that muscles cannot hold: told before solving, or reserves fight the geometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics

if TYPE_CHECKING:
    from mjhcmc.methods.windows import Windows

_CONTACTS = tuple(
    int(getattr(mujoco.mjtConstraint, f"mjCNSTR_CONTACT_{kind}")) for kind in ("FRICTIONLESS", "PYRAMIDAL", "ELLIPTIC")
)


def contacts_beyond_strength(windows: Windows) -> list[str]:
    """One line for each pair of geoms that, at the start and at rest, pushes a joint by more than its muscles can.

    Args:
        windows: whose plant stands at the start, muscles off, after `forward`.
    """
    plant, model = windows.plant, windows.model
    m, d = plant.mj_model, plant.mj_data
    if not d.ncon:
        return []
    B = dynamics.muscle_moments(plant).B
    W = windows.seen_from_tracked(d.qpos.copy(), dynamics.mass_matrix(plant))
    B = W.T @ B
    strength = {1.0: np.maximum(B, 0.0).sum(axis=1), -1.0: np.maximum(-B, 0.0).sum(axis=1)}
    pairs: dict[tuple[str, str], tuple[float, NDArray[np.float64]]] = {}
    of_contact = np.isin(d.efc_type, _CONTACTS)
    for k in range(d.ncon):
        contact = d.contact[k]
        pair = (_name(m, int(contact.geom[0])), _name(m, int(contact.geom[1])))
        depth, force = pairs.get(pair, (0.0, np.zeros(d.nefc)))
        rows = of_contact & (d.efc_id == k)
        force[rows] = d.efc_force[rows]
        pairs[pair] = max(depth, -float(contact.dist)), force
    found = []
    for (one, other), (depth, force) in pairs.items():
        push = np.zeros(m.nv)
        mujoco.mj_mulJacTVec(m, d, push, force)
        push = W.T @ push
        against = np.where(push > 0, strength[-1.0], strength[1.0])
        j = int(np.argmax(np.abs(push) - against))
        if abs(push[j]) > against[j]:
            dof = model.roles.tracked[j]
            unit = "N m" if model.dof_is_rotation[dof] else "N"
            found.append(
                f"{one} and {other} touch at the start, {1e3 * depth:.3g} mm deep, and push joint "
                f"{model.dof_names[dof]!r} by {push[j]:.3g} {unit}, its muscles have {against[j]:.3g} {unit} against "
                "it: start where they are apart, or let them not collide (contact/exclude)"
            )
    return found


def _name(m: mujoco.MjModel, geom: int) -> str:
    own = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_GEOM, geom)
    body = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_BODY, int(m.geom_bodyid[geom]))
    return own or body or f"geom {geom}"
