"""How well muscle parameters are known, and draws of them.

A draw multiplies the parameters of every muscle by log-normal factors, of mean 1 and the standard deviation s that is
asked for: with sigma^2 = ln(1 + s^2) and z standard normal,

    f = exp(sigma z - sigma^2/2),   z = sqrt(r) z_kind + sqrt(1 - r) z_muscle

r correlates the factors that all muscles of one kind of parameter have.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MjhcmcWarning, SettingsError
from mjhcmc.model import MuscleModel
from mjhcmc.muscle_parameters import FIBER, FORCE, KINDS, SLACK, check_kinds, muscle_parameters
from mjhcmc.sharing import by_muscle

Array = NDArray[np.float64]
Spread = float | Mapping[str, float] | ArrayLike

TYPICAL: Mapping[str, float] = {FORCE: 0.1, FIBER: 0.05, SLACK: 0.02}
"""Relative standard deviations where none are given. Chosen here, to show the method; give your own."""


def typical(model: MuscleModel) -> dict[str, float]:
    """`TYPICAL` for a model: without tendon slack lengths where MuJoCo's ranges imply negative ones, with a warning.

    Raises:
        ModelError: muscles that are not MuJoCo's.
    """
    found, slack = dict(TYPICAL), muscle_parameters(model)[SLACK]
    if (slack < 0).any():
        del found[SLACK]
        j = int(np.argmax(slack < 0))
        warnings.warn(
            f"{SLACK} of {model.muscle_names[j]} is {slack[j]:g} m in model {model.name!r}, which has no relative "
            "spread: it is taken as known",
            MjhcmcWarning,
            stacklevel=3,
        )
    return found


def check_draws(n: int, seed: int) -> None:
    """Refuse numbers of draws below 2, and seeds that are none."""
    for name, value, least in (("n", n, 2), ("seed", seed, 0)):
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not least <= value < 2**63:
            raise SettingsError(f"{name} must be a whole number from {least} to 2^63 - 1; got {value!r}")


def spreads(model: MuscleModel, sd: Mapping[str, Spread]) -> tuple[tuple[str, ...], Array]:
    """The kinds that vary, in the order of `KINDS`, and (n_kind, n_muscle) by how much.

    Args:
        model: the model.
        sd: relative standard deviations by kind: one number for all muscles, (n_muscle,), or by muscle name (0 for the
            others).

    Raises:
        SettingsError: an unknown kind or muscle, a number that is not within 0 .. 1, or nothing that varies.
        ModelError: muscles that are not MuJoCo's.
    """
    if not isinstance(sd, Mapping):
        raise SettingsError(f"sd must map kinds of parameters ({', '.join(KINDS)}) to numbers; got {type(sd).__name__}")
    check_kinds(list(sd))
    rows: dict[str, Array] = {}
    for kind in (kind for kind in KINDS if kind in sd):
        what = f"sd of {kind}"
        row = by_muscle(model, what, sd[kind], 0.0)
        bad = ~((row >= 0) & (row <= 1))
        if bad.any():
            j = int(np.argmax(bad))
            raise SettingsError(
                f"{what} of {model.muscle_names[j]} is {row[j]:g}: give a share of the parameter within 0 .. 1, such "
                "as .1 for 10 %"
            )
        if row.any():
            rows[kind] = row
    if not rows:
        raise SettingsError(f"no parameter varies: give an sd above 0 for at least one of {', '.join(KINDS)}")
    slack = muscle_parameters(model)[SLACK]
    if SLACK in rows and ((slack < 0) & (rows[SLACK] > 0)).any():
        j = int(np.argmax((slack < 0) & (rows[SLACK] > 0)))
        raise SettingsError(
            f"{SLACK} of {model.muscle_names[j]} is {slack[j]:g} m in model {model.name!r}, which has no relative "
            "spread: leave it out, or give it sd 0"
        )
    return tuple(rows), np.stack(list(rows.values()))


def draw_factors(spread: Array, kinds: Sequence[str], n: int, seed: int = 0, correlation: float = 0.0) -> Array:
    """(n, n_kind, n_muscle) log-normal factors of mean 1; see the module's docstring.

    Draw i has a counter-based stream of its own (Philox; Salmon, Moraes, Dror & Shaw 2011, doi
    10.1145/2063384.2063405), which always holds numbers for all kinds: they turn normal by the inverse of the normal
    distribution.

    Args:
        spread: (n_kind, n_muscle) relative standard deviations.
        kinds: of `mjhcmc.muscle_parameters.KINDS`.
        n: draws, 2 or more.
        seed: 0 or more.
        correlation: r, 0 .. 1.

    Raises:
        SettingsError: n or seed are no such numbers, or an unknown kind.
    """
    from scipy.special import ndtri

    check_kinds(kinds)
    check_draws(n, seed)
    n_muscle = spread.shape[1]
    uniform = np.empty((n, len(KINDS), 1 + n_muscle))
    for i in range(n):
        stream = np.random.Philox(key=int(seed), counter=[0, 0, 0, i])
        uniform[i] = np.random.Generator(stream).random((len(KINDS), 1 + n_muscle))
    z = ndtri(np.maximum(uniform[:, [KINDS.index(kind) for kind in kinds]], 2.0**-54))  # 0 may be drawn, 1 never
    z = math.sqrt(correlation) * z[:, :, :1] + math.sqrt(1 - correlation) * z[:, :, 1:]
    sigma = np.sqrt(np.log1p(spread**2))
    return np.asarray(np.exp(sigma * z - sigma**2 / 2))
