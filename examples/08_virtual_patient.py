"""A virtual patient: a stretch of the knee at three speeds, what the hand feels, the grade, and the gain read back."""

import numpy as np

from mjhcmc import patients

patient = patients.sample_patient(seed=0, index=58)
group = patient.group("knee_extensors")
print(f"{patient.height:.2f} m, {patient.body_mass:.0f} kg; knee extensors: gain {group.gain:.2f} s, "
      f"threshold {group.threshold:.2f} lopt/s, tone {group.tone:.3f}")  # fmt: skip

leg = patients.leg_of(patient)
trials = [patients.stretch("knee", "mas", session="ideal")]
trials += [patients.stretch("knee", "fast", np.radians(speed), session="ideal", rate=200.0) for speed in (120, 240)]
records = patients.run_trials([patients.Case(patient, leg, trial) for trial in trials])

for trial, record in zip(trials, records, strict=True):
    resistance = -(record.examiner_torque[:, 1] - record.inertia * record.qacc[:, 1])  # flexion is negative
    print(f"{trial.name:20s} resistance up to {resistance.max():5.1f} N m, reflex up to {record.reflex.max():.2f}")

# What a rater feels, beside a healthy limb, and says.
healthy = patients.healthy(patient.height, patient.body_mass)
beside = patients.run_trials([patients.Case(healthy, patients.leg_of(healthy), trials[0])])[0]
felt = patients.read_resistance(records[0], patients.hand_on("knee", patient.height), patients.usual_resistance(beside))
print(f"range affected {100 * felt.range_affected:.0f} %, Modified Ashworth grade {patients.ideal_grade(felt)}")

# The gain, from excitation and fiber velocity alone.
vasti = leg.muscle_names.index("vasti")
found = patients.estimate_gain(
    records[2].reflex[:, vasti], records[2].fiber_velocity[:, vasti], 1 / trials[2].rate, mode="velocity",
    delay=patient.delay,
)  # fmt: skip
print(f"gain {found.gain:.3f} s" if found.identifiable else f"gain not identifiable: {found.reason}")
