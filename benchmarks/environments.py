"""What policies earn in the tracking environments, how the expert comes back, and how fast they step, as Markdown.

    python benchmarks/environments.py [--write [DOCUMENT]]

--write replaces the tables in docs/howto/train-a-policy.md (or DOCUMENT). Times are of the machine that it runs on.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import partial
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

N_STIFF = 40
"""Windows under muscles that are stiff."""

_TIMED = 1.0  # s


def policies(task: TrackingTask, solution: mjhcmc.Solution) -> dict[str, Policy]:
    rng, n = np.random.default_rng(0), task.model.n_muscle
    return {
        "HCMC, asked at each window": FeedbackExpert(task),
        "HCMC's solution, open loop": Expert.of(solution, task),
        "activation held": lambda node, state: state.activation,
        "no excitation": lambda node, state: np.zeros(n),
        "all muscles .1": lambda node, state: np.full(n, 0.1),
        "random excitation": lambda node, state: rng.random(n),
    }


def earned(model: mjhcmc.MuscleModel) -> str:
    table: dict[str, list[str]] = {}
    for movement in ("slow", "fast"):
        for choices in ({}, {"start": "random", "noise": np.deg2rad(NOISE)}):
            task = TrackingTask(model, movement, dt=DT, **choices)
            solution = mjhcmc.hcmc(model, task.motion, DT, task.windows.physics_dt, reserves=False)
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
        task = TrackingTask(model, movement, dt=DT)
        own = task.windows.physics_dt
        for reserves, step in ((False, own), (True, own), (False, 1e-3)):
            solution = mjhcmc.hcmc(model, task.motion, DT, step, reserves=reserves)
            errors = np.array(followed(Episodes(task), Expert.of(solution, task), 0))
            off = np.rad2deg(np.abs(errors - solution.tracking_error).max())
            found.append(
                (
                    movement, "on" if reserves else "off", digits(1e3 * step, 3),
                    digits(np.abs(solution.reserve).max(), 2), digits(off, 2),
                )
            )  # fmt: skip
    header = (
        "movement", "reserves in the solve", "its physics step, ms", "largest, N m",
        "environment off the solution by, deg",
    )  # fmt: skip
    return grid(header, found)


def stiff(model: mjhcmc.MuscleModel) -> str:
    """How far off a leg is under steps of several lengths, against a tenth of the usual one."""
    rng = np.random.default_rng(0)
    ways = {
        "all muscles fully active": np.ones((N_STIFF, model.n_muscle)),
        "on or off at random": (rng.random((N_STIFF, model.n_muscle)) < 0.5).astype(np.float64),
        "random excitation": rng.random((N_STIFF, model.n_muscle)),
    }
    own = TrackingTask(model, "slow", dt=DT).windows.physics_dt
    steps = (1e-3, 5e-4, own)
    rows = []
    for name, actions in ways.items():
        exact = moved(model, actions, 1e-4)
        off = (np.rad2deg(np.abs(moved(model, actions, step) - exact).max()) for step in steps)
        rows.append((name, *(digits(value, 2) for value in off)))
    return grid(("leg off by, deg", *(f"{digits(1e3 * step, 3)} ms" for step in steps)), rows)


def moved(model: mjhcmc.MuscleModel, actions: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """(n, nq) rad, where actions (n, n_muscle) lead."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mjhcmc.MjhcmcWarning)  # that is what is shown
        task = TrackingTask(model, "slow", dt=DT, physics_dt=step, bound=np.inf)
    episodes, found = Episodes(task), []
    episodes.reset(np.random.default_rng(0))
    for action in actions:
        episodes.step(action)
        found.append(episodes.state.qpos)
    return np.array(found)


def speed(model: mjhcmc.MuscleModel) -> str:
    task = TrackingTask(model, "slow", dt=DT)
    u = task.first(np.random.default_rng(0))[1].activation
    asked, episodes = FeedbackExpert(task), Episodes(task)

    def with_expert() -> None:
        if episodes.node in (0, task.n_window):
            episodes.reset(np.random.default_rng(0))
        episodes.step(asked(episodes.node, episodes.state))

    whats: list[tuple[str, TrackingTask, Callable[[], object]]] = []
    for integrator in ("rk4", "implicitfast"):
        env, dm = (make(model, "slow", dt=DT, integrator=integrator) for make in (TrackingEnv, tracking))
        dm.reset()
        whats.append((f"Gymnasium, {integrator}", env.task, partial(stepped, env, u)))
        whats.append((f"dm_control, {integrator}", env.task, partial(dm.step, u)))
    whats.append(("with HCMC's answer, rk4", task, with_expert))
    rows = []
    for name, of, what in whats:
        a_second, steps = rate(what), of.windows.n_step
        rows.append((name, digits(1e3 * of.windows.physics_dt, 3), f"{round(a_second, -1):.0f}",
                     f"{round(steps * a_second, -2):.0f}"))  # fmt: skip
    header = f"leg8, windows of {1e3 * DT:g} ms", "physics step, ms", "windows a second", "physics steps a second"
    return grid(header, rows)


def stepped(env: TrackingEnv, u: NDArray[np.float64]) -> None:
    """One window; at the motion's end from the beginning again."""
    if env.node in (0, env.task.n_window):
        env.reset(seed=0)
    env.step(u)


def rate(what: Callable[[], object]) -> float:
    """How often something is done in a second of CPU time: others may be at work on the machine."""
    what()
    n, began = 0, time.process_time()
    while (passed := time.process_time() - began) < _TIMED:
        what()
        n += 1
    return n / passed


def markdown() -> str:
    model = mjhcmc.MuscleModel.load("leg8")
    return (
        f"What there is to earn is 1 a window. Starts that are off ({NOISE:g} deg at each joint, standard deviation) "
        f"are at random nodes,\n{EPISODES} episodes:\n\n{earned(model)}\n\n"
        f"The largest error of any joint, deg, over {EPISODES} wrong starts of `slow`, HCMC asked at each window:\n\n"
        f"{recovered(model)}\n\nA solution's excitations, played by the environment:\n\n{replayed(model)}\n\n"
        f"How the physics step counts, over {N_STIFF * DT:g} s of `slow`, against steps of 0.1 ms; the last is the one "
        f"that is chosen:\n\n{stiff(model)}\n\nOne thread, by its CPU time:\n\n{speed(model)}"
    )


if __name__ == "__main__":
    page = Path(ROOT / "docs" / "howto" / "train-a-policy.md")
    main("environments.py", "Policies in the tracking environments.", markdown, document=page)
