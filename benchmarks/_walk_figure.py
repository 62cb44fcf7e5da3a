"""The picture of the walk: angles, net joint moments against OpenSim's, activations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from _walk_cases import FLOOR, JOINTS, against, of_joints, opensim_cmc, opensim_moments, solve

from mjhcmc.external_loads import ExternalLoads
from mjhcmc.plotting.panels import (
    BLUE,
    DESIRED,
    FLAGGED,
    GREEN,
    VERMILLION,
    Sheet,
    finish,
    note,
    scale_values,
    shade,
    style,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TOUCH = 20.0  # N: above, the foot is on the ground


def walk_figure() -> Figure:
    """Rows: angles, moments, and two of activations; the foot's time on the ground is shaded."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    solution, run, hill = solve(), opensim_cmc(), solve(tendon="compliant", cost="capacity")
    assert solution.surroundings is not None
    loads = solution.surroundings.loads
    assert isinstance(loads, ExternalLoads)
    time = solution.time
    stance = np.linalg.norm(loads.sample(time).force[:, 0], axis=-1)[:-1] > _TOUCH
    actual = np.rad2deg(of_joints(solution, solution.qpos))
    desired = np.rad2deg(of_joints(solution, solution.qpos_desired))
    moment, theirs = of_joints(solution, solution.net_joint_moment), opensim_moments(time)
    entries = [
        Line2D([], [], color=DESIRED, lw=3.2, label="measured motion"),
        Line2D([], [], color=VERMILLION, lw=1.3, label="OpenSim"),
        Line2D([], [], color=BLUE, lw=1.3, label="mjhcmc"),
        Line2D([], [], color=GREEN, lw=1.1, label="Millard, compliant, cost capacity"),
        Patch(color=FLAGGED, label="right foot on ground"),
    ]
    with style():
        sheet = Sheet(
            4, 4, panel=(1.75, 1.15), gap=(0.62, 0.5), entries=entries,
            title="One walking trial, right leg, HCMC with 5 ms windows",
        )  # fmt: skip
        for j, joint in enumerate(JOINTS):
            for row, label, unit, behind, ours in (
                (0, "angle", "deg", desired, actual),
                (1, "net moment", "N m", theirs, moment),
            ):
                ax = sheet.panel(row, j, joint)
                lines = [behind[:, j], ours[:, j]]
                scale_values(sheet, ax, label, unit, lines)
                shade(ax, time, stance, FLAGGED, _span(ax), 0)
                wide = row == 0
                ax.plot(time, behind[:, j], color=DESIRED if wide else VERMILLION, lw=3.2 if wide else 2.0)
                ax.plot(time, ours[:, j], color=BLUE, lw=1.3)
                error = ours[:, j] - behind[:, j]
                size = np.abs(error).max() if wide else np.sqrt((error**2).mean())
                note(ax, f"{'max error' if wide else 'rms'} {size:.2g} {unit}")
                finish(ax, time_label=False)
        force = loads.sample(time).force[:, 0]
        ax = sheet.panel(0, 3, "ground reaction")
        scale_values(sheet, ax, "force", "N", [force[:, 2], force[:, 0]])
        shade(ax, time, stance, FLAGGED, _span(ax), 0)
        for axis, name, line in ((2, "up", "-"), (0, "forward", "--")):
            ax.plot(time, force[:, axis], color="#262626", lw=1.2, ls=line, label=name)
        ax.legend(loc="upper right", handlelength=1.6, borderpad=0.1, labelspacing=0.1)
        finish(ax, time_label=False)
        ax = sheet.panel(1, 3, "residual at the pelvis")
        up, forward = of_joints(solution, solution.residual, ("pelvis_ty", "pelvis_tx")).T
        scale_values(sheet, ax, "force", "N", [up, forward])
        shade(ax, time, stance, FLAGGED, _span(ax), 0)
        ax.plot(time, up, color="#262626", lw=1.2)
        ax.plot(time, forward, color="#262626", lw=1.2, ls="--")
        finish(ax, time_label=False)
        found = [against(one, run) for one in (solution, hill)] if run else []
        for i, muscle in enumerate(solution.muscle_names):
            row = 2 + i // 4
            ax = sheet.panel(row, i % 4, muscle)
            ax.set_ylim(0, 1.3)
            ax.set_yticks([0, 0.5, 1])
            sheet.label_values(ax, "activation" if i % 4 == 0 else "")
            shade(ax, time, stance, FLAGGED, (0, 1.3), 0)
            if run is not None:
                ax.plot(run.time, run.activation[:, run.muscle_names.index(muscle)], color=VERMILLION, lw=1.3)
                note(ax, "r " + ", ".join(f"{r:.2f}" if np.isfinite(r) else "–" for r in (f[muscle][0] for f in found)))
            ax.plot(time, hill.activation[:, i], color=GREEN, lw=1.1)
            ax.plot(time, solution.activation[:, i], color=BLUE, lw=1.3)
            ax.axhline(FLOOR, color=DESIRED, lw=0.6)
            finish(ax, time_label=row == 3)
    return sheet.figure


def _span(ax: object) -> tuple[float, float]:
    low, high = ax.get_ylim()  # type: ignore[attr-defined]
    return low, high - low
