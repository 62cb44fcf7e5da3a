"""Inverse kinematics: joint angles from markers (.trc, .c3d) that follow sites of the model.

The model's root is fixed to the world, the markers stand in the laboratory's frame. In each frame f the joint angles
q and a rigid transform (R, p) from the laboratory to the model minimise

    sum over markers i of | R y_i + p - x_i(q) |^2,    q within the joints' ranges,

y_i the marker, x_i(q) its site. For given q the best (R, p) is closed form (Kabsch 1976, Acta Cryst. A32, 922-923),
which leaves a least-squares problem in q alone (variable projection: Golub & Pereyra 1973, SIAM J. Numer. Anal. 10,
413-432; its Jacobian in the form of Kaufman 1975, BIT 15, 49-57). It is solved by Levenberg-Marquardt within bounds
(mujoco.minimize), from the angles of the frame before. Lengths of the model are taken as they are: it is not scaled.

The angles follow from the markers only where at least three that do not lie on a line are on bodies that no joint
moves (a pelvis, where it is the root), and others see every joint.

Any rigid transform is allowed, so that Y up is as good as Z up; a reflection is none. Markers in left-handed axes fit
badly, and are known by this: mirrored, they fit.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import minimize
from numpy.typing import NDArray

from mjhcmc.errors import ModelError, MotionError
from mjhcmc.io.columns import listed
from mjhcmc.io.rows import JointRows, crop, rows_of_motion, span
from mjhcmc.io.trc import MarkerTable, read_markers
from mjhcmc.joints import JointModel

Array = NDArray[np.float64]

_ON_A_LINE = 0.01  # second to first extent of the markers that no joint moves: they are on a line
_UNSEEN = 1e-3  # of the markers' spread a radian: less of a joint's turn is not seen
_TOLERANCE = 1e-10  # of the gradient, m2/rad: some 1e-7 rad; less drowns in the rounding of the sum of squares
_NOTHING = 1e-14  # m2: a sum of squares that is rounding
_STEPS = 200
_STARTS = 8  # poses that the first frame is tried from
# Skin slides over the bone by some 40 mm where it is worst, at the thigh (Leardini et al. 2005, Gait Posture 21,
# 212-225): the rms over a set of markers stays below this, whatever the subject
_NO_FIT = 0.05  # m rms
_NO_FIT_SHARE = 0.25  # rms to the markers' spread, for small animals: markers on random sites have about 1
_WORTH_A_WORD = 0.4  # of these: more means markers on the wrong sites, or a model of other lengths
_MIRRORED = 0.5  # of the rms as they are: markers that fit better than this when mirrored are mirrored
_MIRRORED_FRAMES = 12


def marker_rows(
    path: Path, model: JointModel, site_map: dict[str, str], start: float | None, end: float | None, reach: float
) -> JointRows:
    """Joint angles from a marker file.

    Args:
        path: the .trc or .c3d file.
        model: a MuscleModel; a marker is matched with the site of its name (without a subject's name and colon in
            front, where that leaves one).
        site_map: site to marker, where names differ.
        start: s on the file's clock; None: its first row.
        end: s on the file's clock; None: its last row.
        reach: s of rows outside start and end that a filter needs.

    Returns:
        The rows; their notices tell how well the markers were met, which were not used, and where a joint was held
        at its limit.

    Raises:
        MotionError: the file or the map does not allow it, the markers do not determine the angles, in all or in
            one frame, their axes are left-handed, or they are nowhere near their sites.
        ModelError: the model is no MuscleModel.
    """
    m = getattr(model, "mj_model", None)
    if m is None:
        raise ModelError(f"model {model.name}: markers need its sites: give a MuscleModel")
    table = read_markers(path)
    sites, used = _match(table, model, m, site_map)
    names = [table.names[i] for i in used]
    fit = _Fit(model, m, sites)
    missing = fit.what_is_missing(np.ones(len(sites), dtype=bool), names)
    if missing:
        raise MotionError(f"{path}: {missing}")
    positions = table.positions[:, used]
    seen = ~np.isnan(positions[:, :, 0])
    kept = crop(path, table.time, start, end)
    wanting: dict[bytes, str | None] = {}
    for row in seen:
        if row.tobytes() not in wanting:
            wanting[row.tobytes()] = fit.what_is_missing(row, names)
    for row in kept:
        if why := wanting[seen[row].tobytes()]:
            unseen = [name for name, there in zip(names, seen[row], strict=True) if not there]
            raise MotionError(
                f"{path}, {table.row_word} {table.line_numbers[row]}: at {table.time[row]:.6g} s "
                f"marker{'s' * (len(unseen) > 1)} "
                f"{listed(unseen)} not seen: {why}, or fill the gap, or crop it away with start and end"
            )
    sound = np.array([wanting[row.tobytes()] is None for row in seen])
    flat = np.nan_to_num(positions.reshape(len(positions), -1))
    flat[~sound] = np.nan
    rows = rows_of_motion(path, table.time, table.line_numbers, flat, kept, reach)
    qpos, distance = fit.solve(positions[rows], seen[rows])
    begin, finish = span(table.time, kept, rows, start, end)
    inside = (table.time[rows] >= begin) & (table.time[rows] <= finish)
    fit_notice = _fit_notice(names, table.time[rows][inside], distance[inside])
    misfit = _misfit(positions[rows][inside], distance[inside])
    if misfit > _WORTH_A_WORD:
        if why := fit.what_is_mirrored(positions[rows][inside], seen[rows][inside], distance[inside]):
            raise MotionError(f"{path}: {fit_notice}: {why}")
        if misfit > 1:
            raise MotionError(
                f"{path}: {fit_notice}: too far for markers on these sites: check which marker is on which site "
                "(column map of sites and markers), the file's unit, and the model's lengths, which are not scaled to "
                "the subject"
            )
        fit_notice += ": markers on wrong sites, or a model of other lengths, make such distances"
    unused = [name for i, name in enumerate(table.names) if i not in used]
    notices = [
        fit_notice,
        *fit.limit_notices(table.time[rows][inside], qpos[inside]),
        *([f"markers not used: {listed(unused)}"] if unused else []),
    ]
    return JointRows(table.time[rows], qpos, (begin, finish), tuple(notices))


def _match(table: MarkerTable, model: JointModel, m: Any, site_map: dict[str, str]) -> tuple[list[int], list[int]]:
    """Sites of the model and the markers, by index, that belong together."""
    named = {name: i for i in range(m.nsite) if (name := mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_SITE, i))}
    unknown = [site for site in site_map if site not in named]
    if unknown:
        raise MotionError(
            f"column map: model {model.name} has no site {listed(unknown)}: its sites are {listed(list(named))}"
        )
    places: dict[str, int] = {name.rpartition(":")[2]: i for i, name in reversed(list(enumerate(table.names)))}
    places |= {name: i for i, name in enumerate(table.names)}
    absent = [marker for marker in site_map.values() if marker not in places]
    if absent:
        raise MotionError(
            f"{table.path}: no marker {listed(absent)}, which the column map names; its markers are "
            f"{listed(table.names)}: name one of them"
        )
    chosen = {site: places[marker] for site, marker in site_map.items()}
    pairs = {**{site: places[site] for site in named if site in places}, **chosen}
    taken: dict[int, str] = {}
    for site, marker in pairs.items():
        if marker in taken:
            raise MotionError(
                f"{table.path}: marker {table.names[marker]!r} stands for the sites {taken[marker]} and {site}: "
                "map each site to a marker of its own"
            )
        taken[marker] = site
    if not pairs:
        raise MotionError(
            f"{table.path}: no marker has the name of a site of model {model.name}; the markers are "
            f"{listed(table.names)}, the sites {listed(list(named))}: give a column map of sites and markers"
        )
    return [named[site] for site in pairs], list(pairs.values())


@dataclass(frozen=True, eq=False)
class _Pose:
    """Where the sites are, m, and how they move, (n, 3, nq) m/rad or m/m."""

    sites: Array
    jacobian: Array


class _Fit:
    """Joint angles from the positions of some sites."""

    def __init__(self, model: JointModel, m: Any, sites: list[int]) -> None:
        self.model, self.m, self.sites = model, m, np.array(sites)
        self.data = mujoco.MjData(m)
        bodies = m.site_bodyid[self.sites]
        self.fixed = m.body_weldid[bodies] == 0
        self.moved = np.array([[_moves(m, int(body), joint) for joint in range(m.njnt)] for body in bodies])
        self.rotates = np.asarray(model.joint_is_rotation, dtype=bool)
        limits = np.asarray(model.joint_range, dtype=np.float64)
        # the solver wants finite bounds that differ
        self.low = np.where(np.isfinite(limits[:, 0]), limits[:, 0], -1e6)
        self.high = np.maximum(np.where(np.isfinite(limits[:, 1]), limits[:, 1], 1e6), self.low + 1e-12)

    def pose(self, qpos: Array) -> _Pose:
        """Forward kinematics of the sites."""
        data = self.data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self.m, data)
        sites = data.site_xpos[self.sites].copy()
        arms = sites[:, None] - data.xanchor
        turned = np.where(self.rotates[:, None], np.cross(data.xaxis, arms), data.xaxis)
        return _Pose(sites, np.swapaxes(turned * self.moved[:, :, None], 1, 2))

    def what_is_missing(self, seen: NDArray[np.bool_], names: list[str]) -> str | None:
        """Why these markers do not determine the joint angles, and the remedy; None where they do."""
        # a pose without symmetry: at rest, a chain may be straight, and two joints look alike
        somewhere = np.asarray(self.model.qpos_reference) + 0.1 * (1 + np.arange(self.m.nq) % 5)
        pose = self.pose(np.clip(somewhere, self.low, self.high))
        still = pose.sites[self.fixed & seen]
        extent = np.linalg.svd(still - still.mean(axis=0), compute_uv=False) if len(still) > 2 else np.zeros(3)
        if extent[1] <= _ON_A_LINE * extent[0]:
            there = [name for name, ok in zip(names, self.fixed & seen, strict=True) if ok]
            return (
                "the joint angles need at least 3 markers, not on a line, on the bodies that no joint of model "
                f"{self.model.name} moves; {'there is only ' if there else 'there is none'}{listed(there)}: "
                "add markers there (sites, or a column map of sites and markers)"
            )
        spread = np.sqrt(((pose.sites[seen] - pose.sites[seen].mean(axis=0)) ** 2).sum(axis=1).mean())
        jacobian = _without_rigid(pose.sites[seen], pose.jacobian[seen]) * np.where(self.rotates, 1.0, spread)
        _, singular, directions = np.linalg.svd(jacobian, full_matrices=True)
        least = singular[-1] if len(singular) == self.m.nq else 0.0
        if least <= _UNSEEN * spread:
            joint = self.model.joint_names[int(np.argmax(np.abs(directions[-1])))]
            return (
                f"the markers do not see joint {joint} of model {self.model.name}: add one on a body that it moves, "
                "off its axis"
            )
        return None

    def solve(self, positions: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
        """(T, nq) joint angles, and (T, n) distance of each marker from its site, m, NaN where not seen."""
        qpos = np.empty((len(positions), self.m.nq))
        distance = np.full(seen.shape, np.nan)
        best = np.asarray(self.model.qpos_reference, dtype=np.float64)
        for frame, (points, there) in enumerate(zip(positions, seen, strict=True)):
            starts = self._starts() if frame == 0 else [best]
            trials = [self._solve_one(guess, points[there], there) for guess in starts]
            costs = np.array([float(np.sum(residual**2)) for _, residual in trials])
            # the first of those that are as good as the best: the one from the reference pose, if it is
            best, residual = trials[int(np.argmax(costs <= costs.min() * (1 + 1e-6) + _NOTHING))]
            if frame == 0:
                best = self._within_half_a_turn(best)
            qpos[frame] = best
            distance[frame, there] = np.linalg.norm(residual, axis=1)
        return qpos, distance

    def what_is_mirrored(self, positions: Array, seen: NDArray[np.bool_], distance: Array) -> str | None:
        """Left-handed axes in words, where the markers fit much better mirrored; distance (T, n) m as they are."""
        some = np.unique(np.linspace(0, len(positions) - 1, _MIRRORED_FRAMES).round().astype(int))
        # frame by frame, each as a first one: they are too far apart to lead one another
        mirrored = [self.solve(positions[[f]] * [-1.0, 1.0, 1.0], seen[[f]])[1] for f in some]
        there, as_they_are = _rms(np.concatenate(mirrored)), _rms(distance[some])
        if there < _MIRRORED * as_they_are:
            return (
                f"axes are left-handed: mirrored, the markers come within {1e3 * there:.3g} mm rms: reverse the sign "
                "of one axis, or swap two, in the file; or the markers are of the body's other side"
            )
        return None

    def limit_notices(self, time: Array, qpos: Array) -> list[str]:
        """A line for each joint that its range held back."""
        notices = []
        for joint, name in enumerate(self.model.joint_names):
            low, high = self.low[joint], self.high[joint]
            held = np.flatnonzero((qpos[:, joint] <= low) | (qpos[:, joint] >= high))
            if len(held):
                scale, unit = (180 / np.pi, "deg") if self.rotates[joint] else (1.0, "m")
                notices.append(
                    f"joint {name} is held at a limit of its range {scale * low:.6g} .. {scale * high:.6g} {unit} in "
                    f"{len(held)} of {len(qpos)} frames, first at {time[held[0]]:.6g} s"
                )
        return notices

    def _within_half_a_turn(self, qpos: Array) -> Array:
        """Hinges without limits turned by whole turns to within half a one of the reference pose."""
        reference = np.asarray(self.model.qpos_reference, dtype=np.float64)
        free = self.rotates & ~np.isfinite(np.asarray(self.model.joint_range)).any(axis=1)
        turns = np.round((qpos - reference) / (2 * np.pi))
        whole: Array = np.where(free, qpos - 2 * np.pi * turns, qpos)
        return whole

    def _starts(self) -> list[Array]:
        """The reference pose, and others all over the joints' ranges."""
        reference = np.asarray(self.model.qpos_reference, dtype=np.float64)
        low, high = np.maximum(self.low, reference - np.pi), np.minimum(self.high, reference + np.pi)
        random = np.random.default_rng(0)
        return [reference, *random.uniform(low, np.maximum(low, high), (_STARTS - 1, len(reference)))]

    def _solve_one(self, guess: Array, points: Array, there: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Joint angles of one frame, and the residuals (n, 3), m."""

        def residual(x: Array) -> Array:
            columns = [_align(points, self.pose(q).sites[there]) for q in x.T]
            return np.stack([column.ravel() for column in columns], axis=1)

        def jacobian(x: Array, r: Array) -> Array:
            pose = self.pose(x[:, 0])
            # rigid motions act at R y + p = x + r; taken at x, the gradient is the same, since r . (w x r) = 0
            return -_without_rigid(pose.sites[there], pose.jacobian[there])

        x, _ = minimize.least_squares(
            guess, residual, [self.low, self.high], jacobian, verbose=minimize.Verbosity.SILENT,
            xtol=1e-9, gtol=_TOLERANCE, max_iter=_STEPS,
        )  # fmt: skip
        q = np.asarray(x, dtype=np.float64).reshape(-1)
        return q, residual(q[:, None]).reshape(-1, 3)


def _moves(m: Any, body: int, joint: int) -> bool:
    """Whether a joint moves a body."""
    while body > 0:
        if body == m.jnt_bodyid[joint]:
            return True
        body = int(m.body_parentid[body])
    return False


def _align(points: Array, target: Array) -> Array:
    """(n, 3) R y_i + p - x_i for the rigid transform that makes it least."""
    y, x = points - points.mean(axis=0), target - target.mean(axis=0)
    u, _, vt = np.linalg.svd(y.T @ x)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    aligned: Array = y @ turn - x
    return aligned


def _without_rigid(points: Array, jacobian: Array) -> Array:
    """(3n, nq) what of the sites' movement is no rigid movement of all of them."""
    arms = points - points.mean(axis=0)
    rigid = np.zeros((len(points), 3, 6))
    rigid[:, :, :3] = np.eye(3)
    rigid[:, :, 3:] = np.swapaxes(np.cross(np.eye(3), arms[:, None]), 1, 2)
    basis, _ = np.linalg.qr(rigid.reshape(-1, 6))
    flat = jacobian.reshape(-1, jacobian.shape[2])
    projected: Array = flat - basis @ (basis.T @ flat)
    return projected


def _fit_notice(names: list[str], time: Array, distance: Array) -> str:
    """How well the markers were met."""
    frame, marker = np.unravel_index(int(np.nanargmax(distance)), distance.shape)
    return (
        f"inverse kinematics on {len(names)} markers: {1e3 * _rms(distance):.3g} mm rms, worst {names[marker]} with "
        f"{1e3 * distance[frame, marker]:.3g} mm at {time[frame]:.6g} s"
    )


def _misfit(positions: Array, distance: Array) -> float:
    """How far markers (T, n, 3) m are from their sites, (T, n) m, to what no markers on the right ones are."""
    spread = _rms(np.linalg.norm(positions - np.nanmean(positions, axis=1, keepdims=True), axis=2))
    return _rms(distance) / min(_NO_FIT, _NO_FIT_SHARE * spread)


def _rms(distance: Array) -> float:
    """Root of the mean square of those that are there."""
    return float(np.sqrt(np.nanmean(distance**2)))
