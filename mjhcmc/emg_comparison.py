"""Excitations against EMG: time courses, on and off, size; and whether the match says anything.

For each measured muscle, over the control windows that the EMG covers, with u the excitation and e the envelope in the
middle of each window:

    r          Pearson's correlation of u(t) and e(t)
    r best     the largest correlation of u(t) and e(t - lag), |lag| <= delay; lag > 0: excitation comes after EMG
    agreement  share of the time in which both are on or both are off
    Jaccard    time in which both are on over time in which either is
    MAE        mean |u - k e|, k = sum(u e)/sum(e^2) (least squares): what is left when EMG has no size of its own

A signal is on above a share of its own range for long enough (Hodges & Bui 1996, doi 10.1016/S0013-4694(96)95190-5; a
threshold in size and one in duration: Bonato, D'Alessio & Knaflitz 1998, doi 10.1109/10.661154).

Muscles of a cyclic movement resemble each other, so each number is also taken against every muscle that the channel
does *not* measure; what counts is how far the measured muscle is above (MAE: below) their median. A signal that hardly
moves correlates with nothing: there the numbers are NaN, and a reason stands beside them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.checks import is_number
from mjhcmc.emg import Emg
from mjhcmc.errors import SettingsError
from mjhcmc.signals import check_cutoff, zero_phase_lowpass

if TYPE_CHECKING:
    import pandas as pd

    from mjhcmc.solution import Solution

Array = NDArray[np.float64]

_LAG_STEP = 1e-3  # s
_FEWEST = 10  # windows
_LEAST_SHARE = 0.5  # of the windows compared at no lag: fewer, and a lag is chosen for what it leaves out
_TINY = 0.02  # of full excitation: a muscle that moves less is compared by size only
_FLAT = 0.05  # of its peak: an envelope that varies less than this is constant


@dataclass(frozen=True)
class MuscleAgreement:
    """One muscle against its channel; NaN where ``reason`` says why.

    Attributes:
        muscle: name.
        channel: name.
        r: correlation at no lag.
        r_others: median of the same with the muscles that the channel does not measure.
        r_best: largest correlation within the lags.
        lag: s, where it is; positive: excitation comes after EMG.
        r_best_others: median of the largest correlations with the others, each at its own lag.
        rank: 1 where no other muscle's largest correlation exceeds the measured one's; of how many, with it: `of`.
        of: muscles compared.
        agreement: share of time, 0 .. 1.
        jaccard: 0 .. 1.
        jaccard_others: median with the others.
        mae: of excitation, after scaling.
        mae_others: median with the others, each after its own scaling.
        scale: k, excitation per unit of envelope.
        windows: how many were compared at no lag.
        reason: why there is no correlation; empty where there is.
    """

    muscle: str
    channel: str
    r: float
    r_others: float
    r_best: float
    lag: float
    r_best_others: float
    rank: float
    of: int
    agreement: float
    jaccard: float
    jaccard_others: float
    mae: float
    mae_others: float
    scale: float
    windows: int
    reason: str

    @property
    def above_others(self) -> float:
        """How far r_best lies above the others' median."""
        return self.r_best - self.r_best_others


@dataclass(frozen=True, eq=False)
class EmgComparison:
    """What `compare_emg` found.

    Attributes:
        muscles: one entry a measured muscle, in the solution's order.
        time: (n,) s, middles of the windows that the EMG's time covers.
        excitation: (n, m) of the measured muscles, filtered if asked.
        envelope: (n, m) of their channels at no lag; NaN in gaps.
        settings: delay, threshold and the rest, as plain values.
        solution: what was compared: method, model, motion.
        emg: name of the EMG.
    """

    muscles: tuple[MuscleAgreement, ...]
    time: Array = field(repr=False)
    excitation: Array = field(repr=False)
    envelope: Array = field(repr=False)
    settings: dict[str, Any] = field(repr=False)
    solution: str
    emg: str

    def to_dataframe(self) -> pd.DataFrame:
        """One row a muscle: the fields of `MuscleAgreement`, and ``above_others``."""
        import pandas as pd

        return pd.DataFrame([{**asdict(one), "above_others": one.above_others} for one in self.muscles])

    def medians(self) -> dict[str, float]:
        """The median over the muscles that have one, of r, r_best, above_others, agreement, jaccard, mae and lag."""
        names = ("r", "r_best", "above_others", "lag", "agreement", "jaccard", "mae")
        return {name: _median(np.array([getattr(one, name) for one in self.muscles])) for name in names}

    def numbers(self) -> dict[str, Any]:
        """The same as plain values for JSON; None where there is no number."""
        muscles = {}
        for one in self.muscles:
            values = {key: value for key, value in asdict(one).items() if key != "muscle"}
            muscles[one.muscle] = {key: _plain(v) for key, v in {**values, "above_others": one.above_others}.items()}
        return {
            "solution": self.solution,
            "emg": self.emg,
            "settings": self.settings,
            "median": {key: _plain(value) for key, value in self.medians().items()},
            "muscles": muscles,
        }

    def screen(self) -> str:
        """One screen."""
        from mjhcmc.summary import columns

        head = ["muscle", "channel", "r", "others", "best r", "lag, ms", "others", "rank", "on-off", "Jaccard", "MAE"]
        rows = [head]
        for one in self.muscles:
            rows.append(
                [
                    one.muscle,
                    one.channel,
                    *map(_two, (one.r, one.r_others, one.r_best)),
                    _word(1e3 * one.lag, ".0f"),
                    _two(one.r_best_others),
                    f"{one.rank:.0f}/{one.of}" if np.isfinite(one.rank) else "-",
                    *map(_two, (one.agreement, one.jaccard)),
                    _word(one.mae, ".3f"),
                ]
            )
        median = self.medians()
        lines = [
            f"{self.solution} against {self.emg}: {len(self.time)} windows, {self._span()}",
            "",
            *columns(rows),
            "",
            f"median   r {_two(median['r'])}, best {_two(median['r_best'])} within {1e3 * self.settings['delay']:g} "
            f"ms, {_word(median['above_others'], '+.2f')} above muscles that the channel does not measure",
            *[f"notice   {one.muscle}: {one.reason}" for one in self.muscles if one.reason],
        ]
        return "\n".join(lines)

    def __str__(self) -> str:
        """As `screen`."""
        return self.screen()

    def _span(self) -> str:
        return f"{self.time[0]:g} to {self.time[-1]:g} s"


def compare_emg(
    solution: Solution,
    emg: Emg,
    mapping: Mapping[str, str] | str | os.PathLike[str] | None = None,
    *,
    delay: float = 0.1,
    threshold: float = 0.2,
    least_duration: float = 0.03,
    start: float | None = None,
    lowpass_hz: float | None = None,
) -> EmgComparison:
    """Compare a solution's excitations with envelopes of EMG.

    Args:
        solution: any.
        emg: envelopes, on the solution's clock; in any units.
        mapping: muscle to channel, or a file of it, see `io.emg_file.channel_map`; None: by name.
        delay: s, largest lag either way: 0 .. 1.
        threshold: share of a signal's range above its least value from which on it is on: between 0 and 1.
        least_duration: s: shorter interruptions count as on, then shorter bursts as off.
        start: s: windows before are left out; by default none.
        lowpass_hz: filter the excitations as the envelopes were, so that like is compared with like; by default they
            are taken as they are.

    Returns:
        The comparison.

    Raises:
        MotionError: the map's file.
        SettingsError: raw EMG, settings outside their range, muscles or channels that do not exist, or fewer than 10
            windows that the EMG covers.
    """
    from mjhcmc.io.emg_file import channel_map

    _check(emg, delay, threshold, least_duration, start)
    pairs = channel_map(mapping, solution.muscle_names, emg.channels)
    middle = (solution.time[:-1] + solution.time[1:]) / 2
    u = solution.excitation
    if lowpass_hz is not None:
        check_cutoff(lowpass_hz)
        if lowpass_hz >= 0.5 / solution.dt:
            raise SettingsError(
                f"lowpass_hz {lowpass_hz:g} Hz: windows of {solution.dt:g} s carry less than {0.5 / solution.dt:g} Hz: "
                "choose a lower one"
            )
        if len(u) < 4:
            raise SettingsError(f"the solution has {len(u)} windows, too few to filter: leave lowpass_hz out")
        u = zero_phase_lowpass(u, lowpass_hz, solution.dt)
    kept = (middle >= emg.time[0]) & (middle <= emg.time[-1])
    if start is not None:
        kept &= middle >= start
    if kept.sum() < _FEWEST:
        after = "" if start is None else f" from {start:g} s"
        raise SettingsError(
            f"{emg.name} covers {emg.time[0]:.3f} .. {emg.time[-1]:.3f} s, {kept.sum()} of the solution's windows"
            f"{after} ({solution.time[0]:.3f} .. {solution.time[-1]:.3f} s), at least {_FEWEST} are needed: bring it "
            "onto the solution's clock (shifted)"
        )
    middle, u = middle[kept], u[kept]
    n_lag = round(delay / _LAG_STEP)
    lags: Array = _LAG_STEP * np.arange(-n_lag, n_lag + 1, dtype=np.float64)
    least = max(1, round(least_duration / solution.dt))
    found, series = [], []
    for name, channel in pairs.items():
        signal = Emg(emg.time, emg.channel(channel)[:, None], (channel,), emg.name, raw=False)
        shifted = signal.at((middle - lags[:, None]).ravel())[:, 0].reshape(len(lags), -1)
        own = solution.muscle_names.index(name)
        others = [i for i, muscle in enumerate(solution.muscle_names) if pairs.get(muscle) != channel]
        found.append(_agreement(name, channel, u[:, [own, *others]], shifted, lags, threshold, least))
        series.append(shifted[n_lag])
    parts = [str(solution.settings.get(key, "?")) for key in ("method", "model", "motion")]
    settings = {
        "delay": float(delay),
        "threshold": float(threshold),
        "least_duration": float(least_duration),
        "start": None if start is None else float(start),
        "lowpass_hz": None if lowpass_hz is None else float(lowpass_hz),
        "scale": emg.scale,
    }
    which = [solution.muscle_names.index(name) for name in pairs]
    return EmgComparison(
        tuple(found), middle, u[:, which], np.column_stack(series), settings,
        f"{parts[0]} on {parts[1]}, {parts[2]}", emg.name,
    )  # fmt: skip


def _check(emg: Emg, delay: float, threshold: float, least_duration: float, start: float | None) -> None:
    if not isinstance(emg, Emg):
        raise SettingsError(f"emg must be an Emg; got {type(emg).__name__}: use Emg.from_file")
    if emg.raw:
        raise SettingsError(f"{emg.name} is raw: take its envelope first")
    if not (is_number(delay) and 0 <= delay <= 1):
        raise SettingsError(f"delay must lie within 0..1 s; got {delay!r}")
    if not (is_number(threshold) and 0 < threshold < 1):
        raise SettingsError(f"threshold must lie between 0 and 1; got {threshold!r}")
    if not (is_number(least_duration) and 0 <= least_duration <= 1):
        raise SettingsError(f"least_duration must lie within 0..1 s; got {least_duration!r}")
    if start is not None and not (is_number(start) and np.isfinite(start)):
        raise SettingsError(f"start must be a number of seconds; got {start!r}")


def _agreement(
    muscle: str, channel: str, u: Array, shifted: Array, lags: Array, threshold: float, least: int
) -> MuscleAgreement:
    """One channel, shifted by each lag (n_lag, n), against excitations u (n, 1 + others), the measured one first."""
    e = shifted[len(lags) // 2]
    there = np.isfinite(e)
    count, nothing = int(there.sum()), float("nan")
    if count < _FEWEST:
        reason = f"the channel has a value in {count} windows only"
        blank = dict.fromkeys((item.name for item in fields(MuscleAgreement)), nothing)
        return MuscleAgreement(**{**blank, "muscle": muscle, "channel": channel, "of": 0, "windows": count,
                                  "reason": reason})  # type: ignore[arg-type]  # fmt: skip
    reason, moving = _reason(u, e, there)
    r, best, lag = _correlations(u, shifted, lags, count)
    size = np.sqrt((e[there] ** 2).sum())
    k = u[there].T @ e[there] / size**2 if size > 0 else np.zeros(u.shape[1])
    mae = np.abs(u[there] - e[there, None] * k).mean(axis=0)
    on_e = _on(e, there, threshold, least)
    overlap = np.array([_overlap(_on(column, there, threshold, least), on_e, there) for column in u.T])
    for values in (r, best, lag, overlap):
        values[~moving] = nothing
    if reason:
        for values in (r, best, lag, overlap):
            values[:] = nothing
    comparable = np.isfinite(best)
    rank = 1 + float((best[1:][comparable[1:]] > best[0]).sum()) if comparable[0] else nothing
    return MuscleAgreement(
        muscle=muscle, channel=channel,
        r=float(r[0]), r_others=_median(r[1:]), r_best=float(best[0]), lag=float(lag[0]),
        r_best_others=_median(best[1:]), rank=rank, of=int(comparable.sum()),
        agreement=float(overlap[0, 0]), jaccard=float(overlap[0, 1]), jaccard_others=_median(overlap[1:, 1]),
        mae=float(mae[0]), mae_others=_median(mae[1:]), scale=float(k[0]), windows=count, reason=reason,
    )  # fmt: skip


def _reason(u: Array, e: Array, there: NDArray[np.bool_]) -> tuple[str, NDArray[np.bool_]]:
    """Why nothing can be said of the measured muscle, empty where it can; and which excitations move at all."""
    moving = np.ptp(u[there], axis=0) >= _TINY
    peak, spread = float(e[there].max()), float(np.ptp(e[there]))
    if not spread > _FLAT * peak:
        return f"the envelope hardly varies (by {spread:.3g} at a peak of {peak:.3g}): no correlation", moving
    if not moving[0]:
        return f"excitation varies by {np.ptp(u[there, 0]):.2g} only: no correlation", moving
    return "", moving


def _correlations(u: Array, shifted: Array, lags: Array, count: int) -> tuple[Array, Array, Array]:
    """Of each excitation: correlation at no lag, the largest, and its lag, s."""
    fewest = max(_FEWEST, _LEAST_SHARE * count)
    table = np.full((len(lags), u.shape[1]), np.nan)
    for i, e in enumerate(shifted):
        there = np.isfinite(e)
        if there.sum() >= fewest:
            x, y = u[there] - u[there].mean(axis=0), e[there] - e[there].mean()
            size = np.sqrt((x**2).sum(axis=0) * (y**2).sum())
            table[i] = np.divide(x.T @ y, size, out=np.full(u.shape[1], np.nan), where=size > 0)
    # of equally large ones the smallest lag
    order = np.argsort(np.abs(lags), kind="stable")
    at = order[np.argmax(np.where(np.isfinite(table), table, -2.0)[order], axis=0)]
    return table[len(lags) // 2].copy(), table[at, np.arange(u.shape[1])], lags[at].copy()


def _on(values: Array, there: NDArray[np.bool_], threshold: float, least: int) -> NDArray[np.bool_]:
    """(n,) where a signal is on; see `compare_emg`."""
    low, high = values[there].min(), values[there].max()
    on = np.zeros(len(values), dtype=bool)
    on[there] = values[there] > low + threshold * (high - low)
    on = ~_without_short(~on, least)
    return _without_short(on, least) & there


def _without_short(on: NDArray[np.bool_], least: int) -> NDArray[np.bool_]:
    """The same without runs of fewer than ``least``; those at either end go on outside and stay."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8))).reshape(-1, 2)
    result = on.copy()
    for first, last in edges:
        if last - first < least and first > 0 and last < len(on):
            result[first:last] = False
    return result


def _overlap(a: NDArray[np.bool_], b: NDArray[np.bool_], there: NDArray[np.bool_]) -> tuple[float, float]:
    """Agreement and Jaccard index."""
    a, b = a[there], b[there]
    either = int((a | b).sum())
    return float((a == b).mean()), float((a & b).sum() / either) if either else float("nan")


def _median(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _word(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "-"


def _two(value: float) -> str:
    return _word(value, ".2f")
