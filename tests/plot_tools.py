"""What the tests of figures share: solutions of plausible shape, and what is found in a drawn panel."""

from dataclasses import replace

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.patches import StepPatch

from mjhcmc.solution import Solution

LEG = ("iliopsoas", "glut_max", "rect_fem", "hamstrings", "vasti", "gastroc", "soleus", "tib_ant")


def make(muscles=LEG, dofs=("hip", "knee", "ankle"), n=30, seed=0, slides=(), **settings):
    """A solution of plausible shape; excitation stays under 1, errors shrink a hundredfold from joint to joint."""
    rng = np.random.default_rng(seed)
    time = 0.6 + 0.01 * np.arange(n + 1)
    qpos_desired = np.sin(9 * time[:, None] + rng.uniform(0, 6, len(dofs)))
    error = rng.normal(scale=1e-2, size=(n + 1, len(dofs))) * 100.0 ** -np.arange(len(dofs))
    moment = 60 * np.cos(9 * time[:, None] + np.arange(len(dofs)))
    return Solution(
        time=time,
        excitation=rng.uniform(0, 0.9, (n, len(muscles))),
        activation=rng.uniform(0, 0.9, (n + 1, len(muscles))),
        qpos=qpos_desired + error,
        qpos_desired=qpos_desired,
        qvel=np.zeros_like(error),
        tracking_error=error,
        net_joint_moment=moment,
        muscle_force=np.zeros((n + 1, len(muscles))),
        reserve=np.zeros((n, len(dofs))),
        shortfall=np.zeros((n, len(dofs))),
        external_load=np.zeros((n + 1, len(dofs))),
        status=np.zeros(n, dtype=np.int64),
        muscle_names=tuple(muscles),
        dof_names=tuple(dofs),
        dof_is_rotation=np.array([name not in slides for name in dofs]),
        settings={"method": "hcmc", "model": "leg8", "motion": "fast", "dt": 0.01, **settings},
    )


def steps(ax, label):
    return [p for p in ax.patches if isinstance(p, StepPatch) and p.get_label() == label]


def line(ax, label):
    (found,) = [artist for artist in ax.get_lines() if artist.get_label() == label]
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def shaded(ax, n, time, color=None):
    """Windows of which the middle is shaded."""
    middle, found = (time[:-1] + time[1:]) / 2, np.zeros(n, dtype=bool)
    for collection in ax.collections:
        if isinstance(collection, PolyCollection) and (
            color is None or np.allclose(collection.get_facecolor()[0], matplotlib.colors.to_rgba(color))
        ):
            for path in collection.get_paths():
                x = path.vertices[:, 0]
                found |= (middle > x.min()) & (middle < x.max())
    return found


def legend(figure):
    return [t.get_text() for t in figure.legends[0].get_texts()]


def pixels(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba()).copy()


def with_roles(solution, roles, **settings):
    return replace(solution, settings={**solution.settings, "roles": roles, **settings})


def titles(figure):
    return [ax.get_title(loc="left") for ax in figure.axes if ax.get_title(loc="left")]


def rooted(n_dof=3, seed=4):
    names = ("pelvis_tilt", "pelvis_tx", "pelvis_ty")[:n_dof]
    names += tuple(f"slide_{i}" for i in range(n_dof - 3))
    solution = make(dofs=(*names, "hip"), slides=names[1:])
    residual = np.zeros((31, n_dof + 1))
    residual[:, :n_dof] = np.random.default_rng(seed).normal(size=(31, n_dof)) * 100.0
    solution = with_roles(solution, ["prescribed"] * n_dof + ["tracked"], root=list(names))
    return replace(solution, residual=residual)


def activations(ax):
    return [artist for artist in ax.get_lines() if artist.get_label() == "activation"]
