"""A pelvis that moves and a force on the foot: what a measured walk needs, on a made-up one that runs anywhere.

For your own data the first lines are

    from mjhcmc.leg8 import leg8_from_osim
    model = mjhcmc.MuscleModel.load(leg8_from_osim("subject.osim", side="right"))
    motion = mjhcmc.Motion.from_file("walk_q.sto", model, start=0.6, end=1.9)
    loads = mjhcmc.ExternalLoads.from_file("grf.xml", model, osim="subject.osim")

and on the command line: mjhcmc solve walk_q.sto --loads grf.xml --osim subject.osim --start .6 --end 1.9 --out out/
"""

import numpy as np

import mjhcmc

model = mjhcmc.MuscleModel.load("leg8_gait")
print({name: str(role) for name, role in zip(model.dof_names, model.roles.of, strict=True)})

# A step: the pelvis goes up and down and tilts, the leg swings, the ground pushes in the middle of it.
swing = {"pelvis_ty": 0.03, "pelvis_tilt": np.deg2rad(4), "hip": np.deg2rad(20), "knee": np.deg2rad(-30)}
motion = mjhcmc.Motion.cosine(model, amplitudes=swing, period=0.8, cycles=1)
time = np.linspace(0, motion.end, 161)
push = np.sin(np.pi * np.clip((time - 0.2) / 0.4, 0, 1)) ** 2
force = np.zeros((len(time), 1, 3))
force[:, 0] = np.outer(push, [20.0, 0.0, 200.0])  # N, in the model's world: x forward, z up
point = np.tile([0.05, -0.08, 0.05], (len(time), 1, 1))  # m, under the foot
loads = mjhcmc.ExternalLoads("push", time, ("foot",), force, np.zeros_like(force), point)

solution = mjhcmc.hcmc(model, motion, dt=0.005, loads=loads)
for name, role, error in zip(
    solution.dof_names, solution.roles, np.abs(solution.tracking_error).max(axis=0), strict=True
):
    print(f"{name:12s} {role:10s} off by at most {error:.2g}")
print("residual at the pelvis, N and N m:", np.abs(solution.residual).max(axis=0)[:3].round(1))
print("each window played again, error at most:", max(solution.verdict.replay_window_max_error))
print("verdict:", "holds" if solution.verdict.passed else solution.verdict.findings)
