"""Names of `mjhcmc.offscreen`, where drawing without a window stands, for those who look for them here."""

import subprocess

from mjhcmc.offscreen import Canvas, display_answers, gl_back_end, has_display

__all__ = ["Canvas", "display_answers", "gl_back_end", "has_display", "subprocess"]
