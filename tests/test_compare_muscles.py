"""MuJoCo's muscles against the Hill model: the books, closed forms, and an integrator of another kind."""

import csv
import json

import numpy as np
import pytest
from conftest import HANGING_MASS, MUSCLE_ACTUATOR, load_xml
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid

import mjhcmc
from mjhcmc import hill
from mjhcmc.fiber_motion import compliant_motion
from mjhcmc.hill_muscles import hill_model, mujoco_curve_sets
from mjhcmc.leg8.table import MUSCLES, load_table
from mjhcmc.muscle_comparison import compare_muscles, needed_activation, track_of
from mjhcmc.plotting.muscles import curve_figure, force_figure


@pytest.fixture(scope="module")
def millard(leg8, fast_solution):
    return compare_muscles(fast_solution, hill_model(leg8))


@pytest.fixture(scope="module")
def itself(leg8, fast_solution):
    return compare_muscles(fast_solution, hill_model(leg8, "mujoco"))


def test_the_legs_hill_muscles_are_the_sources(leg8):
    """The model's numbers, read backwards, are the table's, but for the digits that the model file keeps."""
    table, muscles = load_table(), hill_model(leg8).muscles
    for i, name in enumerate(MUSCLES):
        source = table["source"]["muscles"][name]
        assert_allclose(muscles.max_isometric_force[i], source["max_isometric_force"], rtol=1e-5)
        assert_allclose(muscles.optimal_fiber_length[i], source["optimal_fiber_length"], rtol=1e-4)
        slack = source["tendon_slack_length"] + table["fitted"]["slack_offset"][name]
        assert_allclose(muscles.tendon_slack_length[i], slack, atol=1e-6)
        assert_allclose(muscles.pennation_at_optimal[i], source["pennation_angle"], atol=1e-8)
        assert_allclose(muscles.fiber_damping[i], 0.1, rtol=1e-4)
    (curves,) = mujoco_curve_sets(leg8)
    assert_allclose(
        curves, [table["fitted"]["curves"][k] for k in ("lmin", "lmax", "fpmax", "fvmax", "vmax")], rtol=2e-3
    )


def test_mujocos_own_curves_differ_from_mujoco_by_nothing(itself):
    """A rigid Hill muscle with MuJoCo's curves is MuJoCo's muscle, but that its tendon does not push."""
    track = itself.track
    assert_allclose(itself.rigid, np.maximum(track.force, 0), atol=1e-7)
    pulls = track.force > 1e-6
    assert np.isfinite(itself.needed_activation[pulls & (track.activation > 1e-6)]).all()
    # activation follows from force only where the muscle can use it
    gain = hill.rigid_tendon(itself.model, 1.0, track.length, track.velocity).active_force
    sure = pulls & (gain > 1.0) & np.isfinite(itself.needed_activation)
    assert sure.mean() > 0.9
    assert_allclose(itself.needed_activation[sure], track.activation[sure], atol=1e-7)
    assert itself.compliant is None
    assert "compliant" not in itself.screen()


def test_the_track_is_the_solutions(millard, fast_solution):
    node, detail = millard.track.node, fast_solution.detail
    assert_allclose(millard.track.time[node], fast_solution.time, atol=1e-12)
    assert_allclose(millard.track.force[node], fast_solution.muscle_force, atol=1e-8)
    assert_allclose(millard.track.length[node], detail.musculotendon_length, atol=1e-12)
    assert_allclose(millard.track.velocity[node], detail.musculotendon_velocity, atol=1e-10)
    assert_allclose(np.diff(millard.track.time), 0.0005, atol=1e-12)
    # and between the nodes: velocity is length's rate
    moved = trapezoid(millard.track.velocity, dx=0.0005, axis=0)
    assert_allclose(moved, millard.track.length[-1] - millard.track.length[0], atol=2e-6)


def test_moments_balance(millard, fast_solution):
    """R^T F and the reserve are the net joint moment; what the muscles differ by is what the joints differ by."""
    track = millard.track
    moment = np.einsum("nmv,nm->nv", track.moment_arm, track.force)[track.node]
    reserve = np.vstack([fast_solution.reserve, fast_solution.reserve[-1:]])
    assert_allclose(moment + reserve, fast_solution.net_joint_moment, atol=1e-7)
    for tendon, force in millard.forces().items():
        hills = np.einsum("nmv,nm->nv", track.moment_arm, force)
        whole = hills - np.einsum("nmv,nm->nv", track.moment_arm, track.force)
        assert_allclose(millard.moment_difference(tendon).sum(axis=1), whole, atol=1e-9)
        found = [row[f"{tendon}_max_nm"] for row in millard.numbers()["joints"].values()]
        assert_allclose(found, np.abs(whole).max(axis=0))
        rms = [row[f"{tendon}_rms_n"] for row in millard.numbers()["muscles"].values()]
        assert_allclose(rms, np.sqrt(((force - track.force) ** 2).mean(axis=0)))


def test_needed_activation_gives_mujocos_force(millard):
    track, needed = millard.track, millard.needed_activation
    reachable = np.isfinite(needed)
    assert 0.9 < reachable.mean() < 1  # iliopsoas is too weak at times, soleus pushes
    assert ((millard.beyond == 0) == reachable).all()
    force = hill.rigid_tendon(millard.model, np.nan_to_num(needed), track.length, track.velocity)
    found = force.fiber_force_along_tendon
    assert_allclose(found[reachable], track.force[reachable], atol=1e-5)
    assert (millard.beyond[track.force < -1e-3] < 0).all()


@pytest.mark.parametrize("curves", [hill.thelen2003(), hill.millard2012(), hill.degroote_fregly2016()])
def test_needed_activation_of_one_muscle(curves):
    """A force made with a known activation asks for it again; ten percent more than the most is out of reach."""
    one = hill.HillModel(hill.MuscleParameters([1000.0], [0.1], [0.2], [0.3], 10.0, 0.1), curves)
    length = np.full((40, 1), 0.3) + np.linspace(-0.02, 0.02, 40)[:, None]
    velocity = np.linspace(0.3, -0.2, 40)[:, None]
    given = np.linspace(0.15, 1, 40)[:, None]
    force = hill.rigid_tendon(one, given, length, velocity).tendon_force
    found, beyond = needed_activation(one, force, length, velocity)
    assert_allclose(found, given, atol=1e-9)
    assert not beyond.any()
    most = hill.rigid_tendon(one, 1.0, length, velocity).tendon_force
    found, beyond = needed_activation(one, 1.1 * most, length, velocity)
    assert np.isnan(found).all()
    assert_allclose(beyond, 0.1 * most, rtol=1e-9)


@pytest.mark.parametrize("curves", ["millard", "degroote-fregly", "thelen"])
def test_compliant_fibers_move_as_by_runge_kutta(leg8, fast_solution, curves):
    """Independent: classical RK4 with the same half steps, over the first 25 ms."""
    model = hill_model(leg8, curves)
    track = track_of(fast_solution, 5e-4)
    n = 101
    a, length, velocity = track.activation[:n], track.length[:n], track.velocity[:n]
    state = compliant_motion(model, track.time[:n], a, length, velocity)
    fiber = hill.static_equilibrium(model, a[0], length[0]).fiber_length
    h = track.time[2] - track.time[0]

    def rate(k, x):
        return hill.fiber_velocity(model, a[k], x, length[k])

    for k in range(0, n - 1, 2):
        k1 = rate(k, fiber)
        k2 = rate(k + 1, fiber + h / 2 * k1)
        k3 = rate(k + 1, fiber + h / 2 * k2)
        fiber = fiber + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(k + 2, fiber + h * k3))
    moved = np.abs(state.fiber_length[-1] - state.fiber_length[0]) / model.muscles.optimal_fiber_length
    assert moved.max() > 0.02
    assert_allclose(state.fiber_length[-1], fiber, atol=3e-7)
    assert_allclose(state.tendon_length + state.fiber_length * state.cos_pennation, length, atol=1e-12)


def test_a_held_muscle_stays_in_equilibrium(leg8):
    model = hill_model(leg8)
    m = model.muscles
    length = np.tile(m.tendon_slack_length + 1.1 * m.optimal_fiber_length, (41, 1))
    a = np.full_like(length, 0.3)
    state = compliant_motion(model, np.linspace(0, 0.04, 41), a, length, 0 * length)
    assert_allclose(state.tendon_force, hill.static_equilibrium(model, a, length).tendon_force, rtol=1e-9)


def test_a_finer_step_changes_nothing_that_is_shown(leg8, fast_solution, millard):
    finer = compare_muscles(fast_solution, hill_model(leg8), step=5e-4)
    change = np.abs(finer.compliant[finer.track.node] - millard.compliant[millard.track.node]).max()
    assert change < 1e-3 * np.abs(millard.compliant - millard.track.force).max()


def test_a_stiff_tendons_difference_is_in_proportion_to_its_strain(millard):
    """Hamstrings over the first cycle: halving a small strain halves what differs from the rigid tendon."""
    track, rigid = millard.track, millard.rigid[:401, 3]
    values = track.time[:401], track.activation[:401], track.length[:401], track.velocity[:401]
    differences = []
    for strain in (0.0049, 0.00245):
        curves = hill.millard2012(tendon=hill.TendonForceLength(strain_at_one_norm_force=strain))
        force = compliant_motion(hill.HillModel(millard.model.muscles, curves), *values).tendon_force[:, 3]
        differences.append(np.sqrt(np.mean((force - rigid) ** 2)))
    assert_allclose(differences[1] / differences[0], 0.5, atol=0.03)


def test_figures_draw_what_was_found(millard, leg8):
    figure = force_figure(millard)
    for i, ax in enumerate(figure.axes):
        lines = {line.get_label(): line.get_ydata() for line in ax.lines}
        assert_allclose(lines["MuJoCo"], millard.track.force[:, i])
        assert_allclose(lines["rigid"], millard.rigid[:, i])
        assert_allclose(lines["compliant"], millard.compliant[:, i])
    axes = curve_figure(leg8).axes
    assert len(axes) == 4
    names = {"Thelen 2003", "Millard 2012", "De Groote-Fregly 2016", "MuJoCo"}
    for ax, at in zip(axes[:3], (1.0, 1.0, 0.0), strict=True):
        lines = {line.get_label(): line for line in ax.lines}
        assert set(lines) == names
        for line in lines.values():
            value = np.interp(at, line.get_xdata(), line.get_ydata())
            assert_allclose(value, 0.0 if ax is axes[1] else 1.0, atol=0.02)
    assert {line.get_label() for line in axes[3].lines} == names


def test_the_command_writes_tables_and_figures(run, tmp_path, millard, coarse_figures):
    outcome = run("compare-muscles", "--out", tmp_path / "out", "--json")
    assert outcome.code == 0, outcome.err
    values = json.loads(outcome.out)
    assert values == json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert list(values["muscles"]) == list(MUSCLES)
    assert_allclose(
        values["muscles"]["soleus"]["compliant_rms_n"], millard.numbers()["muscles"]["soleus"]["compliant_rms_n"]
    )
    with (tmp_path / "out" / "muscles.csv").open() as file:
        rows = {row.pop("muscle"): row for row in csv.DictReader(file)}
    assert rows.keys() == values["muscles"].keys()
    for name, row in rows.items():
        assert {k: float(v) if v else None for k, v in row.items()} == pytest.approx(values["muscles"][name])
    files = {path.name for path in (tmp_path / "out").iterdir()}
    tables = {"muscles.csv", "joints.csv", "comparison.json"}
    assert files == tables | {f"{name}.{kind}" for name in ("curves", "forces") for kind in ("png", "pdf")}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--curves", "hill"], "curves 'hill' are not known: choose one of millard"),
        (["--movement", "hop"], "hop"),
        (["--step", "0"], "step must be positive, in seconds; got 0.0"),
        (["--model", "nothing.xml"], "nothing.xml"),
    ],
)
def test_bad_input_is_one_line_before_the_work(run, tmp_path, arguments, message):
    outcome = run("compare-muscles", *arguments, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert len(outcome.errors) == 1
    assert message in outcome.err
    assert not (tmp_path / "out").exists()


def test_a_muscle_without_room_for_a_tendon_is_refused():
    model = load_xml(HANGING_MASS.format(actuator=MUSCLE_ACTUATOR))
    with pytest.raises(
        mjhcmc.ModelError, match=r"'pull': its lengthrange and range leave a tendon slack length of -2 m"
    ):
        hill_model(model)


def test_other_muscles_are_refused(leg8, fast_solution):
    other = hill.HillModel(hill.MuscleParameters([1000.0], [0.1], [0.2], names="biceps"), hill.millard2012())
    with pytest.raises(mjhcmc.SettingsError, match="biceps are not the solution's"):
        compare_muscles(fast_solution, other)
