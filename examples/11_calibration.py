"""How strong is each muscle? Found from excitations that were measured, and a rhythmic movement with noise of 1 deg."""

import numpy as np

import mjhcmc
from mjhcmc.muscle_parameters import with_muscle_parameters

rng = np.random.default_rng(0)
model = mjhcmc.MuscleModel.load("leg8")  # all that we know of the person
true = model.max_isometric_force * rng.uniform(0.7, 1.3, model.n_muscle)
person = with_muscle_parameters(model, {"max_isometric_force": true})

# What was measured: joint angles at 100 Hz over 60 s of a rhythmic movement, each 1 deg off; excitations from EMG.
period = 0.5
swing = {"hip": np.deg2rad(25), "knee": np.deg2rad(-50), "ankle": np.deg2rad(-25)}
movement = mjhcmc.Motion.cosine(person, amplitudes=swing, period=period, cycles=120).resampled(100)
angles = movement.qpos + np.deg2rad(1) * rng.standard_normal(movement.qpos.shape)
emg = mjhcmc.hcmc(person, mjhcmc.Motion.cosine(person, amplitudes=swing, period=period, cycles=2)).excitation

# Noise of angles becomes noise of accelerations: keep two harmonics of the rhythm, two cycles of them.
cycle = mjhcmc.fit_harmonics(mjhcmc.Motion(movement.time, angles), period, harmonics=2, cycles=2)
found = mjhcmc.calibrate(model, cycle, emg)
for name, value, error, was, is_ in zip(
    found.names, found.values, found.relative_error, found.start, true, strict=True
):
    print(f"{name.split('/')[1]:10s} {value:5.0f} N, +-{error:.0%}; began at {was:5.0f}, true {is_:5.0f}")
print(f"{found.evaluations} solves, {found.message}")
