"""What a trial window buys, with two ways to predict what a change of activation does, as Markdown.

    python benchmarks/corrector.py [--write [DOCUMENT]]

--write replaces the table in docs/method.md (or DOCUMENT). `integrated response` is what `mjhcmc.hcmc` does: the
linearized window integrated over the physics steps. `effective mass` is the simpler E = M + h/2 D + h^2/6 K, as if
every change grew linearly over a short window. Contraction is |a''' - a''|/|a'' - a'| of the activations that
successive trials ask for, median over the windows: what a trial leaves of the error of the one before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from _markdown import JOINTS, ROOT, digits, grid, main
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.methods import correction
from mjhcmc.plant import physics_steps

CASES = (("fast", 0.01), ("fast", 0.005), ("slow", 0.01))
TRIALS = (1, 2, 3)
_SETTLED = 1e-6  # a change of activation too small to tell a ratio from rounding


def effective_mass(*arguments: Any) -> None:
    """In place of `correction._linearize`: E qacc = [B, 1], qvel = h/2 qacc, qpos = h^2/6 qacc."""
    INTEGRATED(*arguments)
    first, last, _, _, s, a, _, B, M, D, K, kp, kv, _, step, n_step, answers, _, Q, _ = arguments
    for b in range(first, last if n_step else first):
        n, h = B.shape[2], step * n_step
        c = 1 + kv[b] * h / 2 + kp[b] * h**2 / 6
        E = M[b] + h / 2 * D[b] + h**2 / 6 * K[b]
        answers[b] = (E / c) @ (c[:, None] * np.linalg.solve(E, np.hstack([B[b], np.eye(len(E))])))
        Q[b] = B[b] @ a[b] + answers[b][:, n:] @ s[b]


INTEGRATED = correction._linearize
PREDICTIONS: dict[str, Callable[..., None]] = {"integrated response": INTEGRATED, "effective mass": effective_mass}


@contextmanager
def swapped(name: str, value: Any) -> Iterator[None]:
    """Another function of that name in the correction's module, for a while."""
    held = getattr(correction, name)
    setattr(correction, name, value)
    try:
        yield
    finally:
        setattr(correction, name, held)


class Watched(mjhcmc.MujocoPlant):
    """A plant that writes down to which activation each step of a window for good leads."""

    def __init__(self, model: mjhcmc.MuscleModel, physics_dt: float) -> None:
        super().__init__(model, physics_dt)
        self.reached: list[list[NDArray[np.float64]]] = [[]]

    def advance(
        self, excitation: NDArray[np.float64], reserve: NDArray[np.float64], n_step: int, times: float = 1.0
    ) -> None:
        """As the plant does."""
        super().advance(excitation, reserve, n_step, times)
        self.reached[-1].append(self.get_state().activation)

    def next_window(self, *_: int) -> None:
        """To be called after each window."""
        self.reached.append([])


def solve(model: mjhcmc.MuscleModel, motion: mjhcmc.Motion, dt: float, trials: int) -> tuple[mjhcmc.Solution, float]:
    """The solution, and the median contraction from the second trial to the third (NaN with fewer)."""
    plant = Watched(model, dt / physics_steps(dt, 1e-3))
    solution = mjhcmc.hcmc(model, motion, dt=dt, trials=trials, tolerance=0.0, plant=plant, progress=plant.next_window)
    if trials < 3:
        return solution, float("nan")
    by_trial = np.array([window[-trials:] for window in plant.reached if window])
    changes = np.linalg.norm(np.diff(by_trial, axis=1), axis=2)
    told = changes[:, 0] > _SETTLED
    return solution, float(np.median(changes[told, 1] / changes[told, 0]))


def markdown() -> str:
    model = mjhcmc.MuscleModel.load("leg8")
    rows = []
    for movement, dt in CASES:
        motion = mjhcmc.Motion.cosine(model, movement)
        for name, response in PREDICTIONS.items():
            for trials in TRIALS:
                with swapped("_linearize", response):
                    solution, contraction = solve(model, motion, dt, trials)
                largest = np.rad2deg(np.abs(solution.tracking_error).max(axis=0))
                change = float(np.abs(np.diff(solution.excitation, axis=0)).mean())
                left = f"{contraction:.3f}" if np.isfinite(contraction) else ""
                rows.append(
                    (
                        f"{movement}, {1e3 * dt:g} ms",
                        name,
                        trials,
                        *(digits(v, 2) for v in largest),
                        digits(change, 2),
                        left,
                    )
                )
    header = ("movement, dt", "prediction", "trials", *(f"{j} max error, deg" for j in JOINTS))
    return grid((*header, "mean abs(Δu)", "contraction"), rows)


if __name__ == "__main__":
    what = "What a trial window buys, with two ways to predict what a change of activation does."
    main("corrector.py", what, markdown, document=ROOT / "docs" / "method.md")
