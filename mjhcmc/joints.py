"""What a motion needs to know of a model's joints, and whether positions keep to their ranges."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError

if TYPE_CHECKING:
    from mjhcmc.motion import Motion

Array = NDArray[np.float64]

TIME_TOLERANCE = 1e-9
"""s. Times closer than this are the same time."""

RANGE_ALLOWANCE = 2e-3
"""rad (.11 deg) or m: a spline or filter overshoots a little where a joint rests at its limit."""


class JointModel(Protocol):
    """What a motion needs to know of a model; MuscleModel has it."""

    @property
    def name(self) -> str:
        """The model's name."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(nq) names of the hinge and slide joints, in the order of qpos."""

    @property
    def joint_is_rotation(self) -> NDArray[np.bool_]:
        """(nq,) true for hinges, false for slides."""

    @property
    def joint_range(self) -> Array:
        """(nq, 2) limits, rad or m; infinite where there are none."""

    @property
    def qpos_reference(self) -> Array:
        """(nq,) the reference pose, rad or m."""

    @property
    def column_map(self) -> Mapping[str, str]:
        """Joint to file column, as shipped with the model; a leading minus flips the sign."""


def check_joint_range(
    motion: "Motion", model: JointModel, time: Array, qpos: Array, source: str, allowance: float, remedy: str
) -> None:
    """Raise MotionError where positions leave the model's joint ranges.

    Args:
        motion: for the joints' labels.
        model: the model, with joint_range (nq, 2).
        time: (n,) s.
        qpos: (n, nq) rad or m.
        source: what to call it in the message.
        allowance: rad or m past a limit that is let pass.
        remedy: what to do, the message's last words.
    """
    limits = np.asarray(model.joint_range, dtype=np.float64)
    excess = np.maximum(limits[:, 0] - qpos, qpos - limits[:, 1])
    if excess.max() <= allowance:
        return
    row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
    scale, unit = (180 / np.pi, "deg") if model.joint_is_rotation[joint] else (1.0, "m")
    low, high = scale * limits[joint]
    raise MotionError(
        f"{source}: {motion.joint_label(int(joint))} is at {scale * qpos[row, joint]:.9g} {unit} at "
        f"{time[row]:.6g} s, "
        f"outside its range {low:.6g} .. {high:.6g} {unit} in model {model.name}: {remedy}"
    )
