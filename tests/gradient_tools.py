"""What the tests of gradients share: a short movement, and central differences of HCMC's converged answer."""

import numpy as np

import mjhcmc
from mjhcmc.muscle_parameters import muscle_parameters, with_muscle_parameters

AMPLITUDES = {"hip": np.deg2rad(10.0), "knee": np.deg2rad(-20.0), "ankle": np.deg2rad(-10.0)}
H = 1e-5  # relative: rounding and truncation of the differences are then both about 1e-7 of u


def leg():
    return mjhcmc.MuscleModel.load("leg8")


def short(model, period=0.2, until=None):
    """One cycle of the paper's movement, or its beginning until a time."""
    motion = mjhcmc.Motion.cosine(model, amplitudes=AMPLITUDES, period=period, cycles=1)
    if until is None:
        return motion
    kept = motion.time <= until + 1e-9
    return mjhcmc.Motion(motion.time[kept], motion.qpos[kept])


def converged(model, motion, **options):
    return mjhcmc.hcmc(model, motion, trials=16, tolerance=0.0, **options)


def scaled(model, kind, muscle, factor):
    """The model with one muscle's parameter times a factor."""
    values = muscle_parameters(model)[kind].copy()
    values[model.muscle_names.index(muscle)] *= factor
    return with_muscle_parameters(model, {kind: values})


def difference(make, h=H, name="excitation", **options):
    """Central difference of an array of solutions by what make(x) makes of model and motion, at x = 0."""
    up, down = (getattr(converged(*make(side * h), **options), name) for side in (1, -1))
    return (up - down) / (2 * h)


def check(exact, numeric, margin, h=H, within=1e-5, near=0.02):
    """Agreement relative to the largest, but where a muscle may have changed what it does within the differences.

    Args:
        exact: (N, n_muscle).
        numeric: (N, n_muscle).
        margin: (N, n_muscle) of the gradient.
        h: of the differences.
        within: bound.
        near: share of entries that may lie so near to a change.
    """
    scale = np.abs(exact).max()
    assert scale > 0
    far = margin > 3 * h * np.abs(exact)
    if not far.all():  # what follows such a window in time is bent as well
        first = int(np.argwhere(~far)[0][0])
        assert (~far).sum() <= near * far.size
        exact, numeric = exact[:first], numeric[:first]
        assert first >= 0.7 * len(far)
    assert np.abs(exact - numeric).max() <= within * scale
