"""leg8's paths for a subject's leg: the document's fixed points, and at the knee what stands for its moving ones.

As for leg8 itself (:mod:`mjhcmc.leg8.fit_paths`), a cylinder and one site of rectus femoris, vasti and gastrocnemius
are fitted by least squares, here to lengths and moment arms both, computed from the subject's own document.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from mjhcmc.errors import ModelError
from mjhcmc.leg8.builder import assemble, source_frames
from mjhcmc.leg8.fit_paths import WRAPS, WrapFit
from mjhcmc.leg8.geometry import Scale
from mjhcmc.leg8.knee import KNEE_SLIDES
from mjhcmc.leg8.osim_leg import SEGMENTS, OsimLeg
from mjhcmc.leg8.table import JOINTS, MUSCLES

Array = NDArray[np.float64]

KNEE_GRID_DEG = tuple(float(angle) for angle in range(-90, 9, 6))
"""Knee angles of the fit; more than walking and running use."""

HIP_GRID_DEG = (-30.0, -10.0, 10.0, 30.0)
ANKLE_GRID_DEG = (-30.0, -10.0, 5.0, 20.0)

_WALKING_DEG = (-75.0, 6.0)  # knee angles that count fully
_BEYOND_WEIGHT = 0.3
_FLEXED_DEG = (-100.0, -110.0, -120.0)  # where the arm must keep its sign
_PAST_END = 0.05  # beyond the knee's range, where the site must be clear of its cylinder still, rad
_GAP_CLEARANCE = 0.03  # from the gap down to the cylinder, m
_CLEARANCE = 1.15  # smallest distance of a fitted site from its cylinder's axis, in radii
_OTHERS = {"rect_fem": 0, "vasti": None, "gastroc": 2}  # the other joint that a fitted muscle spans


class PathModel:
    """Lengths and moment arms of a table's muscles as MuJoCo computes them, over hip, knee and ankle.

    Args:
        table: The parameter table.
    """

    def __init__(self, table: Mapping[str, Any]) -> None:
        import mujoco

        self.model = assemble("leg8", table, Scale(), planar=False).compile()
        self._data = mujoco.MjData(self.model)
        self._dofs = [int(self.model.joint(joint).id) for joint in JOINTS]
        own = table["fitted"].get("knee_motion")
        self._slides = [] if own is None else [int(self.model.joint(name).id) for name in KNEE_SLIDES]
        self._polynomials = [] if own is None else [Polynomial([0.0, *coefficients]) for coefficients in own]

    def _slide(self, angle: Array) -> tuple[Array, Array]:
        """Values of the knee's slides at knee angles (n,), and their slopes, (n, 4) or (n, 0) each."""
        if not self._slides:
            return np.empty((len(angle), 0)), np.empty((len(angle), 0))
        values = [own(angle) for own in self._polynomials[:3]]
        slopes = [own.deriv()(angle) for own in self._polynomials[:3]]
        rest = self._polynomials[3]
        values, slopes = [*values, rest(values[2])], [*slopes, rest.deriv()(values[2]) * slopes[2]]
        return np.stack(values, axis=1), np.stack(slopes, axis=1)

    def lengths_and_arms(self, qpos: Array) -> tuple[Array, Array]:
        """Lengths (n, 8), m, and moment arms -dL/dq (n, 8, 3), m, at hip, knee and ankle (n, 3), rad."""
        import mujoco

        m, d = self.model, self._data
        length, arm = np.empty((len(qpos), m.nu)), np.empty((len(qpos), m.nu, 3))
        dense = np.empty((m.nu, m.nv))
        values, slopes = self._slide(qpos[:, 1])
        for row, posture in enumerate(qpos):
            d.qpos[self._dofs] = posture
            d.qpos[self._slides] = values[row]
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            mujoco.mj_tendon(m, d)
            mujoco.mj_transmission(m, d)
            mujoco.mju_sparse2dense(dense, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
            length[row] = d.actuator_length
            arm[row] = -dense[:, self._dofs]
            arm[row, :, 1] -= dense[:, self._slides] @ slopes[row]
        return length, arm


def fit_subject(leg: OsimLeg, table: Mapping[str, Any], scales: Mapping[str, float]) -> dict[str, Any]:
    """Give a subject's table its paths, cylinders, slack shifts and length ranges.

    Args:
        leg: The subject's leg.
        table: Its table, with everything else.
        scales: How long its segments are over leg8's.

    Returns:
        A copy of the table with new ``paths``, ``wraps``, ``slack_offset`` and ``length_range``.

    Raises:
        ModelError: A muscle's path does not run as leg8's does, or is shorter than its tendon everywhere.
    """
    result: dict[str, Any] = copy.deepcopy(dict(table))
    fitted = result["fitted"]
    own = {wrap.muscle: wrap for wrap in WRAPS}
    generic = copy.deepcopy(fitted)
    fitted["paths"] = {muscle: _points(leg, muscle, own.get(muscle)) for muscle in MUSCLES}
    fitted["slack_offset"] = dict.fromkeys(MUSCLES, 0.0)
    # a range that every muscle can have, until its own is known
    slack = {muscle: result["source"]["muscles"][muscle]["tendon_slack_length"] for muscle in MUSCLES}
    fitted["length_range"] = {muscle: [slack[muscle], 2 * slack[muscle]] for muscle in MUSCLES}
    fits = [_Fit.of(leg, wrap, generic, scales) for wrap in WRAPS]
    for fit in fits:
        fit.put(result, fit.start)
    model = PathModel(result)
    for fit in fits:
        fit.put(result, fit.solve(model, result))
    for fit in fits:
        if fit.wrap.sign > 0:
            fit.open_gap(result)
    _measure(leg, result)
    return result


def _points(leg: OsimLeg, muscle: str, wrap: WrapFit | None) -> list[dict[str, Any]]:
    """A muscle's sites in the table's form; a wrapped muscle's fitted site where the document's point is at zero."""
    osim = leg.model.muscles[leg.name(muscle)]
    zero = np.zeros((1, 3))
    is_on = [bool(rows[0]) for rows in leg.active(muscle, zero)]
    points, parts = [], []
    for i, (point, on) in enumerate(zip(osim.path, is_on, strict=True)):
        if (wrap is not None and point.active is not None) or not on:
            continue
        part, place = leg.place(point)
        points.append({"body": part, "pos": place.tolist(), "name": f"P{i + 1}"})
        parts.append(SEGMENTS.index(part))
    if wrap is None:
        return points
    below = next((i for i, part in enumerate(parts) if part > SEGMENTS.index("femur")), len(points))
    site = below if wrap.sign > 0 else below - 1
    if not 0 < below < len(points) or parts != sorted(parts) or (wrap.sign > 0 and below != len(points) - 1):
        raise ModelError(
            f"{leg.model.path}: muscle {osim.name}: its points lie in {', '.join(point.body for point in osim.path)}: "
            "leg8's runs from the pelvis or femur over the knee, with one last point in the tibia in front of it"
        )
    points[site]["fitted"] = True
    points.insert(below, {"wrap": wrap.wrap})
    return points


@dataclass(frozen=True)
class _Fit:
    """One muscle's fit: x is the cylinder's place and radius, and its site's place, in their source frames."""

    leg: OsimLeg
    wrap: WrapFit
    start: Array
    low: Array
    high: Array
    size: float
    site_part: str

    @classmethod
    def of(cls, leg: OsimLeg, wrap: WrapFit, generic: Mapping[str, Any], scales: Mapping[str, float]) -> _Fit:
        """Start from leg8's fit at the subject's size."""
        front = wrap.sign > 0
        part = "tibia" if front else "femur"
        size, other = scales["femur"], scales[part]
        factor = np.array([size, size, size, other, other])
        cylinder, site = generic["wraps"][wrap.wrap], generic["paths"][wrap.muscle][wrap.point]
        start = np.array([*cylinder["pos"][:2], cylinder["radius"], *site["pos"][:2]]) * factor
        low, high = np.array(wrap.low) * factor, np.array(wrap.high) * factor
        return cls(leg, wrap, np.clip(start, low, high), low, high, size, part)

    def put(self, table: dict[str, Any], x: Array) -> None:
        """Put the cylinder and the site into the table; z of both is the site's in the document."""
        points = table["fitted"]["paths"][self.wrap.muscle]
        site = next(point for point in points if point.get("fitted"))
        z = site["pos"][2]
        site["pos"] = [float(x[3]), float(x[4]), z]
        side = [float(value) for value in self._side(x)]
        table["fitted"]["wraps"][self.wrap.wrap] = {
            "body": "femur",
            "pos": [float(x[0]), float(x[1]), z],
            "radius": float(x[2]),
            "side": [*side, z],
        }

    def _side(self, x: Array) -> Sequence[float]:
        return self.wrap.side_site(float(x[0]), float(x[1]), float(x[2]))

    def _move(self, model: Any, table: Mapping[str, Any], x: Array) -> None:
        """The same in a compiled model, which is what makes the fit fast."""
        frames = source_frames(table)
        site = next(point for point in table["fitted"]["paths"][self.wrap.muscle] if point.get("fitted"))
        origin = frames[self.site_part]
        geom, side = model.geom(self.wrap.wrap).id, model.site(f"{self.wrap.wrap}_side").id
        model.geom_pos[geom, [0, 2]] = x[:2]
        model.geom_size[geom, 0] = x[2]
        model.site_pos[side, [0, 2]] = self._side(x)
        model.site_pos[model.site(f"{self.wrap.muscle}_{site['name']}").id, [0, 2]] = x[3:] + origin[:2]

    def postures(self) -> tuple[Array, Array]:
        """Joint angles (n, 3) of the fit, rad, and their weights (n,)."""
        other = _OTHERS[self.wrap.muscle]
        grid: list[Sequence[float]] = [(0.0,), KNEE_GRID_DEG, (0.0,)]
        if other is not None:
            grid[other] = HIP_GRID_DEG if other == 0 else ANKLE_GRID_DEG
        degrees = np.array(list(product(*grid)))
        walking = (degrees[:, 1] >= _WALKING_DEG[0]) & (degrees[:, 1] <= _WALKING_DEG[1])
        return np.radians(degrees), np.where(walking, 1.0, _BEYOND_WEIGHT)

    def solve(self, model: PathModel, table: Mapping[str, Any]) -> Array:
        """The best x, by least squares over lengths and moment arms."""
        from scipy.optimize import least_squares

        column = MUSCLES.index(self.wrap.muscle)
        qpos, weight = self.postures()
        length, arm = self.leg.length_and_arm(self.wrap.muscle, qpos)
        flexed = np.zeros((len(_FLEXED_DEG), 3))
        flexed[:, 1] = np.radians(_FLEXED_DEG)
        both = np.concatenate([qpos, flexed])

        def residual(x: Array) -> Array:
            self._move(model.model, table, x)
            own_length, own_arm = (values[:, column] for values in model.lengths_and_arms(both))
            n = len(qpos)
            stretch = own_length[:n] - length
            if self.wrap.sign > 0:  # the gap will take out what is constant
                stretch -= np.average(stretch, weights=weight)
            errors = np.concatenate([stretch[:, None], own_arm[:n] - arm], axis=1) * weight[:, None]
            short = self.wrap.flexed_arm * self.size - self.wrap.sign * own_arm[n:, 1]
            near = np.maximum(_CLEARANCE * x[2] - self._distance(x), 0.0)
            return np.concatenate([errors.ravel(), _BEYOND_WEIGHT * np.maximum(short, 0.0), 10 * near]) * 1e3

        fits = [
            least_squares(
                residual,
                np.clip(x, self.low, self.high),
                bounds=(self.low, self.high),
                x_scale=0.01,
                diff_step=1e-3,
                max_nfev=60,
            )
            for x in [self.start]
        ]
        best = min(fits, key=lambda fit: float(fit.cost))
        self._move(model.model, table, best.x)
        return np.asarray(best.x, float)

    def _distance(self, x: Array) -> Array:
        """How far the site is from the cylinder's axis at knee angles over the whole range, m."""
        place = np.array([x[3:]])
        if self.site_part == "tibia":
            low, high = (
                getattr(self.leg.model.coordinates[self.leg.name("knee_angle")], end) for end in ("low", "high")
            )
            angle = np.linspace(low, high + _PAST_END, 40)
            cosine, sine = np.cos(angle), np.sin(angle)
            turned = np.stack([cosine * x[3] - sine * x[4], sine * x[3] + cosine * x[4]], axis=1)
            place = self.leg.knee_path(angle)[:, :2] + turned
        distance: Array = np.linalg.norm(place - x[:2], axis=1)
        return distance

    def open_gap(self, table: dict[str, Any]) -> None:
        """Cut the patella out of a fitted path in front of the knee, so that its length is the document's.

        The document's path ends on the patella; leg8's runs on to the tibia. Two sites of the thigh on the path at zero
        angles take the difference out, just above the cylinder; the tendon's way between them does not count.
        """
        points = table["fitted"]["paths"][self.wrap.muscle]
        at = next(i for i, point in enumerate(points) if "wrap" in point)
        end, direction = self._way_to_cylinder(table)
        qpos, weight = self.postures()
        length = self.leg.length(self.wrap.muscle, qpos)
        below = end - _GAP_CLEARANCE * self.size * direction
        sites = [{"body": "femur", "name": name, "pos": below.tolist()} for name in ("above", "below")]
        points[at:at] = [sites[0], {"gap": True}, sites[1]]
        for _ in range(3):  # the length changes by nearly what the upper site moves
            own = PathModel(table).lengths_and_arms(qpos)[0][:, MUSCLES.index(self.wrap.muscle)]
            excess = float(np.average(own - length, weights=weight))
            sites[0]["pos"] = (np.asarray(sites[0]["pos"]) - excess * direction).tolist()

    def _way_to_cylinder(self, table: Mapping[str, Any]) -> tuple[Array, Array]:
        """Where the path at zero angles first meets cylinder or fitted site, in the femur, m, and the way it comes."""
        import mujoco

        model = PathModel(table).model
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        tendon = MUSCLES.index(self.wrap.muscle)
        first, count = data.ten_wrapadr[tendon], data.ten_wrapnum[tendon]
        path = np.asarray(data.wrap_xpos).reshape(-1, 3)[first : first + count] - data.body("thigh").xpos
        sites = sum("pos" in point for point in table["fitted"]["paths"][self.wrap.muscle]) - 1
        start, end = (np.array([x, z, -y]) for x, y, z in path[sites - 1 : sites + 1])
        return end, (end - start) / np.linalg.norm(end - start)


def _measure(leg: OsimLeg, table: dict[str, Any]) -> None:
    """Set slack shifts and length ranges: a muscle spans two neighbouring joints at most."""
    fitted, joints = table["fitted"], table["source"]["joints"]
    model = PathModel(table)
    walking, _ = _Fit.postures(_Fit(leg, WRAPS[0], *(np.zeros(5),) * 3, 1.0, "tibia"))
    own, _ = model.lengths_and_arms(walking)
    for i, muscle in enumerate(MUSCLES):
        fitted["slack_offset"][muscle] = float((own[:, i] - leg.length(muscle, walking)).mean())
    ends = [np.radians(joints[joint]["range_deg"]) for joint in JOINTS]
    grids = [np.linspace(low, high, 21) for low, high in ends]
    hip_knee = np.array([(hip, knee, 0.0) for hip, knee in product(grids[0], grids[1])])
    knee_ankle = np.array([(0.0, knee, ankle) for knee, ankle in product(grids[1], grids[2])])
    lengths, _ = model.lengths_and_arms(np.concatenate([hip_knee, knee_ankle]))
    for i, muscle in enumerate(MUSCLES):
        slack = table["source"]["muscles"][muscle]["tendon_slack_length"] + fitted["slack_offset"][muscle]
        low = max(np.floor(lengths[:, i].min() * 1e3), np.ceil(slack * 1e3) + 1) / 1e3
        high = np.ceil(lengths[:, i].max() * 1e3) / 1e3
        if high <= low:
            raise ModelError(
                f"{leg.model.path}: muscle {leg.name(muscle)}: its path is at most {high:.3f} m long, its tendon slack "
                f"length {slack:.3f} m: correct tendon_slack_length, or scale it with the path"
            )
        fitted["length_range"][muscle] = [float(low), float(high)]
