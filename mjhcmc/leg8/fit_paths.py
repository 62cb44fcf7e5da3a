"""leg8's knee hinge and knee wraps fitted to the reference's dynamics, lengths and moment arms.

The source's knee slides as it turns and its knee extensors end on points that move with the knee angle; leg8 has one
fixed hinge and fixed sites. So the hinge's place is fitted first, then, muscle by muscle, a wrapping cylinder fixed in
the thigh (patella for rectus femoris and vasti, femoral condyle for gastrocnemius) and one site. What remains of the
lengths' mean difference becomes a shift of the tendon slack length.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.leg8.agreement import (
    FIT_RANGE_DEG,
    DynamicsReference,
    PathReference,
    dynamics_agreement,
    lengths_and_arms,
)
from mjhcmc.leg8.builder import build_leg8
from mjhcmc.leg8.table import JOINTS, MUSCLES

Array = NDArray[np.float64]

ARM_LIMIT, DYNAMICS_LIMIT = 0.006, 0.02
"""What errors are weighed by: a moment arm's in m, and a torque's or inertia's over its peak."""

_OUTSIDE_WEIGHT = 0.3  # of postures of the reference that lie outside FIT_RANGE_DEG
_FLEXED_DEG = (-100.0, -110.0, -120.0)  # beyond the reference's knee angles: the arm must keep its sign there
_CLEARANCE = 1.15  # smallest distance of a fitted site from its cylinder's axis, in radii
_SIDE_GAP = 0.03  # how far outside the cylinder the side site lies, m
_DIGITS = 5  # fitted positions are kept to .01 mm


@dataclass(frozen=True)
class WrapFit:
    """What is fitted of one muscle at the knee: a cylinder in the femur and one of its sites.

    Attributes:
        muscle: The muscle.
        point: Index of the fitted site in the muscle's path.
        side: Unit vector (x, y) from the cylinder's axis to its side site. Where the path leaves the cylinder, its
            nearest point must lie on this side, or the path would jump to the other.
        flexed_arm: Smallest size of the knee moment arm to keep in deep flexion, m.
        starts: Starting values (x, y, radius of the cylinder; x, y of the site), m.
        low: Lower bounds of the same.
        high: Upper bounds of the same.
    """

    muscle: str
    point: int
    side: tuple[float, float]
    flexed_arm: float
    starts: tuple[tuple[float, ...], ...]
    low: tuple[float, ...]
    high: tuple[float, ...]

    @property
    def wrap(self) -> str:
        """Name of the cylinder."""
        return f"{self.muscle}_wrap"

    @property
    def sign(self) -> float:
        """Sign of the knee moment arm: + in front of the knee, - behind it."""
        return 1.0 if self.side[0] > 0 else -1.0

    def side_site(self, x: float, y: float, radius: float) -> tuple[float, float]:
        """Where the side site of a cylinder at (x, y) lies, m."""
        reach = radius + _SIDE_GAP
        return x + reach * self.side[0], y + reach * self.side[1]


_EXTENSOR_STARTS = (
    (0.020, -0.400, 0.022, 0.046, -0.030),
    (0.012, -0.4067, 0.030, 0.046, -0.030),
    (0.020, -0.390, 0.030, 0.046, -0.010),
    (0.030, -0.425, 0.022, 0.030, -0.050),
)
_EXTENSOR_LOW, _EXTENSOR_HIGH = (-0.02, -0.43, 0.02, 0.02, -0.07), (0.05, -0.385, 0.05, 0.06, 0.02)
WRAPS: tuple[WrapFit, ...] = (
    WrapFit("rect_fem", 2, (1.0, 0.0), 0.018, _EXTENSOR_STARTS, _EXTENSOR_LOW, _EXTENSOR_HIGH),
    WrapFit("vasti", 3, (1.0, 0.0), 0.018, _EXTENSOR_STARTS, _EXTENSOR_LOW, _EXTENSOR_HIGH),
    WrapFit(
        "gastroc",
        0,
        (-0.8, 0.6),
        0.005,
        ((-0.02, -0.405, 0.008, -0.02, -0.393), (-0.018, -0.406, 0.012, -0.019, -0.391)),
        (-0.05, -0.43, 0.008, -0.05, -0.41),
        (0.0, -0.38, 0.03, 0.0, -0.36),
    ),
)
"""The three muscles whose paths at the knee are fitted."""


def fit_paths(table: Mapping[str, Any], paths: PathReference, states: DynamicsReference) -> dict[str, Any]:
    """Fit the geometry of the table's ``fitted`` section.

    Args:
        table: The parameter table; only its structure and ``source`` section matter to the result.
        paths: Reference lengths and moment arms.
        states: Reference mass matrices and inverse dynamics.

    Returns:
        A copy of the table with new ``knee_axis``, ``wraps``, ``paths``, ``slack_offset`` and ``length_range``.
    """
    result: dict[str, Any] = copy.deepcopy(dict(table))
    fitted = result["fitted"]
    fitted["knee_axis"] = fit_knee_axis(result, paths, states)
    for wrap in WRAPS:
        _fit_wrap(result, wrap, paths)
    model = build_leg8(table=result).compile()
    inside = paths.within(FIT_RANGE_DEG)
    length, _ = lengths_and_arms(model, inside.qpos)
    shift = (length - inside.length).mean(axis=0)
    fitted["slack_offset"] = {name: _round(shift[i]) for i, name in enumerate(MUSCLES)}
    fitted["length_range"] = length_range(result)
    return result


def fit_knee_axis(table: Mapping[str, Any], paths: PathReference, states: DynamicsReference) -> list[float]:
    """The fixed hinge's place in the femur (x, y, z), m, that makes the worst error over its limit smallest.

    Errors are those of the inverse dynamics and of each entry of the mass matrix (over its own peak), and of the
    hamstrings' knee moment arm, whose points are the source's.
    """
    from scipy.optimize import minimize

    inside = paths.within(FIT_RANGE_DEG)
    trial: dict[str, Any] = copy.deepcopy(dict(table))
    row = MUSCLES.index("hamstrings")

    def worst(place: Array) -> float:
        trial["fitted"]["knee_axis"] = [float(place[0]), float(place[1]), 0.0]
        model = build_leg8(table=trial).compile()
        torque, mass_matrix = dynamics_agreement(model, states)
        _, arm = lengths_and_arms(model, inside.qpos[:: len(inside.qpos) // 60 or 1])
        error = arm[:, row] - inside.arm[:: len(inside.qpos) // 60 or 1, row]
        return float(
            max(torque.max() / DYNAMICS_LIMIT, mass_matrix.max() / DYNAMICS_LIMIT, np.abs(error).max() / ARM_LIMIT)
        )

    start = [-0.0045, -0.4]
    simplex = [start, [start[0] - 0.006, start[1]], [start[0], start[1] - 0.006]]
    options = {"initial_simplex": simplex, "xatol": 1e-6, "fatol": 1e-5, "maxfev": 300}
    best = minimize(worst, start, method="Nelder-Mead", options=options)
    return [_round(best.x[0]), _round(best.x[1]), 0.0]


def length_range(table: Mapping[str, Any]) -> dict[str, list[float]]:
    """Each muscle's shortest and longest length over the joints' ranges, m, to the outer millimetre.

    The shortest is kept a millimetre over the tendon slack length: a shorter muscle with a rigid tendon hangs slack,
    and MuJoCo ignores a range that begins below zero.
    """
    joints = table["source"]["joints"]
    grid = []
    for joint, count in zip(JOINTS, (25, 27, 19), strict=True):
        low_deg, high_deg = (float(value) for value in joints[joint]["range_deg"])
        grid.append(np.radians(np.linspace(low_deg, high_deg, count)))
    length, _ = lengths_and_arms(build_leg8(table=table).compile(), np.array(list(product(*grid))))
    muscles, offset = table["source"]["muscles"], table["fitted"]["slack_offset"]
    slack = np.array([muscles[name]["tendon_slack_length"] + offset[name] for name in MUSCLES])
    low = np.maximum(np.floor(length.min(axis=0) * 1e3), np.ceil(slack * 1e3) + 1) / 1e3
    high = np.ceil(length.max(axis=0) * 1e3) / 1e3
    return {name: [_round(low[i]), _round(high[i])] for i, name in enumerate(MUSCLES)}


def _fit_wrap(table: dict[str, Any], wrap: WrapFit, paths: PathReference) -> None:
    """Fit one muscle's cylinder and site, in place."""
    from scipy.optimize import least_squares

    column = MUSCLES.index(wrap.muscle)
    arm_moves = np.abs(paths.arm[:, column]).max(axis=0) > 1e-9
    subset = np.all(np.abs(paths.qpos[:, ~arm_moves]) < 1e-9, axis=1)  # postures that differ for this muscle
    qpos, target = paths.qpos[subset], paths.arm[subset, column]
    low, high = np.radians(np.asarray(FIT_RANGE_DEG)).T
    inside = np.all((qpos >= low - 1e-9) & (qpos <= high + 1e-9) | ~arm_moves, axis=1)
    weight = np.where(inside, 1.0, _OUTSIDE_WEIGHT)[:, None]
    flexed = np.zeros((len(_FLEXED_DEG), 3))
    flexed[:, 1] = np.radians(_FLEXED_DEG)
    place_wrap(table, wrap, wrap.starts[0])
    model = build_leg8(table=table).compile()

    def residual(x: Array) -> Array:
        _move(model, table, wrap, x)
        _, arm = lengths_and_arms(model, np.concatenate([qpos, flexed]))
        errors = ((arm[: len(qpos), column] - target) * weight).ravel()
        short = wrap.flexed_arm - wrap.sign * arm[len(qpos) :, column, 1]
        near = _CLEARANCE * x[2] - np.hypot(x[3] - x[0], x[4] - x[1]) if wrap.sign < 0 else 0.0
        return np.concatenate([errors, _OUTSIDE_WEIGHT * np.maximum(short, 0.0), [10 * max(near, 0.0)]]) * 1e3

    fits = [
        least_squares(residual, start, bounds=(wrap.low, wrap.high), x_scale=0.01, diff_step=1e-3)
        for start in wrap.starts
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    place_wrap(table, wrap, [_round(value) for value in best.x])


def place_wrap(table: dict[str, Any], wrap: WrapFit, values: Sequence[float]) -> None:
    """Put a cylinder and its muscle's site into the table; z of both stays the source's."""
    x, y, radius, site_x, site_y = (float(value) for value in values)
    point = table["fitted"]["paths"][wrap.muscle][wrap.point]
    z = point["pos"][2]
    point["pos"] = [site_x, site_y, z]
    side = [*(_round(value) for value in wrap.side_site(x, y, radius)), z]
    table["fitted"]["wraps"][wrap.wrap] = {"body": "femur", "pos": [x, y, z], "radius": radius, "side": side}


def _move(model: Any, table: Mapping[str, Any], wrap: WrapFit, x: Array) -> None:
    """Put a cylinder and its muscle's site into the compiled model, which is what makes the fit fast."""
    geom, side = model.geom(wrap.wrap).id, model.site(f"{wrap.wrap}_side").id
    point = table["fitted"]["paths"][wrap.muscle][wrap.point]
    site = model.site(f"{wrap.muscle}_{point['name']}").id
    joint = table["source"]["joints"]["knee"]["offset_at_zero"]
    axis = table["fitted"]["knee_axis"]
    origin = np.subtract(joint, axis) if point["body"] == "tibia" else np.zeros(3)
    model.geom_pos[geom, [0, 2]] = x[:2]
    model.geom_size[geom, 0] = x[2]
    model.site_pos[side, [0, 2]] = wrap.side_site(x[0], x[1], x[2])
    model.site_pos[site, [0, 2]] = x[3] + origin[0], x[4] + origin[1]


def _round(value: float) -> float:
    return round(float(value), _DIGITS) + 0.0
