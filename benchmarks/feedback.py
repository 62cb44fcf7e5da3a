"""What the feedback gain does: the largest root of the sampled error, and the error on fast at dt 10 ms, as Markdown.

    python benchmarks/feedback.py [--write [DOCUMENT]]

--write replaces the table in docs/accuracy.md (or DOCUMENT); `methods/hcmc.py` quotes the roots. They are those of a
unit double integrator, window h = 1, acceleration linear over the window and at its end q'' = -kv v - kp e, kp = g^2:
the state (e, v, q'') goes from window to window by a 3 x 3 matrix.
"""

from __future__ import annotations

import numpy as np
from _markdown import JOINTS, digits, grid, main

import mjhcmc

GAINS = (1.5, 2.0, 2.5, 2.7, 3.0)  # `hcmc` refuses more than 3


def largest_root(gain: float, damping: float) -> complex:
    """The root of largest size, for kp = gain^2 and kv = 2 gain damping."""
    kp, kv = gain**2, 2 * gain * damping
    end = np.array([-kp, -(kv + kp), -(kv / 2 + kp / 3)]) / (1 + kv / 2 + kp / 6)
    roots = np.linalg.eigvals(np.array([[1, 1, 1 / 3] + end / 6, [0, 1, 1 / 2] + end / 2, end]))
    return complex(roots[np.argmax(np.abs(roots))])


def markdown() -> str:
    """Largest root with critical damping (a minus sign: it rings) and with the one used; error with the one used."""
    model = mjhcmc.MuscleModel.load("leg8")
    motion = mjhcmc.Motion.cosine(model, "fast")
    rows = []
    for gain in GAINS:
        critical, used = largest_root(gain, 1.0), largest_root(gain, 1 - gain / 6)
        sign = "-" if critical.real < 0 and abs(critical.imag) < 1e-9 else ""
        error = np.rad2deg(mjhcmc.hcmc(model, motion, dt=0.01, gain=gain).tracking_error)
        measures = (*np.abs(error).max(axis=0), *np.sqrt((error**2).mean(axis=0)))
        roots = (f"{sign}{abs(critical):.2f}", f"{abs(used):.2f}")
        rows.append((f"{gain:g}", *roots, *(digits(value) for value in measures)))
    columns = (*(f"{joint} max, deg" for joint in JOINTS), *(f"{joint} RMSE, deg" for joint in JOINTS))
    return grid(("gain", "root, kv = 2w", "root as used (size)", *columns), rows)


if __name__ == "__main__":
    main("feedback.py", "What the feedback gain does.", markdown)
