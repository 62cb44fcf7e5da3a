"""Which parameters move which excitation: a gradient summed up over the motion, a row a parameter."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError
from mjhcmc.gradients.gradient import Gradient
from mjhcmc.io.files import write_csv

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

_AT_BOUND = 1e-9  # of excitation
_AT_LEAST = 1e-8  # of activation
_NOTHING = 1e-6  # percentage points per 1 %: what moves less is not named as what matters


@dataclass(frozen=True, eq=False)
class SensitivityTable:
    """What a change of each of p parameters by 1 % of its value does, to first order.

    Numbers of excitation are in percentage points: 1 is a hundredth of full excitation. For a direction of the model or
    of the motion, 1 % is that of the direction as it was given.

    Attributes:
        label: model and motion.
        names: (p,) as the gradient has them, in its order.
        muscle_names: (n_muscle,).
        dof_names: (nv,).
        dof_is_rotation: (nv,) True where rad, False where m.
        rms: (p, n_muscle) root mean square over the windows.
        mean: (p, n_muscle) mean over the windows: which way.
        largest: (p, n_muscle) the change that is largest in size, with its sign.
        largest_time: (p, n_muscle) s, start of the window of the largest.
        reserve: (p, nv) N m or N, root mean square over the windows of the change of the reserve.
        drift: (p, nv) rad or m, root mean square over the nodes of the change of the simulated position: for a
            parameter of the muscles that of the tracking error.
        change: the relative change that `near` is for.
        near: (n_muscle,) share of the windows in which, to first order, the muscle reaches or leaves a bound, or turns
            between rising and falling, when one of the parameters changes by so much: there the table holds for smaller
            changes only.
        near_any: the same for any of the muscles.
    """

    label: str
    names: tuple[str, ...]
    muscle_names: tuple[str, ...]
    dof_names: tuple[str, ...]
    dof_is_rotation: NDArray[np.bool_]
    rms: Array = field(repr=False)
    mean: Array = field(repr=False)
    largest: Array = field(repr=False)
    largest_time: Array = field(repr=False)
    reserve: Array = field(repr=False)
    drift: Array = field(repr=False)
    change: float
    near: Array
    near_any: float

    @property
    def size(self) -> Array:
        """(p,) root mean square over muscles and windows: what rows are sorted by."""
        return np.asarray(np.sqrt((self.rms**2).mean(axis=1)))

    @property
    def order(self) -> NDArray[np.intp]:
        """(p,) rows from the largest to the smallest; equal ones stay in their order."""
        return np.argsort(-self.size, kind="stable")

    def top(self, muscle: str, count: int = 3) -> tuple[str, ...]:
        """The parameters that move a muscle's excitation most, largest first; fewer where the rest does nothing.

        Raises:
            SettingsError: no such muscle.
        """
        column = self.rms[:, self._column(muscle)]
        rows = np.argsort(-column, kind="stable")[:count]
        return tuple(self.names[row] for row in rows if column[row] > _NOTHING)

    def words(self, count: int = 3) -> list[str]:
        """What matters most, a line a muscle, and where the answer holds for small changes only."""
        return [self._words(muscle, count) for muscle in self.muscle_names]

    def _words(self, muscle: str, count: int) -> str:
        j, parts = self._column(muscle), []
        for name in self.top(muscle, count):
            i = self.names.index(name)
            parts.append(
                f"+1 % of {said(name)} moves it by {self.rms[i, j]:.2g} points (mean {self.mean[i, j]:+.2g}, largest "
                f"{self.largest[i, j]:+.2g} at {self.largest_time[i, j]:.4g} s)"
            )
        text = "; ".join(parts) or "no parameter moves it"
        if self.near[j]:
            text += (
                f"; valid nearby only: in {share(self.near[j])} of the windows a change of {100 * self.change:g} % "
                "takes it to another active set"
            )
        return f"{muscle}: {text}"

    def numbers(self) -> dict[str, Any]:
        """What `words` tells, for JSON: by muscle, the three parameters that matter most, and what is near."""
        muscles: dict[str, Any] = {}
        for j, muscle in enumerate(self.muscle_names):
            rows = [self.names.index(name) for name in self.top(muscle)]
            blocks = {"rms": self.rms, "mean": self.mean, "largest": self.largest, "time_of_largest": self.largest_time}
            muscles[muscle] = {
                "matters_most": [
                    {"parameter": self.names[i], **{key: float(values[i, j]) for key, values in blocks.items()}}
                    for i in rows
                ],
                "near": float(self.near[j]),
            }
        return {"change": self.change, "near_any": self.near_any, "parameters": len(self.names), "muscles": muscles}

    def _column(self, muscle: str) -> int:
        if muscle not in self.muscle_names:
            raise SettingsError(f"the table has no muscle {muscle!r}: it has {', '.join(self.muscle_names)}")
        return self.muscle_names.index(muscle)

    def to_dataframe(self) -> pd.DataFrame:
        """A row a parameter, largest first: parameter, kind, muscle, size, rms/MUSCLE ... drift/JOINT.

        ``drift`` is in rad or m, ``reserve`` in N m or N, times in s, the rest in percentage points, all per 1 %. The
        column muscle is empty for directions, and their kind is ``direction``.
        """
        import pandas as pd

        blocks = {
            "rms": (self.muscle_names, self.rms), "mean": (self.muscle_names, self.mean),
            "largest": (self.muscle_names, self.largest), "time_of_largest": (self.muscle_names, self.largest_time),
            "reserve": (self.dof_names, self.reserve), "drift": (self.dof_names, self.drift),
        }  # fmt: skip
        pairs = [kind_and_muscle(name, self.muscle_names) for name in self.names]
        columns: dict[str, Any] = {
            "parameter": self.names, "kind": [kind for kind, _ in pairs], "muscle": [muscle for _, muscle in pairs],
            "size": self.size,
        }  # fmt: skip
        for block, (names, values) in blocks.items():
            columns |= {f"{block}/{name}": values[:, j] for j, name in enumerate(names)}
        return pd.DataFrame(columns).iloc[self.order].reset_index(drop=True)

    def save(self, path: str | Path) -> Path:
        """Write `to_dataframe` as a .csv file, whole or not at all.

        Raises:
            OutputError: the folder does not exist or cannot be written.
        """
        return write_csv(self.to_dataframe(), Path(path))


def sensitivity_table(gradient: Gradient, change: float = 0.01) -> SensitivityTable:
    """Sum a gradient up over its motion.

    Args:
        gradient: of `mjhcmc.gradients.gradient.gradient`.
        change: relative change of one parameter at a time under which the active sets are asked to stay, for ``near``.

    Raises:
        SettingsError: a change that is not positive.
    """
    if not (is_number(change) and np.isfinite(change) and change > 0):
        raise SettingsError(f"change must be a positive number, a share of the parameter; got {change!r}")
    solution, relative = gradient.solution, gradient.relative  # percentage points per 1 %, as much as 1 per 1
    scale = np.where(np.isnan(gradient.values), 1.0, gradient.values)
    at = np.abs(relative).argmax(axis=0)
    near = _near(gradient, scale * change)
    percent = 0.01 * scale
    return SensitivityTable(
        label=", ".join(Path(str(solution.settings[key])).name for key in ("model", "motion")),
        names=gradient.names,
        muscle_names=solution.muscle_names,
        dof_names=solution.dof_names,
        dof_is_rotation=solution.dof_is_rotation,
        rms=_rms(relative).T,
        mean=relative.mean(axis=0).T,
        largest=np.take_along_axis(relative, at[None], axis=0)[0].T,
        largest_time=solution.time[:-1][at].T,
        reserve=_rms(gradient.reserve * percent).T,
        drift=_rms(gradient.qpos * percent).T,
        change=float(change),
        near=near.mean(axis=0),
        near_any=float(near.any(axis=1).mean()),
    )


def _near(gradient: Gradient, steps: Array) -> NDArray[np.bool_]:
    """(N, n_muscle) where a step of one parameter is expected to change what a muscle does.

    Between its bounds a muscle has gaps: to either bound, to its least activation, and between excitation and the
    activation at the window's start, where it turns between rising and falling. The step is held against them to first
    order. A muscle at a bound does not move with the parameters, what it would do without the bound does: that is taken
    to be as much as what the muscle that moves most does, and held against the gradient's margin.
    """
    solution = gradient.solution
    low, high = np.array([0.0, 1.0]) if solution.model is None else solution.model.excitation_range.T
    least = np.asarray(solution.settings.get("min_activation", 0.0), dtype=np.float64)
    u, a, b = solution.excitation, solution.activation[:-1], solution.activation[1:]
    du, da, db = (slope * steps for slope in (gradient.excitation, gradient.activation[:-1], gradient.activation[1:]))
    near = np.zeros(u.shape, dtype=bool)
    for gap, change in ((u - low, du), (high - u, du), (u - a, du - da), (b - least, db)):
        near |= (np.abs(change) >= np.abs(gap)[:, :, None]).any(axis=2)
    bound = (u <= low + _AT_BOUND) | (u >= high - _AT_BOUND) | (b <= least + _AT_LEAST)
    most = np.abs(db).max(axis=(1, 2))[:, None]
    return np.asarray(np.where(bound, gradient.margin <= most, near))


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def kind_and_muscle(name: str, muscles: tuple[str, ...]) -> tuple[str, str]:
    """Kind and muscle of a parameter's name; ``"direction"`` and no muscle for what is none."""
    kind, _, muscle = name.partition("/")
    return (kind, muscle) if muscle in muscles else ("direction", "")


def said(name: str) -> str:
    """A parameter's name in words."""
    kind, slash, muscle = name.partition("/")
    return f"{kind.replace('_', ' ')} of {muscle}" if slash else name


def share(value: float) -> str:
    """A share in percent, as ``17 %``; never 0 for what is above."""
    return "under 1 %" if 0 < value < 0.005 else f"{100 * value:.0f} %"
