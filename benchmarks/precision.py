"""What precision buys: integration, rounding, the activation map and HCMC's own error, as Markdown.

    python benchmarks/precision.py [--write [DOCUMENT]]

--write replaces the tables in docs/precision.md (or DOCUMENT) and draws precision.png beside it. Needs mpmath and
python-flint (pip install "mjhcmc[precision]").
"""

from __future__ import annotations

import math
import textwrap
from functools import cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from _markdown import ROOT, digits, grid, main, save_png
from _precision_hcmc import NUDGE, Share, amplification, hcmc_curves, hcmc_share, nudged, shares
from _timing import alternate, figure, machine
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.exact import leg, reference, scalars
from mjhcmc.exact.activation import activation_after, activation_rk4
from mjhcmc.exact.chain import torque_driven_model
from mjhcmc.exact.leg import planar_leg_of
from mjhcmc.exact.scalars import FLOAT, LONGDOUBLE, QUADRUPLE_BITS, Scalars
from mjhcmc.plotting.precision import ErrorPanel, precision_figure

WINDOW, N_WINDOW, PERIOD = 0.02, 50, 0.2  # 1 s of the paper's fast movement
STEPS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)  # a window
FIRST_ORDER = 128  # most steps of the methods of order 1
INTEGRATORS = ("RK4", "Euler", "implicit", "implicitfast")
DEEP = 60  # digits against which rounding is measured
ROUNDED = {"float64": (FLOAT, 512), "longdouble": (LONGDOUBLE, 64), "113 bits": (scalars.mpmath(bits=113), 32)}
"""Scalar type, and most steps a window that it is run at."""

COST_BITS = (53, QUADRUPLE_BITS, 168, 334, 666)  # the last three are 50, 100 and 200 digits
ACTIVATION_WINDOW = 0.01
ACTIVATION_STEPS = (1, 2, 4, 10, 20, 40, 100)
SMALL = 10  # times: what is called far below, and no part worth naming
LEVELS = np.linspace(0.0, 1.0, 11)
TAU = (0.01, 0.04)  # s, leg8's


class Runs(NamedTuple):
    """Errors (n_step,) in deg over 1 s, largest of all joints and nodes."""

    truncation: NDArray[np.float64]
    engine: dict[str, NDArray[np.float64]]
    rounding: dict[str, NDArray[np.float64]]


def markdown() -> str:
    parts = [answers(), integration(), rounding(), cost(), activation_map(), hcmc_share(), amplification()]
    return "\n\n".join(parts)


@cache
def setting() -> tuple[leg.PlanarLeg, list[list[float]]]:
    """The leg, and the moments of the paper's fast movement, of the middle of each window."""
    planar = planar_leg_of(mjhcmc.MuscleModel.load("leg8"))
    size, w = np.deg2rad([10.0, -20.0, -10.0]) / 2, 2 * np.pi / PERIOD
    return planar, [
        leg.inverse_dynamics(
            planar, size * (1 - np.cos(w * t)), size * w * np.sin(w * t), size * w**2 * np.cos(w * t), FLOAT
        )
        for t in WINDOW * (np.arange(N_WINDOW) + 0.5)
    ]


@cache
def runs() -> Runs:
    planar, torques = setting()
    deep = scalars.flint_arb(DEEP)
    still = [0.0] * planar.n
    exact, _ = reference.torque_driven(planar, still, still, torques, WINDOW, deep)
    truncation, kept = [], {name: [] for name in ROUNDED}
    engine = {name: [] for name in INTEGRATORS}
    rounding = {"MuJoCo": [], **kept}
    rounded_exact = reference.floats(exact, deep)
    for n in STEPS:
        plain, _ = reference.torque_driven_rk4(planar, still, still, torques, WINDOW, n, deep)
        truncation.append(apart(plain, exact, deep, deep))
        for name in INTEGRATORS:
            if name == "RK4" or n <= FIRST_ORDER:
                rows = stepped(name, n)
                engine[name].append(np.rad2deg(np.abs(rows - rounded_exact).max()))
                if name == "RK4":
                    rounding["MuJoCo"].append(apart(rows.tolist(), plain, FLOAT, deep))
        for name, (kind, most) in ROUNDED.items():
            if n <= most:
                rows, _ = reference.torque_driven_rk4(planar, still, still, torques, WINDOW, n, kind)
                rounding[name].append(apart(rows, plain, kind, deep))
    return Runs(
        np.array(truncation),
        {name: np.array(values) for name, values in engine.items()},
        {name: np.array(values) for name, values in rounding.items()},
    )


def apart(rows: list, others: list, kind: Scalars, deep: Scalars) -> float:
    """Largest difference in deg; nothing is lost on the way from one type to the deeper one."""
    with deep.working():
        return max(
            np.rad2deg(deep.size(deeper(x, kind, deep) - y))
            for row, other in zip(rows, others, strict=True)
            for x, y in zip(row, other, strict=True)
        )


def deeper(x: object, kind: Scalars, deep: Scalars) -> object:
    if kind is deep:
        return x
    if kind is FLOAT:
        return deep.number(float(x))
    high = float(x)  # the rest of a number is a number: exact parts, at most three floats
    mid = float(x - high)
    low = float(x - high - mid)
    return deep.number(high) + deep.number(mid) + deep.number(low)


def stepped(integrator: str, n: int) -> NDArray[np.float64]:
    """(N + 1, nv) of MuJoCo."""
    m, torques = torque_driven_model(mjhcmc.MuscleModel.load("leg8")), setting()[1]
    m.opt.integrator = getattr(
        mujoco.mjtIntegrator,
        {"Euler": "mjINT_EULER", "RK4": "mjINT_RK4"}.get(integrator, f"mjINT_{integrator.upper()}"),
    )
    m.opt.timestep = WINDOW / n
    d = mujoco.MjData(m)
    rows = [d.qpos.copy()]
    for torque in torques:
        d.qfrc_applied[:] = torque
        mujoco.mj_step(m, d, nstep=n)
        rows.append(d.qpos.copy())
    return np.array(rows)


def milliseconds(n: int) -> float:
    return 1e3 * WINDOW / n


def orders(values: NDArray[np.float64], steps: tuple[int, ...]) -> list[str]:
    ratio = np.log(values[:-1] / values[1:]) / np.log(
        np.array(steps[1 : len(values)]) / np.array(steps[: len(values) - 1])
    )
    return ["–", *(f"{value:.2f}" for value in ratio)]


def integration() -> str:
    found = runs()
    columns = [found.truncation, *(found.engine[name] for name in INTEGRATORS)]
    order = [orders(found.truncation, STEPS), orders(found.engine["RK4"], STEPS)]
    rows = []
    for i, n in enumerate(STEPS):
        cells = [digits(column[i]) if i < len(column) else "" for column in columns]
        rows.append((f"{milliseconds(n):.4g}", cells[0], order[0][i], cells[1], order[1][i], *cells[2:]))
    header = [
        "physics step, ms", f"RK4, {DEEP} digits", "order", "MuJoCo RK4", "order",
        *(f"MuJoCo {x}" for x in INTEGRATORS[1:]),
    ]  # fmt: skip
    return f"### Error of the torque-driven leg after up to 1 s, degrees\n\n{grid(header, rows)}"


def rounding() -> str:
    found = runs()
    names = list(found.rounding)
    rows = []
    for i, n in enumerate(STEPS):
        cells = [digits(found.rounding[name][i], 2) if i < len(found.rounding[name]) else "" for name in names]
        rows.append((f"{milliseconds(n):.4g}", digits(found.truncation[i], 2), *cells))
    header = ["physics step, ms", "truncation", *(f"rounding, {name}" for name in names)]
    return (
        "### Truncation and rounding of RK4, degrees\n\n"
        f"Rounding is the difference from the same steps with {DEEP} digits.\n\n{grid(header, rows)}"
    )


@cache
def times() -> dict[str, float]:
    """s of CPU time a physics step of RK4 on the leg; the least of the turns: arithmetic takes the same each time."""
    planar, torques = setting()
    kinds = [FLOAT, LONGDOUBLE]
    kinds += [make(bits=bits) for make in (scalars.mpmath, scalars.flint_arb) for bits in COST_BITS]
    still, n = [0.0] * planar.n, 4

    def call(kind: Scalars, windows: int = 2):
        return lambda: reference.torque_driven_rk4(planar, still, still, torques[:windows], WINDOW, n, kind)

    m = torque_driven_model(mjhcmc.MuscleModel.load("leg8"))
    m.opt.timestep = WINDOW / n
    d = mujoco.MjData(m)
    calls = {kind.name: call(kind) for kind in kinds}
    readings = alternate({"MuJoCo": lambda: mujoco.mj_step(m, d, nstep=1000), **calls}, 12)
    per = {name: 1000 if name == "MuJoCo" else 2 * n for name in readings}
    return {name: min(reading.cpu for reading in values) / per[name] for name, values in readings.items()}


def cost() -> str:
    took = times()
    base, engine = took[FLOAT.name], took["MuJoCo"]
    rows = [
        (
            name.replace("mpmath", "mpmath,").replace("arb", "python-flint arb,"),
            figure(1e6 * t),
            figure(t / base),
            figure(t / engine),
        )
        for name, t in took.items()
    ]
    header = ["arithmetic", "CPU time of an RK4 step, µs", "over float64 in Python", "over MuJoCo (float64, C)"]
    return f"### What digits cost\n\n{machine(('mujoco', 'numpy', 'mpmath', 'python-flint'))}\n\n{grid(header, rows)}"


@cache
def activation_errors() -> dict[str, NDArray[np.float64]]:
    """Largest error over all pairs of levels, by direction, (n_step,)."""
    deep = scalars.flint_arb(40)
    worst = {"rising": np.zeros(len(ACTIVATION_STEPS)), "falling": np.zeros(len(ACTIVATION_STEPS))}
    for a in LEVELS:
        for u in LEVELS:
            if a == u:
                continue
            exact = activation_after(float(a), float(u), *TAU, ACTIVATION_WINDOW, deep)
            way = worst["rising" if u > a else "falling"]
            for i, n in enumerate(ACTIVATION_STEPS):
                with deep.working():
                    error = deep.size(activation_rk4(float(a), float(u), *TAU, ACTIVATION_WINDOW, n, deep) - exact)
                way[i] = max(way[i], error)
    return worst


def activation_map() -> str:
    found = activation_errors()
    order = {way: orders(values, ACTIVATION_STEPS) for way, values in found.items()}
    rows = [
        (
            f"{1e3 * ACTIVATION_WINDOW / n:g}",
            *(cell for way in found for cell in (digits(found[way][i]), order[way][i])),
        )
        for i, n in enumerate(ACTIVATION_STEPS)
    ]
    header = ["physics step, ms", *(cell for way in found for cell in (f"{way}: largest error", "order"))]
    return (
        f"### The activation map over a window of {1e3 * ACTIVATION_WINDOW:g} ms\n\n"
        "Largest error of RK4's activation over all starts and excitations 0, .1, .. 1; time constants "
        f"{1e3 * TAU[0]:g} and {1e3 * TAU[1]:g} ms.\n\n{grid(header, rows)}"
    )


def answers() -> str:
    """The paper's questions in a few sentences."""
    found, took = runs(), times()
    at = STEPS.index(16)
    error, noise = found.truncation[at], found.rounding["MuJoCo"][at]
    constant = error / milliseconds(STEPS[at]) ** 4
    floor = float(np.median(found.rounding["MuJoCo"][at:]))
    crossing = (floor / constant) ** 0.25
    one = took[FLOAT.name]
    mp, arb = (took[make(bits=QUADRUPLE_BITS).name] / one for make in (scalars.mpmath, scalars.flint_arb))
    digit = [
        100 * ((took[make(bits=666).name] / took[make(bits=168).name]) ** (math.log2(10) / (666 - 168)) - 1)
        for make in (scalars.mpmath, scalars.flint_arb)
    ]
    slow, fast = (x for x in shares() if x.asked == 1.0 and x.window == 10.0)
    halved = tuple(x for x in shares() if x.asked == 1.0 and x.window == 5.0)
    kind = f"{LONGDOUBLE.bits} bits ({LONGDOUBLE.digits} decimal digits)"
    kind += ", the 80-bit format of x87" if LONGDOUBLE.bits == 64 else ""
    worst = max(a for pair in nudged().values() for a in pair)
    grown = floor * worst  # what the muscle-driven leg makes of float64's rounding
    calls = ": most of the time goes into Python's calls" if max(digit) < 1 else ""
    points = [
        f"**Would float128 or mpmath help? {_helps(error, noise)}** At a step of {milliseconds(STEPS[at]):g} ms RK4's "
        f"truncation error is {error:.1e} deg and MuJoCo's rounding error {noise:.1e} deg, {_times(error, noise)}. 113 "
        f"bits leave truncation as it is and bring rounding to at most {np.max(found.rounding['113 bits']):.0e} deg.",
        f"**Where rounding would begin to matter:** at a step of {1e3 * crossing:.0f} µs, where truncation falls to "
        f"float64's floor of {floor:.0e} deg; the default step is {1 / crossing:.0f} times that. The tracking error "
        f"of HCMC at the default step and dt 10 ms is {slow.tracking:.1e} deg (slow) and {fast.tracking:.1e} deg "
        f"(fast), what integration leaves in the motion {slow.integration:.1e} and {fast.integration:.1e} deg. "
        f"{_source((slow, fast), halved, error > SMALL * noise)}",
        f"**What it costs:** an RK4 step in 113 bits takes {figure(mp)} (mpmath) or {figure(arb)} (python-flint) times "
        f"Python's float64, which takes {figure(one / took['MuJoCo'])} times MuJoCo's (which also computes the "
        f"muscles' paths). From 50 to 200 digits each further digit costs {digit[0]:.2f} % (mpmath) or "
        f"{digit[1]:.2f} % (python-flint){calls}.",
        f"**Which is which:** numpy.longdouble has {kind} here; NumPy's float128 is the same, padded to 128 bits. IEEE "
        "binary128 (113 bits, C's _Float128) has no NumPy type: mpmath with 113 bits rounds as it does.",
        f"**Do muscles amplify rounding?** A difference of {NUDGE:g} rad at the start grows at most {figure(worst)} "
        f"times (last table): of float64's floor that makes {grown:.0e} deg, "
        f"{_carries(grown, min(slow.integration, fast.integration))} for the muscle-driven one.",
    ]
    return "### The answers\n\n" + "\n".join(
        textwrap.fill(f"- {point}", 120, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
        for point in points
    )


def _helps(error: float, noise: float) -> str:
    if error > SMALL * noise:
        return "No."
    return "Yes: rounding is the larger part." if noise > error else "A little: rounding is a part of the error."


def _times(error: float, noise: float) -> str:
    return f"{error / noise:.0e} times smaller" if noise < error else f"{noise / error:.0e} times larger"


def _source(now: tuple[Share, ...], halved: tuple[Share, ...], bare: bool) -> str:
    """Where HCMC's tracking error comes from: from dt where integration is little of it and half of dt makes it less.

    bare: rounding is far below truncation.
    """
    share = max(x.integration / x.tracking for x in now)
    if share * SMALL >= 1:
        return f"Integration is up to {100 * share:.2g} % of the tracking error: a smaller physics step helps first."
    gain = min(x.tracking / y.tracking for x, y in zip(now, halved, strict=True))
    if gain < 2:
        return f"Half of dt makes the tracking error {figure(gain)} times smaller only: it is not dt that makes it."
    more = "more digits do not" if bare else "and so may more digits"
    return f"Half of dt makes the tracking error at least {figure(gain)} times smaller: a smaller dt helps, {more}."


def _carries(grown: float, least: float) -> str:
    """Whether rounding stays small beside what integration leaves in the muscle-driven motion; both in deg."""
    if grown * SMALL < least:
        return f"far below the {least:.0e} deg that integration leaves. What is said of the torque-driven leg holds"
    return f"not far below the {least:.0e} deg that integration leaves. What is said of the torque-driven leg fails"


def figures(folder: Path) -> None:
    found, step = runs(), [milliseconds(n) for n in STEPS]
    curves = {f"MuJoCo {name}": (step[: len(y)], y) for name, y in found.engine.items() if name != "implicitfast"}
    curves |= {f"RK4, {DEEP} digits": (step, found.truncation)}
    curves |= {f"rounding, {name}": (step[: len(y)], y) for name, y in found.rounding.items() if name in ROUNDED}
    way = activation_errors()
    panels = [
        ErrorPanel(
            "Torque-driven leg, 1 s", "physics step (ms)", "max error (deg)", curves,
            {4: f"RK4, {DEEP} digits", 1: "MuJoCo Euler"}, "lower left",
        ),
        ErrorPanel(
            f"Activation after {1e3 * ACTIVATION_WINDOW:g} ms", "physics step (ms)", "max error",
            {k: ([1e3 * ACTIVATION_WINDOW / n for n in ACTIVATION_STEPS], y) for k, y in way.items()}, {4: "falling"},
        ),
        ErrorPanel(
            "HCMC", "control window dt, or physics step (ms)", "max error (deg)", hcmc_curves(), {2: "tracking, slow"}
        ),
    ]  # fmt: skip
    save_png(precision_figure(panels, "leg8: what is truncation, what is rounding"), folder / "precision.png")


if __name__ == "__main__":
    what = "Truncation, rounding, the activation map and HCMC's own error."
    main("precision.py", what, markdown, figures, ROOT / "docs" / "precision.md")
