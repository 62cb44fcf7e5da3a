"""Laws of the stretch reflex, as controllers of muscle excitation: one row a simulation.

What is sampled at the start of a control period makes the excitation that is held over that period. Velocities v are
of the fiber, in optimal fiber lengths a second, lengthening positive; forces F are fractions of F0.

- ``"velocity"``: u = clip(g max(0, v(t - delay) - V), 0, 1). Of the velocity of stretch beyond a threshold, as spastic
  muscle answers (Lance 1980), after the time that the spinal loop takes.
- ``"equation1"``: Eq. 1 of doi:10.17979/ja-cea.2024.45.10802, literally: u' = G v while v > V, else u' = 0, clipped to
  [0, 1]. It never decays and knows no delay: the law's ``delay`` is not looked at.
- ``"force"``: tau e' = -e + g F (1 + tanh(k (F - V)))/2 with F(t - delay), u = clip(e, 0, 1) (Falisse et al. 2018,
  doi:10.1371/journal.pone.0208811).

The integrals of the last two are exact for what is sampled held over each period, and are given at its start. Before
the time ``delay`` the reflex sees rest: velocity 0, or the first force for ever, which its filter has then settled on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError

MODES = ("velocity", "equation1", "force")

LONGEST_DELAY = 1.0
"""s. A stretch reflex takes some hundredths of a second; a delay above this is one in milliseconds."""

_VELOCITY, _EQUATION1, _FORCE = range(3)
_SAME_PERIOD = 1e-9  # periods: a delay so near to a whole number of them is one, whatever rounding made of it
_EVEN = 1e-6  # periods, that a time may be off its grid

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ReflexLaw:
    """How the muscles of b simulations answer to stretch; see the module for the laws. Muscles without reflex: gain 0.

    Attributes:
        mode: one of `MODES`.
        gain: (b, n) excitation per lopt/s (``"velocity"``), 1/lopt (``"equation1"``), or excitation per F0.
        threshold: (b, n) lopt/s, or with ``"force"`` a fraction of F0.
        delay: (b,) s, from stretch to excitation.
        period: s, control period.
        tau: s, time constant of ``"force"``.
        steepness: per F0, of the threshold of ``"force"``.
    """

    mode: str
    gain: Array
    threshold: Array
    delay: Array
    period: float
    tau: float = 0.03
    steepness: float = 100.0

    def __post_init__(self) -> None:
        """Check it.

        Raises:
            SettingsError: an unknown mode, shapes that do not fit, or a number outside its valid values.
        """
        if self.mode not in MODES:
            raise SettingsError(f"reflex {self.mode!r} is not known: choose one of {', '.join(MODES)}")
        for name in ("gain", "threshold", "delay"):
            object.__setattr__(self, name, finite(f"reflex {name}", getattr(self, name), 1 if name == "delay" else 2))
        b = self.gain.shape[0]
        if self.threshold.shape != self.gain.shape or self.delay.shape != (b,):
            raise SettingsError(
                f"reflex gain {self.gain.shape}, threshold {self.threshold.shape} and delay {self.delay.shape} must "
                "have the shapes (b, n), (b, n), (b,)"
            )
        if (self.gain < 0).any():
            row, muscle = np.argwhere(self.gain < 0)[0]
            value = self.gain[row, muscle]
            raise SettingsError(f"reflex gain {value:g} of simulation {row}, muscle {muscle}: give 0 or more")
        outside = (self.delay < 0) | (self.delay > LONGEST_DELAY)
        if outside.any():
            row = int(np.argmax(outside))
            raise SettingsError(
                f"reflex delay {self.delay[row]:g} s of simulation {row}: give seconds, from 0 to {LONGEST_DELAY:g}"
            )
        for name in ("period", "tau", "steepness"):
            value = getattr(self, name)
            if not (is_number(value) and math.isfinite(value) and value > 0):
                raise SettingsError(f"reflex {name} {value!r}: give a positive number")

    @property
    def count(self) -> int:
        """Simulations."""
        return len(self.gain)


@numba.njit(cache=True, error_model="numpy")
def _delayed(samples, i, k, whole, part, rest):  # type: ignore[no-untyped-def]
    """Column i of samples (a ring), ``whole + part`` periods before sample k; before sample 0, ``rest``."""
    if k < whole or (k == whole and part > 0.0):
        return rest
    size = samples.shape[0]
    late = samples[(k - whole) % size, i]
    if part == 0.0:
        return late
    return late + part * (samples[(k - whole - 1) % size, i] - late)


@numba.njit(cache=True, error_model="numpy")
def _clip(u):  # type: ignore[no-untyped-def]
    """To [0, 1]; NaN stays NaN."""
    if u <= 0.0:
        return 0.0
    return 1.0 if u > 1.0 else u


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _step(mode, ids, sample, gain, threshold, whole, part, period, decay, steepness, ring, seen, state, out):  # type: ignore[no-untyped-def]
    """Take in sample (k, n) of the simulations ids (k,), and fill out (k, n). NaN makes NaN, in its row alone.

    Args:
        mode: the law.
        ids: (k,).
        sample: (k, n) velocity or force.
        gain: (b, n).
        threshold: (b, n).
        whole: (b,) periods of the delay.
        part: (b,) and of a further period.
        period: s.
        decay: of the filter over a period.
        steepness: of the threshold.
        ring: (b, size, n) the last samples.
        seen: (b,) how many there were.
        state: (b, n) integral or filter.
        out: (k, n).
    """
    for s in range(ids.size):
        b = ids[s]
        k = seen[b]
        for i in range(sample.shape[1]):
            now, g, V = sample[s, i], gain[b, i], threshold[b, i]
            if mode == _EQUATION1:
                out[s, i] = state[b, i]
                if not now <= V:
                    state[b, i] = _clip(state[b, i] + g * now * period)
                continue
            ring[b, k % ring.shape[1], i] = now
            if mode == _VELOCITY:
                beyond = _delayed(ring[b], i, k, whole[b], part[b], 0.0) - V
                out[s, i] = 0.0 if beyond <= 0.0 else _clip(g * beyond)
            else:
                force = _delayed(ring[b], i, k, whole[b], part[b], ring[b, 0, i])
                drive = g * force * (0.5 + 0.5 * np.tanh(steepness * (force - V)))
                if k == 0:
                    state[b, i] = drive
                out[s, i] = _clip(state[b, i])
                state[b, i] = drive + (state[b, i] - drive) * decay
        seen[b] = k + 1


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _delay_all(samples, whole, part, rest, out):  # type: ignore[no-untyped-def]
    for k in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[k, i] = _delayed(samples, i, k, whole, part, rest)


class ReflexArc:
    """The reflex of b simulations as they go, each from rest. A simulation's answers depend on its own samples alone.

    Args:
        law: how they answer.
    """

    def __init__(self, law: ReflexLaw) -> None:
        self.law = law
        b, n = law.gain.shape
        self._mode = MODES.index(law.mode)
        self._whole, self._part = _periods(law.delay, law.period)
        size = 1 if law.mode == "equation1" else int(self._whole.max(initial=0)) + 2
        self._ring = np.zeros((b, size, n))
        self._seen = np.zeros(b, np.int64)
        self._state = np.zeros((b, n))
        self._decay = math.exp(-law.period / law.tau)

    def step(self, ids: ArrayLike, velocity: ArrayLike, force: ArrayLike | None = None) -> Array:
        """The excitation by reflex over the control period that starts now; call it once a period.

        Args:
            ids: (k,) simulations, in any order, none twice.
            velocity: (k, n) lopt/s, fiber velocities now, lengthening positive.
            force: (k, n) fractions of F0, now; for ``"force"``.

        Returns:
            (k, n) in [0, 1]; NaN where what was sampled is.

        Raises:
            SettingsError: simulations that are not the law's, shapes that do not fit, or no force where it is needed.
        """
        which = np.asarray(ids)
        if which.ndim != 1 or not (which.dtype.kind in "iu" or which.size == 0):
            raise SettingsError(f"reflex: ids are integers (k,); got {which.dtype} of shape {which.shape}")
        which = which.astype(np.int64)
        known = not which.size or (which.min() >= 0 and which.max() < self.law.count)
        if not known or np.unique(which).size != which.size:
            raise SettingsError(f"reflex: ids are of 0 to {self.law.count - 1}, none twice; got {which.tolist()}")
        return self._advance(which, self._sample(velocity, force, (which.size, self.law.gain.shape[1])))

    def _sample(self, velocity: ArrayLike, force: ArrayLike | None, shape: tuple[int, ...]) -> Array:
        """What the law answers to."""
        if self.law.mode == "force":
            if force is None:
                raise SettingsError("reflex 'force' answers to the muscles' forces: give force")
            name, given = "force", force
        else:
            name, given = "velocity", velocity
        sample = np.ascontiguousarray(given, dtype=np.float64)
        if sample.shape != shape:
            raise SettingsError(f"reflex: {name} has the shape {sample.shape}: give {shape}")
        return sample

    def _advance(self, ids: NDArray[np.int64], sample: Array) -> Array:
        law, out = self.law, np.empty(sample.shape)
        _step(
            self._mode, ids, sample, law.gain, law.threshold, self._whole, self._part, law.period, self._decay,
            law.steepness, self._ring, self._seen, self._state, out,
        )  # fmt: skip
        return out


def reflex_along(law: ReflexLaw, time: ArrayLike, velocity: ArrayLike, force: ArrayLike | None = None) -> Array:
    """The excitation by reflex along a movement that is known: `ReflexArc` led along it.

    Args:
        law: of b simulations.
        time: (n_time,) s, a period apart.
        velocity: (b, n_time, n) lopt/s; (n_time, n) where b is 1.
        force: fractions of F0, shaped as velocity; for ``"force"``.

    Returns:
        In the shape of velocity, in [0, 1].

    Raises:
        SettingsError: a time that is not a period apart, or as `ReflexArc.step`.
    """
    grid = finite("reflex time", time, 1)
    off = np.flatnonzero(np.abs(np.diff(grid) - law.period) > _EVEN * law.period)
    if off.size:
        at = off[0]
        raise SettingsError(
            f"reflex: from {grid[at]:.6g} s the next time is {grid[at + 1] - grid[at]:.6g} s away: give times "
            f"{law.period:g} s apart"
        )
    arc, b, n = ReflexArc(law), *law.gain.shape
    alone = b == 1 and np.ndim(velocity if force is None or law.mode != "force" else force) == 2
    shape = (len(grid), n) if alone else (b, len(grid), n)
    sample = arc._sample(velocity, force, shape).reshape(b, len(grid), n)
    out, everyone = np.empty_like(sample), np.arange(b)
    for k in range(len(grid)):
        out[:, k] = arc._advance(everyone, np.ascontiguousarray(sample[:, k]))
    return out.reshape(shape)


def delayed(samples: Array, delay: float, period: float) -> Array:
    """(n_time, n) what a reflex sees of samples (n_time, n) a period apart; 0 before the delay, both in s."""
    whole, part = _periods(np.array([delay]), period)
    out = np.empty(samples.shape)
    _delay_all(np.ascontiguousarray(samples, dtype=np.float64), whole[0], part[0], 0.0, out)
    return out


def finite(name: str, values: ArrayLike, ndim: int) -> Array:
    """An array of finite numbers.

    Raises:
        SettingsError: other numbers of dimensions, or values, naming the first.
    """
    try:
        found = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise SettingsError(f"{name}: give an array of numbers with {ndim} dimension(s): {error}") from error
    if found.ndim != ndim:
        raise SettingsError(f"{name} has the shape {found.shape}: give an array with {ndim} dimension(s)")
    if not np.isfinite(found).all():
        at = tuple(int(i) for i in np.argwhere(~np.isfinite(found))[0])
        raise SettingsError(f"{name} is {found[at]} at {at}: give finite numbers")
    return found


def _periods(delay: Array, period: float) -> tuple[NDArray[np.int64], Array]:
    """Whole periods of delays, and what part of a further one."""
    periods = delay / period
    whole = np.floor(periods + _SAME_PERIOD)
    part = periods - whole
    return whole.astype(np.int64), np.where(part < _SAME_PERIOD, 0.0, part)
