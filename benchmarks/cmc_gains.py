"""CMC by its gains kp = w^2, kv = 2 w: its errors, and whether the leg comes back, as Markdown.

    python benchmarks/cmc_gains.py [--write [DOCUMENT]]

--write replaces the table in docs/accuracy.md (or DOCUMENT). The defaults of `cmc` are chosen by this rule: the largest
w of the list with which the leg comes back from every start and no case diverges. It has come back where the error
after two cycles is within twice that of a right start. The look-ahead is dt; reserves are off in the last two columns.
"""

from __future__ import annotations

import warnings
from typing import Any

import mujoco
import numpy as np
from _markdown import JOINTS, digits, grid, main
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.motion import COSINE_PERIODS

RATES = range(10, 81, 10)
"""w, 1/s; 10 gives the gains of OpenSim."""

CASES = [(movement, dt) for dt in (0.01, 0.005) for movement in ("fast", "slow")]
STARTS = (1.0, -5.0)
"""deg, offset of all joints."""

LIMIT = 2.0
CYCLES = 2  # allowed to come back


def errors(motion: mjhcmc.Motion, model: mjhcmc.MuscleModel, **settings: Any) -> NDArray[np.float64] | str:
    """(N+1, nv) rad, |tracking error|; or why there is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", mjhcmc.MjhcmcWarning)  # solved again with a finer step: it diverged
        try:
            return np.asarray(np.abs(mjhcmc.cmc(model, motion, **settings).tracking_error))
        except mjhcmc.SettingsError:
            return "refused"
        except (mjhcmc.SimulationError, mjhcmc.MjhcmcWarning):
            return "diverges"


def triple(error: NDArray[np.float64] | str) -> str:
    return error if isinstance(error, str) else "/".join(digits(v) for v in np.rad2deg(error.max(axis=0)))


def row(model: mjhcmc.MuscleModel, w: int) -> tuple[bool, list[str]]:
    """Whether w passes, and its cells."""
    gains = {"kp": float(w**2), "kv": 2.0 * w}
    motions = {movement: mjhcmc.Motion.cosine(model, movement) for movement in ("fast", "slow")}
    tracked = [errors(motions[movement], model, dt=dt, **gains) for movement, dt in CASES]
    passed = "diverges" not in map(triple, tracked)
    cells = [
        f"{w}{' (OpenSim)' if w == 10 else ''}",
        *(f"{value:g}" for value in gains.values()),
        *map(triple, tracked),
    ]
    fast = motions["fast"]
    node = round(CYCLES * COSINE_PERIODS["fast"] / 0.01)
    nominal = errors(fast, model, reserves=False, **gains)
    rest = fast.sample(fast.start).qpos[0]
    for degrees in STARTS:
        back = errors(fast, model, reserves=False, initial_qpos=rest + np.deg2rad(degrees), **gains)
        if isinstance(back, str) or isinstance(nominal, str):
            cells.append("diverges")
            passed = False
            continue
        ratio = back[node:].max(axis=0) / nominal[node:].max(axis=0)
        returns = bool((ratio <= LIMIT).all())
        passed = passed and returns
        cells.append(f"{'yes' if returns else 'NO'}, {'/'.join(f'{r:.2f}' for r in ratio)}")
    return passed, cells


def markdown() -> str:
    model = mjhcmc.MuscleModel.load("leg8")
    mujoco.set_mju_user_warning(lambda _: None)  # divergences are what is looked for: no log of them
    try:
        rows = {w: row(model, w) for w in RATES}
    finally:
        mujoco.set_mju_user_warning(None)
    chosen = max(w for w, (passed, _) in rows.items() if passed)
    defaults = mjhcmc.cmc(model, mjhcmc.Motion.cosine(model, "fast")).settings
    kp, kv = defaults["kp"], defaults["kv"]
    agrees = "which are" if (kp, kv) == (chosen**2, 2 * chosen) else f"but NOT kp {kp:g}, kv {kv:g}, which are"
    header = (
        "w, 1/s",
        "kp",
        "kv",
        *(f"{movement}, {1000 * dt:g} ms" for movement, dt in CASES),
        *(f"back from {degrees:+g} deg".replace("-", "−") for degrees in STARTS),
    )
    return (
        f"Largest error {'/'.join(JOINTS)}, deg, by movement and dt; in the last columns that after {CYCLES} cycles "
        f"over that of a right start, on fast at 10 ms.\n\n{grid(header, [cells for _, cells in rows.values()])}\n\n"
        f"The largest w that comes back from every start (within {LIMIT:g}) and never diverges: {chosen}, so "
        f"kp {chosen**2}, kv {2 * chosen}, {agrees} the defaults."
    )


if __name__ == "__main__":
    main("cmc_gains.py", "CMC by its gains.", markdown)
