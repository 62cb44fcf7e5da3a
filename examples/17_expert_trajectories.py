"""An environment, HCMC as its expert, a file of what the expert did, and a policy that learns from it.

Needs Gymnasium: pip install "mjhcmc[learn]". For dm_control: mjhcmc.environments.tracking(model, "slow").
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import mjhcmc
from mjhcmc.environments import FeedbackExpert, Trajectories, expert_trajectories

try:
    import gymnasium

    import mjhcmc.environments.gym  # makes mjhcmc/Track-v0 known
except (ImportError, mjhcmc.SettingsError):
    sys.exit('this example needs Gymnasium: pip install "mjhcmc[learn]"')

folder = Path(tempfile.mkdtemp())
model = mjhcmc.MuscleModel.load("leg8")
choices = {"start": "random", "noise": np.deg2rad(1)}

# What the expert does from random nodes and postures, and how it comes back when its excitations are disturbed.
path = expert_trajectories(model, "slow", n=10, disturbance=0.02, seed=1, **choices).save(folder / "expert.parquet")
seen = Trajectories.load(path)
print(f"{len(seen.time)} windows of {len(seen.returns)} episodes in {path}")

# The simplest policy that can learn from it: excitation as a linear function of what is observed.
at, scale = seen.observation.mean(axis=0), seen.observation.std(axis=0) + 1e-3
inputs = np.column_stack([(seen.observation - at) / scale, np.ones(len(seen.time))])
ridge = inputs.T @ inputs + 1.0 * np.eye(inputs.shape[1])
weights = np.linalg.solve(ridge, inputs.T @ seen.action)

env = gymnasium.make("mjhcmc/Track-v0", model=model, motion="slow", **choices)
expert, rng = FeedbackExpert(env.unwrapped.task), np.random.default_rng(0)
policies = {
    "expert": lambda observation: expert(env.unwrapped.node, env.unwrapped.state),
    "linear": lambda observation: np.append((observation - at) / scale, 1.0) @ weights,
    "zero": lambda observation: np.zeros(8),
    "random": lambda observation: rng.random(8),
}
for name, policy in policies.items():
    earned, windows = 0.0, 0
    for seed in range(3):
        observation, info = env.reset(seed=seed)
        windows, over = windows + env.unwrapped.task.n_window - info["node"], False
        while not over:
            action = np.clip(policy(observation), 0, 1)
            observation, reward, terminated, truncated, info = env.step(action)
            earned, over = earned + reward, terminated or truncated
    print(f"{name:8s} earns {100 * earned / windows:5.1f} % of what there is")
