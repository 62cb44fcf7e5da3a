"""Which OpenGL back ends can draw a picture here, and whether there is a screen."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass

from mjhcmc.doctor.children import Child

_BY_SYSTEM = {"linux": ("glfw", "egl", "osmesa"), "darwin": ("cgl",), "win32": ("wgl",)}
_NEEDS = {  # what Debian and Ubuntu call it
    "glfw": "a screen (DISPLAY), and apt install libgl1",
    "egl": "apt install libegl1",
    "osmesa": "apt install libosmesa6",
}
_PATIENCE = 60.0  # s
_LONG = 100  # characters of a back end's own words

_DRAW = """
import json
import mujoco
print(json.dumps({"imported": True}), flush=True)
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><light pos='0 0 3'/><geom size='.1' rgba='1 0 0 1'/></worldbody></mujoco>"
)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 64, 64) as renderer:
    renderer.update_scene(data)
    pixels = renderer.render()
red, corner = pixels[32, 32].astype(int), pixels[0, 0].astype(int)
drawn = bool(red[0] > red[1] + 20 and red[0] > red[2] + 20 and abs(red - corner).sum() > 20)
print(json.dumps({"drawn": drawn}), flush=True)
import os
os._exit(0)  # some drivers break on the way out, when the picture is long drawn
"""


@dataclass(frozen=True)
class BackEnd:
    """An OpenGL back end of MuJoCo.

    Attributes:
        name: what MUJOCO_GL is set to for it.
        works: whether it drew a red ball.
        why: it did not; empty where it did.
        needs: what it takes to make it work.
    """

    name: str
    works: bool
    why: str = ""
    needs: str = ""


@dataclass(frozen=True)
class Pictures:
    """What can be drawn.

    Attributes:
        screen: what windows would be opened on, such as ``DISPLAY=:0``; None where there is no screen.
        asked: MUJOCO_GL as it is set; None where it is not.
        back_ends: those that were tried.
    """

    screen: str | None
    asked: str | None
    back_ends: tuple[BackEnd, ...]

    @property
    def use(self) -> str | None:
        """The first that works, what MUJOCO_GL may be set to; None where none does."""
        return next((each.name for each in self.back_ends if each.works), None)

    @property
    def remedy(self) -> str | None:
        """What to do, where something is to be done."""
        if self.use is None:
            return "install one of " + ", ".join(f"{each.name} ({each.needs})" for each in self.back_ends)
        chosen = next((each for each in self.back_ends if each.name == self.asked), None)
        if self.asked and (chosen is None or not chosen.works):
            return f"MUJOCO_GL={self.asked} draws nothing: export MUJOCO_GL={self.use}"
        if self.asked is None and not self.back_ends[0].works:  # MuJoCo's own choice
            return f"export MUJOCO_GL={self.use} for programs of yours that draw; mjhcmc finds it by itself"
        return None


def start_asked() -> Child | None:
    """Import MuJoCo with MUJOCO_GL as it is set, which refuses what it does not know; None where it is not set."""
    return Child("import mujoco") if os.environ.get("MUJOCO_GL") else None


def asked_problem(child: Child | None, use: str | None) -> str | None:
    """Why MuJoCo cannot be imported with MUJOCO_GL as it is set, with the remedy; None where it can.

    Args:
        child: of `start_asked`.
        use: a back end that works, None where there is none.
    """
    outcome = None if child is None else child.wait(_PATIENCE)
    if outcome is None or outcome.ended_well:
        return None
    instead = f", or export MUJOCO_GL={use}" if use else ""
    return (
        f"MUJOCO_GL={os.environ['MUJOCO_GL']}: MuJoCo cannot be imported with it ({_shortened(outcome.why)}): "
        f"unset MUJOCO_GL{instead}"
    )


def start() -> dict[str, Child]:
    """Try each back end in a process of its own; by back end."""
    names = _BY_SYSTEM.get(sys.platform, ("glfw",))
    return {
        name: Child(
            _DRAW, environment={"MUJOCO_GL": name, "PYOPENGL_PLATFORM": name if name in ("egl", "osmesa") else None}
        )
        for name in names
    }


def gather(children: dict[str, Child]) -> Pictures:
    """What came of them."""
    back_ends = []
    for name, child in children.items():
        outcome = child.wait(_PATIENCE)
        works = any(line.get("drawn") for line in outcome.lines)
        why = "" if works else outcome.why or "the picture is empty"
        needs = _NEEDS.get(name, "a graphics driver")
        if not works and not any(line.get("imported") for line in outcome.lines):
            needs = "mujoco that can be imported"
        elif not works and name == "glfw" and screen() is None:
            why = "there is no screen"  # what MuJoCo says of it is harder to understand
        back_ends.append(BackEnd(name, works, _shortened(why), "" if works else needs))
    return Pictures(screen(), os.environ.get("MUJOCO_GL") or None, tuple(back_ends))


def _shortened(why: str) -> str:
    return why if len(why) <= _LONG else f"{why[: _LONG - 3]}..."


def screen() -> str | None:
    """What windows would be opened on, as far as the environment tells."""
    if not sys.platform.startswith("linux"):
        return "the system's"
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        if value := os.environ.get(name):
            return f"{name}={value}"
    return None
