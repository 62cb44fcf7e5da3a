"""Solution: what a method found, window by window and node by node, with a status for each window."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.coordinate_names import NamedCoordinates
from mjhcmc.errors import OutputError, SimulationError
from mjhcmc.plant import RK4_LIMIT, MujocoPlant, State
from mjhcmc.surroundings import Surroundings

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from mjhcmc.detail import Detail
    from mjhcmc.hosted.muscles import HostedMuscles
    from mjhcmc.model import MuscleModel
    from mjhcmc.verify import Verdict

RESERVE_SHARE = 1e-3
"""A window is flagged where a reserve exceeds this share of the joint's peak net moment."""

_ROLES = ("tracked", "dependent", "prescribed", "free")  # see `roles.Role`
_NO_MOMENT = 1e-3  # N m or N: a joint that carries less carries nothing worth a reserve's share


class WindowStatus(IntEnum):
    """How a control window went; of several findings the gravest stands."""

    OK = 0
    RESERVE = 1
    UNMET = 2
    STIFF = 3

    @property
    def message(self) -> str:
        """What it means and what to do next."""
        return _MESSAGES[self]


_MESSAGES = {
    WindowStatus.OK: "the muscles gave the moments that were asked for",
    WindowStatus.RESERVE: "a reserve helped: the muscles cannot give the moment in time; see the verdict for which",
    WindowStatus.UNMET: "activation is too slow, or muscles too weak, and no reserve helps: expect a tracking error",
    WindowStatus.STIFF: "the active muscles are too stiff for the physics step: solve again with a smaller physics_dt",
}


def moment_scale(net_joint_moment: NDArray[np.float64]) -> NDArray[np.float64]:
    """(nv,) N m or N: each joint's own peak net moment, what its reserve is measured by; at least .001.

    Args:
        net_joint_moment: (N+1, nv) N m or N.
    """
    return np.asarray(np.maximum(np.abs(net_joint_moment).max(axis=0), _NO_MOMENT))


def window_status(
    moment: NDArray[np.float64],
    reserve: NDArray[np.float64],
    shortfall: NDArray[np.float64],
    step_times_rate: NDArray[np.float64],
    limit: float = RK4_LIMIT,
) -> NDArray[np.int64]:
    """(N,) `WindowStatus` of each window.

    Args:
        moment: (N+1, nv) N m, net joint moments.
        reserve: (N, nv) N m.
        shortfall: (N, nv) N m.
        step_times_rate: (N,) physics step times the fastest decay rate at the window's end.
        limit: of it, above which the integrator is unstable.
    """
    least = RESERVE_SHARE * moment_scale(moment)
    status = np.full(len(reserve), int(WindowStatus.OK), dtype=np.int64)
    status[(np.abs(reserve) > least).any(axis=1)] = WindowStatus.RESERVE
    status[(np.abs(shortfall - reserve) > least).any(axis=1)] = WindowStatus.UNMET
    status[step_times_rate > limit] = WindowStatus.STIFF
    return status


@dataclass(frozen=True, eq=False)
class Solution:
    """Excitations and everything that follows from them: N control windows between N + 1 nodes.

    Attributes:
        time: (N+1,) s, on the motion file's own clock.
        excitation: (N, n_muscle) in [0, 1], constant over a window.
        activation: (N+1, n_muscle).
        qpos: (N+1, nq) rad or m, of the muscle-driven model.
        qpos_desired: (N+1, nq) rad or m.
        qvel: (N+1, nv) rad/s or m/s, of the muscle-driven model.
        tracking_error: (N+1, nv) rad or m, actual minus desired.
        residual: (N+1, nv) N m or N: at prescribed degrees of freedom what keeps them on the motion beside the muscles,
            at tracked ones of the root the reserve, elsewhere 0.
        net_joint_moment: (N+1, nv) N m or N: M q'' + bias - passive - limits and contacts - other actuators -
            external load of the simulated motion, equal to R^T F + reserve (the reserve of the window that starts at
            the node; last node: the last window's). What acts on dependent degrees of freedom is counted at those that
            move them.
        muscle_force: (N+1, n_muscle) N along the tendon, pulling positive: active, passive and fiber damping.
        reserve: (N, nv) N m or N, constant over a window and applied to the plant.
        shortfall: (N, nv) N m or N: what the muscles could not give at the window's end. The reserve where reserves
            are on; where they are off, the part that nothing gave.
        external_load: (N+1, nv) N m or N, generalized forces from outside at the nodes.
        status: (N,) `WindowStatus`, as integers.
        muscle_names: (n_muscle,).
        dof_names: (nv,).
        dof_is_rotation: (nv,) True where rad, False where m.
        settings: how it was made: method, model, motion, dt, physics_dt and the method's own settings.
        interrupted: True where the solve was stopped before the motion's end.
        model: the model that was driven; None where the solution was read from a file without it.
        stored_verdict: the verdict that a file held, if any.
        surroundings: what acted from outside and led prescribed joints; None where the solution was read from a file
            that does not hold it.
        fiber_length: (N+1, n_muscle) m, of Hill muscles with compliant tendons; None of others.
        muscles: the Hill muscles that drove the model; None where MuJoCo's own did, or a file does not tell which.
        coordinate_names: (nq,) see `MuscleModel.joint_names`. Left out: the model's, or else `dof_names`.
    """

    time: NDArray[np.float64]
    excitation: NDArray[np.float64]
    activation: NDArray[np.float64]
    qpos: NDArray[np.float64]
    qpos_desired: NDArray[np.float64]
    qvel: NDArray[np.float64]
    tracking_error: NDArray[np.float64]
    net_joint_moment: NDArray[np.float64]
    muscle_force: NDArray[np.float64]
    reserve: NDArray[np.float64]
    shortfall: NDArray[np.float64]
    external_load: NDArray[np.float64]
    status: NDArray[np.int64]
    muscle_names: tuple[str, ...]
    dof_names: tuple[str, ...]
    dof_is_rotation: NDArray[np.bool_]
    settings: dict[str, Any] = field(default_factory=dict)
    interrupted: bool = False
    model: MuscleModel | None = field(default=None, repr=False, compare=False)
    stored_verdict: Verdict | None = field(default=None, repr=False, compare=False)
    surroundings: Surroundings | None = field(default=None, repr=False, compare=False)
    fiber_length: NDArray[np.float64] | None = None
    residual: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    muscles: HostedMuscles | None = field(default=None, repr=False, compare=False)
    coordinate_names: tuple[str, ...] = ()

    @property
    def n_window(self) -> int:
        """Number of control windows, N."""
        return len(self.status)

    @property
    def dt(self) -> float:
        """Length of a control window, s."""
        return float(self.settings["dt"])

    @property
    def integrator(self) -> str:
        """What stepped the plant, see `integrators`; files from before there was a choice do not tell: RK4."""
        return str(self.settings.get("integrator", "rk4"))

    @property
    def hosted(self) -> bool:
        """Whether Hill muscles drove the model (see `HillPlant`) in place of MuJoCo's."""
        return self.muscles is not None or "muscles" in self.settings or self.fiber_length is not None

    @property
    def roles(self) -> tuple[str, ...]:
        """(nv,) what each degree of freedom was to the solve, see `roles.Role`."""
        return tuple(self.settings.get("roles") or ["tracked"] * len(self.dof_names))

    @property
    def is_root(self) -> NDArray[np.bool_]:
        """(nv,) True at the root, where reserves are residuals."""
        return np.isin(self.dof_names, self.settings.get("root") or [])

    @property
    def may_have_residual(self) -> NDArray[np.bool_]:
        """(nv,) True where a residual can be: what is prescribed, and what is tracked at the root."""
        roles = np.array(self.roles)
        return np.asarray((roles == "prescribed") | ((roles == "tracked") & self.is_root))

    @cached_property
    def named_coordinates(self) -> NamedCoordinates:
        """Which coordinates belong to which degrees of freedom."""
        return NamedCoordinates(self.coordinate_names, self.dof_names)

    @property
    def knows_surroundings(self) -> bool:
        """Whether what acted from outside, and led prescribed joints, is known as a function of time."""
        return self.surroundings is not None or not (self.external_load.any() or "prescribed" in self.roles)

    def state(self, k: int) -> State:
        """The state at node k."""
        none = np.zeros(len(self.dof_names))
        fiber = np.empty(0) if self.fiber_length is None else self.fiber_length[k]
        return State(float(self.time[k]), self.qpos[k], self.qvel[k], self.activation[k], none, fiber)

    def plant(self, physics_dt: float | None = None) -> MujocoPlant:
        """What was driven, with its surroundings as far as they are known.

        Args:
            physics_dt: s, its physics step; by default that of the solve, but .001 under RK4.

        Raises:
            SimulationError: the solution does not know its model or muscles (it was read from a file).
        """
        if self.model is None:
            raise SimulationError(
                "this solution was read from a file and does not know its model: read it with Solution.load(path, "
                "model=...)"
            )
        if physics_dt is None:
            physics_dt = 1e-3 if self.integrator == "rk4" else float(self.settings["physics_dt"])
        if not self.hosted:
            return MujocoPlant(
                self.model, physics_dt, surroundings=self.surroundings, integrator=self.integrator
            )  # fmt: skip
        if self.muscles is None:
            raise SimulationError("this solution was driven by Hill muscles that its file does not hold: solve again")
        from mjhcmc.hosted.plant import HillPlant

        return HillPlant(self.model, self.muscles, physics_dt=physics_dt, surroundings=self.surroundings)

    @property
    def peak_moment(self) -> NDArray[np.float64]:
        """(nv,) N m or N: the largest |net joint moment| of each joint."""
        return np.asarray(np.abs(self.net_joint_moment).max(axis=0))

    def messages(self) -> list[str]:
        """One line for each kind of status that occurs, with how many windows and the first time."""
        lines = []
        for status in WindowStatus:
            windows = np.flatnonzero(self.status == status)
            if windows.size and status != WindowStatus.OK:
                lines.append(
                    f"{windows.size} of {self.n_window} windows, first at {self.time[windows[0]]:.3f} s: "
                    f"{status.message}"
                )
        return lines

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the simulation holds: reserves and tracking; computed on first access (it replays them)."""
        if self.stored_verdict is not None:
            return self.stored_verdict
        from mjhcmc.verify import judge

        return judge(self)

    @cached_property
    def detail(self) -> Detail:
        """Fibers, muscle power, each muscle's share of the moments, joint reactions; computed on first access.

        Raises:
            SimulationError: the solution does not know its model (it was read from a file without it).
        """
        from mjhcmc.detail import detail_of

        return detail_of(self)

    def save(self, path: str | Path) -> Path:
        """Write the solution, by suffix: .parquet, .csv, .sto, or .nc (extra ``netcdf``).

        The file holds the table of `to_dataframe`; .parquet, .sto and .nc also hold settings and verdict.

        Raises:
            OutputError: an unknown suffix, a folder that cannot be written, or a missing extra.
        """
        from mjhcmc.io.tables import save_solution

        return save_solution(self, Path(path))

    @classmethod
    def load(cls, path: str | Path, model: MuscleModel | str | Path | None = None) -> Solution:
        """Read a solution that `save` wrote.

        A .csv holds no settings, but for an integrator other than RK4 and its step, and no verdict: its verdict is
        judged from the table, without replay unless there is a model, and without one every joint is taken for a hinge.
        Loads from outside, and the motion that prescribed joints followed, are functions of time that no file holds:
        where there were some, the verdict stays the one that was saved, and joint reactions are not known.

        Args:
            path: the file.
            model: the model that was driven, or what `MuscleModel.load` takes; needed for `detail` and a replay only.

        Raises:
            OutputError: the file cannot be read, is no solution, or its muscles, coordinates, degrees of freedom or
                equality constraints are not the model's.
            ModelError: the model cannot be loaded.
        """
        from mjhcmc.io.tables import load_solution

        return load_solution(Path(path), model)

    def to_dataframe(self, detail: bool = False) -> pd.DataFrame:
        """One row a node: time, then q/, q_desired/, qvel/, excitation/, activation/, force/, moment/ ..., status.

        SI units and radians; columns of a window (excitation, reserve, shortfall, status) are empty in the last row.
        Columns q/ and q_desired/ are named by `coordinate_names`; there are residual/ columns only for degrees of
        freedom that can have one (prescribed, or tracked at the root).

        Args:
            detail: add `detail`: fiber_length/<muscle> (m), fiber_velocity/<muscle> (m/s), power/<muscle> (W),
                contribution/<dof>/<muscle> (N m or N), reaction_force/<joint>/<x, y or z> (N) and
                reaction_moment/<joint>/<x, y or z> (N m).

        Raises:
            SimulationError: detail is asked for, but the solution does not know its model.
        """
        from mjhcmc.io.tables import to_dataframe

        return to_dataframe(self, detail)

    def to_xarray(self) -> xr.Dataset:
        """The same as a Dataset with dimensions node, window, muscle, dof (extra ``netcdf``)."""
        from mjhcmc.io.tables import to_xarray

        return to_xarray(self)

    def __repr__(self) -> str:
        """One line: what was solved, and the verdict where it is known already (it takes a replay to find)."""
        verdict = self.stored_verdict or vars(self).get("verdict")
        judged = "" if verdict is None else f", verdict {'holds' if verdict.passed else 'FAILS'}"
        n = len(self.time) - 1
        return (
            f"Solution({self.settings.get('method', '?')}, {n} windows from {self.time[0]:g} to {self.time[-1]:g} s, "
            f"{len(self.muscle_names)} muscles, {len(self.dof_names)} degrees of freedom"
            f"{', interrupted' if self.interrupted else ''}{judged})"
        )

    def __post_init__(self) -> None:
        """Check that the arrays fit together, and make them read-only."""
        if not self.residual.size:
            object.__setattr__(self, "residual", np.zeros_like(self.net_joint_moment))
        if not self.coordinate_names:
            names = self.dof_names if self.model is None else self.model.joint_names
            object.__setattr__(self, "coordinate_names", names)
        n, m, v = len(self.time) - 1, len(self.muscle_names), len(self.dof_names)
        nq = len(self.coordinate_names)
        shapes = {
            "qpos": (n + 1, nq),
            "qpos_desired": (n + 1, nq),
            "dof_is_rotation": (v,),
            "time": (n + 1,),
            "excitation": (n, m),
            "activation": (n + 1, m),
            "qvel": (n + 1, v),
            "tracking_error": (n + 1, v),
            "net_joint_moment": (n + 1, v),
            "residual": (n + 1, v),
            "muscle_force": (n + 1, m),
            "reserve": (n, v),
            "shortfall": (n, v),
            "external_load": (n + 1, v),
            "status": (n,),
        }
        if self.fiber_length is not None:
            shapes["fiber_length"] = (n + 1, m)
        if len(self.roles) != v or not set(self.roles) <= set(_ROLES):
            raise OutputError(f"solution: roles are {self.roles}, expected {v} of {', '.join(_ROLES)}")
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise OutputError(f"solution: {name} has shape {getattr(self, name).shape}, expected {shape}")
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                own = value.copy()
                own.flags.writeable = False
                object.__setattr__(self, item.name, own)
