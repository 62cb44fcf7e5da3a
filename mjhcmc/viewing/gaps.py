"""Gaps in tendon paths: pulleys that divide nothing, where a path leaves off and goes on at the same body.

A path whose way along a bone is not modelled (a knee that moves on splines has fitted points on either side of it) ends
at one site of the bone and goes on from another, with a pulley between that leaves the divisor as it is. The piece of
constant length counts for nothing in the simulation; to the eye it is one muscle, and pictures close the gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco


@dataclass(frozen=True)
class Gap:
    """Where the path of a tendon leaves off and goes on.

    Attributes:
        tendon: its number.
        pulley: how many pulleys of the tendon come before.
        ends: the sites on either side of it, of bodies that do not move against each other.
    """

    tendon: int
    pulley: int
    ends: tuple[int, int]


def gaps_of(model: Any) -> tuple[Gap, ...]:
    """The gaps of all spatial tendons of a ``mujoco.MjModel``; where a path truly divides there is none."""
    kind, of, parameter = model.wrap_type, model.wrap_objid, model.wrap_prm
    found = []
    for tendon in range(model.ntendon):
        first, last = int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]) - 1
        pulleys, divisor = 0, 1.0
        for w in range(first, last + 1):
            if kind[w] != mujoco.mjtWrap.mjWRAP_PULLEY:
                continue
            before, divisor = divisor, float(parameter[w])
            pulleys += 1
            if before != divisor or not first < w < last:
                continue
            if kind[w - 1] == kind[w + 1] == mujoco.mjtWrap.mjWRAP_SITE:
                ends = int(of[w - 1]), int(of[w + 1])
                bodies = {int(model.body_weldid[model.site_bodyid[site]]) for site in ends}
                if len(bodies) == 1:
                    found.append(Gap(tendon, pulleys - 1, ends))
    return tuple(found)
