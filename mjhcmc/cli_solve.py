"""``mjhcmc solve``: from motion files, and whatever was measured beside them, to muscle excitations."""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from mjhcmc.cli_emg import emg_options, targets_from
from mjhcmc.cli_support import (
    CURVES,
    FILE,
    INTERRUPTED,
    MUSCLE,
    QUIET,
    VERBOSE,
    engine_notices,
    kept_notices,
    look_at,
    progress_bar,
    told,
    typed,
    write_solution,
)
from mjhcmc.errors import MjhcmcWarning, SettingsError
from mjhcmc.io.files import output_folder
from mjhcmc.methods import METHODS, find_method

if TYPE_CHECKING:
    from mjhcmc.external_loads import ExternalLoads
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion

_MODEL = "leg8"


@click.command()
@click.argument("motions", type=FILE, nargs=-1, required=True, metavar="MOTION...")
@click.option(
    "--model", metavar="MODEL", help=f"A shipped name or a path to an MJCF (.xml) or compiled (.mjb) file; {_MODEL}.",
)  # fmt: skip
@click.option(
    "--osim", type=FILE, metavar="FILE",
    help="A scaled OpenSim model: without --model, the leg is this subject's, on a pelvis that moves; with it, tells "
    "which bodies loads may be on.",
)  # fmt: skip
@click.option("--side", default="right", show_default=True, metavar="right|left", help="Which leg of --osim.")
@click.option("--moving-knee", is_flag=True, help="Let the knee's axis move as in --osim; else it is a fixed hinge.")
@click.option("--prescribe", multiple=True, metavar="JOINT", help="Move this joint along the motion; may be repeated.")
@click.option("--track", multiple=True, metavar="JOINT", help="Let muscles and residuals move this root joint.")
@click.option("--free", multiple=True, metavar="JOINT", help="Let this joint go as it will; may be repeated.")
@MUSCLE
@CURVES
@click.option("--method", default="hcmc", show_default=True, metavar="|".join(METHODS), help="What finds excitations.")
@click.option("--dt", default=0.01, show_default=True, help="Control window, s: excitation is constant over it.")
@click.option("--physics-dt", default=0.001, show_default=True, help="Largest physics step, s.")
@click.option(
    "--integrator", default="rk4", show_default=True, metavar="NAME", help="rk4, euler, implicit or implicitfast.",
)  # fmt: skip
@click.option("--lowpass", type=float, metavar="HZ", help="Zero-phase low-pass filter of the angles.")
@click.option("--resample", type=float, metavar="HZ", help="Put the motion on an even grid of that many rows a second.")
@click.option("--start", type=float, metavar="S", help="Begin here, on the file's clock.")
@click.option("--end", type=float, metavar="S", help="End here, on the file's clock.")
@click.option(
    "--map", "column_map", type=FILE, metavar="FILE",
    help='JSON: {"joint": "column"}, or a .csv of such pairs; a leading - on the column flips its sign.',
)  # fmt: skip
@click.option("--unit", metavar="deg|rad", help="Unit of the angles, where the file does not say.")
@click.option("--angles", default="joint", show_default=True, metavar="joint|segment", help="What the angles are of.")
@click.option("--loads", type=FILE, metavar="FILE", help="External loads: OpenSim's .xml, or a table with --loads-map.")
@click.option("--loads-data", type=FILE, metavar="FILE", help="The table of the loads, where the .xml names none.")
@click.option(
    "--loads-map", type=FILE, metavar="FILE", help='JSON: {"body": {"force": "ground_force_v", "point": ..}}.'
)
@click.option("--moments", type=FILE, metavar="FILE", help="Net joint moments to share, in place of inverse dynamics.")
@click.option("--cost", metavar="NAME", help="effort (a^2, the default), cubic, volume, stress or capacity.")
@click.option("--weights", type=FILE, metavar="FILE", help='JSON: {"muscle": weight}; more: does less.')
@click.option("--smoothness", type=float, metavar="W", help="Weight of changes of activation beside the cost.")
@click.option("--min-activation", type=float, metavar="A", help="Least activation of every muscle.")
@click.option("--disable", multiple=True, metavar="MUSCLE", help="Keep this muscle silent; may be repeated.")
@click.option(
    "--solver",
    default="newton",
    show_default=True,
    metavar="NAME",
    help="newton, or a qpsolvers back end (daqp, osqp ...).",
)
@emg_options
@click.option("--no-figures", is_flag=True, help="Write no figures, which take longer than most solves.")
@click.option("--opensim", is_flag=True, help="Write controls and states for OpenSim, too.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the summary.")
@QUIET
@VERBOSE
@click.option("--out", required=True, type=FILE, metavar="DIR", help="Folder for the results; then: mjhcmc report DIR.")
def solve(
    motions: tuple[Path, ...],
    model: str | None,
    osim: Path | None,
    side: str,
    moving_knee: bool,
    prescribe: tuple[str, ...],
    track: tuple[str, ...],
    free: tuple[str, ...],
    muscle: str,
    curves: str,
    method: str,
    dt: float,
    physics_dt: float,
    integrator: str,
    lowpass: float | None,
    resample: float | None,
    start: float | None,
    end: float | None,
    column_map: Path | None,
    unit: str | None,
    angles: str,
    loads: Path | None,
    loads_data: Path | None,
    loads_map: Path | None,
    moments: Path | None,
    cost: str | None,
    weights: Path | None,
    smoothness: float | None,
    min_activation: float | None,
    disable: tuple[str, ...],
    solver: str,
    emg: Path | None,
    emg_map: Path | None,
    emg_weight: float | None,
    emg_mvc: Path | None,
    emg_delay: float | None,
    no_figures: bool,
    opensim: bool,
    as_json: bool,
    quiet: bool,
    verbose: int,
    out: Path,
) -> int:
    """From motion files (.mot, .sto, .csv, .trc, .c3d) to muscle excitations.

    Writes DIR/solution.parquet, DIR/verdict.json, DIR/run.json and the figures (with --osim the model, too); of several
    motions, into a folder each in DIR. What to do next: mjhcmc report DIR.

    \b
    Examples:
      mjhcmc solve walk.mot --lowpass 6 --dt .005 --out walk
      mjhcmc solve q.sto --osim subject.osim --loads grf.xml --start .6 --end 1.9 --out walk
      mjhcmc solve arm.csv --unit deg --model arm.xml --map map.json --out arm
      mjhcmc solve one.mot two.mot --method cmc --json --out both
      mjhcmc report walk
    """
    from mjhcmc.integrators import scheme_of
    from mjhcmc.muscle_choice import check_muscle, plant_for

    find_method(method)
    check_muscle(muscle, curves)
    scheme_of(integrator)
    notices = click.get_current_context().with_resource(kept_notices(quiet))
    click.get_current_context().with_resource(told(verbose))
    import mjhcmc

    click.get_current_context().with_resource(engine_notices())
    spec = _subject(model, osim, side, moving_knee=moving_knee)
    chosen = click.get_current_context().get_parameter_source("integrator") is not ParameterSource.DEFAULT
    muscle_model = mjhcmc.MuscleModel.load(model or spec or _MODEL, integrator=integrator if chosen else None)
    if prescribe or track or free:
        muscle_model = muscle_model.with_roles(tracked=track, prescribed=prescribe, free=free)
    read = mjhcmc.Motion.from_files(
        motions, muscle_model, lowpass, column_map=column_map, start=start, end=end, angle_unit=unit,  # type: ignore[arg-type]
        angles=angles,  # type: ignore[arg-type]
    )  # fmt: skip
    for motion in read:
        noise = motion.noise_warning() if lowpass is None else None
        _tell([*motion.notices, *([noise] if noise else [])], motion.name if len(read) > 1 else "")
    if resample is not None:
        read = [motion.resampled(resample) for motion in read]
    options: dict[str, Any] = {
        "dt": dt, "physics_dt": physics_dt, "integrator": integrator, "solver": solver, "disabled": disable,
    }  # fmt: skip
    shares = {"cost": cost, "smoothness": smoothness, "min_activation": min_activation}
    options |= {name: value for name, value in shares.items() if value is not None}
    options["plant"] = plant_for(muscle_model, muscle, dt, physics_dt, curves)
    if weights is not None:
        options["weights"] = _read_weights(weights)
    if moments is not None:
        options["joint_moments"] = mjhcmc.JointMoments.from_file(moments, muscle_model, column_map)
        for motion in read:
            options["joint_moments"].check_covers(motion, muscle_model)
    options["loads"] = _read_loads(loads, loads_data, loads_map, osim, muscle_model, read)
    targets = targets_from(emg, emg_map, emg_weight, emg_mvc, emg_delay, muscle_model.muscle_names)
    if targets is not None:
        options["emg"] = targets
        for motion in read:
            targets.check_covers(motion)
    if opensim:
        from mjhcmc.io.export import check_names

        check_names(muscle_model)
    from mjhcmc.run_facts import input_facts

    shared = _input_files(click.get_current_context().params)
    with output_folder(out) as folder:
        results = {}
        for motion, file in zip(read, motions, strict=True):
            place = folder if len(read) == 1 else folder / motion.name
            inputs = tuple(input_facts([("motion", file), *shared]))
            origin = _Origin(model or _MODEL, None if model else spec, inputs, notices)
            results[motion.name] = _solve_one(
                method, muscle_model, motion, options, place, origin, opensim=opensim, draw=not no_figures,
                as_json=as_json, quiet=quiet,
            )  # fmt: skip
            if results[motion.name]["interrupted"]:
                break
    if as_json:
        click.echo(json.dumps(next(iter(results.values())) if len(read) == 1 else {"motions": results}))
    elif not quiet:
        click.echo(look_at(place if len(read) == 1 else out / next(iter(results))))
    if any(result["interrupted"] for result in results.values()):
        return INTERRUPTED
    return 0 if all(result["verdict"]["passed"] for result in results.values()) else 1


def _subject(model: str | None, osim: Path | None, side: str, *, moving_knee: bool) -> Any:
    """The subject's leg, where there is to be one."""
    if side not in ("right", "left"):
        raise SettingsError(f"--side {side!r}: choose right or left")
    if osim is None or model is not None:
        if moving_knee or side != "right":
            raise SettingsError("--side and --moving-knee are of the leg that --osim makes: give --osim, no --model")
        return None
    from mjhcmc.leg8 import leg8_from_osim

    return leg8_from_osim(osim, side=side, moving_knee=moving_knee)


def _tell(notices: Sequence[str], of: str = "") -> None:
    for notice in notices:
        warnings.warn(f"{of}: {notice}" if of else notice, MjhcmcWarning, stacklevel=2)


def _read_loads(
    path: Path | None,
    data: Path | None,
    column_map: Path | None,
    osim: Path | None,
    model: MuscleModel,
    motions: Sequence[Motion],
) -> ExternalLoads | None:
    """The loads, where there are any; that they cover the motions is checked."""
    if path is None:
        if data is not None or column_map is not None:
            raise SettingsError("--loads-data and --loads-map are of loads: give --loads, too")
        return None
    from mjhcmc.external_loads import ExternalLoads

    loads = ExternalLoads.from_file(path, model, data=data, column_map=column_map, osim=osim)
    for motion in motions:
        loads.check_covers(motion)
    _tell(loads.notices)
    return loads


@dataclass(frozen=True)
class _Origin:
    """What a solve was read from.

    Attributes:
        model: a shipped name or a path, where spec is None.
        spec: of the subject's leg, where ``--osim`` makes it.
        inputs: the other files, see `run_facts.input_facts`.
        notices: what was noticed so far; of several motions, those of all.
    """

    model: str
    spec: Any
    inputs: tuple[dict[str, Any], ...]
    notices: list[str]


def _input_files(options: Mapping[str, Any]) -> list[tuple[str, Path]]:
    """The files that options name, and the table that a file of loads names."""
    files = [
        ("map" if name == "column_map" else name.replace("_", " "), value)
        for name, value in options.items()
        if isinstance(value, Path) and name != "out"
    ]
    loads = options["loads"]
    if loads is not None and options["loads_data"] is None and loads.suffix.lower() == ".xml":
        from mjhcmc.io.loads_file import loads_table
        from mjhcmc.io.opensim_loads import read_loads_xml

        files.append(("loads data", loads_table(read_loads_xml(loads), None, [])))
    return files


def _solve_one(
    method: str,
    model: MuscleModel,
    motion: Motion,
    options: Mapping[str, Any],
    place: Path,
    origin: _Origin,
    *,
    opensim: bool,
    draw: bool,
    as_json: bool,
    quiet: bool,
) -> dict[str, Any]:
    """Solve one motion into a folder; what --json prints of it."""
    import mjhcmc
    from mjhcmc.run_facts import model_facts, run_facts, write_run
    from mjhcmc.summary import numbers, screen

    interrupted = False
    with output_folder(place) as folder:
        try:
            with progress_bar(quiet or as_json) as progress:
                began = time.perf_counter()
                solution = find_method(method)(model, motion, progress=progress, **options)
        except mjhcmc.SolveInterrupted as stop:
            if stop.solution is None:
                raise
            solution, interrupted = stop.solution, True
        wall_time = time.perf_counter() - began
        files = write_solution(solution, folder, opensim=opensim, draw=draw)
        driven = model_facts(model, origin.model) if origin.spec is None else None
        if driven is None:
            files.append(_write_model(origin.spec, folder))
            path = folder / "model.xml"  # read back: what is written in decimals may compile to other last digits
            driven = model_facts(mjhcmc.MuscleModel.load(path, integrator=solution.integrator), path, in_folder=True)
        facts = run_facts(
            command=typed(), model=driven, inputs=origin.inputs, solution=folder / "solution.parquet",
            wall_time=wall_time, interrupted=interrupted, notices=origin.notices,
        )  # fmt: skip
        files.append(write_run(folder, facts))
    if not (as_json or quiet):
        click.echo(screen(solution))
        click.echo(f"written  {', '.join(files)}")
    return {**numbers(solution), "settings": solution.settings, "interrupted": interrupted, "files": files}


def _write_model(spec: Any, folder: Path) -> str:
    """Write the subject's model beside its solution; returns the path."""
    from mjhcmc.io.files import written_whole

    path = folder / "model.xml"
    with written_whole(path) as temporary:
        temporary.write_text(spec.to_xml(), encoding="utf-8")
    return str(path)


def _read_weights(path: Path) -> dict[str, float]:
    """Weights by muscle from a JSON file; names and ranges are checked against the model later."""
    from mjhcmc.checks import is_number

    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise SettingsError(f"weights {path}: cannot be read ({error.strerror}): check the path") from None
    except ValueError as error:
        raise SettingsError(f'weights {path}: not JSON ({error}): give {{"muscle": weight}}') from None
    if not isinstance(content, dict):
        raise SettingsError(f'weights {path}: holds no object: give {{"muscle": weight}}')
    for name, value in content.items():
        if not is_number(value):
            told = json.dumps(value)
            told = told if len(told) <= 40 else f"{told[:37]}..."
            raise SettingsError(f"weights {path}: that of {name} is {told}, no number: give a positive one")
    return content
