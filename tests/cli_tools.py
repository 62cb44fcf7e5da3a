"""What the tests of the command line share; the fixtures reach them through conftest."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from matplotlib.figure import Figure

import mjhcmc
from mjhcmc import verify
from mjhcmc.cli import main
from mjhcmc.io.opensim import write_table

MUSCLES = ("iliopsoas", "glut_max", "rect_fem", "hamstrings", "vasti", "gastroc", "soleus", "tib_ant")
JOINTS = ("hip", "knee", "ankle")
FIGURES = tuple(f"{name}.{kind}" for name in ("excitations", "tracking", "moments") for kind in ("png", "pdf"))
FILES = ("solution.parquet", "verdict.json", "run.json", *FIGURES)  # that solve writes of leg8
COLUMNS = ("pelvis_tx", "knee", "hip", "ankle")  # not the model's order, and one too many
FIRST_ROW = 8  # line of the first row of a table that write_table wrote
LONG = "x" * 300


@dataclasses.dataclass
class Outcome:
    code: int
    out: str
    err: str

    @property
    def notices(self) -> list[str]:
        return [line for line in self.err.splitlines() if line.startswith("mjhcmc: notice: ")]

    @property
    def errors(self) -> list[str]:
        return [line for line in self.err.splitlines() if not line.startswith("mjhcmc: notice: ")]


@pytest.fixture
def run(capfd):
    """Run the command line in this process; what C code prints is seen too."""

    def run(*arguments) -> Outcome:
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        return Outcome(stop.value.code, out, err)

    return run


@pytest.fixture
def no_figures(monkeypatch):
    """Leave the figures out where a test is not about them: they take a second."""
    for name in ("excitation_figure", "tracking_figure", "moment_figure", "residual_figure"):
        monkeypatch.setattr(f"mjhcmc.plotting.{name}", lambda solution, overlay=None: None)
    monkeypatch.setattr("mjhcmc.plotting.save_figures", lambda figures, folder: [])


@pytest.fixture
def coarse_figures(monkeypatch):
    """Figures of few pixels, where a test is not about how they look."""
    monkeypatch.setattr("mjhcmc.plotting.figures._PNG_DPI", 40)


@pytest.fixture
def blank_figures(monkeypatch):
    """Figures with nothing on them, where a test is about which files are written."""
    for name in ("excitation_figure", "tracking_figure", "moment_figure", "residual_figure"):
        monkeypatch.setattr(f"mjhcmc.plotting.{name}", lambda solution, overlay=None: Figure(figsize=(1, 1)))


@pytest.fixture
def timed_once(monkeypatch):
    """`reproduce` times each method by one call, not by five, where a test is not about the times."""
    monkeypatch.setattr("mjhcmc.reproduce._TIMED_CALLS", 1)


@pytest.fixture
def coarse_replay(monkeypatch):
    """Verdicts replay in physics steps of 1 ms, not .1 ms, where a test is not about what replay shows."""
    for name in ("replay", "replay_windows"):
        getattr(mjhcmc, name)  # which the package keeps once it is asked for: not this one
        monkeypatch.setattr(verify, name, partial(getattr(verify, name), physics_dt=1e-3))


@pytest.fixture
def mot(tmp_path, leg8):
    """Write a motion file: cycles of a cosine movement of the leg, 5 ms a row; edit changes its lines."""

    def write(name="walk.mot", *, edit=None, movement="slow", cycles=1, factor=1.0, start=0.0, amplitudes=None, **more):
        amplitudes = amplitudes or dict(zip(JOINTS, np.deg2rad([10, -20, -10]), strict=True))
        period = more.pop("period", {"slow": 0.6, "fast": 0.2}[movement])
        motion = mjhcmc.Motion.cosine(leg8, amplitudes=amplitudes, period=period, cycles=cycles)
        rows = np.linspace(0, motion.end, round(motion.end / 0.005) + 1)
        hip, knee, ankle = factor * np.rad2deg(motion.sample(rows).qpos).T
        path = tmp_path / name
        columns = more.pop("columns", COLUMNS)
        values = np.column_stack([rows, knee, hip, ankle])
        write_table(path, columns, start + rows, values, name="a walk", in_degrees=more.pop("in_degrees", True))
        if edit is not None:
            lines = path.read_text().splitlines()
            edit(lines)
            path.write_text("\n".join(lines) + "\n")
        return path

    return write


def put(row, column, text):
    """An edit: this text at a row (from 0) and column (time is 0)."""

    def edit(lines):
        cells = lines[FIRST_ROW - 1 + row].split("\t")
        cells[column] = text
        lines[FIRST_ROW - 1 + row] = "\t".join(cells)

    return edit


def replaced(old, new):
    """An edit: new for old in every line."""

    def edit(lines):
        lines[:] = [line.replace(old, new) for line in lines]

    return edit
