"""HCMC, CMC and static optimization on one motion: errors, excitations over each other, who carries the moments."""

import tempfile
from pathlib import Path

import numpy as np

import mjhcmc
from mjhcmc.plotting import excitation_figure, moment_figure, save_figure

folder = Path(tempfile.mkdtemp())
model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(model, "fast")

solutions = {
    "hcmc": mjhcmc.hcmc(model, motion),
    "cmc": mjhcmc.cmc(model, motion),
    "static": mjhcmc.static_optimization(model, motion),
    "hcmc, cubic cost": mjhcmc.hcmc(model, motion, cost="cubic"),
    "hcmc, no gastroc": mjhcmc.hcmc(model, motion, disabled=["gastroc"]),
}
for name, solution in solutions.items():
    largest = np.rad2deg(np.abs(solution.tracking_error)).max(axis=0)
    errors = ", ".join(f"{dof} {value:.2g}" for dof, value in zip(solution.dof_names, largest, strict=True))
    print(f"{name:18s} max error, deg: {errors}; verdict {'holds' if solution.verdict.passed else 'FAILS'}")

save_figure(excitation_figure({name: solutions[name] for name in ("hcmc", "cmc", "static")}), folder / "methods")
save_figure(moment_figure(solutions["hcmc"]), folder / "moments")
print("written to", folder, *sorted(path.name for path in folder.iterdir()))

# Who carries the knee's moment when it is largest?
hcmc = solutions["hcmc"]
knee = model.dof_names.index("knee")
node = int(np.abs(hcmc.net_joint_moment[:, knee]).argmax())
for muscle, moment in zip(model.muscle_names, hcmc.detail.muscle_moment[node, :, knee], strict=True):
    if abs(moment) > 0.1:
        print(f"{muscle:12s} {moment:7.2f} N m at the knee at {hcmc.time[node]:.3f} s")

# For OpenSim's own tools.
print("for OpenSim:", *(path.name for path in mjhcmc.export_opensim(hcmc, folder / "fast")))
