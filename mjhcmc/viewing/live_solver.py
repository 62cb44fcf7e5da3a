"""Solving again and again as someone drags: what is asked for, what comes of it, and how long it took.

`LiveSolver` turns a request into a result; nothing here knows of a page. `newest.Newest` keeps a thread at it.
"""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcError, MjhcmcWarning, ModelError
from mjhcmc.log import get_logger
from mjhcmc.methods.hcmc import hcmc
from mjhcmc.methods.run import Progress
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.solution import Solution
from mjhcmc.verify import Verdict, judge
from mjhcmc.viewing.live_reflex import Reflex, reflex_of

Array = NDArray[np.float64]

MOST_JOINTS = 8
"""Sliders for more joints are no help: those with most muscles are taken."""

LASTING = 0.8
"""s: a movement has as many whole cycles as this holds, 1 at least and 3 at most: longer ones take longer to solve."""

_MOST_CYCLES = 3  # as the paper's movements have

_WIDEST = {True: np.deg2rad(60.0), False: 0.1}  # rad, m: most that a slider moves a hinge, a slide
_SHORTEST, _LONGEST = 0.2, 1.2  # s a cycle
_PERIOD_STEP = 0.02  # s
_POSES = 4  # in which moment arms are looked for
_ARM = 1e-6  # m

_log = get_logger(__name__)


@dataclass(frozen=True)
class LiveJoint:
    """A joint that a slider moves.

    Attributes:
        name: of the degree of freedom.
        is_rotation: rad; else m.
        low: least amplitude, rad or m, that keeps to the joint's range.
        high: largest.
    """

    name: str
    is_rotation: bool
    low: float
    high: float


@dataclass(frozen=True)
class LiveRequest:
    """A movement and a reflex.

    Attributes:
        amplitudes: rad or m by joint, see `Motion.cosine`.
        period: s a cycle.
        reflex: what is added to the excitations.
        asked: when, on the clock of `time.perf_counter`.
    """

    amplitudes: tuple[float, ...]
    period: float
    reflex: Reflex = field(default_factory=Reflex)
    asked: float = 0.0

    @property
    def healthy(self) -> LiveRequest:
        """The same movement without a reflex."""
        return replace(self, reflex=replace(self.reflex, gain=0.0))

    def same_movement(self, other: LiveRequest) -> bool:
        """Whether both ask for the same movement."""
        return (self.amplitudes, self.period) == (other.amplitudes, other.period)


@dataclass(frozen=True, eq=False)
class LiveResult:
    """What came of a request.

    Attributes:
        request: the request.
        solution: None where it failed.
        reflex: (N, n_muscle) the part of the excitations that the reflex imposes; None where it failed.
        error: one line; None where there is a solution.
        notes: what was warned of, one line each.
        solve_time: s.
    """

    request: LiveRequest
    solution: Solution | None
    reflex: Array | None
    error: str | None
    notes: tuple[str, ...]
    solve_time: float

    @cached_property
    def verdict(self) -> Verdict | None:
        """Without replay, which would take longer than the solve; None where it failed."""
        return None if self.solution is None else judge(replace(self.solution, model=None))

    @cached_property
    def cocontraction(self) -> Array:
        """(nv,) share of the muscles' moments that is given twice, against each other: see `cocontraction_of`."""
        assert self.solution is not None
        return cocontraction_of(self.solution)


def cocontraction_of(solution: Solution) -> Array:
    """(nv,) co-contraction index of each joint, 0 .. 1 over the whole movement.

    With the moments M+ and M- of the muscles that pull to either side, 2 int min(M+, M-) dt / int (M+ + M-) dt, after
    the index of EMG of Falconer and Winter (1985, Electromyogr Clin Neurophysiol 25, 135-149), of moments in place of
    EMG. NaN where no muscle acts.
    """
    moment = solution.detail.active_moment
    up, down = np.clip(moment, 0, None).sum(axis=1), np.clip(-moment, 0, None).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(2 * np.minimum(up, down).sum(axis=0) / (up + down).sum(axis=0))


class LiveSolver:
    """HCMC of cosine movements of one model, with a stretch reflex on top.

    One thread at a time may use it.

    Args:
        model: the model.
        dt: s, control window.
        physics_dt: s, physics step.

    Attributes:
        joints: that requests move, in the order of `LiveRequest.amplitudes`.
        left_out: names of tracked joints that are not among them.

    Raises:
        ModelError: no joint that muscles move could follow a cosine.
    """

    def __init__(self, model: MuscleModel, *, dt: float = 0.01, physics_dt: float = 0.001) -> None:
        self.model, self.dt, self.physics_dt = model, dt, physics_dt
        self.joints, self.left_out = live_joints(model)
        if not self.joints:
            raise ModelError(f"model {model.name!r} has no hinge or slide that muscles move: live has nothing to drag")

    @property
    def periods(self) -> tuple[float, float, float]:
        """Least and largest period and its steps, s; whole numbers of control windows."""
        step = self.dt * max(1, round(_PERIOD_STEP / self.dt))
        least = max(1, math.ceil(_SHORTEST / step - 1e-9))
        most = max(least + 1, math.floor(_LONGEST / step + 1e-9))
        return round(least * step, 9), round(most * step, 9), round(step, 9)

    def motion_of(self, request: LiveRequest) -> Motion:
        """The movement that a request asks for.

        Raises:
            MotionError: it leaves a joint's range.
            SettingsError: a number that is none.
        """
        names = (joint.name for joint in self.joints)
        amplitudes = dict(zip(names, request.amplitudes, strict=True))
        return Motion.cosine(
            self.model, amplitudes=amplitudes, period=request.period, cycles=cycles_of(request.period)
        )  # fmt: skip

    def solve(self, request: LiveRequest, progress: Progress | None = None) -> LiveResult:
        """Solve a request. A failure is in the result.

        Args:
            request: what is asked for.
            progress: see `hcmc`.

        Raises:
            SolveInterrupted: progress raised a KeyboardInterrupt.
        """
        began = time.perf_counter()
        solution, reflex, error = None, None, None
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", MjhcmcWarning)
            try:
                solution, reflex = self._solve(request, progress)
            except MjhcmcError as failure:
                error = str(failure)
            except Exception as failure:  # whatever it is, the page lives on; the log tells where
                _log.exception("live: a solve failed")
                error = f"{type(failure).__name__}: {failure}: please report it, with the sliders' values"
        seconds = time.perf_counter() - began
        notes = tuple(str(one.message) for one in caught if issubclass(one.category, MjhcmcWarning))
        return LiveResult(request, solution, reflex, error, notes, seconds)

    def _solve(self, request: LiveRequest, progress: Progress | None) -> tuple[Solution, Array]:
        motion = self.motion_of(request)
        imposed = reflex_of(self.model, motion, self.dt, request.reflex) if request.reflex.gain > 0 else None
        solution = hcmc(self.model, motion, self.dt, self.physics_dt, imposed=imposed, progress=progress)
        if not (np.isfinite(solution.excitation).all() and np.isfinite(solution.qpos).all()):
            raise MjhcmcError("the solution holds values that are not finite: take smaller amplitudes")
        part = np.zeros_like(solution.excitation) if imposed is None else imposed.over(solution.time)
        return solution, part

    def warm_up(self) -> float:
        """Compile what solves need, by a movement of a few windows; how long it took, s."""
        began = time.perf_counter()
        rest = LiveRequest(tuple(0.0 for _ in self.joints), max(self.periods[0], 2 * self.dt), Reflex())
        result = self.solve(rest)
        if result.solution is not None:
            _ = result.verdict, result.cocontraction
        return time.perf_counter() - began


def cycles_of(period: float) -> int:
    """Cycles of a movement of a period in s, see `LASTING`."""
    return min(max(int(LASTING / period + 1e-9), 1), _MOST_CYCLES)


def live_joints(model: MuscleModel) -> tuple[tuple[LiveJoint, ...], tuple[str, ...]]:
    """The joints for sliders, in the model's order, and the names of tracked ones that are left out.

    Tracked hinges and slides; where there are more than `MOST_JOINTS`, those with most muscles.
    """
    m = model.mj_model
    found: list[tuple[int, LiveJoint]] = []
    left_out = []
    for dof in model.roles.tracked:
        joint = int(m.dof_jntid[dof])
        name = model.dof_names[dof]
        if int(m.jnt_type[joint]) not in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)):
            left_out.append(name)
            continue
        at = int(m.jnt_qposadr[joint])
        most = _WIDEST[bool(model.dof_is_rotation[dof])]
        low, high = model.joint_range[at] - model.qpos_reference[at]
        low, high = max(low, -most), min(high, most)
        if low <= 0 <= high and high - low > 0:  # the movement begins at the reference pose
            found.append((int(dof), LiveJoint(name, bool(model.dof_is_rotation[dof]), float(low), float(high))))
        else:
            left_out.append(name)
    if len(found) > MOST_JOINTS:
        count = _muscles_at(model)
        kept = sorted(found, key=lambda one: -count[one[0]])[:MOST_JOINTS]
        left_out += [joint.name for dof, joint in found if (dof, joint) not in kept]
        found = [one for one in found if one in kept]
    return tuple(joint for _, joint in found), tuple(left_out)


def _muscles_at(model: MuscleModel) -> NDArray[np.intp]:
    """(nv,) how many muscles have a moment arm there, in the reference pose or near it."""
    m = model.mj_model
    data, dense, rng = mujoco.MjData(m), np.empty((m.nout, m.nv)), np.random.default_rng(0)
    arms = np.zeros((model.n_muscle, model.nv), dtype=bool)
    for _ in range(_POSES):
        data.qpos[:] = model.qpos_reference
        mujoco.mj_integratePos(m, data.qpos, rng.uniform(-0.1, 0.1, model.nv), 1.0)
        mujoco.mj_fwdPosition(m, data)
        mujoco.mju_sparse2dense(dense, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
        arms |= np.abs(dense[m.actuator_outadr[model.muscle_ids]]) > _ARM
    return np.asarray(arms.sum(axis=0))
