"""Virtual patients with spasticity: from latent mechanisms to clinical tests, grades and a dataset.

The shortest path from a patient to a grade::

    from mjhcmc import patients

    patient = patients.sample_patient(seed=0, index=4)
    trial = patients.stretch("knee", "mas")
    record = patients.run_trials([patients.Case(patient, patients.leg_of(patient), trial)])[0]
    hand = patients.hand_on("knee", patient.height)
    print(patients.ideal_grade(patients.read_resistance(record, hand)))
"""

from importlib import import_module
from typing import Any

# Where each public name lives. Imported on first use, as those of the package are.
_HOME = {
    "Case": "bench",
    "Configuration": "configuration",
    "DISTRIBUTIONS": "distributions",
    "GainEstimate": "gain",
    "Patient": "patient",
    "Record": "record",
    "ReflexArc": "reflex",
    "ReflexLaw": "reflex",
    "Trial": "trials",
    "battery": "examination",
    "estimate_gain": "gain",
    "examine": "examination",
    "generate": "generation",
    "hand_on": "resistance",
    "healthy": "patient",
    "ideal_grade": "rater",
    "leg_of": "leg",
    "move": "movement",
    "observe": "sensors",
    "pendulum": "trials",
    "rate": "rater",
    "read_resistance": "resistance",
    "recover": "inverse",
    "reflex_along": "reflex",
    "run_trials": "bench",
    "sample_patient": "patient",
    "sample_raters": "rater",
    "stretch": "trials",
    "usual_resistance": "resistance",
    "voluntary": "trials",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'mjhcmc.patients' has no attribute {name!r}; it offers {', '.join(__all__)}")
    return getattr(import_module(f"mjhcmc.patients.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
