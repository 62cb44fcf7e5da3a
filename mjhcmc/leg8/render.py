"""A picture of leg8, drawn without a screen."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import OutputError
from mjhcmc.leg8.builder import build_leg8
from mjhcmc.leg8.table import JOINTS


def render_leg8(
    angles: Mapping[str, float] | None = None,
    *,
    width: int = 900,
    height: int = 1200,
    table: Mapping[str, Any] | None = None,
) -> NDArray[np.uint8]:
    """Draw leg8 in a posture, seen by its camera ``side``.

    Args:
        angles: Joint angles by joint name, rad; zero where absent.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        table: The parameter table; the package's own where None.

    Returns:
        The picture (height, width, 3), 8 bits a channel.

    Raises:
        OutputError: No OpenGL is to be had for drawing without a screen.
    """
    import mujoco

    from mjhcmc.offscreen import Canvas

    model = build_leg8(table=table).compile()
    data = mujoco.MjData(model)
    for joint in JOINTS:
        data.joint(joint).qpos = (angles or {}).get(joint, 0.0)
    mujoco.mj_forward(model, data)
    with Canvas(model, width, height) as canvas:
        return canvas.picture(model, data, "side")


def main(arguments: list[str] | None = None) -> int:
    """Write a PNG of leg8 at rest and with bent knee; returns the exit code, 2 where it cannot be drawn."""
    from matplotlib.image import imsave

    parser = argparse.ArgumentParser(prog="python -m mjhcmc.leg8.render", description="Draw leg8, twice, as PNG.")
    parser.add_argument("path", type=Path, help="file to write")
    options = parser.parse_args(arguments)
    bent = {"hip": math.radians(25.0), "knee": math.radians(-50.0), "ankle": math.radians(-10.0)}
    try:
        picture = np.hstack([render_leg8(width=700), render_leg8(bent, width=700)])
    except OutputError as error:
        print(error, file=sys.stderr)
        return 2
    temporary = options.path.with_name(options.path.name + ".part")
    imsave(temporary, picture, format="png")
    temporary.replace(options.path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
