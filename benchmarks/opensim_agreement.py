"""Activations beside OpenSim's own CMC and Static Optimization, and what makes the difference, as Markdown.

    python benchmarks/opensim_agreement.py [--write [DOCUMENT]]

--write replaces the tables in docs/opensim.md (or DOCUMENT). Needs OpenSim's results (shared/reference) beside the
checkout.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from _markdown import JOINTS, ROOT, digits, grid, main
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.activity import agreement
from mjhcmc.leg8 import build_leg8
from mjhcmc.methods import METHODS, find_method
from mjhcmc.opensim_reference import CMC_FLOOR, INITIALISATION, OpenSimRun, find_reference, read_reference
from mjhcmc.sharing import COSTS

MOVEMENTS = ("slow", "fast")
REFERENCES = {"cmc": "CMC", "static": "Static Optimization"}
FLOOR = {"cmc": CMC_FLOOR, "static": 0.01}
"""The least activation in OpenSim's results."""

LEFT_OUT = INITIALISATION
TITLE = {"hcmc": "HCMC", "cmc": "CMC", "static": "static"}


@dataclass(frozen=True)
class Agreement:
    """Of one muscle: peaks, root mean square difference, and correlation (NaN where a signal is tiny)."""

    theirs: float
    ours: float
    rms: float
    r: float


@cache
def model(bare: bool = False) -> mjhcmc.MuscleModel:
    """leg8; bare: without passive fiber force and fiber damping, which OpenSim's Static Optimization leaves out."""
    if not bare:
        return mjhcmc.MuscleModel.load("leg8")
    compiled = build_leg8().compile()
    compiled.tendon_damping[:] = 0.0
    for parameters in (compiled.actuator_gainprm, compiled.actuator_biasprm):
        parameters[:, 7] = 1e-9  # fpmax, which must be positive
    return mjhcmc.MuscleModel.load(compiled)


@cache
def solve(method: str, movement: str, bare: bool = False, **settings: Any) -> mjhcmc.Solution:
    motion = mjhcmc.Motion.cosine(model(bare), movement)
    return find_method(method)(model(bare), motion, **settings)


@cache
def reference(movement: str, method: str) -> OpenSimRun:
    run = read_reference(model(), movement, method)
    if run is None:
        raise SystemExit("OpenSim's results (shared/reference/opensim_cmc) are not beside this checkout")
    return run


def tracking_error(run: OpenSimRun, movement: str) -> NDArray[np.float64]:
    """(n, 3) deg: actual minus desired angles of OpenSim's leg, at its own times within the movement."""
    motion = mjhcmc.Motion.cosine(model(), movement)
    inside = run.time <= motion.end + 1e-9
    assert run.qpos is not None  # OpenSim's CMC has angles
    return np.asarray(np.rad2deg(run.qpos[inside] - motion.sample(run.time[inside]).qpos))


def compare(solution: mjhcmc.Solution, run: OpenSimRun, floor: float) -> list[Agreement]:
    """Muscle by muscle, on OpenSim's times."""
    kept = (run.time >= LEFT_OUT) & (run.time <= solution.time[-1])
    found = agreement(solution.time, solution.activation, run.activity, floor, LEFT_OUT)
    result = []
    for i, name in enumerate(solution.muscle_names):
        theirs, (r, rms) = run.activation[kept, run.muscle_names.index(name)], found[name]
        ours = np.interp(run.time[kept], solution.time, solution.activation[:, i])
        result.append(Agreement(theirs.max(), ours.max(), rms, r))
    return result


def correlation(r: float) -> str:
    return "–" if np.isnan(r) else f"{r:.2f}"


def middle(values: Iterable[float]) -> float:
    """Median of those that are there."""
    there = [value for value in values if not np.isnan(value)]
    return float(np.median(there)) if there else np.nan


def summary(found: Sequence[Agreement]) -> tuple[str, str, str]:
    """Median r, median and largest RMS difference."""
    rms = [one.rms for one in found]
    return correlation(middle(one.r for one in found)), f"{np.median(rms):.3f}", f"{max(rms):.3f}"


def markdown() -> str:
    sections = ["### Joint moments, fast\n\n" + moments(), "### What the window adds, fast\n\n" + ripple()]
    for method, name in REFERENCES.items():
        for movement in MOVEMENTS:
            sections.append(f"### Against OpenSim's {name}, {movement}\n\n" + muscles(movement, method))
    sections.append("### What makes the difference\n\n" + ladder())
    return "\n\n".join(sections)


def moments() -> str:
    """Net joint moments against OpenSim's inverse dynamics, at the nodes."""
    folder = find_reference()
    path = folder.parent / "leg8" / "leg8_inverse_dynamics_traj_b.csv" if folder else ROOT / "absent.csv"
    if not path.is_file():
        raise SystemExit("OpenSim's inverse dynamics (shared/reference/leg8) is not beside this checkout")
    lines = path.read_text(encoding="utf-8").splitlines()
    names = lines[0].split(",")
    table: NDArray[np.float64] = np.array([line.split(",") for line in lines[1:]], dtype=np.float64)
    time, wanted = table[:, 0], np.column_stack([table[:, names.index(f"tau_{joint}")] for joint in JOINTS])

    peak = np.abs(wanted).max(axis=0)

    def row(what: str, moment: NDArray[np.float64], at: NDArray[np.float64]) -> tuple[str, ...]:
        nearest = np.abs(time[:, None] - at).argmin(axis=0)
        assert np.allclose(time[nearest], at, atol=1e-6)
        return (what, *map(digits, np.abs(moment).max(axis=0)), *shares(moment - wanted[nearest], peak))

    rows = [("OpenSim, inverse dynamics", *map(digits, peak), *"   ")]
    rows.append(row("leg8's bodies, moved exactly", exact_moment(time), time))
    for method in METHODS:
        for dt in (0.01, 0.005) if method == "hcmc" else (0.01,):
            solution = solve(method, "fast", dt=dt)
            title = f"{TITLE.get(method, method)}, dt {1e3 * dt:g} ms"
            rows.append(row(title, solution.net_joint_moment, solution.time))
    header = ("", *(f"{joint} peak, N m" for joint in JOINTS), *(f"{joint} RMS difference" for joint in JOINTS))
    return grid(header, rows)


def shares(error: NDArray[np.float64], peak: NDArray[np.float64]) -> list[str]:
    """Root mean squares over time, N m, each with its share of OpenSim's peak."""
    root = np.sqrt((error**2).mean(axis=0))
    return [f"{digits(value)} ({digits(100 * part, 2)} %)" for value, part in zip(root, root / peak, strict=True)]


def ripple() -> str:
    """HCMC's net joint moments at the nodes against those of leg8 moved exactly, by dt."""
    rows, last = [], None
    for dt, physics_dt in ((0.01, 0.001), (0.005, 0.001), (0.0025, 0.0005), (0.00125, 0.00025)):
        solution = solve("hcmc", "fast", dt=dt, physics_dt=physics_dt)
        exact = exact_moment(solution.time)
        error = solution.net_joint_moment - exact
        root = np.sqrt((error**2).mean(axis=0))
        order = ["–"] * 3 if last is None else [f"{value:.1f}" for value in np.log2(last / root)]
        rows.append((f"{1e3 * dt:g}", *shares(error, np.abs(exact).max(axis=0)), *order))
        last = root
    header = ("dt, ms", *(f"{joint} RMS, N m" for joint in JOINTS), *(f"{joint} order" for joint in JOINTS))
    return grid(header, rows)


def exact_moment(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """What leg8's bodies need on the fast movement: M q'' + bias; (T, 3) N m."""
    import mujoco

    sample = mjhcmc.Motion.cosine(model(), "fast").sample(time)
    compiled = model().mj_model
    data, moment, inertia = mujoco.MjData(compiled), np.empty((len(time), 3)), np.empty((3, 3))
    for k in range(len(time)):
        data.qpos[:], data.qvel[:] = sample.qpos[k], sample.qvel[k]
        mujoco.mj_forward(compiled, data)
        mujoco.mj_fullM(compiled, data, inertia)
        moment[k] = inertia @ sample.qacc[k] + data.qfrc_bias
    return moment


def muscles(movement: str, method: str) -> str:
    run = reference(movement, method)
    found = {ours: compare(solve(ours, movement), run, FLOOR[method]) for ours in METHODS}
    names = model().muscle_names
    rows = []
    for i, name in enumerate(names):
        cells = [
            c for ours in found.values() for c in (correlation(ours[i].r), f"{ours[i].rms:.3f}", f"{ours[i].ours:.2f}")
        ]
        rows.append((name, f"{found['hcmc'][i].theirs:.2f}", *cells))
    rows.append(("**median**", "", *(c for ours in found.values() for c in (*summary(ours)[:2], ""))))
    titles = [TITLE.get(ours, ours) for ours in found]
    header = ("muscle", "OpenSim peak", *(f"{t} {what}" for t in titles for what in ("r", "RMS", "peak")))
    return grid(header, rows)


def ladder() -> str:
    """Variants of ours against OpenSim: each takes over one more of its choices."""
    least = {name: f"least activation {FLOOR[name]:g}" for name in REFERENCES}
    variants: dict[str, list[tuple[str, str, dict[str, Any]]]] = {
        "cmc": [
            ("HCMC", "hcmc", {}),
            (f"HCMC, {least['cmc']}", "hcmc", {"min_activation": FLOOR["cmc"]}),
            *(
                (f"HCMC, {least['cmc']}, cost {cost}", "hcmc", {"min_activation": FLOOR["cmc"], "cost": cost})
                for cost in COSTS
                if cost != "effort"
            ),
        ],
        "static": [
            ("static", "static", {}),
            ("HCMC", "hcmc", {}),
            (f"HCMC, {least['static']}", "hcmc", {"min_activation": FLOOR["static"]}),
            (f"HCMC, {least['static']}, no passive force, no damping", "hcmc",
             {"min_activation": FLOOR["static"], "bare": True}),
            (f"static, {least['static']}, no passive force, no damping", "static",
             {"min_activation": FLOOR["static"], "bare": True}),
        ],
    }  # fmt: skip
    rows = []
    for method, name in REFERENCES.items():
        for what, ours, settings in variants[method]:
            if ours not in METHODS:
                continue
            cells = [
                cell
                for movement in MOVEMENTS
                for cell in summary(
                    compare(solve(ours, movement, **settings), reference(movement, method), FLOOR[method])
                )
            ]
            rows.append((f"{what}, against {name}", *cells))
    columns = ("median r", "median RMS", "largest RMS")
    return grid(("", *(f"{movement}: {column}" for movement in MOVEMENTS for column in columns)), rows)


if __name__ == "__main__":
    main(
        "opensim_agreement.py",
        "Activations beside OpenSim's CMC and Static Optimization.",
        markdown,
        document=ROOT / "docs" / "opensim.md",
    )
