"""Derivatives of the muscle step: MJX and JAX beside MuJoCo in C, entry by entry and in time, as Markdown.

    python benchmarks/mjx.py [--write [DOCUMENT]]

Needs the extra ``jax``. --write replaces the tables in docs/mjx.md (or DOCUMENT). It takes about 7 minutes, most of
them JAX's compiler.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from _markdown import ROOT, digits, grid, main
from _timing import alternate, machine, quiet, spread, walls
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.gradients.looks import Looker, States
from mjhcmc.gradients.mjx_step import MuscleStep, muscle_step, window_jacobian
from mjhcmc.gradients.window_jacobian import WindowJacobian, stagewise_jacobian
from mjhcmc.muscle_parameters import KINDS, with_muscle_parameters

Array = NDArray[np.float64]

STEP, N_STEP, PATIENTS = 0.001, 10, (1, 16, 128)
ALONG = 16  # states along the movement
TIED = 1e-9  # of activation and excitation: as good as equal, where the slope by activation jumps
RUNS = 5


def markdown() -> str:
    model = mjhcmc.MuscleModel.load("leg8")
    with quiet():
        solution = mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, "fast"), dt=N_STEP * STEP)
    step = muscle_step(model, STEP, N_STEP, KINDS)
    times = compile_times(step, solution)
    states, u = at(solution, np.linspace(1, solution.n_window - 1, ALONG).round().astype(int))
    return "\n\n".join(
        [
            machine(("mujoco", "mujoco-mjx", "jax", "numpy")),
            agreement(step, solution, states, u),
            speed(step, solution, times),
        ]
    )


def at(solution: mjhcmc.Solution, windows: Array) -> tuple[States, Array]:
    """States at the starts of windows, with what acts in them."""
    parts = (solution.qpos, solution.qvel, solution.activation, solution.reserve)
    return States(*(part[windows] for part in parts)), solution.excitation[windows]


def agreement(step: MuscleStep, solution: mjhcmc.Solution, states: States, u: Array) -> str:
    model = step.model
    mjx, along = window_jacobian(step, states, u), stagewise_jacobian(model, states, u, STEP, N_STEP, KINDS)
    nv, n = model.nv, model.n_muscle
    first, second = (np.concatenate([found.start, found.inputs], axis=2) for found in (mjx, along))
    tied = np.abs(states.activation - u) < TIED
    for whole in (first, second):
        whole[:, :, 2 * nv : 2 * nv + n] *= ~tied[:, None, :]
    names = ["position", "velocity", "activation", "excitation", "reserve", *(kind.replace("_", " ") for kind in KINDS)]
    columns = np.split(np.arange(first.shape[2]), np.cumsum([nv, nv, n, n, nv, *[n] * (len(KINDS) - 1)]))
    rows = np.split(np.arange(2 * nv + n), [nv, 2 * nv])
    table = [
        (name, *(difference(first[:, row][:, :, column], second[:, row][:, :, column]) for row in rows))
        for name, column in zip(names, columns, strict=True)
    ]
    velocity, active = Looker(model, len(u)).look(states).velocity, states.activation > 0.05
    return (
        f"The end of a window of {1e3 * N_STEP * STEP:g} ms of leg8, {N_STEP} steps, by its start, its inputs and "
        f"{len(step.names)} muscle parameters, at {len(u)} windows along *fast*. Muscles with an activation over .05 "
        f"lengthen in {int((active & (velocity > 0)).sum())} of these states and shorten in "
        f"{int((active & (velocity < 0)).sum())}. Ends agree within {np.abs(mjx.end - along.end).max():.0e}. Largest "
        f"difference of the derivatives, over the largest value of the block:\n\n"
        f"{grid(['derivative by', 'of position', 'of velocity', 'of activation'], table)}\n\n"
        f"Left out: {int(tied.sum())} of {tied.size} derivatives by activation, of muscles whose activation is their "
        f"excitation. {reverse(step, mjx, states, u)}"
    )


def difference(one: Array, other: Array) -> str:
    largest = np.abs(other).max()
    return f"{np.abs(one - other).max() / largest:.0e}" if largest else ("0" if not one.any() else "not 0")


def reverse(step: MuscleStep, forward: WindowJacobian, states: States, u: Array) -> str:
    """Reverse mode against forward mode."""
    nv, n = step.model.nv, step.model.n_muscle
    x = inputs(step, states, u)

    def end(row: Any) -> Any:
        return jax.numpy.concatenate(step(*jax.numpy.split(row, np.cumsum([nv, nv, n, n, nv]))))

    with jax.enable_x64(True):
        begun = time.perf_counter()
        compiled = jax.jit(jax.vmap(jax.jacrev(end))).lower(x).compile()
        took = time.perf_counter() - begun
        whole = np.asarray(compiled(x))
        begun = time.perf_counter()
        jax.block_until_ready(compiled(x))
        run = (time.perf_counter() - begun) / len(x)
    both = np.concatenate([forward.start, forward.inputs], axis=2)
    off = np.abs(whole - both).max() / np.abs(both).max()
    finite = (
        "all of it is finite"
        if np.isfinite(whole).all()
        else f"{int((~np.isfinite(whole)).sum())} values are not finite"
    )
    return (
        f"Reverse mode (`jax.jacrev`) compiles in {took:.0f} s, takes {1e3 * run:.3g} ms a window and differs from "
        f"forward mode by {off:.0e} of the largest value; {finite}."
    )


def inputs(step: MuscleStep, states: States, u: Array, values: Array | None = None) -> Array:
    values = np.tile(step.values, (len(u), 1)) if values is None else values
    return np.hstack([states.qpos, states.qvel, states.activation, u, states.reserve, values])


def drawn(step: MuscleStep, solution: mjhcmc.Solution, count: int) -> tuple[States, Array, Array]:
    """Patients: each muscle's parameters within 10 %, each at a window of the movement."""
    rng = np.random.default_rng(count)
    states, u = at(solution, rng.integers(1, solution.n_window, count))
    return states, u, step.values * rng.uniform(0.9, 1.1, (count, len(step.values)))


def compile_times(step: MuscleStep, solution: mjhcmc.Solution) -> list[float]:
    """s, of the first call with so many patients; later ones are compiled."""
    times = []
    for count in PATIENTS:
        begun = time.perf_counter()
        window_jacobian(step, *drawn(step, solution, count), verify=False)
        times.append(time.perf_counter() - begun)
    return times


def speed(step: MuscleStep, solution: mjhcmc.Solution, times: list[float]) -> str:
    rows = []
    for count, first in zip(PATIENTS, times, strict=True):
        states, u, values = drawn(step, solution, count)
        calls: dict[str, Callable[[], Any]] = {
            "mjx": lambda s=states, u=u, p=values: window_jacobian(step, s, u, p, verify=False),
            "verified": lambda s=states, u=u, p=values: window_jacobian(step, s, u, p),
            "c": lambda s=states, u=u, p=values: one_by_one(step, s, u, p),
        }
        found = {name: walls(readings) for name, readings in alternate(calls, RUNS).items()}
        each = (spread(found[name], 1e-3 * count) for name in ("mjx", "verified", "c"))
        ratio = np.median(np.divide(found["mjx"], found["c"]))
        rows.append((count, f"{first:.0f}", spread(found["mjx"], 1e-3), *each, digits(float(ratio), 2)))
    header = [
        "patients", "first call, s", "MJX, a window of all, ms", "MJX, ms a patient", "checked by steps in C",
        "C and stages, ms a patient", "MJX / C",
    ]  # fmt: skip
    return (
        f"B patients at once, each with {len(step.values)} parameters of its own: the whole derivative of one window, "
        f"{2 * step.model.nv + step.model.n_muscle} by "
        f"{inputs(step, *at(solution, np.arange(1, 2))).shape[1]} numbers. Median of {RUNS} (quartiles). No GPU was "
        f"used.\n\n{grid(header, rows)}"
    )


def one_by_one(step: MuscleStep, states: States, u: Array, values: Array) -> None:
    """The same derivatives in C, a model a patient."""
    for b, row in enumerate(values.reshape(len(u), len(KINDS), -1)):
        patient = with_muscle_parameters(step.model, dict(zip(KINDS, row, strict=True)))
        chosen = States(*(part[b : b + 1] for part in states))
        stagewise_jacobian(patient, chosen, u[b : b + 1], STEP, N_STEP, KINDS)


if __name__ == "__main__":
    main("mjx.py", __doc__ or "", markdown, document=ROOT / "docs" / "mjx.md")
