"""Which muscle parameters move which excitation, and how far excitations are known if parameters are not."""

import tempfile
from pathlib import Path

import numpy as np

import mjhcmc
from mjhcmc.gradients.gradient import gradient
from mjhcmc.gradients.table import sensitivity_table
from mjhcmc.gradients.uncertainty import intervals
from mjhcmc.plotting import interval_figure, save_figure, sensitivity_figure

folder = Path(tempfile.mkdtemp())
model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(model, "fast")

# The table: percentage points of excitation with 1 % of each parameter of each muscle. It is a derivative: where an
# excitation meets 0 or 1 within the change, it holds for smaller changes only, and says so.
slopes = gradient(model, motion)
table = sensitivity_table(slopes)
print(*table.words(count=1), sep="\n")
table.save(folder / "sensitivity.csv")
save_figure(sensitivity_figure(table), folder / "sensitivity")

# Intervals: strength known to 10 %, soleus to 3 %, tendons to 1 %. Each draw is a leg that is solved anew; the gradient
# predicts the same spread at once, to first order.
strength = dict.fromkeys(model.muscle_names, 0.1) | {"soleus": 0.03}
found = intervals(
    model, motion, {"max_isometric_force": strength, "tendon_slack_length": 0.01}, n=20, first_order=slopes
)
for j, name in enumerate(found.muscle_names):
    k = int(found.sd[:, j].argmax())
    low, high = 100 * found.low[k, j], 100 * found.high[k, j]
    print(
        f"{name:10s} least known at {found.time[k]:.2f} s: {low:3.0f} .. {high:3.0f} %, "
        f"first-order over Monte Carlo sd {found.ratio[j]:.2f}"
    )
print(f"largest reserve in any draw: {np.max(found.reserve_share):.1%} of its joint's peak moment")
found.save(folder / "intervals.csv")
save_figure(interval_figure(found), folder / "intervals")
print("written to", folder)
