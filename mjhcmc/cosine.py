"""The rows of a cosine movement: out of the reference pose and back."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.joints import JointModel

Array = NDArray[np.float64]

COSINE_PERIODS = {"fast": 0.2, "slow": 0.6}
"""s a cycle of the named cosine movements."""

_COSINE_AMPLITUDES = {"hip": np.deg2rad(10.0), "knee": np.deg2rad(-20.0), "ankle": np.deg2rad(-10.0)}
_COSINE_ROWS_PER_CYCLE = 1000  # the quintic spline's q'' then errs by 1e-9 of its peak, at the ends too


def cosine_rows(
    model: JointModel,
    movement: str | None,
    amplitudes: Mapping[str, float] | None,
    period: float | None,
    cycles: float,
) -> tuple[Array, Array, str]:
    """(T,) times, (T, nq) positions and the name of a cosine movement: see Motion.cosine."""
    if (movement is None) == (amplitudes is None):
        raise SettingsError(f"cosine: give one of the movements {', '.join(COSINE_PERIODS)}, or amplitudes and period")
    if movement is not None:
        if movement not in COSINE_PERIODS:
            raise SettingsError(f"cosine: unknown movement {movement!r}: choose from {', '.join(COSINE_PERIODS)}")
        if period is not None:
            raise SettingsError(f"cosine: {movement!r} has its own period: leave period out, or give amplitudes")
        missing = [joint for joint in _COSINE_AMPLITUDES if joint not in model.joint_names]
        if missing:
            raise MotionError(
                f"cosine: model {model.name} has no joint {', '.join(missing)}, which {movement!r} "
                f"moves; it has "
                f"{', '.join(model.joint_names)}: give amplitudes={{joint: rad}} and period"
            )
        amplitudes, period = _COSINE_AMPLITUDES, COSINE_PERIODS[movement]
    assert amplitudes is not None
    for what, value in (("period", period), ("cycles", cycles)):
        if value is None or not 0 < value < np.inf:
            raise SettingsError(f"cosine: {what} is {value}: give a positive number")
    assert period is not None
    # of ball and free joints it is degrees of freedom that swing
    names = tuple(getattr(model, "dof_names", model.joint_names))
    excursion = np.zeros(len(names))
    for joint, amplitude in amplitudes.items():
        if joint not in names:
            raise MotionError(f"cosine: model {model.name} has no joint {joint!r}: its joints are {', '.join(names)}")
        if not np.isfinite(amplitude):
            raise SettingsError(f"cosine: the amplitude of joint {joint} is {amplitude}: give a finite number")
        excursion[names.index(joint)] = amplitude
    phase = np.linspace(0.0, cycles, int(np.ceil(_COSINE_ROWS_PER_CYCLE * max(cycles, 0.01))) + 1)
    # 1 - cos x = 2 sin^2(x/2) keeps its digits near rest, where q'' is at its largest.
    way, reference = np.sin(np.pi * phase)[:, None] ** 2 * excursion, np.asarray(model.qpos_reference)
    coordinates = getattr(model, "coordinates", None)
    if coordinates is None or coordinates.flat:
        qpos = reference + way
    else:
        qpos = coordinates.moved(np.tile(reference, (len(way), 1)), way)
    return phase * period, qpos, movement or "cosine"
