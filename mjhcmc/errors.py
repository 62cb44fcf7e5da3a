"""Everything that mjhcmc raises on purpose, and the warning it gives.

Each message names the thing (file, row, joint, muscle, time), the value found, and the remedy, in one line.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mjhcmc.solution import Solution


class MjhcmcError(Exception):
    """Base of every error that mjhcmc raises on purpose."""


class ModelError(MjhcmcError):
    """A model that cannot be loaded, or that HCMC cannot drive."""


class MotionError(MjhcmcError):
    """A motion, or a motion file, that cannot be used."""


class SettingsError(MjhcmcError):
    """An argument or option outside its valid values."""


class SimulationError(MjhcmcError):
    """A simulation that cannot be run as asked.

    Attributes:
        solution: what was solved before it, a shorter `Solution` marked interrupted; None where there is nothing.
    """

    solution: "Solution | None" = None


class DivergedError(SimulationError):
    """A simulation that ran away: its state is not finite."""


class OutputError(MjhcmcError):
    """A result that cannot be written, or a result file that cannot be read."""


class MjhcmcWarning(UserWarning):
    """Something that the user should know; the work goes on."""
