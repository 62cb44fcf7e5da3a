"""Ways to look at models, for the tests of check."""

import mujoco
import numpy as np

from mjhcmc.model_check.check import check


def check_xml(xml):
    return check(mujoco.MjModel.from_xml_string(xml))


def found(report, level, where):
    return [p for p in report.problems if p.level == level and where in p.where]


def flexor_and_biceps(shoulder, elbow):
    """Path lengths in the two-joint arm by plane geometry, x forward and z up; both joints swing forward."""

    def turn(angle, x, z):
        return np.array([x * np.cos(angle) - z * np.sin(angle), x * np.sin(angle) + z * np.cos(angle)])

    b, c = turn(shoulder, 0.05, -0.1), turn(shoulder, 0.05, -0.15)
    d = turn(shoulder, 0, -0.3) + turn(shoulder + elbow, 0.05, -0.08)
    return np.array([np.linalg.norm(b - [0.1, 0.1]), np.linalg.norm(d - c)])


def force_length(L, lmin=0.5, lmax=1.6):
    """MuJoCo's active force-length curve, piecewise quadratic."""
    end = lmin if L < 1 else lmax
    x = (L - 1) / (end - 1)  # 0 at the optimum, 1 at the end of the curve
    return 1 - 2 * x**2 if x < 0.5 else 2 * max(0.0, 1 - x) ** 2


def pendulum_strength(shoulder, elbow):
    """(2 muscles, 2 joints) N m at full activation: F0 FL(L) (-dL/dq)."""
    h = 1e-6
    arms = -np.stack(
        [
            (flexor_and_biceps(shoulder + h, elbow) - flexor_and_biceps(shoulder - h, elbow)) / (2 * h),
            (flexor_and_biceps(shoulder, elbow + h) - flexor_and_biceps(shoulder, elbow - h)) / (2 * h),
        ],
        axis=1,
    )
    L = 0.75 + flexor_and_biceps(shoulder, elbow) - 0.05  # L0 is .3 m/.3
    return np.array([400 * force_length(L[0]), 200 * force_length(L[1])])[:, None] * arms
