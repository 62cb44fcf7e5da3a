"""Many movements in lock step: legs of different mass and strength follow one swing; one of them cannot."""

import warnings

import numpy as np

import mjhcmc

model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(model, "slow")

# Numbers of their own for 6 legs, by the names of MjModel's fields: one row a simulation.
rng = np.random.default_rng(1)
mass = model.mj_model.body_mass * rng.uniform(0.8, 1.2, (6, 1))
gain = np.repeat(model.mj_model.actuator_gainprm[None], 6, axis=0)
gain[:, :, 2] *= rng.uniform(0.7, 1.3, (6, 8))  # max isometric force, N
mass[4, 2] = np.nan  # a slip

with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    batch = mjhcmc.hcmc_batch(model, motion, parameters={"body_mass": mass, "actuator_gainprm": gain})
print("warning:", told[-1].message)

for i, solution in batch.solved.items():
    largest = np.rad2deg(np.abs(solution.tracking_error)).max()
    busiest = model.muscle_names[int(solution.excitation.max(axis=0).argmax())]
    verdict = "holds" if solution.verdict.passed else "FAILS"
    print(f"leg {i:2d}: max error {largest:.2g} deg, busiest muscle {busiest}, verdict {verdict}")

# Each is what hcmc gives alone, to the last bit.
alone = mjhcmc.hcmc(batch[3].model, motion)
print("leg 3 alone, the same bits:", np.array_equal(alone.excitation, batch[3].excitation))
