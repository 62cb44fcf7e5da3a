"""Look at a solution: its table, its figures, its verdict, and its replay without feedback."""

import tempfile
from pathlib import Path

import numpy as np

import mjhcmc
from mjhcmc.plotting import excitation_figure, save_figure, tracking_figure

folder = Path(tempfile.mkdtemp())
model = mjhcmc.MuscleModel.load("leg8")
solution = mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, "fast"), dt=0.005)

# The table: one row a node, SI units and radians. It also loads with pandas.read_parquet, without mjhcmc.
solution.save(folder / "fast.parquet")
table = mjhcmc.Solution.load(folder / "fast.parquet").to_dataframe()
print(table[["time", "q/hip", "excitation/iliopsoas", "activation/iliopsoas", "moment/hip"]].head())

# The figures: PNG and PDF.
save_figure(excitation_figure(solution), folder / "excitations")
save_figure(tracking_figure(solution), folder / "tracking")
print("written to", folder, *sorted(path.name for path in folder.iterdir()))

# The verdict: reserves and tracking decide. A window that needed help has a status of its own.
verdict = solution.verdict
print("verdict:", "holds" if verdict.passed else "FAILS", *verdict.findings, *solution.messages())
for name, share, rms in zip(verdict.dof_names, verdict.peak_reserve_share, verdict.tracking_rms, strict=True):
    print(f"{name:6s} reserve {100 * share:.2g} % of peak moment, tracking RMS {np.rad2deg(rms):.2g} deg")

# The replay: the same excitations in a plain forward simulation with ten times finer steps, and nothing else.
drift = np.abs(mjhcmc.replay(solution) - solution.qpos).max(axis=0)
print("replay drifts by", ", ".join(f"{value:.1g} deg" for value in np.rad2deg(drift)))
