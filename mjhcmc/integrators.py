"""Integrators of the plant: how a physics step moves it, and what control over many steps has to know of that.

MuJoCo's Euler, implicit and implicitfast are of first order and semi-implicit: from the state at the start of a step of
length s they find one acceleration A, and

    v+ = v + s A,    q+ = q + s v+,    a+ = a + s a'(a, u).

They differ in what of the damping is taken at the end of the step. With D = -dF/dv of all smooth forces F,

    (M + s D_s) A = F,    D_s: joint damping (Euler), D (implicit), D but for Coriolis terms (implicitfast).

Three things follow for a window of n steps, h = n s, over which acceleration goes along a line from A0 to A1, which is
what the step that follows the window takes. With r = 1/n, and r = 0 for RK4, to which the same formulas apply:

    v1 = v + h/2 [(1 + r) A0 + (1 - r) A1]
    q1 = q + h v + h^2/6 [(2 + 3r + r^2) A0 + (1 - r^2) A1]

*The effective mass*, what a moment meets that grows linearly over the window: M + s D_s + h/2 (1 - r) D +
h^2/6 (1 - r^2) K, per unit of A1, before feedback.

*The gains.* Where each window ends with A1 = -kv v1 - kp q1 (errors), the error obeys

    a z^2 + b z + c = 0,    a = 1 + (1 - r) x/2 + (1 - r^2) y/6,    a - c = x,    a + b + c = y,

with x = kv h and y = kp h^2. So x/a and y/a fix the roots, and gains (x, y) that suit RK4 have the same roots when both
are divided by 1 + r x/2 + r^2 y/6.

*The motion to follow.* A motion q(t) that is met at every step has v = (q(t) - q(t - s))/s and
A = (q(t + s) - 2 q(t) + q(t - s))/s^2: velocities lag by half a step. Those are desired, in place of q' and q''.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError, SimulationError

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

Array = NDArray[np.float64]

RK4_LIMIT = 2.78
"""Largest step times decay rate at which classical Runge-Kutta is stable (2.785 on the real axis)."""

_EULER_LIMIT = 2.0
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Scheme:
    """One of MuJoCo's integrators.

    Attributes:
        name: as users give it.
        limit: largest step times decay rate at which it is stable; see `explicit`.
        first_order: whether it steps as the module's docstring says; RK4 does not.
        implicit: whether it takes all damping, that of muscles too, at the end of the step.
    """

    name: str
    limit: float
    first_order: bool
    implicit: bool

    @property
    def code(self) -> int:
        """MuJoCo's number for it."""
        import mujoco

        return int(getattr(mujoco.mjtIntegrator, f"mjINT_{self.name.upper()}"))

    def lag(self, n_step: int) -> float:
        """r of the module's docstring, for a window of that many steps."""
        return 1.0 / n_step if self.first_order else 0.0

    def joint_damping(self, mj_model: Any) -> Array:
        """(nv,) N m s, damping of joints that Euler takes at the end of the step; 0 of other integrators."""
        import mujoco

        damped = self.first_order and not self.implicit
        off = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP) | int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
        flags = mj_model.opt.disableflags & off
        found: Array = np.array(mj_model.dof_damping) if damped and not flags else np.zeros(mj_model.nv)
        return found

    def inertia(self, M: Array, D: Array, joint: Array, step: float) -> Array:
        """M + s D_s of the module's docstring; M itself under RK4.

        Args:
            M: (..., nv, nv) kg m^2.
            D: (..., nv, nv) N m s.
            joint: (..., nv, nv) N m s, joint damping as a matrix, see `joint_damping`.
            step: s.
        """
        if not self.first_order:
            return M
        return M + step * (D if self.implicit else joint)

    def explicit(self, D: Array, joint: Array) -> Array:
        """The damping that counts for stability, such that a step s is stable where s eig(M^-1 D_e) < limit.

        Euler, with damping D of which D_s is taken at the end of the step, shrinks v by 1 - s (M + s D_s)^-1 D, which
        is above -1 where s (D - 2 D_s) < 2 M.

        Args:
            D: as `inertia`.
            joint: as `inertia`.
        """
        if not self.first_order:
            return D
        return np.zeros_like(D) if self.implicit else D - 2 * joint


RK4 = Scheme("rk4", RK4_LIMIT, first_order=False, implicit=False)
SCHEMES = {
    scheme.name: scheme
    for scheme in (
        RK4,
        Scheme("euler", _EULER_LIMIT, first_order=True, implicit=False),
        Scheme("implicit", _EULER_LIMIT, first_order=True, implicit=True),
        Scheme("implicitfast", _EULER_LIMIT, first_order=True, implicit=True),
    )
}


def scheme_of(name: object) -> Scheme:
    """The integrator of a name.

    Raises:
        SettingsError: there is none of that name.
    """
    found = SCHEMES.get(name) if isinstance(name, str) else None
    if found is None:
        raise SettingsError(f"integrator {name!r} is not known: choose one of {', '.join(SCHEMES)}")
    return found


def check_activation(model: MuscleModel, scheme: Scheme, step: float) -> None:
    """Refuse a step over which activation, advanced by one Euler step, would overshoot the excitation.

    Its time constants (Thelen 2003, doi 10.1115/1.1531112) are shortest at rest, tau_act/2, and at full activation,
    tau_deact/2.

    Args:
        model: the model.
        scheme: what steps it.
        step: s.

    Raises:
        SimulationError: naming the muscle.
    """
    if not scheme.first_order:
        return
    shortest = model.activation_parameters[:, :2].min(axis=1) / 2
    i = int(np.argmin(shortest))
    if step > shortest[i] * (1 + _ROUNDING):
        raise SimulationError(
            f"model {model.name!r}: physics_dt {step:g} s is longer than the shortest time constant of activation of "
            f"{model.muscle_names[i]!r} ({shortest[i]:.4g} s), which {scheme.name} then overshoots: use physics_dt <= "
            f"{shortest[i]:.4g}, or integrator 'rk4'"
        )


def check_engine(model: MuscleModel, scheme: Scheme, step: float) -> None:
    """Refuse a model that MuJoCo does not step by an integrator; finds out by one step.

    Args:
        model: the model.
        scheme: what is to step it.
        step: s.

    Raises:
        SettingsError: with what MuJoCo says.
    """
    if not scheme.first_order:
        return
    import copy

    import mujoco

    m = copy.copy(model.mj_model)
    m.opt.integrator, m.opt.timestep = scheme.code, step
    try:
        mujoco.mj_step(m, mujoco.MjData(m))
    except mujoco.FatalError as error:
        raise SettingsError(
            f"model {model.name!r}: MuJoCo does not step it by {scheme.name} ({error}): choose integrator 'rk4'"
        ) from None
