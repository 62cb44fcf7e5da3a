"""What stands on a picture: its title, the time, the scale of activation, what the ghost is."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.viewing.colours import activation_rgba
from mjhcmc.viewing.frames import Frames
from mjhcmc.viewing.scene import GHOST_RGBA

Image = NDArray[np.uint8]

HEAD, FOOT = 0.07, 0.11
"""Parts of a picture's height, at the top and at the bottom, that title and legend take."""

_DARK, _LIGHT = (32, 38, 46), (240, 243, 247)
_BAR_STEPS = 256
_EXACT = 1e-9  # deg and mm: less is rounding


class Legend:
    """Writes title, time and legend on pictures of one size.

    Args:
        width: pixels.
        height: pixels.
        title: at the top; left out where it is wider than the picture.
        speed: seconds of the motion for each second that is watched; told where it is not 1. None: a still.
        ghost: whether there is a ghost to explain.
        hidden: what to say of the desired pose where there is none.
    """

    def __init__(
        self, width: int, height: int, title: str, *, speed: float | None, ghost: bool, hidden: str = ""
    ) -> None:
        self._size = (width, height)
        self._title, self._ghost, self._hidden = title, ghost, hidden
        self._speed = "" if speed is None or speed == 1 else f"  × {speed:g}"
        self._unit = max(7, round(min(height / 34, width / 40)))  # height of letters

    def write_on(self, picture: Image, time: float) -> Image:
        """The picture (height, width, 3) with the legend; time is s, on the motion's clock."""
        from PIL import Image as Images
        from PIL import ImageDraw

        image = Images.fromarray(np.ascontiguousarray(picture))
        draw = ImageDraw.Draw(image)
        width, height = self._size
        u, font, small = self._unit, _font(self._unit), _font(max(7, round(0.72 * self._unit)))
        ink = _ink(picture[-max(1, int(FOOT * height)) :])
        middle = height - 1.6 * u
        left = 1.0 * u
        text = f"{time:.3f} s{self._speed}"
        draw.text((left, middle), text, font=font, fill=ink, anchor="lm")
        left += draw.textlength(text, font=font) + 2 * u
        right = self._scale(image, draw, width - 1.0 * u, middle, small, ink)
        if self._ghost or self._hidden:
            self._explain(image, draw, (left, right), middle, small, ink)
        if self._title and draw.textlength(self._title, font=small) < width - 2 * u:
            head = _ink(picture[: max(1, int(0.06 * height))])
            draw.text((u, 1.2 * u), self._title, font=small, fill=head, anchor="lm")
        return np.asarray(image)

    def _scale(self, image: Any, draw: Any, right: float, middle: float, font: Any, ink: Any) -> float:
        """The colours of activation from 0 to 1, ending at the right; gives where they begin, pixels."""
        from PIL import Image as Images

        u = self._unit
        bar, tall = int(7 * u), max(3, int(0.7 * u))
        draw.text((right, middle), "1", font=font, fill=ink, anchor="rm")
        right -= draw.textlength("1", font=font) + 0.4 * u
        strip = (255 * activation_rgba(np.linspace(0, 1, _BAR_STEPS))[None, :, :3]).round().astype(np.uint8)
        corner = (int(right - bar), int(middle - tall / 2))
        image.paste(Images.fromarray(strip).resize((bar, tall)), corner)
        draw.rectangle((corner[0] - 1, corner[1] - 1, corner[0] + bar, corner[1] + tall), outline=ink)
        left = corner[0] - 0.4 * u
        draw.text((left, middle), "activation  0", font=font, fill=ink, anchor="rm")
        return float(left - draw.textlength("activation  0", font=font))

    def _explain(self, image: Any, draw: Any, room: tuple[float, float], middle: float, font: Any, ink: Any) -> None:
        """A sample of the ghost and what it is, in the middle of the room there is; nothing where that is too small."""
        u, text = self._unit, "desired" if self._ghost else self._hidden
        sample = 1.5 * u if self._ghost else 0.0
        need = sample + draw.textlength(text, font=font)
        if need + 2 * u > room[1] - room[0]:
            return
        left = (room[0] + room[1] - need) / 2
        draw.text((left + sample, middle), text, font=font, fill=ink, anchor="lm")
        if not self._ghost:
            return
        box = (int(left), int(middle - 0.4 * u), int(left + u), int(middle + 0.4 * u))
        under = np.asarray(image.crop(box), dtype=float)
        alpha, colour = 1 - (1 - GHOST_RGBA[3]) ** 2, 255 * np.array(GHOST_RGBA[:3])  # its front and its back
        from PIL import Image as Images

        image.paste(Images.fromarray(((1 - alpha) * under + alpha * colour).astype(np.uint8)), box[:2])


def hidden_words(frames: Frames) -> str:
    """Of a desired pose that nowhere differs visibly: how far off it is."""
    turn, way = frames.largest_error
    off = [f"{value:.2g} {unit}" for value, unit in ((np.rad2deg(turn), "deg"), (1e3 * way, "mm")) if value > _EXACT]
    return f"desired: hidden, at most {' and '.join(off)} off" if off else "desired: the same pose"


def _ink(behind: Image) -> tuple[int, int, int]:
    """Dark letters on light, light ones on dark."""
    return _DARK if float(behind.mean()) > 110 else _LIGHT


@cache
def _font(size: int) -> Any:
    """DejaVu Sans, which matplotlib brings along."""
    from matplotlib import get_data_path
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)


def scale_image(unit: int = 16) -> Image:
    """(height, width, 3) the scale of activation by itself; unit: pixels, height of its letters."""
    from PIL import Image as Images
    from PIL import ImageDraw

    legend = Legend(40 * unit, 34 * unit, "", speed=None, ghost=False)
    image = Images.new("RGB", (16 * unit, 2 * unit), (246, 247, 249))
    legend._scale(image, ImageDraw.Draw(image), 15.5 * unit, unit, _font(unit), _DARK)
    return np.asarray(image)
