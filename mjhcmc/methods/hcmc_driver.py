"""HCMC at work: a team's windows, from the expected end through trials to the step that is kept; see `hcmc`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjhcmc.beside import FEW
from mjhcmc.clamps import activation_cap
from mjhcmc.linearization import Linearization
from mjhcmc.methods.aim import fill_aim, floors_of
from mjhcmc.methods.correction import correct
from mjhcmc.methods.record import diverged, padded
from mjhcmc.methods.run import Team
from mjhcmc.methods.stability import decay_rate, decay_rates
from mjhcmc.methods.trial import Correction, Reach, Trial
from mjhcmc.motion import Reference
from mjhcmc.qp_back_ends import NEWTON
from mjhcmc.sharing import together

if TYPE_CHECKING:
    from mjhcmc.methods.hcmc import Hcmc

_STABLE = 2.0  # step times decay rate up to which an RK4 trial may step coarsely; the limit is 2.78
_USUAL_DT = 0.01  # s
_STIFFNESS_EVERY = 8  # windows
_OF_OTHERS = 0.5  # of the rms acceleration of the joints that move most
_HELD_GAIN = 1.5  # a limit or contact that comes and goes makes quick feedback bounce
_SOFT_GAIN = 0.5  # what hangs on a soft equality lags; quick feedback would ring with it
_HELD_MISSABLE = 10.0  # times what may be missed otherwise: what it does is not corrected away
_SUSPECT = 0.7  # of the rate that is stable: how far from it the expected end may be
_RUN_AWAY = 1.0  # times the largest acceleration of the motion

Array = NDArray[np.float64]
Ids = NDArray[np.intp]
Index = NDArray[np.intp] | slice


class _Here(NamedTuple):
    """One window of b simulations.

    Attributes:
        k: its number.
        ids: (b,) the simulations.
        at: their rows in arrays of the team.
        rows: (b, n_row) their states at its start.
        activation: (b, n_muscle) there.
        kp: (b, nv) 1/s^2.
        kv: (b, nv) 1/s.
        around: their expected ends.
    """

    k: int
    ids: Ids
    at: Index
    rows: Array
    activation: Array
    kp: Array
    kv: Array
    around: Linearization

    def some(self, which: NDArray[np.bool_]) -> _Here:
        """The same for some of the simulations."""
        ids = self.ids[which]
        rows, activation, kp, kv = (part[which] for part in (self.rows, self.activation, self.kp, self.kv))
        return _Here(self.k, ids, ids, rows, activation, kp, kv, self.around.of(which))


class HcmcDriver:
    """Takes a team through its windows.

    Carries from window to window, for each simulation: M and B at the last window's expected end, for the next one's
    feedback; K, which is looked at only now and then, since answers to it are of order h^2; the acceleration at the
    last end; the activation before it; and the multipliers of the last allocation, from which the next begins.
    """

    def __init__(self, settings: Hcmc, team: Team) -> None:
        self._settings, self._team, self._layout = settings, team, team.plants.layout
        windows = team.windows
        models = [w.model for w in windows]
        self._space = models[0].coordinates
        b, n, nz = len(windows), models[0].n_muscle, self._space.nz
        self._large = models[0].nv > FEW  # a look takes longer than it gains
        self._scheme, self._lag = team.plants.scheme, team.plants.scheme.lag(team.n_step)
        self._joint_damping = np.stack([self._scheme.joint_damping(m.mj_model) for m in models])
        self._sharing = together([w.sharing for w in windows])
        self._reach = Reach(
            np.stack([m.activation_parameters for m in models]), np.stack([m.excitation_range for m in models]),
            team.physics_dt, team.n_step, self._scheme.name,
        )  # fmt: skip
        self._limits = self._reach.excitation_range
        self._imposed = floors_of([w.imposed for w in windows], int(team.count.max()), self._limits[:, :, 0])
        self._ahead, self._authority = team.dt, float(settings.authority)
        of, now = self._space.of, self._references([w.target for w in windows])
        self._qpos, self._qvel = now[0], now[1]
        self._goal_qpos, self._goal_qvel, self._goal_qacc = (values[1:] for values in now)
        rms = of(np.stack([w.rms_qacc for w in windows]))
        self._least_authority = rms if settings.reserves else np.zeros_like(rms)
        self._largest = np.abs(of(now[2])).max(axis=(0, 2))
        share = settings.tolerance * min(1.0, (team.dt / _USUAL_DT) ** 2)
        # a joint held still is judged by those that move
        hinge = of(np.stack([m.dof_is_rotation for m in models]))
        others = np.where(hinge, (rms * hinge).max(axis=1)[:, None], (rms * ~hinge).max(axis=1)[:, None])
        self._missable = share * np.maximum(rms, _OF_OTHERS * others)
        self._M, self._B, self._K = np.empty((b, nz, nz)), np.empty((b, nz, n)), np.empty((b, nz, nz))
        self._qacc_at, self._before, self._price = np.empty((b, nz)), np.empty((b, n)), np.zeros((b, nz))
        limit = np.stack([m.force_limit for m in models])
        self._limit = limit if np.isfinite(limit).any() else None
        soft = np.array([m.coupling is not None and m.coupling.soft for m in models])
        self._most_gain = np.where(soft, min(settings.gain, _SOFT_GAIN), float(settings.gain))
        self._gain = self._most_gain.copy()

    def _references(self, references: Sequence[Reference]) -> tuple[Array, Array, Array]:
        """Desired positions, velocities and accelerations of all simulations, (n, b, nv)."""
        length = int(self._team.count.max()) + 1
        found = [
            np.stack([padded(getattr(r, name), length) for r in references], axis=1)
            for name in ("qpos", "qvel", "qacc")
        ]
        return found[0], found[1], found[2]

    def _impose(self, k: int, at: Index) -> None:
        """Raise the least excitation to what is imposed in window k."""
        if self._imposed is not None:
            self._limits[at, :, 0] = np.minimum(self._imposed[k][at], self._limits[at, :, 1])

    def window(self, k: int, ids: Ids, rows: Array) -> Array:
        """See `run.Driver` and the module's docstring."""
        team, settings, plants = self._team, self._settings, self._team.plants
        at, activation = self._which(ids), np.ascontiguousarray(rows[:, self._layout.activation])
        self._impose(k, at)
        if k == 0:
            self._look_around(ids, at, rows)
        kp, kv, goal, expected = self._aim(k, at, rows, activation)
        around = self._look(k + 1, ids, expected, stiffness=k % _STIFFNESS_EVERY == 0)
        self._keep(at, around)
        here = _Here(k, ids, at, rows, activation, kp, kv, around)
        self._correct(here, expected, self._missing_at(around, goal), team.dt, 0)
        ends, step, n_step = self._trial(here)
        whole = plants.acceleration(ids, ends, team.reserve[at])
        qacc = self._space.of(whole)
        final: Array | None = None
        whom: Index = slice(None)  # which of the call's simulations are corrected
        for trial in range(settings.trials):
            if trial > 0 and not self._large:  # the end that was expected is not where it ended
                there = self._look(k + 1, here.ids, self._where_forces_act(ends, whole), stiffness=True)
                here = here._replace(around=there)
                self._keep(here.at, there)
            self._correct(here, ends, self._missing(k, here.at, (here.kp, here.kv), ends, qacc), step, n_step)
            ends = plants.step(here.ids, here.rows, team.excitation[here.at], team.reserve[here.at], team.n_step)
            step, n_step = team.physics_dt, team.n_step
            whole = plants.acceleration(here.ids, ends, team.reserve[here.at])
            qacc = self._space.of(whole)
            self._qacc_at[here.at] = qacc
            if final is None:
                final = ends
            else:
                final[whom] = ends
            if trial + 1 == settings.trials:
                break
            limit = self._missable[here.at] * np.where(here.around.held, _HELD_MISSABLE, 1.0)[:, None]
            again = np.any(np.abs(self._missing(k, here.at, (here.kp, here.kv), ends, qacc)) > limit, axis=1)
            if not again.any():
                break
            if not again.all():
                whom = np.flatnonzero(again) if isinstance(whom, slice) else whom[again]
                here, ends, qacc, whole = here.some(again), ends[again], qacc[again], whole[again]
        self._before[at] = activation
        assert final is not None  # there is at least one trial
        self._look_at_stiff(k, ids, at, final, around)
        return final

    def _which(self, ids: Ids) -> Index:
        """The rows of the simulations in arrays of the team; all of them as a slice: quicker."""
        return slice(None) if len(ids) == len(self._price) else ids

    def _look_around(self, ids: Ids, at: Index, rows: Array) -> None:
        """What the first window needs to know of its start."""
        found = self._look(0, ids, rows, stiffness=False)
        self._keep(at, found)
        self._qacc_at[at], self._before[at] = found.qacc, rows[:, self._layout.activation]
        if self._scheme.first_order:
            self._qacc_at[at] = self._space.of(self._team.plants.acceleration(ids, rows, self._team.reserve[at]))

    def _where_forces_act(self, rows: Array, qacc: Array) -> Array:
        """The rows with the velocity at which the integrator takes forces, when a step of qacc (b, nv) follows."""
        if not self._scheme.implicit:
            return rows
        moved = rows.copy()
        moved[:, self._layout.qvel] += self._team.physics_dt * qacc
        return moved

    def _missing_at(self, around: Linearization, goal: Array) -> Array:
        """(b, nz) rad/s^2, what is missed at the expected end; implicit integrators take it there as it is."""
        if around.inertia is None or self._scheme.implicit:
            return np.asarray(goal - around.qacc)
        F = around.M @ around.qacc[:, :, None]
        return np.asarray(goal - np.linalg.solve(around.inertia, F)[:, :, 0])

    def _look_at_stiff(self, k: int, ids: Ids, at: Index, ends: Array, expected: Linearization) -> None:
        """Where the muscles may be too stiff for the physics step, tell by the ends themselves.

        A bound on the rate is known; where that is too large, the rate itself at the expected end tells who is to be
        looked at. An end where they are, and where acceleration is far from any that was wanted, has run away though it
        is finite: it becomes NaN.
        """
        team, limit = self._team, self._scheme.limit / self._team.physics_dt
        suspect = np.flatnonzero(team.fastest_rate[at] > _SUSPECT * limit)
        if suspect.size:
            damping = expected.D if expected.explicit is None else expected.explicit
            rates = decay_rates(expected.M[suspect], damping[suspect])
            harmless = rates <= _SUSPECT * limit  # False with NaN
            team.fastest_rate[ids[suspect[harmless]]] = rates[harmless]
            suspect = suspect[~harmless]
        if not suspect.size:
            return
        who = ids[suspect]
        found = self._look(k + 1, who, ends[suspect], stiffness=False)
        for j, i in enumerate(who.tolist()):
            damping = found.D if found.explicit is None else found.explicit
            if _finite(found.M[j], damping[j]):
                team.fastest_rate[i] = decay_rate(found.M[j], damping[j])
            missed = np.abs(self._space.of(self._goal_qacc[k, i]) - found.qacc[j]).max()
            if team.fastest_rate[i] > limit and not missed <= _RUN_AWAY * self._largest[i]:
                ends[suspect[j]] = np.nan

    def _look(self, node: int, ids: Ids, rows: Array, *, stiffness: bool) -> Linearization:
        """What forces do around states near a node, seen from the tracked degrees of freedom."""
        found = self._team.plants.linearize(
            ids, rows, self._team.reserve[self._which(ids)], stiffness=stiffness, damping=self._sharing.counts_forces
        )
        if self._scheme.first_order:
            found = self._as_stepped(ids, found)
        if self._space.all_tracked:
            return found
        if self._space.simple:
            t = self._space.tracked
            square = np.ix_(np.arange(len(ids)), t, t)
            K = None if found.K is None else found.K[square]
            qacc, M, B, D = found.qacc[:, t], found.M[square], found.B[:, t], found.D[square]
            inertia, explicit = (None if part is None else part[square] for part in (found.inertia, found.explicit))
            return found._replace(qacc=qacc, M=M, B=B, D=D, K=K, inertia=inertia, explicit=explicit)
        return self._seen(found, self._weights(node, ids, found.M))

    def _weights(self, node: int, ids: Ids, M: Array) -> Array:
        """W (b, nv, nz) of `coordinates`; the tangent is that of the desired motion."""
        each = [self._space.seen_from_tracked(self._tangent(node, int(i)), m) for i, m in zip(ids, M, strict=True)]
        return np.stack(each)

    def _seen(self, found: Linearization, W: Array) -> Linearization:
        """The same from the tracked degrees of freedom; see `coordinates`."""
        back = np.swapaxes(W, 1, 2)
        K = None if found.K is None else back @ found.K @ W
        qacc, M, B, D = self._space.of(found.qacc), back @ found.M @ W, back @ found.B, back @ found.D @ W
        inertia, explicit = (None if part is None else back @ part @ W for part in (found.inertia, found.explicit))
        return found._replace(qacc=qacc, M=M, B=B, D=D, K=K, inertia=inertia, explicit=explicit)

    def _as_stepped(self, ids: Ids, found: Linearization) -> Linearization:
        """The same with what the integrator makes of inertia and damping."""
        joint = self._joint_damping[ids][:, :, None] * np.eye(self._joint_damping.shape[1])
        inertia = self._scheme.inertia(found.M, found.D, joint, self._team.physics_dt)
        return found._replace(inertia=inertia, explicit=self._scheme.explicit(found.D, joint))

    def _tangent(self, node: int, i: int) -> Array | None:
        tangents = self._team.windows[i].tangents
        return None if tangents is None else tangents[min(node, len(tangents) - 1)]

    def _keep(self, at: Index, found: Linearization) -> None:
        self._M[at], self._B[at] = found.M, found.B
        most = self._most_gain[at]
        self._gain[at] = np.where(found.held, np.minimum(most, _HELD_GAIN), most)
        if found.K is not None:
            self._K[at] = found.K

    def _aim(self, k: int, at: Index, rows: Array, activation: Array) -> tuple[Array, Array, Array, Array]:
        """Gains kp (b, nv) 1/s^2 and kv (b, nv) 1/s of window k; acceleration (b, nv) and rows that it should end in.

        Acceleration goes along a line from what it is to what it should be, activation goes on as it did:

            v^ = v + h/2 (alpha + alpha*),  q^ = q + h v + h^2/3 alpha + h^2/6 alpha*
            alpha* = [q''_d + kv (v_d - v - h/2 alpha) + kp (q_d - q - h v - h^2/3 alpha)]/(1 + kv h/2 + kp h^2/6)

        Gains are as high as gain/h and no higher than the joint can follow: kp = w^2, kv = 2 w,
        w_j = min(gain/h, alpha_j/(|e'_j| + sqrt(e'_j^2 + alpha_j |e_j|))), so that w^2 |e| + 2 w |e'| <= alpha_j, from
        the error at the window's start. At w = gain/h, kv is 2 w (1 - gain/6): aiming at the end of the window damps by
        itself, and critical damping would make the sampled error ring (largest root at gain 2.7: .44 against -.72; at
        3: .5 against -.84). alpha_j is a share of the smaller of the accelerations that full activation gives the joint
        either way. Where reserves help it is at least the rms of q''_d, or a motion beyond the muscles would be fed
        forward and not fed back. A joint that nothing limits keeps gain/h. For other integrators than RK4 see
        `integrators`: how acceleration adds up over the window, and the gains that have the same roots.
        """
        layout, gain, h, space = self._layout, self._gain[at], self._ahead, self._space
        qacc, q = self._qacc_at[at], rows[:, layout.qpos]
        v = np.ascontiguousarray(space.of(rows[:, layout.qvel]))  # one layout, however many: compiled once
        kp, kv, goal, way, speed = (np.empty_like(qacc) for _ in range(5))
        ahead = space.difference(self._goal_qpos[k, at], q)
        fill_aim(
            self._M[at], self._B[at], space.of(space.difference(self._qpos[k, at], q)), space.of(self._qvel[k, at]),
            space.of(ahead), space.of(self._goal_qvel[k, at]), space.of(self._goal_qacc[k, at]), v, qacc,
            self._least_authority[at], self._authority, gain, h, self._lag, kp, kv, goal, way, speed,
        )  # fmt: skip
        expected = rows.copy()
        if self._scheme.implicit:  # forces are looked at where a step of that acceleration takes them
            speed += self._team.physics_dt * goal
        if not space.all_tracked:
            way, speed = self._whole(k, at, rows, ahead, way, speed)
        expected[:, layout.qpos] = space.moved(q, way)
        expected[:, layout.qvel] = speed
        expected[:, layout.time] += h
        expected[:, layout.activation] = np.clip(2 * activation - self._before[at], 0.0, 1.0)
        return kp, kv, goal, expected

    def _whole(self, k: int, at: Index, rows: Array, ahead: Array, way: Array, speed: Array) -> tuple[Array, Array]:
        """Way and velocity (b, nv) of all degrees of freedom over window k, from those of the tracked ones.

        What is prescribed goes with the motion, what is tied with it and with how far the tracked are off it, what is
        free goes on as it does.

        Args:
            k: the window.
            at: rows of the simulations in arrays of the team.
            rows: (b, n_row) their states.
            ahead: (b, nv) the way to the desired position.
            way: (b, nz).
            speed: (b, nz).
        """
        space, roles, wanted = self._space, self._space.roles, self._goal_qvel[k, at]
        whole, fast = space.full(way), space.full(speed)
        for led in (roles.prescribed, roles.dependent):
            whole[:, led], fast[:, led] = ahead[:, led], wanted[:, led]
        if len(roles.free):
            fast[:, roles.free] = rows[:, self._layout.qvel][:, roles.free]
            whole[:, roles.free] = self._ahead * fast[:, roles.free]
        if len(roles.dependent):
            off, off_speed = way - space.of(ahead), speed - space.of(wanted)
            for j, i in enumerate(np.arange(len(self._price))[at]):
                N = self._tangent(k + 1, int(i))
                assert N is not None  # something is dependent
                N = N[np.ix_(roles.dependent, space.tracked)]
                whole[j, roles.dependent] += N @ off[j]
                fast[j, roles.dependent] += N @ off_speed[j]
        return whole, fast

    def _trial(self, here: _Here) -> tuple[Array, float, int]:
        """The ends of a window with the inputs so far; and the physics step and steps that it took.

        About twice the plant's step does where that is stable: what is corrected by it is checked by the window itself.
        Not so under integrators of first order: with another step they end elsewhere.
        """
        team, plants, ids, rows = self._team, self._team.plants, here.ids, here.rows
        u, s = team.excitation[here.at], team.reserve[here.at]
        if self._scheme.first_order:
            return plants.step(ids, rows, u, s, team.n_step), team.physics_dt, team.n_step
        n = (team.n_step + 1) // 2
        times = team.n_step / n
        stable = team.fastest_rate[here.at] * times * team.physics_dt <= _STABLE
        if stable.all():
            ends = plants.step(ids, rows, u, s, n, times)
        else:
            ends = np.full_like(rows, np.nan)
            if stable.any():
                ends[stable] = plants.step(ids[stable], rows[stable], u[stable], s[stable], n, times)
        if not math.isfinite(ends.sum()):
            failed = ~np.isfinite(ends).all(axis=1)
            ends[failed] = plants.step(ids[failed], rows[failed], u[failed], s[failed], team.n_step)
        return ends, team.dt / n, n

    def _missing(self, k: int, at: Index, gains: tuple[Array, Array], ends: Array, qacc: Array) -> Array:
        """(b, nv) rad/s^2, r of the module's docstring, under gains kp and kv."""
        layout, (kp, kv), space = self._layout, gains, self._space
        v_error = space.of(self._goal_qvel[k, at] - ends[:, layout.qvel])
        q_error = space.of(space.difference(self._goal_qpos[k, at], ends[:, layout.qpos]))
        r: Array = space.of(self._goal_qacc[k, at]) + kv * v_error + kp * q_error - qacc
        return r

    def _correct(self, here: _Here, ends: Array, missing: Array, step: float, n_step: int) -> None:
        """Put corrected inputs into the team, after a trial of n_step steps; none: at the expected end."""
        team, at, found = self._team, here.at, here.around
        trial = Trial(
            here.activation, team.excitation[at], self._space.of(team.reserve[at]),
            np.ascontiguousarray(ends[:, self._layout.activation]), missing, found.M, found.B, found.gain, found.bias,
            found.D, self._K[at], here.kp, here.kv, step, n_step, self._cap(at, found),
            ends[:, self._layout.time],
            found.M if self._scheme.implicit and n_step == 0 else found.inertia, found.explicit,
            self._scheme.first_order,
        )  # fmt: skip
        reach, sharing, price = self._reach, self._sharing, self._price[at]
        if not isinstance(at, slice):
            reach, sharing = reach.of(at), sharing.of(at)
        correction = correct(
            trial, reach, sharing, price, reserves=self._settings.reserves, threads=self._settings.threads
        )
        self._price[at] = price
        self._take(here.k, here.ids, at, correction, (missing, found.B, found.D))

    def _cap(self, at: Index, found: Linearization) -> Array:
        """(b, n_muscle) activation from which on a forcerange lets a muscle pull no more."""
        if self._limit is None:
            return np.full(found.gain.shape, np.inf)
        return activation_cap(self._limit[at], found.gain, found.bias)

    def _take(self, k: int, ids: Ids, at: Index, correction: Correction, seen: tuple[Array, ...]) -> None:
        """Put a correction into the team, which followed from what was seen, (b, ...) each."""
        team, ours = self._team, self._sharing.solver == NEWTON and self._sharing.cost != "cubic"
        for j, error in correction.errors.items():
            i = int(ids[j])
            if ours or not _finite(*(part[j] for part in seen)):  # ours does not fail where numbers make sense
                error = diverged(team.windows[i], k)
            team.errors.setdefault(i, error)
        shortfall = self._space.full(correction.shortfall)
        team.excitation[at], team.shortfall[at] = correction.excitation, shortfall
        team.reserve[at] = shortfall if self._settings.reserves else 0.0
        team.fastest_rate[at] = correction.fastest_rate


def _finite(*parts: Array) -> bool:
    return all(bool(np.isfinite(part).all()) for part in parts)
