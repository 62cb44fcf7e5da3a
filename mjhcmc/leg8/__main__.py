"""``python -m mjhcmc.leg8``: write leg8 and leg8_gait as MJCF files (see ``--help``)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mjhcmc.errors import MjhcmcError
from mjhcmc.leg8.builder import SOURCE_BODY_MASS, SOURCE_HEIGHT
from mjhcmc.leg8.xml import write_leg8, write_leg8_gait


def main(arguments: list[str] | None = None) -> int:
    """Write leg8, and leg8_gait beside it; returns the exit code, 2 on bad input."""
    what = "Write leg8 as an MJCF file, and beside it leg8_gait, the same leg on a moving pelvis."
    parser = argparse.ArgumentParser(prog="python -m mjhcmc.leg8", description=what)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("assets/leg8.xml"),
        help="file of leg8 (%(default)s); leg8_gait's has _gait before the suffix",
    )
    parser.add_argument("--mass", type=float, default=SOURCE_BODY_MASS, help="body mass, kg (%(default)s)")
    parser.add_argument("--height", type=float, default=SOURCE_HEIGHT, help="stature, m (%(default)s)")
    options = parser.parse_args(arguments)
    try:
        write_leg8(options.out, options.mass, options.height)
        gait = options.out.with_stem(options.out.stem + "_gait")
        write_leg8_gait(gait, options.mass, options.height)
    except MjhcmcError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"wrote {options.out} and {gait}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
