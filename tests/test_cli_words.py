"""What the command line says: the library's messages in terms of options, and MuJoCo's warnings once each."""

import warnings

import mujoco
import numpy as np
import pytest

from mjhcmc.cli import cli
from mjhcmc.cli_support import engine_notices, in_options
from mjhcmc.errors import MjhcmcWarning
from mjhcmc.io.trc import write_trc


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("name the column 'hip (deg)', or give angle_unit", "name the column 'hip (deg)', or give --unit"),
        ("angle_unit says deg: leave angle_unit out", "--unit says deg: leave --unit out"),
        ("angles 'euler': choose 'joint'", "--angles 'euler': choose 'joint'"),
        ("use physics_dt <= 0.0005, or filter", "use --physics-dt <= 0.0005, or filter"),
        ("dt 0.01 s is longer: choose a smaller dt", "--dt 0.01 s is longer: choose a smaller --dt"),
        ("dt must be positive; got -1.0", "--dt must be positive; got -1.0"),
        ("min_activation of vasti must be at least 0", "--min-activation of vasti must be at least 0"),
        ("smoothness must be 0 or positive", "--smoothness must be 0 or positive"),
        ("weights of vasti must be positive", "--weights of vasti must be positive"),
        ("disabled: model 'leg8' has no muscle 'x'", "--disable: model 'leg8' has no muscle 'x'"),
        ("disabled names every muscle", "--disable names every muscle"),
        ("muscles that are to do nothing in disabled", "muscles that are to do nothing in --disable"),
        ("w.mot: start 5 s lies outside the file's times", "w.mot: --start 5 s lies outside the file's times"),
        ("start 2 s is not before end -1e-05 s: choose a later end", "--start 2 s is not before --end -1e-05 s: choose "
         "a later end"),
        ("crop it away with start and end", "crop it away with --start and --end"),
        ("name one with a column map", "name one with a column map (--map)"),
        ("initial_qpos: joint knee is at 20 deg", "the start of the motion: joint knee is at 20 deg"),
    ],
)  # fmt: skip
def test_arguments_are_named_as_options(message, shown):
    assert in_options(message) == shown
    assert in_options(shown) == shown


@pytest.mark.parametrize(
    "message",
    [
        "runs/angle_unit/physics_dt.mot: no rows after the column names",
        r"C:\dt\physics_dt.csv: not a text file",
        "column 'dt': 'min_activation' is not a number",
        "my_physics_dt and physics_dts, joint_moments_2",
        "muscle vasti_disabled, actuator disabled_1, is disabled by the model's options",
        "the joint angles need at least 3 markers; angles in degrees; the start of the file; a tab or line end: rename",
        "column map: model leg8 has no joint x",
    ],
)
def test_what_users_name_is_left_alone(message):
    assert in_options(message) == message


def test_every_option_named_is_one_of_solve():
    options = {name for parameter in cli.commands["solve"].params for name in parameter.opts}
    from mjhcmc.cli_support import _IN_OPTIONS

    named = {word.strip("()") for _, option in _IN_OPTIONS for word in option.split() if word.strip("()")[:2] == "--"}
    named = {
        each
        for word in named
        for each in (["--start", "--end", "--smoothness", "--weights"] if "\\" in word else [word])
    }
    assert len(named) > 10
    assert named <= options


# --- through the commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--unit", "grad"], "error: --unit 'grad': choose"),
        (["--angles", "euler"], "error: --angles 'euler': choose"),
        (["--min-activation", "1.5"], "error: --min-activation of iliopsoas must be"),
        (["--disable", "biceps"], "error: --disable: model 'leg8' has no muscle 'biceps'"),
        (["--physics-dt", "-1"], "error: --physics-dt"),
        (["--start", "9"], ": --start 9 s lies outside"),
        (["--start", ".4", "--end", ".2"], ": --start 0.4 s is not before --end 0.2 s"),
    ],
)
def test_errors_name_options(run, mot, tmp_path, arguments, words):
    outcome = run("solve", mot(), *arguments, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert len(outcome.errors) == 1
    assert words in outcome.errors[0]


def test_markers_take_no_unit(run, tmp_path):
    path = tmp_path / "walk.trc"
    write_trc(path, ["a"], np.arange(4) / 100, np.zeros((4, 1, 3)))
    outcome = run("solve", path, "--unit", "deg", "--angles", "segment", "--out", tmp_path / "out")
    assert outcome.code == 2
    assert outcome.errors[0].endswith("holds markers, not angles: leave out --unit 'deg' and --angles 'segment'")


def test_notices_name_options(run, mot, tmp_path, no_figures):
    outcome = run("solve", mot(), "--dt", "0.007", "--json", "--out", tmp_path / "out")
    assert outcome.code in (0, 1)
    assert [notice for notice in outcome.notices if "--dt 0.007 s does not divide" in notice]


# --- MuJoCo's warnings ----------------------------------------------------------------------------------------


def told(*texts):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with engine_notices():
            show = mujoco.get_mju_user_warning()
            for text in texts:
                show(text)
    assert all(issubclass(each.category, MjhcmcWarning) for each in caught)
    return [str(each.message) for each in caught]


def test_mujoco_warns_once_of_a_kind():
    unstable = "Nan, Inf or huge value in {} at DOF {}. The simulation is unstable. Time = {}."
    said = [unstable.format(what, i, 0.685 + i) for i in range(3) for what in ("QVEL", "QACC", "QPOS")]
    assert told(*said) == [f"MuJoCo: {said[0]}"]
    assert told("Contact buffer is full at 100", said[1], "Contact buffer is full at 200", said[0]) == [
        "MuJoCo: Contact buffer is full at 100",
        f"MuJoCo: {said[1]}",
    ]


def test_mujoco_warns_a_few_times_at_most():
    assert told(*(f"warning {letter} of a kind" for letter in "abcdefghij")) == [
        f"MuJoCo: warning {letter} of a kind" for letter in "abcde"
    ]


def test_an_instability_in_mujoco_is_one_notice():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint type="slide"/><geom size="1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with engine_notices():
            for _ in range(3):
                data.qvel[:] = np.nan
                mujoco.mj_step(model, data)
                data.qpos[:] = np.nan
                mujoco.mj_step(model, data)
    assert len(caught) == 1
    assert "MuJoCo: Nan, Inf or huge value" in str(caught[0].message)
