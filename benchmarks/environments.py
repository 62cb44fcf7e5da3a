"""What policies earn in the tracking environments, how the expert comes back, and how fast they step, as Markdown.

    python benchmarks/environments.py [--write [DOCUMENT]]

--write replaces the tables in docs/howto/train-a-policy.md (or DOCUMENT). Times are of the machine that it runs on.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from _markdown import ROOT, digits, grid, main
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.environments import Episodes, Expert, FeedbackExpert, Policy, TrackingEnv, TrackingTask, returns, tracking

DT = 0.01
EPISODES = 20
NOISE = 1.0
"""deg, of the start."""

OFF = (1, 3, 5)
"""deg, standard deviation of the start's noise."""

AFTER = (0.0, 0.1, 0.2, 0.3, 0.6)
"""s after a wrong start."""

_TIMED = 1.0  # s


def policies(task: TrackingTask, solution: mjhcmc.Solution) -> dict[str, Policy]:
    rng, n = np.random.default_rng(0), task.model.n_muscle
    return {
        "HCMC, asked at each window": FeedbackExpert(task),
        "HCMC's solution, open loop": Expert.of(solution),
        "activation held": lambda node, state: state.activation,
        "no excitation": lambda node, state: np.zeros(n),
        "all muscles .1": lambda node, state: np.full(n, 0.1),
        "random excitation": lambda node, state: rng.random(n),
    }


def earned(model: mjhcmc.MuscleModel) -> str:
    table: dict[str, list[str]] = {}
    for movement in ("slow", "fast"):
        solution = mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, movement), DT, reserves=False)
        for choices in ({}, {"start": "random", "noise": np.deg2rad(NOISE)}):
            task = TrackingTask(model, movement, dt=DT, **choices)
            for name, rows in returns(task, policies(task, solution), n=EPISODES if choices else 1).items():
                table.setdefault(name, []).append(f"{100 * rows[:, 0].sum() / rows[:, 2].sum():.1f}")
    header = ("share of what there is, %", "slow", f"slow, {NOISE:g} deg off", "fast", f"fast, {NOISE:g} deg off")
    return grid(header, ([name, *shares] for name, shares in table.items()))


def recovered(model: mjhcmc.MuscleModel) -> str:
    rows = []
    for off in OFF:
        task = TrackingTask(model, "slow", dt=DT, noise=np.deg2rad(off))
        episodes, expert = Episodes(task), FeedbackExpert(task)
        worst = np.zeros(task.n_window + 1)
        for seed in range(EPISODES):
            errors = np.array([np.abs(error).max() for error in followed(episodes, expert, seed)])
            worst[: len(errors)] = np.maximum(worst[: len(errors)], errors)
        nodes = [round(after / DT) for after in AFTER]
        rows.append([f"{off} deg", *(digits(v, 2) for v in np.rad2deg(worst[nodes]))])
    return grid(("start off by (standard deviation)", *(f"{after:g} s" for after in AFTER)), rows)


def followed(episodes: Episodes, policy: Policy, seed: int) -> list[NDArray[np.float64]]:
    """Tracking errors (nz,) rad at the nodes of one episode."""
    episodes.reset(np.random.default_rng(seed))
    errors, over = [episodes.task.tracking_error(episodes.node, episodes.state)], False
    while not over:
        outcome = episodes.step(policy(episodes.node, episodes.state))
        errors.append(outcome.tracking_error)
        over = outcome.terminated or outcome.truncated
    return errors


def replayed(model: mjhcmc.MuscleModel) -> str:
    """How far an environment's tracking errors are from the solution's."""
    found = []
    for movement in ("slow", "fast"):
        motion = mjhcmc.Motion.cosine(model, movement)
        for reserves in (False, True):
            solution = mjhcmc.hcmc(model, motion, DT, reserves=reserves)
            errors = np.array(followed(Episodes(TrackingTask(model, motion, dt=DT)), Expert.of(solution), 0))
            off = np.rad2deg(np.abs(errors - solution.tracking_error).max())
            found.append(
                (movement, "on" if reserves else "off", digits(np.abs(solution.reserve).max(), 2), digits(off, 2))
            )
    return grid(("movement", "reserves in the solve", "largest, N m", "environment off the solution by, deg"), found)


def speed(model: mjhcmc.MuscleModel) -> str:
    env, dm = TrackingEnv(model, "slow", dt=DT), tracking(model, "slow", DT)
    task = env.task
    u = task.first(np.random.default_rng(0))[1].activation
    dm.reset()

    def with_gymnasium() -> None:
        if env.node in (0, task.n_window):
            env.reset(seed=0)
        env.step(u)

    asked, episodes = FeedbackExpert(task), Episodes(task)

    def with_expert() -> None:
        if episodes.node in (0, task.n_window):
            episodes.reset(np.random.default_rng(0))
        episodes.step(asked(episodes.node, episodes.state))

    whats = {"Gymnasium": with_gymnasium, "dm_control": lambda: dm.step(u), "with HCMC's answer": with_expert}
    steps = round(task.settings.dt / task.settings.physics_dt)
    rates = {name: rate(what) for name, what in whats.items()}
    rows = [(name, f"{round(per_s, -1):.0f}", f"{round(steps * per_s, -2):.0f}") for name, per_s in rates.items()]
    return grid((f"leg8, windows of {1e3 * DT:g} ms", "windows a second", "physics steps a second"), rows)


def rate(what: Callable[[], object]) -> float:
    """How often something is done a second."""
    what()
    n, began = 0, time.perf_counter()
    while (passed := time.perf_counter() - began) < _TIMED:
        what()
        n += 1
    return n / passed


def markdown() -> str:
    model = mjhcmc.MuscleModel.load("leg8")
    return (
        f"What there is to earn is 1 a window. Starts that are off ({NOISE:g} deg at each joint, standard deviation) "
        f"are at random nodes, {EPISODES} episodes:\n\n{earned(model)}\n\n"
        f"The largest error of any joint, deg, over {EPISODES} wrong starts of `slow`, HCMC asked at each window:\n\n"
        f"{recovered(model)}\n\nA solution's excitations, played by the environment:\n\n{replayed(model)}\n\n"
        f"One thread:\n\n{speed(model)}"
    )


if __name__ == "__main__":
    page = Path(ROOT / "docs" / "howto" / "train-a-policy.md")
    main("environments.py", "Policies in the tracking environments.", markdown, document=page)
