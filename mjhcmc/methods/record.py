"""What a method writes down as it goes, and the solution that follows from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.dynamics import tied
from mjhcmc.errors import DivergedError, SimulationError
from mjhcmc.lockstep import Plants
from mjhcmc.methods.loose_ties import tell_of_loose_ties
from mjhcmc.methods.windows import Windows
from mjhcmc.solution import Solution, window_status
from mjhcmc.surroundings import coordinates_of

if TYPE_CHECKING:
    from mjhcmc.methods.run import Team

Array = NDArray[np.float64]


class Record:
    """The state of each simulation at each node, and the inputs of each window.

    Args:
        windows: one a simulation.
        plants: what is stepped.
        settings: of the method.
    """

    def __init__(self, windows: Sequence[Windows], plants: Plants, settings: dict[str, Any]) -> None:
        self._windows, self._plants, self._settings = windows, plants, settings
        most, b = max(w.count for w in windows), len(windows)
        n, nv = windows[0].model.n_muscle, windows[0].model.nv
        self._done = np.zeros(b, dtype=int)
        self._times = np.stack([padded(w.reference.time, most + 1) for w in windows], axis=1)
        self._rows = np.empty((most + 1, b, 0))
        self._excitation = np.empty((most, b, n))
        self._reserve, self._shortfall, self._rate = (
            np.empty((most, b, nv)),
            np.empty((most, b, nv)),
            np.empty((most, b)),
        )

    def begin(self, rows: Array) -> None:
        """Write down the first states (count, n_row)."""
        self._rows = np.empty((*self._rows.shape[:2], rows.shape[1]))
        self._rows[0] = rows

    def last(self, ids: NDArray[np.intp], k: int) -> Array:
        """(b, n_row) the states of simulations at node k, a copy."""
        rows: Array = self._rows[k].copy() if len(ids) == len(self._done) else self._rows[k, ids]
        return rows

    def done(self, i: int) -> int:
        """Windows of simulation i that are written down whole."""
        return int(self._done[i])

    def window(self, k: int, ids: NDArray[np.intp], ends: Array, team: Team) -> dict[int, SimulationError]:
        """Write down window k of some simulations.

        Args:
            k: the window.
            ids: (b,) the simulations.
            ends: (b, n_row) their states at its end; a simulation whose state is not finite counts as failed.
            team: holds their inputs.

        Returns:
            An error for each simulation that failed now.
        """
        at: Any = slice(None) if len(ids) == len(self._done) else ids
        ends[:, self._plants.layout.time] = self._times[k + 1, at]
        self._rows[k + 1, at] = ends
        self._excitation[k, at], self._reserve[k, at] = team.excitation[at], team.reserve[at]
        self._shortfall[k, at], self._rate[k, at] = team.shortfall[at], team.fastest_rate[at]
        if math.isfinite(ends.sum()) and not team.errors:
            self._done[at] = k + 1
            return {}
        fine = np.isfinite(ends).all(axis=1)
        errors: dict[int, SimulationError] = {
            int(i): self._diverged(int(i), k, row)
            for i, row in zip(ids[~fine], ends[~fine], strict=True)
            if int(i) not in team.errors
        }
        self._done[[int(i) for i in ids[fine] if int(i) not in team.errors] if team.errors else ids[fine]] = k + 1
        return errors

    def _diverged(self, i: int, k: int, row: Array) -> DivergedError:
        windows, layout = self._windows[i], self._plants.layout
        remedy = f"use physics_dt <= {windows.physics_dt / 2:.2g}, or filter the motion"
        fault = self._plants.fault(i)
        if fault:
            return DivergedError(
                f"MuJoCo failed in the window at {windows.reference.time[k]:.4g} s ({fault}): {remedy}"
            )
        tracked = {windows.model.dof_names[i] for i in windows.model.roles.tracked}
        for name, columns, labels in (
            ("position", layout.qpos, windows.model.joint_names),
            ("velocity", layout.qvel, windows.model.dof_names),
            ("activation", layout.activation, windows.model.muscle_names),
        ):
            bad = np.flatnonzero(~np.isfinite(row[columns]))
            if bad.size:
                # what is prescribed does not run away, it is taken along
                worst = next((i for i in bad if labels[i] in tracked), bad[0])
                return DivergedError(
                    f"the {name} of {labels[worst]!r} is not finite at {windows.reference.time[k + 1]:.4g} s: the "
                    f"simulation diverged; {remedy}"
                )
        return diverged(windows, k)

    def solution(self, i: int, *, interrupted: bool = False) -> Solution | None:
        """Everything that follows for simulation i; None where no window is done."""
        n = self.done(i)
        if not n:
            return None
        windows, layout = self._windows[i], self._plants.layout
        model, rows = windows.model, self._rows[: n + 1, i]
        reserve, shortfall = self._reserve[:n, i], self._shortfall[:n, i]
        # a node has the reserve of the window that starts there, the last that of the window that ends there
        at_nodes = self._plants.nodes(i, rows, np.concatenate([reserve, reserve[-1:]]))
        if model.coupling is not None:
            at_nodes = tied(at_nodes, model.coupling.tangent(rows[:, layout.qpos]))
        moment, times = at_nodes.net_joint_moment, windows.reference.time[: n + 1]
        qpos, desired = rows[:, layout.qpos], windows.reference.qpos[: n + 1].copy()
        roles = model.roles
        free = coordinates_of(model.mj_model, roles.free)
        desired[:, free] = qpos[:, free]  # nothing is desired of them
        residual = np.zeros_like(moment)
        held = roles.prescribed
        residual[:, held] = (moment - at_nodes.muscle_moment)[:, held]
        root = roles.is_root & np.isin(np.arange(model.nv), roles.tracked)
        leg = ~root  # what acts at the root is a residual
        residual[:, root] = np.concatenate([reserve, reserve[-1:]])[:, root]
        given = windows.joint_moments
        everything = {
            "model": model.name,
            "motion": windows.motion.name,
            "joint_moments": None if given is None else given.name,
            "dt": windows.dt,
            "physics_dt": windows.physics_dt,
            "integrator": windows.scheme.name,
            **windows.sharing.options,
            **self._settings,
        }
        if not roles.all_tracked:
            everything["roles"] = [str(role) for role in roles.of]
        if roles.is_root.any():
            everything["root"] = [name for name, at_root in zip(model.dof_names, roles.is_root, strict=True) if at_root]
        hosted = windows.own_plant.hosted if windows.own_plant is not None else None
        if hosted is not None:
            everything["muscles"] = hosted.settings()
        if self._settings["method"] == "hcmc":
            everything["imposed"] = windows.imposed is not None
        if given is not None:
            difference = np.abs(moment - given.sample(times)).max(axis=0)
            everything["joint_moment_difference"] = dict(zip(model.dof_names, difference.tolist(), strict=True))
        solution = Solution(
            time=times,
            excitation=self._excitation[:n, i],
            activation=rows[:, layout.activation],
            qpos=qpos,
            qpos_desired=desired,
            qvel=rows[:, layout.qvel],
            tracking_error=model.coordinates.difference(qpos, desired),
            net_joint_moment=moment,
            residual=residual,
            muscle_force=at_nodes.muscle_force,
            reserve=reserve,
            shortfall=shortfall,
            external_load=at_nodes.external_load,
            status=window_status(
                moment, reserve * leg, shortfall * leg, self._rate[:n, i] * windows.physics_dt, windows.scheme.limit
            ),
            muscle_names=model.muscle_names,
            dof_names=model.dof_names,
            coordinate_names=model.joint_names,
            dof_is_rotation=model.dof_is_rotation.copy(),
            settings=everything,
            interrupted=interrupted,
            model=model,
            surroundings=windows.surroundings,
            fiber_length=rows[:, layout.fiber] if rows[:, layout.fiber].size else None,
            muscles=hosted,
        )
        tell_of_loose_ties(solution)
        return solution


def padded(values: Array, n: int) -> Array:
    """The first n of an array; its last one repeated where it is shorter."""
    return values[np.minimum(np.arange(n), len(values) - 1)]


def diverged(windows: Windows, k: int) -> DivergedError:
    """The error of a simulation that ran away in window k."""
    return DivergedError(
        f"the simulation diverged in the window at {windows.reference.time[k]:.4g} s: use physics_dt <= "
        f"{windows.physics_dt / 2:.2g}, or filter the motion"
    )
