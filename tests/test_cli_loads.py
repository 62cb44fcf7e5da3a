"""``mjhcmc solve`` with loads, roles and a subject's leg: what it does, and what it refuses before any work begins."""

import json
from pathlib import Path

import numpy as np
import pytest

import mjhcmc
from mjhcmc.io.opensim import write_table

pytestmark = pytest.mark.usefixtures("coarse_replay")

WALK = Path(__file__).resolve().parents[2] / "shared" / "walk"
walk_only = pytest.mark.skipif(not WALK.is_dir(), reason="the measured walk (shared/walk) is not beside the checkout")
SWING = {"hip": 0.3, "knee": -0.5, "ankle": 0.1, "pelvis_ty": 0.02, "pelvis_tilt": 0.05}
AXES = "xyz"


@pytest.fixture(scope="module")
def gait():
    return mjhcmc.MuscleModel.load("leg8_gait")


@pytest.fixture
def gait_files(tmp_path, gait):
    """A made-up walk, a push on the foot that comes and goes, and the map that tells which columns it is in."""

    def write(*, until=1.0, height=0.05, force=(20.0, 300.0, 0.0), drop=None):
        motion = mjhcmc.Motion.cosine(gait, amplitudes=SWING, period=1.0, cycles=1)
        motion.save(tmp_path / "walk.mot", gait)
        time = np.linspace(0.0, until, 101)
        push = np.sin(np.pi * np.clip(time, 0, 1)) ** 2
        columns = {f"f_v{a}": c * push for a, c in zip(AXES, force, strict=True)}
        columns |= {f"f_p{a}": np.full(101, c) for a, c in zip(AXES, (0.05, height, 0.08), strict=True)}
        columns |= {f"f_t{a}": np.zeros(101) for a in AXES}
        columns.pop(drop, None)
        rows = np.column_stack(list(columns.values()))
        write_table(tmp_path / "push.mot", list(columns), time, rows, name="push", in_degrees=False)
        entry = {"calcn_r": {"force": "f_v", "point": "f_p", "torque": "f_t"}}
        (tmp_path / "map.json").write_text(json.dumps(entry))
        return [tmp_path / "walk.mot", "--loads", tmp_path / "push.mot", "--loads-map", tmp_path / "map.json"]

    return write


@pytest.mark.usefixtures("no_figures")
def test_loads_act_and_the_pelvis_is_led(run, gait_files, tmp_path):
    out = tmp_path / "out"
    given = run("solve", *gait_files(), "--model", "leg8_gait", "--json", "--out", out)
    assert given.code in (0, 1), given.err
    numbers = json.loads(given.out)
    assert max(numbers["max_error_deg"][j] for j in ("hip", "knee", "ankle")) < 0.2
    assert max(numbers["max_error_deg"][j] for j in ("pelvis_tx", "pelvis_ty")) < 1e-9
    # the push, of 300 N, is borne by the pelvis but for the leg's own weight and inertia
    assert numbers["peak_external_load_nm"]["pelvis_ty"] == pytest.approx(300, rel=1e-3)
    assert numbers["peak_residual_nm"]["pelvis_ty"] > 100
    without = run("solve", gait_files()[0], "--model", "leg8_gait", "--json", "--out", tmp_path / "other")
    assert json.loads(without.out)["peak_external_load_nm"] is None


@pytest.mark.usefixtures("no_figures")
def test_roles_are_chosen_by_name(run, gait_files, tmp_path):
    walk = gait_files()[0]
    out = tmp_path / "out"
    assert run("solve", walk, "--model", "leg8_gait", "--track", "pelvis_tilt", "--out", out, "--quiet").code in (0, 1)
    solution = mjhcmc.Solution.load(out / "solution.parquet")
    assert dict(zip(solution.dof_names, solution.roles, strict=True))["pelvis_tilt"] == "tracked"
    assert np.abs(solution.residual[:, solution.dof_names.index("pelvis_tilt")]).max() > 1
    wrong = run("solve", walk, "--model", "leg8_gait", "--prescribe", "pelvis", "--out", tmp_path / "no")
    assert wrong.code == 2
    assert "no joint 'pelvis'" in wrong.errors[0]
    assert "pelvis_tilt" in wrong.errors[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"until": 0.6}, ("0.6", "motion")),
        ({"drop": "f_vy"}, ("the force of load", "f_v")),
    ],
)
def test_loads_that_do_not_do_are_named_first(run, gait_files, tmp_path, change, words):
    wrong = run("solve", *gait_files(**change), "--model", "leg8_gait", "--out", tmp_path / "out")
    assert wrong.code == 2
    assert len(wrong.errors) == 1
    assert all(word in wrong.errors[0] for word in words), wrong.errors
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("no_figures")
def test_a_foot_in_the_air_that_carries_load_is_pointed_out(run, gait_files, tmp_path):
    given = run("solve", *gait_files(height=-0.6), "--model", "leg8_gait", "--end", ".3", "--out", tmp_path / "out")
    assert any("frame" in line for line in given.notices), given.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--side", "middle"), "right or left"),
        (("--side", "left"), "--osim"),
        (("--moving-knee",), "--osim"),
        (("--loads-map", "map.json"), "--loads"),
        (("--osim", "nothing.osim"), "nothing.osim"),
        (("--loads", "nothing.xml"), "nothing.xml"),
    ],
)
def test_options_that_do_not_go_together(run, mot, tmp_path, options, words):
    wrong = run("solve", mot(), *options, "--out", tmp_path / "out")
    assert wrong.code == 2
    assert len(wrong.errors) == 1
    assert words in wrong.errors[0]
    assert not (tmp_path / "out").exists()


@walk_only
@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(("side", "foot"), [("right", "calcn_l"), ("left", "calcn_r")])
def test_a_subjects_leg_and_ground_reaction(run, tmp_path, side, foot):
    out = tmp_path / "out"
    given = run(
        "solve", WALK / "subject_adjusted_Kinematics_q.sto", "--loads", WALK / "subject01_walk_grf.xml", "--osim",
        WALK / "subject01.osim", "--start", "0.6", "--end", "1.0", "--dt", "0.01", "--min-activation", "0.02", "--side",
        side, "--json", "--out", out,
    )  # fmt: skip
    assert given.code == 0, given.err
    assert any(foot in line for line in given.notices)  # the other side is listed, not silently gone
    numbers = json.loads(given.out)
    assert max(numbers["max_error_deg"].values()) < 0.1
    again = mjhcmc.MuscleModel.load(out / "model.xml")  # the subject's leg is written beside its solution
    assert again.muscle_names == tuple(numbers["peak_excitation"])
    assert mjhcmc.Solution.load(out / "solution.parquet", model=again).time[0] == pytest.approx(0.6)


@walk_only
def test_a_body_in_neither_model_is_an_error(run, tmp_path):
    text = (WALK / "subject01_walk_grf.xml").read_text().replace("calcn_r", "shoe_r")
    (tmp_path / "grf.xml").write_text(text)
    wrong = run(
        "solve", WALK / "subject_adjusted_Kinematics_q.sto", "--loads", tmp_path / "grf.xml", "--loads-data",
        WALK / "subject01_walk_grf.mot", "--osim", WALK / "subject01.osim", "--start", ".6", "--end", "1", "--out",
        tmp_path / "out",
    )  # fmt: skip
    assert wrong.code == 2
    assert "shoe_r" in wrong.errors[0]
    assert not (tmp_path / "out").exists()
