"""The picture of leg8: at rest, and with bent knee. It needs OpenGL (MUJOCO_GL=egl or osmesa without a screen).

python benchmarks/leg8_picture.py [--write [FILE]]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mujoco
import numpy as np
from _markdown import ROOT

from mjhcmc.io.files import written_whole

PICTURE = ROOT / "docs" / "leg8.png"
POSES = ((0.0, 0.0, 0.0), (25.0, -55.0, -15.0))  # deg: hip, knee, ankle
SIZE = 1200, 700  # pixels: height, width of a pose


def picture() -> np.ndarray:
    """The poses side by side, seen from the right: (height, width, 3) bytes."""
    model = mujoco.MjModel.from_xml_path(str(ROOT / "assets" / "leg8.xml"))
    model.vis.global_.offheight, model.vis.global_.offwidth = SIZE
    model.vis.headlight.ambient[:] = 0.45
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.distance = 90, -8, 1.5
    option = mujoco.MjvOption()
    views = []
    with mujoco.Renderer(model, *SIZE) as renderer:
        for pose in POSES:
            data.qpos[:] = np.deg2rad(pose)
            mujoco.mj_forward(model, data)
            if not views:
                camera.lookat[:] = -0.05, 0, (data.geom_xpos[:, 2].max() + data.geom_xpos[:, 2].min()) / 2
            renderer.update_scene(data, camera, option)
            views.append(renderer.render().copy())
    return np.hstack(views)


def main() -> None:
    parser = argparse.ArgumentParser(prog="leg8_picture.py", description="The picture of leg8.")
    parser.add_argument("--write", type=Path, nargs="?", const=PICTURE, metavar="FILE", help="where to (docs/leg8.png)")
    path = parser.parse_args().write
    pixels = picture()
    print(f"{pixels.shape[1]} x {pixels.shape[0]} pixels")
    if path:
        from matplotlib.image import imsave

        with written_whole(path) as temporary:
            imsave(temporary, pixels, format="png")


if __name__ == "__main__":
    main()
