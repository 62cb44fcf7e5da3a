"""``mjhcmc completion``: what a shell needs to complete commands, options and their values."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import click
from click.shell_completion import CompletionItem, get_completion_class

from mjhcmc.assets import model_names, model_path

SHELLS = ("bash", "zsh", "fish")

# As the library offers them; importing those modules would take longer than anyone waits for a completion.
VALUES: dict[str, tuple[str, ...]] = {
    "method": ("hcmc", "cmc", "static"),
    "cost": ("effort", "cubic", "volume", "stress", "capacity"),
    "muscle": ("mujoco", "rigid", "compliant"),
    "curves": ("millard", "thelen", "degroote-fregly"),
    "integrator": ("rk4", "euler", "implicit", "implicitfast"),
    "movement": ("fast", "slow"),
    "solver": ("newton", "daqp", "osqp"),
    "side": ("right", "left"),
    "unit": ("deg", "rad"),
    "angles": ("joint", "segment"),
    "joint": ("hip", "knee", "ankle"),
    "target": ("rater_a", "ideal"),
    "camera": ("side", "front", "top"),
}
"""Values by the name of an option."""


@click.command()
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> int:
    """Print the script that completes commands, options and values in SHELL: bash, zsh or fish.

    \b
    Load it in every new shell:
      bash   echo 'eval "$(mjhcmc completion bash)"' >> ~/.bashrc
      zsh    echo 'eval "$(mjhcmc completion zsh)"' >> ~/.zshrc      (after compinit)
      fish   mjhcmc completion fish > ~/.config/fish/completions/mjhcmc.fish

    \b
    Example:
      mjhcmc completion bash
    """
    root = click.get_current_context().find_root()
    found = get_completion_class(shell)
    assert found is not None  # click knows these shells
    click.echo(found(root.command, {}, "mjhcmc", "_MJHCMC_COMPLETE").source())
    return 0


class _Named(click.types.StringParamType):
    """Text that has known values; what else is typed is judged by the library, in its own words."""

    def __init__(self, values: tuple[str, ...], *, or_file: bool = False) -> None:
        self._values, self._or_file = values, or_file

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """The values that begin like this; where there are none, files."""
        found = [CompletionItem(value) for value in self._values if value.startswith(incomplete)]
        return found or ([CompletionItem(incomplete, type="file")] if self._or_file else [])


class _Part(_Named):
    """Names of muscles or joints of the model that was typed before; leg8's where none was."""

    def __init__(self, path: str) -> None:
        super().__init__(())
        self._path = path

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Those that begin like this; none where the model is no MJCF file."""
        named = str(ctx.params.get("model") or ("leg8_gait" if ctx.params.get("osim") else "leg8"))
        path = model_path(named) or Path(named)
        try:
            found = ElementTree.parse(path).findall(self._path)
        except (OSError, ElementTree.ParseError):
            return []  # nothing to offer; solve itself says what is wrong with it
        names = dict.fromkeys(each.get("name", "") for each in found)
        return [CompletionItem(name) for name in names if name and name.startswith(incomplete)]


class _Folder(click.Path):
    """A folder, of which the library says whether it is fit."""

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Folders only."""
        return [CompletionItem(incomplete, type="dir")]


_JOINTS = ".//worldbody//joint"
_PARTS = {"disable": "./actuator/*", "prescribe": _JOINTS, "track": _JOINTS, "free": _JOINTS}
"""Where the names of an option's values are in an MJCF file."""


def complete_values(command: click.Command) -> None:
    """Let the options of a command, and of those below it, complete their values."""
    for below in getattr(command, "commands", {}).values():
        complete_values(below)
    for parameter in command.params:
        if isinstance(parameter.type, click.Path) and parameter.metavar in ("DIR", "[DIR]"):
            parameter.type = _Folder(path_type=parameter.type.type)
        if parameter.type is not click.STRING:
            continue  # files, numbers and choices complete by themselves
        if parameter.name == "model":
            parameter.type = _Named(model_names(), or_file=True)
        elif parameter.name in _PARTS:
            parameter.type = _Part(_PARTS[parameter.name])
        elif parameter.name in VALUES:
            parameter.type = _Named(VALUES[parameter.name])
