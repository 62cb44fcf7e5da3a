"""HCMC at work on Hill muscles: see `hcmc_driver`, and `hosted.window` for what is shared.

A compliant tendon puts its fiber between activation and force: within a short window force hardly answers, and windows
that each ask for their own end overshoot in turn (the sampled zero of u -> F nears -1). The excitation of a window is
therefore chosen for what it would make of the acceleration a look-ahead T later, and held for the window alone:
T = max(10 ms, 1.2 dt). With rigid tendons T is the window.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.hosted.lockstep import HillLockstep, MuscleView
from mjhcmc.methods.aim import floors_of
from mjhcmc.methods.force_correction import Ahead, correct_forces
from mjhcmc.methods.hcmc_driver import HcmcDriver, Ids, Index
from mjhcmc.methods.run import Team

if TYPE_CHECKING:
    from mjhcmc.methods.hcmc import Hcmc

Array = NDArray[np.float64]

_LOOK_AHEAD = 0.01  # s; with less excitations ring at small dt, with more they lead (benchmarks/hill.py)
_WINDOWS_AHEAD = 1.2
_AUTHORITY = 0.5  # of the setting: within the time ahead, stretched tendons let muscles change so much less
_TINY = 1e-9  # rad/s^2


class ForceDriver(HcmcDriver):
    """Takes a team of Hill plants through its windows.

    Each begins with a trial: under what an allocation at the expected end gives where tendons are compliant, else under
    the last window's inputs. Newton steps correct the trial until its end misses no more than is tolerated; with
    compliant tendons one that cannot be believed, or whose end misses more, is taken back. See `HcmcDriver`
    for what is carried from window to window.
    """

    def __init__(self, settings: Hcmc, team: Team) -> None:
        super().__init__(settings, team)
        plants = team.plants
        assert isinstance(plants, HillLockstep)
        self._plants, self._n_step = plants, team.n_step
        self._internal = np.zeros(len(team.windows))
        if plants.muscles.compliant:
            ahead = max(_LOOK_AHEAD, _WINDOWS_AHEAD * team.dt)
            self._n_step = max(team.n_step, round(ahead / team.physics_dt))
            self._ahead = self._n_step * team.physics_dt
            self._authority *= _AUTHORITY
            goals = self._references([w.reference_at(w.reference.time[:-1] + self._ahead) for w in team.windows])
            self._goal_qpos, self._goal_qvel, self._goal_qacc = goals
        limits = plants.excitation_range
        least = np.minimum(self._sharing.min_activation, limits[:, :, 1])
        low = np.where(self._sharing.disabled, limits[:, :, 0], np.maximum(limits[:, :, 0], least))
        self._limits = np.stack([low, limits[:, :, 1]], axis=-1)
        self._imposed = floors_of([w.imposed for w in team.windows], int(team.count.max()), low)

    def window(self, k: int, ids: Ids, rows: Array) -> Array:
        """See `run.Driver` and the module's docstring."""
        team, plants, at = self._team, self._plants, self._which(ids)
        self._impose(k, at)
        if k == 0:
            self._look_around(ids, at, rows)
        kp, kv, goal, expected = self._aim(k, at, rows, rows[:, self._layout.activation])
        path = plants.path(ids, rows)
        trial = rows, path, kp, kv
        if plants.muscles.compliant:  # rigid muscles answer so fast that the last window's inputs are a better start
            view = self._view(k, ids, expected, stiffness=False)
            self._correct_by(k, ids, at, view, goal - view.around.qacc, trial, tried=False)
        ends = plants.step(ids, rows, team.excitation[at], team.reserve[at], self._n_step)
        view = self._view(k, ids, ends)
        tried = view.around
        missing = self._missing(k, at, (kp, kv), ends, view.around.qacc)
        size = self._size(at, missing)
        whom: Index = slice(None)  # which of the call's simulations are still corrected
        who, where = ids, at
        for _ in range(self._settings.trials):
            self._keep(where, view.around)
            self._internal[where] = -view.slopes[:, :, 2].min(axis=1)
            kept = [values[where].copy() for values in (team.excitation, team.reserve, team.shortfall)]
            sound = self._correct_by(k, who, where, view, missing, tuple(part[whom] for part in trial), tried=True)
            anew = plants.step(who, rows[whom], team.excitation[where], team.reserve[where], self._n_step)
            view = self._view(k, who, anew)
            left = self._missing(k, where, (kp[whom], kv[whom]), anew, view.around.qacc)
            found = self._size(where, left)
            worse = ~(sound & (found < size[whom])) if plants.muscles.compliant else np.zeros(len(who), dtype=bool)
            if worse.any():
                bad = who[worse]
                team.excitation[bad], team.reserve[bad], team.shortfall[bad] = (part[worse] for part in kept)
                anew[worse] = ends[whom][worse]
            ends[whom], size[whom] = anew, np.where(worse, size[whom], found)
            again = ~worse & (found > 1.0)
            if not again.any():
                break
            if not again.all():
                whom = np.flatnonzero(again) if isinstance(whom, slice) else whom[again]
                who = where = ids[whom]
                view, left = view.of(again), left[again]
            missing = left
        if self._n_step > team.n_step:
            ends = plants.step(ids, rows, team.excitation[at], team.reserve[at], team.n_step)
        self._qacc_at[at] = self._space.of(plants.acceleration(ids, ends, team.reserve[at]))
        self._look_at_stiff(k, ids, at, ends, tried)
        team.fastest_rate[at] = np.maximum(team.fastest_rate[at], self._internal[at])
        return ends

    def _view(self, k: int, ids: Ids, rows: Array, *, stiffness: bool = True) -> MuscleView:
        """What muscles do around states at the end of window k, seen from the tracked degrees of freedom."""
        view = self._plants.view(ids, rows, self._team.reserve[self._which(ids)], stiffness=stiffness)
        if self._space.all_tracked:
            return view
        W = self._weights(k + 1, ids, view.around.M)
        return replace(view, around=self._seen(view.around, W), R=view.R @ W)

    def _size(self, at: Index, missing: Array) -> Array:
        """(b,) what is missed, in what may be missed."""
        return np.asarray(np.abs(missing / np.maximum(self._missable[at], _TINY)).max(axis=1))

    def _correct_by(
        self, k: int, ids: Ids, at: Index, view: MuscleView, missing: Array, trial: tuple[Array, ...], *, tried: bool
    ) -> NDArray[np.bool_]:
        """Put corrected inputs into the team; a trial began with rows and path, under gains kp and kv.

        Returns:
            (b,) whether the corrections can be believed, see `correct_forces`.
        """
        team, price, sharing = self._team, self._price[at], self._sharing
        rows, path, kp, kv = trial
        ahead = Ahead(
            ids, rows, path, team.excitation[at], self._space.of(team.reserve[at]), missing, view, kp, kv,
            team.physics_dt, self._n_step, tried,
        )  # fmt: skip
        correction, sound = correct_forces(
            self._plants, ahead, self._limits[at], sharing if isinstance(at, slice) else sharing.of(at), price,
            reserves=self._settings.reserves, threads=self._settings.threads,
        )  # fmt: skip
        self._price[at] = price
        self._take(k, ids, at, correction, (missing, view.around.B, view.around.D))
        return sound
