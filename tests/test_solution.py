"""Solution: shapes, table, files that come back bit for bit, messages; nothing half-written, nothing misread."""

import dataclasses
import json
import os
import resource
import stat
from contextlib import contextmanager

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import mjhcmc
from mjhcmc.io.opensim import read_table
from mjhcmc.solution import moment_scale

MUSCLES = ("iliopsoas", "glut_max", "rect_fem", "hamstrings", "vasti", "gastroc", "soleus", "tib_ant")
JOINTS = ("hip", "knee", "ankle")
SUFFIXES = (".parquet", ".csv", ".sto", ".nc")
ARRAYS = [
    item.name
    for item in dataclasses.fields(mjhcmc.Solution)
    if item.type.startswith("NDArray") and not item.type.endswith("None")
]


@pytest.fixture(scope="module")
def solution(leg8, fast):
    """Fast, moved to begin at .6 s."""
    return mjhcmc.hcmc(leg8, mjhcmc.Motion(fast.time + 0.6, fast.qpos, name="late"))


@pytest.fixture(scope="module")
def overloaded(linear_mass):
    """A slide whose muscle is too weak: reserves, flags, a failing verdict."""
    return mjhcmc.hcmc(
        linear_mass, mjhcmc.Motion.cosine(linear_mass, amplitudes={"height": 0.2}, period=0.25, cycles=1)
    )


# --- the contract -----------------------------------------------------------------------------------------------


def test_n_windows_between_n_plus_1_nodes(solution):
    n, m, v = 60, 8, 3
    shapes = {
        "time": (n + 1,), "excitation": (n, m), "activation": (n + 1, m), "qpos": (n + 1, v),
        "qpos_desired": (n + 1, v), "qvel": (n + 1, v), "tracking_error": (n + 1, v), "net_joint_moment": (n + 1, v),
        "muscle_force": (n + 1, m), "reserve": (n, v), "shortfall": (n, v), "status": (n,), "dof_is_rotation": (v,),
        "external_load": (n + 1, v), "residual": (n + 1, v),
    }  # fmt: skip
    assert {name: getattr(solution, name).shape for name in ARRAYS} == shapes
    assert solution.n_window == n
    assert solution.dt == 0.01
    assert solution.muscle_names == MUSCLES
    assert solution.dof_names == JOINTS
    assert solution.excitation.min() >= 0
    assert solution.excitation.max() <= 1
    assert not solution.interrupted
    np.testing.assert_array_equal(solution.tracking_error, solution.qpos - solution.qpos_desired)
    np.testing.assert_array_equal(solution.peak_moment, np.abs(solution.net_joint_moment).max(axis=0))
    for key, value in {"method": "hcmc", "model": "leg8", "motion": "late", "dt": 0.01, "physics_dt": 0.001}.items():
        assert solution.settings[key] == value


def test_time_is_the_motions_own_clock(solution):
    np.testing.assert_allclose(solution.time, 0.6 + 0.01 * np.arange(61), rtol=0, atol=1e-12)
    assert solution.time[0] == 0.6


def test_the_clock_changes_nothing_else(solution, fast_solution):
    np.testing.assert_allclose(solution.excitation, fast_solution.excitation, atol=1e-6)
    np.testing.assert_allclose(solution.qpos, fast_solution.qpos, atol=1e-8)


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_are_read_only(solution, name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(solution, name)[0] = 0


@pytest.mark.parametrize("name", ["time", "excitation", "activation", "reserve", "muscle_force", "status"])
def test_arrays_that_do_not_fit_are_refused(solution, name):
    with pytest.raises(mjhcmc.OutputError, match=r"has shape .*, expected"):
        dataclasses.replace(solution, **{name: getattr(solution, name)[:-1].copy()})


def test_at_the_prompt_it_is_one_line(fast_solution):
    """And the verdict, which takes a replay, is told only once it is known."""
    fresh = dataclasses.replace(fast_solution)
    about = "Solution(hcmc, 60 windows from 0 to 0.6 s, 8 muscles, 3 degrees of freedom"
    assert repr(fresh) == f"{about})"
    assert "verdict" not in vars(fresh)
    assert repr(fresh.verdict).startswith("Verdict(holds: peak reserve at most ")
    assert "\n" not in repr(fresh.verdict)
    assert repr(fresh) == f"{about}, verdict holds)"


def test_the_verdict_is_computed_once(solution):
    assert solution.verdict is solution.verdict


@pytest.mark.parametrize("weak", [0.0, 1e-3, 0.02, 1.0])
def test_a_reserve_is_measured_by_its_own_joints_peak(weak):
    moment = np.array([[3.0, weak], [-50.0, 0.0]])
    np.testing.assert_allclose(moment_scale(moment), [50.0, max(weak, 1e-3)])


# --- the table --------------------------------------------------------------------------------------------------


def test_the_table_has_a_row_a_node_and_the_documented_columns(solution):
    table = solution.to_dataframe()
    dof = ["q", "q_desired", "qvel", "moment", "reserve", "shortfall"]
    muscle = ["excitation", "activation", "force"]
    expected = {"time", "status"} | {f"{prefix}/{joint}" for prefix in dof for joint in JOINTS}
    expected |= {f"{prefix}/{name}" for prefix in muscle for name in MUSCLES}
    assert set(table.columns) == expected
    assert table.columns.is_unique
    assert table.columns[0] == "time"
    assert len(table) == 61
    window = [name for name in table.columns if name.split("/")[0] in ("excitation", "reserve", "shortfall", "status")]
    assert table[window].iloc[-1].isna().all()
    assert not table[window].iloc[:-1].isna().any().any()
    assert not table.drop(columns=window).isna().any().any()


def test_the_table_holds_the_arrays(solution):
    table = solution.to_dataframe()
    for column, values in {
        "time": solution.time,
        "q/knee": solution.qpos[:, 1],
        "q_desired/ankle": solution.qpos_desired[:, 2],
        "qvel/hip": solution.qvel[:, 0],
        "excitation/vasti": solution.excitation[:, 4],
        "activation/iliopsoas": solution.activation[:, 0],
        "force/tib_ant": solution.muscle_force[:, 7],
        "moment/hip": solution.net_joint_moment[:, 0],
        "reserve/ankle": solution.reserve[:, 2],
        "shortfall/ankle": solution.shortfall[:, 2],
        "status": solution.status,
    }.items():
        np.testing.assert_array_equal(table[column].to_numpy()[: len(values)], values, err_msg=column)


def test_the_dataset_has_named_dimensions(solution):
    data = solution.to_xarray()
    assert dict(data.sizes) == {"node": 61, "window": 60, "muscle": 8, "dof": 3}
    assert data["excitation"].dims == ("window", "muscle")
    assert data["activation"].dims == ("node", "muscle")
    assert data["qpos"].dims == ("node", "dof")
    assert data["reserve"].dims == ("window", "dof")
    assert data["status"].dims == ("window",)
    np.testing.assert_array_equal(data["excitation"].sel(muscle="soleus"), solution.excitation[:, 6])
    np.testing.assert_array_equal(data["net_joint_moment"].sel(dof="knee"), solution.net_joint_moment[:, 1])
    np.testing.assert_array_equal(data["time"], solution.time)


# --- files ------------------------------------------------------------------------------------------------------


def assert_same_arrays(loaded, solution):
    for name in ARRAYS:
        found, expected = getattr(loaded, name), getattr(solution, name)
        assert found.dtype == expected.dtype, name
        np.testing.assert_array_equal(found, expected, err_msg=name)
        assert not found.flags.writeable
    assert loaded.muscle_names == solution.muscle_names
    assert loaded.dof_names == solution.dof_names


@pytest.mark.parametrize("suffix", [".parquet", ".sto", ".nc"])
@pytest.mark.parametrize("which", ["solution", "overloaded"])
def test_a_file_brings_everything_back(tmp_path, request, suffix, which):
    original = request.getfixturevalue(which)
    path = original.save(tmp_path / f"walk{suffix}")
    assert path == tmp_path / f"walk{suffix}"
    loaded = mjhcmc.Solution.load(path)
    assert_same_arrays(loaded, original)
    assert loaded.settings == original.settings
    assert loaded.interrupted is False
    assert loaded.verdict == original.verdict
    assert loaded.model is None
    again = mjhcmc.Solution.load(loaded.save(tmp_path / f"again{suffix}"))
    assert_same_arrays(again, original)
    assert again.verdict == original.verdict


def test_a_csv_brings_the_arrays_back_and_is_judged_anew_without_replay(tmp_path, solution):
    loaded = mjhcmc.Solution.load(solution.save(tmp_path / "walk.csv"))
    assert_same_arrays(loaded, solution)
    assert loaded.dt == pytest.approx(0.01, rel=1e-9)
    assert loaded.verdict.replay_max_error is None
    assert loaded.verdict.replay_window_max_error is None
    assert solution.verdict.replay_max_error is not None
    judged = {"replay_max_error": None, "replay_window_max_error": None, "physics_dt": None}
    assert loaded.verdict == dataclasses.replace(solution.verdict, **judged)


@pytest.mark.parametrize("suffix", [".parquet", ".sto", ".nc"])
def test_an_interrupted_solution_stays_marked(tmp_path, solution, suffix):
    part = dataclasses.replace(solution, interrupted=True)
    loaded = mjhcmc.Solution.load(part.save(tmp_path / f"part{suffix}"))
    assert loaded.interrupted is True
    assert not loaded.verdict.passed
    assert loaded.verdict.findings == part.verdict.findings


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_suffix_in_capitals_and_a_path_as_text(tmp_path, solution, suffix):
    path = str(tmp_path / f"WALK{suffix.upper()}")
    assert_same_arrays(mjhcmc.Solution.load(solution.save(path)), solution)


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_pandas_reads_it(tmp_path, solution, suffix):
    path = solution.save(tmp_path / f"walk{suffix}")
    read = pd.read_parquet(path) if suffix == ".parquet" else pd.read_csv(path)
    expected = solution.to_dataframe()
    assert list(read.columns) == list(expected.columns)
    pd.testing.assert_frame_equal(read.astype(float), expected.astype(float), rtol=1e-14, atol=1e-300)


def test_a_table_that_pandas_wrote_again_loads_like_a_csv(tmp_path, solution):
    path = tmp_path / "walk.parquet"
    pd.read_parquet(solution.save(path)).to_parquet(tmp_path / "again.parquet")
    loaded = mjhcmc.Solution.load(tmp_path / "again.parquet")
    assert_same_arrays(loaded, solution)
    assert loaded.verdict.passed == solution.verdict.passed


def test_opensims_table_is_read_back(tmp_path, solution):
    table = read_table(solution.save(tmp_path / "walk.sto"))
    expected = solution.to_dataframe()
    assert table.in_degrees is False
    assert table.columns == tuple(expected.columns[1:])
    np.testing.assert_array_equal(table.time, solution.time)
    np.testing.assert_array_equal(table.values, expected.astype(float).to_numpy()[:, 1:])
    assert json.loads(table.header["mjhcmc"])["settings"] == solution.settings


def test_plain_xarray_reads_it(tmp_path, solution):
    with xr.open_dataset(solution.save(tmp_path / "walk.nc"), engine="scipy") as data:
        np.testing.assert_array_equal(data["excitation"], solution.excitation)
        assert list(data["muscle"].to_numpy()) == list(MUSCLES)


def test_settings_of_numpy_are_saved_as_plain_numbers(tmp_path, solution):
    odd = dataclasses.replace(solution, settings={**solution.settings, "reserves": np.True_, "gain": np.float32(2)})
    assert mjhcmc.Solution.load(odd.save(tmp_path / "odd.parquet")).settings == {**solution.settings, "gain": 2.0}


# --- messages ---------------------------------------------------------------------------------------------------


def test_messages_count_each_kind_and_name_its_first_time(solution):
    assert solution.messages() == []
    status = np.zeros(60, dtype=np.int64)
    status[10:15] = mjhcmc.WindowStatus.RESERVE
    status[40] = mjhcmc.WindowStatus.STIFF
    reserve, stiff = dataclasses.replace(solution, status=status).messages()
    assert reserve.startswith("5 of 60 windows, first at 0.700 s: a reserve helped")
    assert stiff.startswith("1 of 60 windows, first at 1.000 s: ")
    assert "smaller physics_dt" in stiff


def test_every_status_says_something(solution):
    messages = [status.message for status in mjhcmc.WindowStatus]
    assert all(messages)
    assert len(set(messages)) == len(messages)


# --- what goes wrong --------------------------------------------------------------------------------------------


def one_line(error, *words):
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert str(word) in text
    return text


@pytest.mark.parametrize("name", ["walk.xlsx", "walk", "walk.parquet.gz"])
def test_an_unknown_suffix_lists_the_known(tmp_path, solution, name):
    for act in (solution.save, mjhcmc.Solution.load):
        with pytest.raises(mjhcmc.OutputError) as error:
            act(tmp_path / name)
        one_line(error, tmp_path / name, *SUFFIXES)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_saving_where_there_is_no_folder(tmp_path, solution, suffix):
    (tmp_path / "file").write_text("not a folder")
    for folder in ("missing", "file", "x" * 300):
        path = tmp_path / folder / f"walk{suffix}"
        with pytest.raises(mjhcmc.OutputError) as error:
            solution.save(path)
        one_line(error, path)
    for name in ("x" * 300, "x" * 245):
        with pytest.raises(mjhcmc.OutputError) as error:
            solution.save(tmp_path / f"{name}{suffix}")
        one_line(error, name)
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(mjhcmc.OutputError) as error:
        solution.save(tmp_path / f"folder{suffix}")
    one_line(error, f"folder{suffix}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", f"folder{suffix}"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_loading_what_is_not_there(tmp_path, suffix):
    for name in ("missing", "x" * 300):
        with pytest.raises(mjhcmc.OutputError) as error:
            mjhcmc.Solution.load(tmp_path / f"{name}{suffix}")
        one_line(error, name)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.5, 0.9])
def test_loading_a_truncated_file(tmp_path, solution, suffix, share):
    path = solution.save(tmp_path / f"walk{suffix}")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(mjhcmc.OutputError) as error:
        mjhcmc.Solution.load(path)
    one_line(error, path)


def test_loading_a_csv_that_ends_between_two_rows(tmp_path, solution):
    path = solution.save(tmp_path / "walk.csv")
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:30]))
    with pytest.raises(mjhcmc.OutputError, match="cut off") as error:
        mjhcmc.Solution.load(path)
    one_line(error, path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_loading_something_else(tmp_path, suffix):
    path = tmp_path / f"foreign{suffix}"
    foreign = pd.DataFrame({"time": [0.0, 1.0], "speed": [1.0, 2.0], "name": ["a", "b"]})
    contents = [b"\x00\x01\xffbinary" * 50, b"[1, 2]\n", b"CDF\x01" + 40 * b"\x7f", b"PAR1" + 40 * b"x" + b"PAR1"]
    contents.append(b"a\nversion=1\nnRows=1\nnColumns=2\ninDegrees=no\nendheader\ntime\tx\n0\t1\n")
    contents.append(foreign.to_csv(index=False).encode())
    contents.append(foreign.to_parquet())
    contents.append(b"")
    for content in contents:
        path.write_bytes(content)
        with pytest.raises(mjhcmc.OutputError) as error:
            mjhcmc.Solution.load(path)
        one_line(error, path)


def test_loading_a_table_with_something_taken_away_or_spoiled(tmp_path, solution):
    path = tmp_path / "walk.csv"
    table = solution.to_dataframe()

    def refused(changed, *words):
        changed.to_csv(path, index=False)
        with pytest.raises(mjhcmc.OutputError) as error:
            mjhcmc.Solution.load(path)
        one_line(error, path, *words)

    refused(table.drop(columns="time"), "time")
    refused(table.drop(columns="status"), "status")
    refused(table.drop(columns="force/soleus"))
    refused(table.drop(columns=[name for name in table.columns if name.startswith("moment/")]), "moment/")
    refused(table.iloc[-1:])
    for column in ("q/knee", "excitation/vasti", "status", "time"):
        spoiled = table.copy()
        spoiled.loc[7, column] = None
        refused(spoiled, "row 7", "nan")
    spoiled = table.astype({"q/hip": object})
    spoiled.loc[7, "q/hip"] = "seven"
    refused(spoiled, "seven")


def test_loading_spoiled_metadata(tmp_path, solution):
    path = solution.save(tmp_path / "walk.sto")
    text = path.read_text()
    for old, new in [('mjhcmc={"', 'mjhcmc=[{"'), ('mjhcmc={"', 'mjhcmc=[1]\nother={"'), ('"passed"', '"past"')]:
        path.write_text(text.replace(old, new))
        with pytest.raises(mjhcmc.OutputError) as error:
            mjhcmc.Solution.load(path)
        one_line(error, path)


@contextmanager
def disk_full_after(size):
    """Any file that grows beyond size bytes fails with an OSError, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("before", [None, b"what was there"])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_writer_that_fails_in_the_middle_leaves_nothing_of_its_own(tmp_path, solution, suffix, before):
    solution.save(tmp_path / f"complete{suffix}")
    size = (tmp_path / f"complete{suffix}").stat().st_size
    path = tmp_path / "out" / f"walk{suffix}"
    path.parent.mkdir()
    if before is not None:
        path.write_bytes(before)
    with disk_full_after(size // 2), pytest.raises(mjhcmc.OutputError) as error:
        solution.save(path)
    one_line(error, path)
    assert [item.name for item in path.parent.iterdir()] == ([] if before is None else [path.name])
    if before is not None:
        assert path.read_bytes() == before


def test_an_interrupt_while_writing_leaves_nothing(tmp_path, solution, monkeypatch):
    def write_half(self, path, **_):
        path.write_text("time,q/hip\n")
        raise KeyboardInterrupt

    monkeypatch.setattr(pd.DataFrame, "to_csv", write_half)
    with pytest.raises(KeyboardInterrupt):
        solution.save(tmp_path / "walk.csv")
    assert not list(tmp_path.iterdir())


def test_without_the_extra_the_remedy_is_named(tmp_path, solution, monkeypatch):
    import sys

    path = solution.save(tmp_path / "walk.nc")
    monkeypatch.setitem(sys.modules, "xarray", None)
    for act in (lambda: solution.save(tmp_path / "other.nc"), solution.to_xarray, lambda: mjhcmc.Solution.load(path)):
        with pytest.raises(mjhcmc.OutputError, match=r'pip install "mjhcmc\[netcdf\]"'):
            act()
    assert [item.name for item in tmp_path.iterdir()] == ["walk.nc"]


def test_no_device_and_no_folder_is_replaced_by_a_file(solution, tmp_path):
    (tmp_path / "walk.parquet").mkdir()
    with pytest.raises(mjhcmc.OutputError, match=r"walk\.parquet: cannot be written, it is a folder"):
        solution.save(tmp_path / "walk.parquet")
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(mjhcmc.OutputError, match=r"pipe\.csv: cannot be written, it is no ordinary file"):
        solution.save(tmp_path / "pipe.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pipe.csv", "walk.parquet"]
    assert stat.S_ISFIFO((tmp_path / "pipe.csv").stat().st_mode)
