"""Gradients of HCMC's solution: agreement with differences, what they cost, and what calibration recovers, as Markdown.

    python benchmarks/gradients.py [--write [DOCUMENT]]

--write replaces the tables in docs/gradients.md (or DOCUMENT). Takes about 8 minutes.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from _markdown import ROOT, digits, grid, main
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.muscle_parameters import FORCE, FORCE_KINDS, muscle_parameters, with_muscle_parameters
from mjhcmc.patients.leg import leg_of
from mjhcmc.patients.patient import sample_patient

Array = NDArray[np.float64]

STEPS = (1e-5, 1e-4)  # relative, of differences: what is rounding in one is less in the other
LEAST = 0.01  # of the movement's largest derivative: smaller ones are measured by this, the differences have noise
ROUNDS = 7
PATIENTS = 8
NOISE_DEG, RATE, SECONDS, HARMONICS = 1.0, 100.0, 30.0, 2
PERIOD, AMPLITUDES = 0.5, {"hip": np.deg2rad(25.0), "knee": np.deg2rad(-50.0), "ankle": np.deg2rad(-25.0)}


def markdown() -> str:
    return "\n\n".join([agreement(), cost(), calibration()])


def converged(model: mjhcmc.MuscleModel, motion: mjhcmc.Motion) -> Array:
    return mjhcmc.hcmc(model, motion, trials=16, tolerance=0.0).excitation


def agreement() -> str:
    """Of all 24 muscle parameters with central differences of two steps, relative to each one's largest derivative."""
    model = mjhcmc.MuscleModel.load("leg8")
    now, rows = muscle_parameters(model), []
    for movement in ("fast", "slow"):
        motion = mjhcmc.Motion.cosine(model, movement)
        found = mjhcmc.gradient(model, motion)
        for j, kind in enumerate(FORCE_KINDS):
            largest = 0.0
            errors: dict[float, list[float]] = {h: [] for h in STEPS}
            left_out = dict.fromkeys(STEPS, 0)
            for i in range(model.n_muscle):
                exact = found.relative[:, :, j * model.n_muscle + i]
                largest = max(largest, float(np.abs(exact).max()))
                scale = max(np.abs(exact).max(), LEAST * np.abs(found.relative).max())

                def moved(h: float, kind: str = kind, i: int = i) -> mjhcmc.MuscleModel:
                    values = now[kind].copy()
                    values[i] *= 1 + h
                    return with_muscle_parameters(model, {kind: values})

                for h in STEPS:
                    error, whole = disagreement(exact, found.margin, moved, motion, h)
                    errors[h].append(error / scale)
                    left_out[h] += len(exact) - whole
            told = {h: digits(max(errors[h]), 2) if np.isfinite(max(errors[h])) else "–" for h in STEPS}
            each = (f"{told[h]} ({left_out[h]})" for h in STEPS)
            rows.append((movement, kind.replace("_", " "), digits(largest), *each))
    header = ["movement", "parameter of 8 muscles", "largest change of u per relative change"]
    return grid(header + [f"largest disagreement (windows left out), step {h:g}" for h in STEPS], rows)


def disagreement(
    exact: Array, margin: Array, moved: Callable[[float], mjhcmc.MuscleModel], motion: mjhcmc.Motion, h: float
) -> tuple[float, int]:
    """Largest difference from central differences over the windows before any muscle may change; and their number."""
    changing = (margin <= 3 * h * np.abs(exact)).any(axis=1)
    whole = int(np.argmax(changing)) if changing.any() else len(exact)
    if not whole:
        return np.inf, 0
    numeric = (converged(moved(h), motion) - converged(moved(-h), motion)) / (2 * h)
    return float(np.abs(exact - numeric)[:whole].max()), whole


def timed(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def cost() -> str:
    """In turns with plain solves: medians of ratios."""
    model = mjhcmc.MuscleModel.load("leg8")
    weak = with_muscle_parameters(model, {FORCE: 0.3 * model.max_isometric_force})
    fast, slow = (mjhcmc.Motion.cosine(model, movement) for movement in ("fast", "slow"))
    rows = []
    for name, one, motion, kinds in (
        ("fast, 24 parameters", model, fast, FORCE_KINDS),
        ("slow, 24 parameters", model, slow, FORCE_KINDS),
        ("fast, 8 parameters", model, fast, (FORCE,)),
        ("fast, muscles of .3 strength (reserves carry most), 24", weak, fast, FORCE_KINDS),
    ):
        calls = {
            "plain": lambda one=one, motion=motion: mjhcmc.hcmc(one, motion),
            "converged": lambda one=one, motion=motion: mjhcmc.hcmc(one, motion, trials=30, tolerance=1e-6),
            "gradient": lambda one=one, motion=motion, kinds=kinds: mjhcmc.gradient(one, motion, parameters=kinds),
        }
        for call in calls.values():
            call()
        seconds = {key: [] for key in calls}
        for _ in range(ROUNDS):
            for key, call in calls.items():
                seconds[key].append(timed(call))
        ratio = [g / p for g, p in zip(seconds["gradient"], seconds["plain"], strict=True)]
        solve = [c / p for c, p in zip(seconds["converged"], seconds["plain"], strict=True)]
        low, high = np.quantile(ratio, [0.25, 0.75])
        rows.append(
            (name, digits(statistics.median(seconds["plain"])), digits(statistics.median(solve), 2),
             f"{statistics.median(ratio):.1f} ({low:.1f}–{high:.1f})", 2 * len(kinds) * model.n_muscle)
        )  # fmt: skip
    header = [
        "case", "plain solve, s", "converged solve, plain solves", "whole gradient, plain solves",
        "central differences, plain solves",
    ]  # fmt: skip
    return grid(header, rows)


def calibration() -> str:
    """Eight strengths of virtual patients' own legs, begun at half to twice of what they are."""
    rows = []
    for index in range(PATIENTS):
        patient = leg_of(sample_patient(7, index))
        rng = np.random.default_rng(index)
        true = patient.max_isometric_force
        start = with_muscle_parameters(patient, {FORCE: true * 2.0 ** rng.uniform(-1, 1, patient.n_muscle)})
        motion = mjhcmc.Motion.cosine(patient, amplitudes=AMPLITUDES, period=PERIOD, cycles=2)
        excitation = mjhcmc.hcmc(patient, motion).excitation
        clean = mjhcmc.calibrate(start, motion, excitation)
        cycles = round(SECONDS / PERIOD)
        whole = mjhcmc.Motion.cosine(patient, amplitudes=AMPLITUDES, period=PERIOD, cycles=cycles).resampled(RATE)
        seen = whole.qpos + np.deg2rad(NOISE_DEG) * rng.standard_normal(whole.qpos.shape)
        measured = mjhcmc.fit_harmonics(mjhcmc.Motion(whole.time, seen), PERIOD, HARMONICS, cycles=2)
        noisy = mjhcmc.calibrate(start, measured, excitation)
        errors = [100 * np.abs(found.values / true - 1) for found in (clean, noisy)]
        rows.append(
            (index, digits(100 * float(np.abs(clean.start / true - 1).max()), 2), digits(errors[0].max(), 2),
             clean.evaluations, digits(errors[1].max(), 2), digits(float(np.median(errors[1])), 2), noisy.evaluations,
             digits(100 * float(noisy.relative_error.max()), 2), digits(float(excitation.max()), 2))
        )  # fmt: skip
    header = [
        "patient", "largest error at the start, %", "clean: largest error, %", "solves", "noisy: largest error, %",
        "median error, %", "solves", "largest standard error told, %", "peak excitation",
    ]  # fmt: skip
    return grid(header, rows)


if __name__ == "__main__":
    main("gradients.py", __doc__, markdown, document=ROOT / "docs" / "gradients.md")
