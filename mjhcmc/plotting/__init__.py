"""Figures for a person, as plain `matplotlib.figure.Figure` objects; degrees on screen, SI inside."""

from mjhcmc.plotting.emg import emg_figure
from mjhcmc.plotting.fibers import detail_figure
from mjhcmc.plotting.figures import convergence_figure, excitation_figure, save_figure, save_figures
from mjhcmc.plotting.moments import moment_figure
from mjhcmc.plotting.residuals import residual_figure
from mjhcmc.plotting.sensitivity import interval_figure, sensitivity_figure
from mjhcmc.plotting.tracking import tracking_figure

__all__ = [
    "convergence_figure",
    "detail_figure",
    "emg_figure",
    "excitation_figure",
    "interval_figure",
    "moment_figure",
    "residual_figure",
    "save_figure",
    "save_figures",
    "sensitivity_figure",
    "tracking_figure",
]
