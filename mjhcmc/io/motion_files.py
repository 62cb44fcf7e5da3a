"""Several motions at once: all read before any work begins, each under a name of its own."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.io.columns import listed
from mjhcmc.io.motion_file import check_options, read_motion
from mjhcmc.motion import JointModel, Motion


def read_motions(
    paths: Iterable[str | os.PathLike[str]],
    model: JointModel,
    lowpass_hz: float | None = None,
    *,
    column_map: Mapping[str, str] | str | os.PathLike[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    angle_unit: str | None = None,
    angles: str = "joint",
) -> list[Motion]:
    """Read several motions: see Motion.from_files, which this is."""
    if isinstance(paths, (str, os.PathLike)):
        raise SettingsError(f"from_files takes a list of paths, not one path: write [{os.fspath(paths)!r}]")
    files = [Path(path) for path in paths]
    if not files:
        raise MotionError("no motion files: name at least one")
    check_options(lowpass_hz, angle_unit, angles)
    names = _names(files)
    motions, bad = [], []
    for path, name in zip(files, names, strict=True):
        try:
            motions.append(
                read_motion(
                    path, model, lowpass_hz, column_map=column_map, start=start, end=end, angle_unit=angle_unit,
                    angles=angles, name=name,
                )
            )  # fmt: skip
        except MotionError as error:
            bad.append((path, error))
    if bad:
        first = bad[0][1]
        others = [str(path) for path, _ in bad[1:]]
        more = f"; {len(others)} more of the {len(files)} files cannot be used: {listed(others)}" if others else ""
        raise MotionError(f"{first}{more}") from first
    return motions


def _names(files: list[Path]) -> list[str]:
    """Stems, with as many folders in front as make them differ, and the suffix behind within one folder."""
    resolved = [path.resolve() for path in files]
    for i, path in enumerate(resolved):
        if path in resolved[:i]:
            raise MotionError(f"{files[i]}: given twice: name each file once")

    folders, endings = [0] * len(files), [""] * len(files)
    while True:
        names = [
            "_".join((*path.parent.parts[len(path.parent.parts) - count :], path.stem)) + ending
            for path, count, ending in zip(resolved, folders, endings, strict=True)
        ]
        alike: dict[str, list[int]] = {}
        for i, name in enumerate(names):
            alike.setdefault(name.casefold(), []).append(i)
        groups = [group for group in alike.values() if len(group) > 1]
        if not groups:
            return names
        for group in groups:
            apart = len({resolved[i].parent for i in group}) > 1
            for place, i in enumerate(group, 1):
                if apart and folders[i] < len(resolved[i].parent.parts) - 1:
                    folders[i] += 1
                elif not endings[i]:
                    endings[i] = f"_{resolved[i].suffix[1:]}"
                else:  # only the letters' case differs
                    endings[i] += f"_{place}"
