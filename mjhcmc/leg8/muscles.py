"""leg8's muscles: sites, wrapping cylinders, tendons and actuators, from the parameter table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mjhcmc.errors import ModelError
from mjhcmc.leg8.geometry import Scale, Vector, digits
from mjhcmc.leg8.table import MUSCLES

if TYPE_CHECKING:
    import mujoco

BODIES = {"pelvis": "pelvis", "femur": "thigh", "tibia": "shank", "talus": "foot", "calcn": "foot", "toes": "foot"}
"""The model's body that carries each of the source's."""

_SITE_SIZE = [0.004, 0.005, 0.005]  # a sphere; the last two are MuJoCo's defaults, which the file leaves out
_CYLINDER_QUAT = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # a cylinder's own axis z onto the flexion axis


def fiber_mapping(muscle: Mapping[str, float]) -> tuple[float, float, float]:
    """What a rigid-tendon Hill muscle gives MuJoCo's muscle, which has no pennation.

    With pennation angle alpha at the optimal length, fiber length along the tendon is lopt cos(alpha), force along
    the tendon F0 cos(alpha), and fiber velocity is tendon velocity times cos(alpha), so that the maximum velocity in
    the reduced length is vmax / cos(alpha)^2. Exact at the optimal length (Zajac 1989; Millard et al. 2013).

    Args:
        muscle: A muscle's entry in the table's ``source`` section.

    Returns:
        Length unit lopt cos(alpha) in m, force F0 cos(alpha) in N, and the factor 1/cos(alpha)^2 of the velocity.
    """
    cosine = math.cos(muscle["pennation_angle"])
    return (
        muscle["optimal_fiber_length"] * cosine,
        muscle["max_isometric_force"] * cosine,
        1.0 / cosine**2,
    )


def add_muscles(spec: mujoco.MjSpec, table: Mapping[str, Any], scale: Scale, frames: Mapping[str, Vector]) -> None:
    """Add sites, wrapping cylinders, tendons and actuators.

    A muscle's entry may have ``passive_stiffness``, a factor of its passive force; 1 where it has none.
    """
    import mujoco

    common, fitted, look = table["source"]["muscle_common"], table["fitted"], table["appearance"]
    curves = fitted["curves"]
    for name, wrap in fitted["wraps"].items():
        body = spec.body(BODIES[wrap["body"]])
        origin = frames[wrap["body"]]
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            pos=scale.point(np.asarray(wrap["pos"]) + origin),
            quat=list(_CYLINDER_QUAT),
            size=[scale.length(wrap["radius"]), scale.length(look["wrap_half_width"]), 0.0],
            rgba=look["colors"]["wrap"],
            contype=0,
            conaffinity=0,
            group=3,
        )
        body.add_site(name=f"{name}_side", pos=scale.point(np.asarray(wrap["side"]) + origin), group=4, size=_SITE_SIZE)

    for name in MUSCLES:
        muscle = {**common, **table["source"]["muscles"][name]}  # a subject's muscles may each have their own times
        color = look["colors"][name]
        tendon = spec.add_tendon(name=f"{name}_tendon", width=scale.length(look["tendon_width"]), rgba=color)
        for point in fitted["paths"][name]:
            if "wrap" in point:
                tendon.wrap_geom(point["wrap"], f"{point['wrap']}_side")
                continue
            if "gap" in point:  # what follows is a branch of its own: the way from the site before to the one after
                tendon.wrap_pulley(1.0)  # counts for nothing
                continue
            site = f"{name}_{point['name']}"
            body = spec.body(BODIES[point["body"]])
            pos = np.asarray(point["pos"]) + frames[point["body"]]
            body.add_site(name=site, pos=scale.point(pos), group=3, size=_SITE_SIZE, rgba=color)
            tendon.wrap_site(site)

        unit, force, velocity = fiber_mapping(muscle)
        # Tension F0 beta v_fiber/(vmax lopt) cos(alpha) with v_fiber = v_tendon cos(alpha) (Millard et al. 2013).
        slope = muscle["fiber_damping"] / (muscle["max_fiber_velocity"] * muscle["optimal_fiber_length"])
        damping = slope * force * math.cos(muscle["pennation_angle"])
        tendon.damping[0] = digits(damping * scale.mass / scale.height)

        slack = muscle["tendon_slack_length"] + fitted["slack_offset"][name]
        limits = fitted["length_range"][name]
        norm_range = [digits((value - slack) / unit) for value in limits]
        if norm_range[0] < 0:  # MuJoCo would silently take its default instead
            raise ModelError(f"leg8 table: length_range of {name} begins at {limits[0]:g} m: take at least {slack:g} m")
        actuator = spec.add_actuator(name=name, target=f"{name}_tendon", trntype=mujoco.mjtTrn.mjTRN_TENDON)
        actuator.set_to_muscle(
            timeconst=[muscle["activation_time"], muscle["deactivation_time"]],
            tausmooth=0.0,
            range=norm_range,
            force=digits(force * scale.mass),
            scale=200.0,
            lmin=curves["lmin"],
            lmax=curves["lmax"],
            vmax=digits(curves["vmax"] * velocity * (muscle["max_fiber_velocity"] / common["max_fiber_velocity"])),
            fpmax=digits(curves["fpmax"] * muscle.get("passive_stiffness", 1.0)),
            fvmax=curves["fvmax"],
        )
        actuator.lengthrange = [scale.length(value) for value in limits]
        actuator.ctrllimited = True
        actuator.ctrlrange = [0.0, 1.0]
