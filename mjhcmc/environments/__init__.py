"""Environments: follow a motion with muscle excitations, for dm_control and Gymnasium, and HCMC as the expert policy.

`task` says what is observed, rewarded and when an episode ends, whatever steps the model; `episodes` steps it;
`dm` and `gym` give both their libraries' shape.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjhcmc.environments.dm import DmTask, tracking
    from mjhcmc.environments.episodes import Episodes, Policy, returns
    from mjhcmc.environments.expert import Expert, FeedbackExpert
    from mjhcmc.environments.gym import TrackingEnv
    from mjhcmc.environments.task import Settings, TrackingTask
    from mjhcmc.environments.trajectories import Trajectories, expert_trajectories

# Imported on first use: dm_control and Gymnasium are optional, MuJoCo takes a second.
_HOME = {
    "DmTask": "dm",
    "Episodes": "episodes",
    "Expert": "expert",
    "FeedbackExpert": "expert",
    "Policy": "episodes",
    "Settings": "task",
    "TrackingEnv": "gym",
    "TrackingTask": "task",
    "Trajectories": "trajectories",
    "expert_trajectories": "trajectories",
    "returns": "episodes",
    "tracking": "dm",
}

__all__ = [
    "DmTask",
    "Episodes",
    "Expert",
    "FeedbackExpert",
    "Policy",
    "Settings",
    "TrackingEnv",
    "TrackingTask",
    "Trajectories",
    "expert_trajectories",
    "returns",
    "tracking",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'mjhcmc.environments' has no attribute {name!r}; it offers {', '.join(__all__)}")
    value = getattr(import_module(f"mjhcmc.environments.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
