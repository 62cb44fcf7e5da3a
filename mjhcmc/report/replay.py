"""The animated replay inside the report: data of a solution's frames, and a small player on a canvas.

The data hold what stays once (solids and tendon paths in the frames of rigid groups) and what moves for each frame
(poses of groups, points where tendons wrap, activation, excitation), as integers in base64. The player's JavaScript is
our own (replay_solids.js and replay_scene.js draw, replay.js plays); it asks nothing of the network.
"""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import OutputError
from mjhcmc.report import replay_motion as motion
from mjhcmc.report.markup import json_in_script
from mjhcmc.report.replay_shapes import Shape, corners_of, drawn_geoms, geom_in_group, planes_of, shapes_of
from mjhcmc.report.units import short
from mjhcmc.viewing.colours import activation_rgba, hex_colour

if TYPE_CHECKING:
    from mjhcmc.viewing.frames import Frames

__all__ = ["DATA_ID", "ReplayPart", "replay_part"]

DATA_ID = "mjhcmc-replay-data"
"""Of the script element in the page that holds the data; the player reads it there."""

MAX_RATE = 200.0
"""Frames in each second of the motion, at most; the player goes evenly between them."""

MAX_FRAMES = 300
"""Frames in all, at most."""

MAX_BYTES = 500_000
"""What all frames together may take before base64; models with hundreds of muscles get fewer frames."""

UNKNOWN = 65535
"""In the streams of activation and excitation: not a number."""

_SCRIPTS = ("replay_solids.js", "replay_scene.js", "replay.js")
_COLOURS = 256
_SKIN = 0.6  # geoms that are less opaque are drawn beneath the bones, as one
_EXACT = 1e-9  # deg and mm: less is rounding
_FLESH = 135  # gray: colour is for muscles and for the desired pose
_CLOSE = 1.0  # size of what moves: solids of the world that lie farther from its middle are scenery


@dataclass(frozen=True)
class ReplayPart:
    """The replay, ready to be put in a page.

    Attributes:
        html: goes where the replay is to be seen; brings its own style.
        script: JavaScript, once in the page, after html and data.
        data: goes into the page as JSON, in a script element of the id `DATA_ID`.
    """

    html: str
    script: str
    data: dict[str, Any]

    @property
    def markup(self) -> str:
        """All three, in the order that a page needs."""
        return f"{self.html}\n{json_in_script(DATA_ID, self.data)}\n<script>{self.script}</script>\n"


def replay_part(frames: Frames) -> ReplayPart:
    """The replay of a solution's frames.

    Args:
        frames: see `Frames.of`; of many the player gets at most `MAX_RATE` a second and `MAX_FRAMES` in all.

    Raises:
        OutputError: in no frame all positions are finite.
    """
    data = _data_of(frames)
    here = Path(__file__).parent
    script = "".join((here / name).read_text(encoding="utf-8") for name in _SCRIPTS)
    return ReplayPart(_html_of(data), f'(() => {{\n"use strict";\n{script}}})();\n', data)


def _data_of(frames: Frames) -> dict[str, Any]:
    model = frames.model
    paths = motion.paths_of(model)
    chosen = _chosen(frames, paths)
    poses = motion.poses_of(frames, chosen, paths)
    shapes = shapes_of(model, _without_scenery(model, poses))
    view = motion.first_view(model, poses, shapes, paths)
    moving = poses.moving
    centre = (poses.position[:, moving] if len(moving) else poses.position).mean(axis=(0, 1))
    points = poses.wrap_points[poses.wraps]  # (wrapped, 2, 3), frame after frame
    places = poses.position[:, moving] - centre
    span = max(np.abs(places).max(initial=0.0), np.abs(points - centre).max(initial=0.0), 1e-3)
    shift = poses.desired_position[:, moving] - poses.position[:, moving]
    turn = motion.rotation_vectors(poses.quaternion[:, moving], poses.desired_quaternion[:, moving])
    group = {int(body): g for g, body in enumerate(poses.bodies)}
    return {
        "title": frames.title,
        "off": _off(frames),
        "time": _rounded(frames.time[chosen], 6),
        "thinned": len(chosen) < len(frames.time),
        "groups": [
            {"at": _rounded(poses.position[0, g], 6), "turn": _rounded(poses.quaternion[0, g], 7)}
            for g in range(len(poses.bodies))
        ],
        "moving": moving.tolist(),
        "centre": _rounded(centre, 6),
        "position": _packed(places, span),
        "turn": _packed(poses.quaternion[:, moving], 1.0),
        "shift": _packed(shift, float(np.abs(shift).max(initial=0.0))),
        "shift_turn": _packed(turn, float(np.abs(turn).max(initial=0.0))),
        "wrapped": _base64(poses.wraps.astype(np.uint8)),
        "slots": poses.wraps.shape[1],
        "wrap_points": _packed(points - centre, span),
        "shapes": [_shape(shape, group) for shape in shapes],
        "tendons": _tendons(frames, paths, group),
        "rings": _rings(frames, group),
        "muscles": list(frames.muscle_names),
        "activation": _shares(frames.activation[chosen]),
        "excitation": _shares(frames.excitation[chosen]),
        "colours": _colours(),
        "unknown": hex_colour(activation_rgba(np.nan)),
        "ground": _grounds(model, view),
        "view": {
            "right": _rounded(view.right, 6),
            "up": _rounded(view.up, 6),
            "axis": _rounded(view.axis, 6),
            "half": _rounded(view.half, 5),
            "centre": _rounded(view.centre if view.follows else view.centre[:1], 4),
        },
    }


def _chosen(frames: Frames, paths: list[motion.Path]) -> NDArray[np.intp]:
    """The frames that are sent: evenly spread, with the first and the last."""
    finite = np.flatnonzero(np.isfinite(frames.qpos).all(axis=1) & np.isfinite(frames.desired).all(axis=1))
    if not len(finite):
        raise OutputError("the replay cannot be drawn: no frame has finite positions; solve again, or leave it out")
    model = frames.model
    groups = int((model.body_weldid == np.arange(model.nbody)).sum())
    slots = sum(isinstance(stop, int) for path in paths for stop in path.stops)
    bytes_each = 26 * groups + 13 * slots + 4 * len(frames.muscle_names)
    duration = float(frames.time[finite[-1]] - frames.time[finite[0]])
    most = min(MAX_FRAMES, int(duration * MAX_RATE + 1e-6) + 1, max(2, MAX_BYTES // max(bytes_each, 1)))
    if len(finite) <= most:
        return np.asarray(finite)
    return np.asarray(finite[np.unique(np.linspace(0, len(finite) - 1, max(most, 2)).round().astype(int))])


def _without_scenery(model: Any, poses: motion.Poses) -> list[int]:
    """Geoms that are drawn, but for those fixed to the world and not close to what moves, such as walls."""
    box = {g: corners_of(model, g) for g in drawn_geoms(model)}
    moving = [poses.world(body, corners) for body, corners in box.values() if body]
    if not moving:
        return list(box)
    every = np.concatenate(moving, axis=1).reshape(-1, 3)
    middle = (every.min(axis=0) + every.max(axis=0)) / 2
    reach = _CLOSE * np.ptp(every, axis=0).max()
    return [g for g, (body, corners) in box.items() if body or np.abs(corners - middle).max() <= reach]


def _shape(shape: Shape, group: dict[int, int]) -> dict[str, Any]:
    found: dict[str, Any] = {
        "body": group[shape.body],
        "kind": shape.kind,
        "rgb": [round(255 * float(c)) for c in shape.rgba[:3]],
    }
    if shape.rgba[3] < _SKIN:
        found["skin"] = round(float(shape.rgba[3]), 3)
        found["rgb"] = [_FLESH] * 3
    if shape.kind == "mesh":
        middle = shape.points.mean(axis=0)
        span = float(np.abs(shape.points - middle).max())
        found |= {"middle": _rounded(middle, 6), "vertices": _packed(shape.points - middle, span)}
        found["faces"] = _base64(shape.faces.astype("<u2"))
    else:
        found |= {"points": _rounded(shape.points, 5), "radius": round(shape.radius, 5)}
    return found


def _off(frames: Frames) -> str:
    """How far the model is from the desired pose, in words."""
    turn, way = frames.largest_error
    pairs = ((np.rad2deg(turn), "deg"), (1e3 * way, "mm"))
    parts = [f"{short(value)} {unit}" for value, unit in pairs if value > _EXACT]
    return f"at most {' and '.join(parts)} off" if parts else "the same as the model's"


def _tendons(frames: Frames, paths: list[motion.Path], group: dict[int, int]) -> list[dict[str, Any]]:
    with np.errstate(invalid="ignore"):  # activation may be unknown
        own = frames.tendon_rgba(0)
    found = []
    for path in paths:
        stops: list[Any] = [
            [group[stop[0]], *_rounded(stop[1], 5)] if isinstance(stop, tuple) else -1 if stop is None else stop
            for i, stop in enumerate(path.stops)
            if i not in path.closed
        ]
        muscles = np.flatnonzero(frames.tendon_of_muscle == path.tendon).tolist()
        tendon: dict[str, Any] = {"stops": stops, "muscles": muscles}
        if not muscles:
            tendon["rgb"] = hex_colour(own[path.tendon])
        found.append(tendon)
    return found


def _rings(frames: Frames, group: dict[int, int]) -> list[dict[str, Any]]:
    """Where muscles act that have no path to be drawn: at joints, sites or bodies, or through fixed tendons."""
    model = frames.model
    places: dict[tuple[int, tuple[float, ...]], list[int]] = {}
    drawn = {path.tendon for path in motion.paths_of(model)}
    for muscle, tendon in enumerate(frames.tendon_of_muscle):
        if int(tendon) not in drawn:
            body, at = motion.where_it_acts(model, int(frames.muscle_ids[muscle]))
            at_key = (body, tuple(_rounded(at, 5)))
            places.setdefault(at_key, []).append(muscle)
    return [{"body": group[body], "at": list(at), "muscles": of} for (body, at), of in places.items()]


def _grounds(model: Any, view: motion.View) -> list[dict[str, Any]]:
    """Planes that stand still and lie in or near the picture: a point, two axes, half lengths (0: no end)."""
    found = []
    for geom, half in planes_of(model):
        if model.body_weldid[model.geom_bodyid[geom]] != 0:
            continue
        _, corner = geom_in_group(model, geom, np.vstack([np.zeros(3), np.eye(3)]))
        normal = corner[3] - corner[0]
        distance = np.abs((view.centre - corner[0]) @ normal)
        if distance.min() < 3 * float(view.half.max()):
            axes = [_rounded(corner[i] - corner[0], 6) for i in (1, 2)]
            found.append({"at": _rounded(corner[0], 5), "axes": axes, "half": _rounded(half, 4)})
    return found


def _colours() -> list[str]:
    return [hex_colour(rgba) for rgba in activation_rgba(np.linspace(0.0, 1.0, _COLOURS))]


def _shares(values: ArrayLike) -> str:
    """Numbers from 0 to 1 as 16 bits; `UNKNOWN` where it is none."""
    array = np.asarray(values, dtype=float)
    found = np.rint(np.clip(np.nan_to_num(array), 0.0, 1.0) * (UNKNOWN - 1)).astype("<u2")
    found[~np.isfinite(array)] = UNKNOWN
    return _base64(found)


def _packed(values: NDArray[np.float64], span: float) -> dict[str, Any]:
    """Numbers from -span to span as 16 bits: value = scale * integer, off by half a scale at most."""
    scale = span / 32767
    whole = np.rint(values / scale) if scale > 0 else np.zeros(values.shape)
    return {"scale": scale, "of": _base64(np.clip(whole, -32767, 32767).astype("<i2"))}


def _base64(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


def _rounded(values: ArrayLike, digits: int) -> list[Any]:
    """Nested lists of numbers; without -0."""
    found: list[Any] = (np.round(np.asarray(values, dtype=float), digits) + 0.0).tolist()
    return found


def _html_of(data: dict[str, Any]) -> str:
    colours = data["colours"]
    text = (Path(__file__).parent / "replay.html").read_text(encoding="utf-8")
    stops = ", ".join(colours[i] for i in range(0, _COLOURS, 15))
    flesh = f"rgb({_FLESH} {_FLESH} {_FLESH} / .3)"
    text = text.replace("{{flesh}}", flesh)
    return text.replace("{{gradient}}", stops).replace("{{title}}", html.escape(data["title"], quote=True))
