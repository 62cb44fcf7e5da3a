"""What joint limits and contacts do at a model's reference pose, at rest, muscles off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.model_check.report import ContactReport
from mjhcmc.model_check.scan import Pose, ScanPlant

_SLIGHT = 1e-6  # N m or N
_LIMIT = (int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT), int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON))
_CONTACT = (
    int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS),
    int(mujoco.mjtConstraint.mjCNSTR_CONTACT_PYRAMIDAL),
    int(mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC),
)


@dataclass(frozen=True)
class Pushes:
    """Limits and contacts at the reference pose.

    Attributes:
        pushed: (nv,) N m or N, by both; what acts on something tied acts on what it follows.
        contacts: pairs of geoms that touch.
    """

    pushed: NDArray[np.float64]
    contacts: tuple[ContactReport, ...]


def find_pushes(plant: ScanPlant, reference: Pose) -> Pushes:
    """See `Pushes`.

    Args:
        plant: of the model.
        reference: what muscles do at the plant's reference pose.
    """
    m = plant.model.mj_model
    d = mujoco.MjData(m)
    d.qpos[:] = plant.reference
    mujoco.mj_forward(m, d)
    force = np.where(np.isin(d.efc_type, (*_LIMIT, *_CONTACT)), d.efc_force, 0.0)
    pairs: dict[tuple[str, str], tuple[float, NDArray[np.float64]]] = {}
    for k in range(d.ncon):
        contact = d.contact[k]
        pair = (_name(m, int(contact.geom[0])), _name(m, int(contact.geom[1])))
        depth, own = pairs.get(pair, (0.0, np.zeros(d.nefc)))
        rows = np.isin(d.efc_type, _CONTACT) & (d.efc_id == k)
        own[rows] = d.efc_force[rows]
        pairs[pair] = max(depth, float(-contact.dist)), own
    found = [_report(plant, reference, pair, depth, _seen(plant, d, own)) for pair, (depth, own) in pairs.items()]
    return Pushes(_seen(plant, d, force), tuple(found))


def _seen(plant: ScanPlant, d: Any, force: NDArray[np.float64]) -> NDArray[np.float64]:
    """(nv,) N m or N, generalized force of constraint forces (nefc,), on what is neither tied nor prescribed."""
    generalized = np.zeros(plant.model.nv)
    mujoco.mj_mulJacTVec(plant.model.mj_model, d, generalized, force)
    reduced = plant.ties.reduce(plant.reference, generalized)
    reduced[plant.model.roles.prescribed] = 0.0
    return np.where(np.abs(reduced) > _SLIGHT, reduced, 0.0)


def _report(
    plant: ScanPlant, reference: Pose, pair: tuple[str, str], depth: float, push: NDArray[np.float64]
) -> ContactReport:
    worst = int(np.abs(push).argmax()) if push.any() else -1
    against = 0.0
    if worst >= 0:
        against = float(reference.strength[worst, 0 if push[worst] > 0 else 1])
    return ContactReport(
        geoms=pair,
        depth=depth,
        joint=plant.model.dof_names[worst] if worst >= 0 else None,
        push=float(push[worst]) if worst >= 0 else 0.0,
        strength=abs(against),
    )


def _name(m: Any, geom: int) -> str:
    own = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_GEOM, geom)
    body = int(m.geom_bodyid[geom])
    return own or mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_BODY, body) or f"geom{geom}"
