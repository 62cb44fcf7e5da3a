"""A comparison of engines as a table for the screen."""

from __future__ import annotations

from mjhcmc.engines.base import FORWARD_LIMIT, ORDER_TOLERANCE, SINGLE_LIMIT, TOLERANCE
from mjhcmc.engines.cases import QUANTITIES
from mjhcmc.engines.compare import STEP, Comparison, EngineResult

_WIDTHS = (12, 8, 8, 8, 8, 8, 8, 10, 9, 9, 8, 6)
_HEADER = ("engine", "version", "computes", "leg", "M", "bias", "tau", "", "call us", "step us", "1 s deg", "order")
_LEG = _HEADER.index("leg")

INSTALL = 'pip install "mjhcmc[engines]"'
"""What brings those that have packages for many systems."""


def screen(comparison: Comparison) -> str:
    """Rows by engine and leg; then how each was given the model and moves it; then who is missing and why."""
    ran = [row for row in comparison.rows if row.legs]
    failed = [row for row in comparison.rows if row.status == "failed"]
    missing = [row for row in comparison.rows if row.status == "not installed"]
    widths = list(_WIDTHS)
    widths[_LEG] = max([_WIDTHS[_LEG], *(len(leg) for row in ran for leg in row.legs)])
    lines = [_line(cells, widths) for cells in (_HEADER, *(cells for row in ran for cells in _rows(row)))]
    lines += ["", *(f"{row.engine.title:<12} from {row.engine.reads}, by {row.engine.integrator}" for row in ran)]
    wrong = [row for row in ran if row.status == "disagrees"] + failed
    if wrong:
        lines += ["", *(f"{row.engine.title:<12} {row.status}: {row.reason}" for row in wrong)]
    if missing:
        lines += ["", *(f"{row.engine.title:<12} not installed: {_remedy(row)}" for row in missing)]
    return "\n".join([*lines, "", _legend(comparison)])


def _rows(row: EngineResult) -> list[tuple[str, ...]]:
    out = []
    for i, (leg, result) in enumerate(row.legs.items()):
        about = (row.engine.title, row.version, row.engine.precision) if i == 0 else ("", "", "")
        order = "" if result.forward_order is None else f"{result.forward_order:.2f}"
        cells = (
            *about, leg, *(f"{result.difference[quantity]:.1e}" for quantity in QUANTITIES),
            row.status if i == 0 else "", f"{result.call_us:.1f}", f"{result.step_us:.1f}",
            f"{result.forward_error_deg:.1e}", order,
        )  # fmt: skip
        out.append(cells)
    return out


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    return " ".join(f"{cell:<{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()


def _remedy(row: EngineResult) -> str:
    return row.reason + (f": {row.engine.install}" if row.engine.install else "")


def _legend(comparison: Comparison) -> str:
    limits = ", ".join(f"{value:g} in {name}" for name, value in TOLERANCE.items())
    count = f"{comparison.states} random state{'s' if comparison.states > 1 else ''} a leg (seed {comparison.seed})"
    return (
        f"{count}; M, bias, tau: largest difference from MuJoCo by the largest value;\n"
        f"{limits} allowed\n"
        "call: one inverse dynamics through Python, median\n"
        f"1 s: a torque-driven second in steps of {1e3 * STEP:g} ms, largest angle error; order: by halving them\n"
        f"{_orders(comparison)}\n{_verdict(comparison)}"
    )


def _orders(comparison: Comparison) -> str:
    engines = [row.engine for row in comparison.rows if row.legs]
    limits = [f"{FORWARD_LIMIT[order]:g} at order {order}" for order in sorted({engine.order for engine in engines})]
    limits += [f"{SINGLE_LIMIT:g} in float32"] * any(engine.precision == "float32" for engine in engines)
    return f"{', '.join(limits)} allowed; an order is to be within {ORDER_TOLERANCE:g} of its method's"


def _verdict(comparison: Comparison) -> str:
    if not comparison.passed:
        return "not every installed engine agrees"
    if not comparison.compared:
        return f"no other engine is installed: nothing was compared: {INSTALL}"
    return "every installed engine agrees"
