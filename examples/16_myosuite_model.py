"""A MyoSuite model: its elbow bends as HCMC says. Needs the models of MyoSuite: pip install myo-sim"""

import logging
import sys
import warnings

import numpy as np

import mjhcmc

try:
    import myo_sim
except ImportError:
    sys.exit("this example needs the models of MyoSuite: pip install myo-sim")

# myo_sim composes an MjModel; a path to one of your own does as well. MyoSuite's models name no integrator.
logging.disable(logging.WARNING)  # of composing
warnings.filterwarnings("ignore", message="model .* MuJoCo would step it by", category=mjhcmc.MjhcmcWarning)
model = mjhcmc.MuscleModel.load(myo_sim.load_model("myoelbow"))
print(f"{model.name}: {model.n_muscle} muscles, joints {', '.join(model.joint_names)}")

# What is known of a model before it is solved: what HCMC can drive, and what it cannot.
print(mjhcmc.check(model).screen())

# Bend it by 60 degrees and stretch it again.
elbow = model.dof_names[model.roles.tracked[0]]
motion = mjhcmc.Motion.cosine(model, amplitudes={elbow: np.deg2rad(60)}, period=1.2, cycles=1)
solution = mjhcmc.hcmc(model, motion, dt=0.01)
error = np.rad2deg(np.abs(solution.tracking_error).max())
print(f"{elbow} follows within {error:.1g} deg; verdict {'holds' if solution.verdict.passed else 'FAILS'}")
for name, u in zip(solution.muscle_names, solution.excitation.T, strict=True):
    print(f"{name:10s} peak excitation {u.max():.3f}, mean {u.mean():.3f}")
