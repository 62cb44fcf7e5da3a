"""The live page's computation, without a browser: what is solved, in which order, and what a reflex adds."""

import os
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import load_xml
from test_patients_examination import affected

import mjhcmc
from mjhcmc.methods.run import SolveInterrupted
from mjhcmc.patients.bench import Case
from mjhcmc.patients.leg import leg_of
from mjhcmc.patients.movement import move
from mjhcmc.patients.patient import GroupState
from mjhcmc.patients.trials import voluntary
from mjhcmc.viewing import live_solver
from mjhcmc.viewing.echo import echo
from mjhcmc.viewing.live_reflex import Reflex, has_fibers, reflex_of
from mjhcmc.viewing.live_solver import LiveRequest, LiveResult, LiveSolver, cocontraction_of, cycles_of, live_joints
from mjhcmc.viewing.live_words import latency_words, numbers_of, verdict_words
from mjhcmc.viewing.newest import Newest

SMALL = tuple(np.deg2rad([5.0, -10.0, -5.0]))
SHORT = 0.4
WAIT = 20.0  # s, for a thread


@pytest.fixture(scope="module")
def solver(leg8):
    return LiveSolver(leg8)


@pytest.fixture(scope="module")
def leg8():
    return mjhcmc.MuscleModel.load("leg8")


@pytest.fixture(scope="module")
def healthy(solver):
    return solver.solve(LiveRequest(SMALL, SHORT))


def test_a_request_is_what_hcmc_gives_for_its_motion(leg8, healthy):
    names = dict(zip(("hip", "knee", "ankle"), SMALL, strict=True))
    motion = mjhcmc.Motion.cosine(leg8, amplitudes=names, period=SHORT, cycles=2)
    alone = mjhcmc.hcmc(leg8, motion)
    assert np.array_equal(healthy.solution.excitation, alone.excitation)
    assert np.array_equal(healthy.solution.qpos, alone.qpos)
    assert healthy.error is None
    assert healthy.notes == ()
    assert 0 < healthy.solve_time < 60
    assert healthy.verdict.passed
    assert healthy.verdict.replay_max_error is None  # a replay would take longer than the solve


def test_a_reflex_of_gain_0_is_none(solver, healthy):
    without = solver.solve(LiveRequest(SMALL, SHORT, Reflex(0.0, 0.3)))
    assert np.array_equal(without.solution.excitation, healthy.solution.excitation)
    assert not without.reflex.any()


def test_a_reflex_is_a_floor_that_others_work_against(solver, healthy):
    spastic = solver.solve(LiveRequest(SMALL, SHORT, Reflex(0.1, 0.05)))
    assert spastic.reflex.max() > 0.03
    assert (spastic.solution.excitation >= spastic.reflex - 1e-12).all()
    assert spastic.solution.excitation.mean() > healthy.solution.excitation.mean()
    knee = spastic.solution.dof_names.index("knee")
    assert spastic.cocontraction[knee] > healthy.cocontraction[knee]
    assert spastic.verdict.passed  # still the movement that was meant


def test_a_reflex_grows_with_gain_and_falls_with_threshold(leg8, solver):
    motion = solver.motion_of(LiveRequest(SMALL, SHORT))
    weak, strong = (reflex_of(leg8, motion, 0.01, Reflex(g, 0.1)).excitation for g in (0.05, 0.15))
    late = reflex_of(leg8, motion, 0.01, Reflex(0.15, 0.4)).excitation
    assert (strong >= weak).all()
    assert (strong >= late).all()
    assert strong.max() == pytest.approx(3 * weak.max())  # far from full excitation: linear
    assert late.max() > 0


def test_a_reflex_of_some_muscles_is_in_those_alone(leg8, solver):
    motion = solver.motion_of(LiveRequest(SMALL, SHORT))
    everywhere = reflex_of(leg8, motion, 0.01, Reflex(0.1, 0.0)).excitation
    some = reflex_of(leg8, motion, 0.01, Reflex(0.1, 0.0, ("vasti", "soleus"))).excitation
    has = np.isin(leg8.muscle_names, ("vasti", "soleus"))
    assert np.array_equal(some[:, has], everywhere[:, has])
    assert not some[:, ~has].any()
    with pytest.raises(mjhcmc.SettingsError, match="no muscle soles"):
        reflex_of(leg8, motion, 0.01, Reflex(0.1, 0.0, ("soles",)))


def test_the_reflex_is_that_of_the_virtual_patients():
    """Their own machinery, which samples the same law on its own way through the movement."""
    patient = affected()
    groups = tuple(GroupState(g.name, 0.12, 0.05, g.passive_strain, g.fiber_shortening, 0.0) for g in patient.groups)
    patient = replace(patient, groups=groups, cocontraction=0.0)
    leg = leg_of(patient)
    motion = mjhcmc.Motion.cosine(leg, amplitudes={"knee": -0.5}, period=0.4, cycles=1)
    [record] = move([Case(patient, leg, replace(voluntary("cosine", "slow", 100.0), session="ideal"))], [motion])
    affected_muscles = tuple(name for name in leg.muscle_names if name not in ("glut_max", "tib_ant"))
    ours = reflex_of(leg, motion, 0.01, Reflex(0.12, 0.05, affected_muscles, patient.delay)).excitation
    assert ours.max() > 0.05
    np.testing.assert_allclose(ours, record.reflex, rtol=0, atol=1e-12)


def test_numbers_that_no_reflex_has_are_refused():
    for bad in ({"gain": -0.1}, {"threshold": float("nan")}, {"delay": -1.0}):
        with pytest.raises(mjhcmc.SettingsError, match=f"reflex {next(iter(bad))} is"):
            Reflex(**bad)


def test_a_request_that_fails_says_why_and_the_next_one_works(solver, healthy):
    failed = solver.solve(LiveRequest((9.0, 0.0, 0.0), SHORT))
    assert failed.solution is None
    assert failed.verdict is None
    assert "hip" in failed.error
    assert "\n" not in failed.error
    again = solver.solve(LiveRequest(SMALL, SHORT))
    assert np.array_equal(again.solution.excitation, healthy.solution.excitation)


def test_what_is_warned_of_is_a_note(solver, monkeypatch):
    def diverges(*_, **__):
        import warnings

        warnings.warn("it is solved again", mjhcmc.MjhcmcWarning, stacklevel=1)
        raise mjhcmc.DivergedError("the simulation diverged")

    monkeypatch.setattr(live_solver, "hcmc", diverges)
    result = solver.solve(LiveRequest(SMALL, SHORT))
    assert result.notes == ("it is solved again",)
    assert result.error == "the simulation diverged"


def test_what_nobody_thought_of_is_reported_too(solver, monkeypatch):
    monkeypatch.setattr(live_solver, "hcmc", lambda *_, **__: 1 / 0)
    assert "ZeroDivisionError" in solver.solve(LiveRequest(SMALL, SHORT)).error


def test_a_solve_can_be_given_up(solver, healthy):
    seen = []

    def stop(done, count):
        seen.append(done)
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(SolveInterrupted):
        solver.solve(LiveRequest(SMALL, SHORT), stop)
    assert seen == [1, 2, 3]
    assert np.array_equal(solver.solve(LiveRequest(SMALL, SHORT)).solution.excitation, healthy.solution.excitation)


class Slow:
    """A solver whose solves go on window by window as the test lets them."""

    def __init__(self, windows=10):
        self.windows, self.begun, self.step = windows, [], threading.Semaphore(0)
        self.at = threading.Semaphore(0)

    def solve(self, request, progress=None):
        self.begun.append(request.period)
        for done in range(1, self.windows + 1):
            self.at.release()
            assert self.step.acquire(timeout=WAIT)
            try:
                progress(done, self.windows)
            except KeyboardInterrupt as stop:
                raise SolveInterrupted([None]) from stop
        return LiveResult(request, None, None, "none", (), 0.0)

    def let(self, count):
        """Let so many windows go, each after the one before has been taken in."""
        for _ in range(count):
            assert self.at.acquire(timeout=WAIT)
            self.step.release()


def ask(worker, period):
    worker.ask(LiveRequest((), period))


def wait_for(condition):
    end = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_only_the_newest_request_is_solved():
    slow, shown = Slow(), []
    worker = Newest(slow, lambda result: shown.append(result.request.period))
    ask(worker, 1.0)
    slow.let(9)  # nearly through: it is finished
    assert slow.at.acquire(timeout=WAIT)
    for period in (2.0, 3.0, 4.0):
        ask(worker, period)
    slow.step.release()
    slow.let(10)
    wait_for(lambda: len(shown) == 2)
    assert shown == [1.0, 4.0]
    assert slow.begun == [1.0, 4.0]
    assert worker.given_up == 0
    worker.close()


def test_a_solve_that_is_not_half_through_is_given_up_once():
    slow, shown = Slow(), []
    worker = Newest(slow, lambda result: shown.append(result.request.period))
    ask(worker, 1.0)
    slow.let(2)
    assert slow.at.acquire(timeout=WAIT)
    ask(worker, 2.0)
    slow.step.release()  # and it ends here
    slow.let(2)
    assert slow.at.acquire(timeout=WAIT)
    ask(worker, 3.0)  # the second is let through: while one drags, results keep coming
    slow.step.release()
    slow.let(17)
    wait_for(lambda: len(shown) == 2)
    assert shown == [2.0, 3.0]
    assert worker.given_up == 1
    worker.close()


def test_idle_work_is_done_when_nothing_waits_and_given_up_for_a_request():
    slow, shown, idle = Slow(4), [], []

    def compare(result):
        idle.append(result.request.period)
        slow.solve(replace(result.request, period=-1.0), worker.give_up_if_asked)
        idle.append("done")

    worker = Newest(slow, lambda result: shown.append(result.request.period), compare)
    ask(worker, 1.0)
    slow.let(4)
    slow.let(1)  # of the idle work
    assert slow.at.acquire(timeout=WAIT)
    ask(worker, 2.0)
    slow.step.release()
    slow.let(8)
    wait_for(lambda: len(idle) == 3)
    assert shown == [1.0, 2.0]
    assert idle == [1.0, 2.0, "done"]
    worker.close()


def test_a_page_that_breaks_does_not_end_the_thread(caplog):
    slow, shown = Slow(1), []

    def show(result):
        shown.append(result.request.period)
        raise RuntimeError("the page went away")

    worker = Newest(slow, show)
    for period in (1.0, 2.0):
        ask(worker, period)
        slow.let(1)
        wait_for(lambda period=period: shown[-1:] == [period])
    worker.close()
    assert "could not be shown" in caplog.text


def test_closing_gives_up_what_is_in_progress():
    slow = Slow(1000)
    worker = Newest(slow, lambda result: None)
    ask(worker, 1.0)
    assert slow.at.acquire(timeout=WAIT)
    closing = threading.Thread(target=worker.close)
    closing.start()
    wait_for(lambda: worker._closed)
    slow.step.release()
    closing.join(WAIT)
    assert not closing.is_alive()


def test_sliders_keep_to_the_joints_ranges(leg8):
    joints, left_out = live_joints(leg8)
    assert [joint.name for joint in joints] == ["hip", "knee", "ankle"]
    assert left_out == ()
    knee = joints[1]
    assert np.rad2deg([knee.low, knee.high]) == pytest.approx([-60, 10])  # at most 60 deg, and no further than it goes


def test_of_many_joints_those_with_most_muscles_have_sliders():
    """Joint j of ten has 10 - j muscles, so the last two are left out; a joint whose range lacks 0 cannot begin."""
    bodies, tendons, muscles = "", "", ""
    for j in range(10):
        limits = 'range="10 60" limited="true"' if j == 3 else ""
        sites = "".join(f'<site name="s{j}_{i}" pos=".02 {0.01 * i} -.05"/>' for i in range(10 - j))
        base = "".join(f'<site name="b{j}_{i}" pos="{j + 0.02} {0.01 * i} .05"/>' for i in range(10 - j))
        bodies += (
            f'{base}<body pos="{j} 0 0"><joint name="j{j}" axis="0 1 0" {limits}/>'
            f'<geom size=".02" mass="1" pos="0 0 -.1"/>{sites}</body>'
        )
        for i in range(10 - j):
            tendons += f'<spatial name="t{j}_{i}"><site site="b{j}_{i}"/><site site="s{j}_{i}"/></spatial>'
            muscles += f'<muscle name="m{j}_{i}" tendon="t{j}_{i}" force="10" ctrlrange="0 1" lengthrange=".05 .2"/>'
    model = load_xml(
        f'<mujoco><option integrator="RK4"/><worldbody>{bodies}</worldbody><tendon>{tendons}</tendon>'
        f"<actuator>{muscles}</actuator></mujoco>"
    )
    joints, left_out = live_joints(model)
    assert [joint.name for joint in joints] == ["j0", "j1", "j2", "j4", "j5", "j6", "j7", "j8"]
    assert set(left_out) == {"j3", "j9"}


@pytest.mark.parametrize("dt", [0.01, 0.005, 0.007, 0.05])
def test_periods_are_whole_numbers_of_windows(leg8, dt):
    least, most, step = LiveSolver(leg8, dt=dt).periods
    for value in (least, most, step):
        assert value / dt == pytest.approx(round(value / dt))
    assert 0.2 - 1e-9 <= least < most <= 1.2 + 1e-9


def test_movements_are_short_enough_to_be_solved_soon():
    assert [cycles_of(period) for period in (0.2, 0.26, 0.4, 0.42, 1.2)] == [3, 3, 2, 1, 1]


def test_cocontraction_counts_what_is_given_twice():
    """Two muscles of 3 and -1 N m, then of 2 and 0: 2 (1 + 0) / (4 + 2)."""
    moment = np.array([[[3.0], [-1.0]], [[2.0], [0.0]]])
    assert cocontraction_of(SimpleNamespace(detail=SimpleNamespace(active_moment=moment))) == pytest.approx([1 / 3])
    idle = np.zeros((2, 2, 1))
    assert np.isnan(cocontraction_of(SimpleNamespace(detail=SimpleNamespace(active_moment=idle)))).all()


def test_fibers_are_known_of_mujocos_muscles_alone(leg8):
    assert has_fibers(leg8)
    affine = leg8.mj_model.__copy__()
    affine.actuator_gaintype[0] = 0
    assert not has_fibers(replace(leg8, mj_model=affine))


@pytest.fixture(scope="module")
def page():
    pytest.importorskip("viser")
    from mjhcmc.viewing.live import live_page

    said = []
    found = live_page(port=0, open_browser=False, block=False, say=said.append)
    found.said = said
    yield found
    found.close()


def results_after(page, count):
    wait_for(lambda: page.shown >= count and not page.busy)


def test_a_slider_brings_a_solution_and_its_latency(page, leg8):
    assert page.url in page.said[-1]
    results_after(page, 1)
    before = page.shown
    page.slider("hip").value = 15.0
    results_after(page, before + 1)
    amplitudes = {"hip": np.deg2rad(15.0), "knee": np.deg2rad(-20.0), "ankle": np.deg2rad(-10.0)}
    motion = mjhcmc.Motion.cosine(leg8, amplitudes=amplitudes, period=0.3, cycles=2)
    assert np.array_equal(page.result.solution.excitation, mjhcmc.hcmc(leg8, motion).excitation)
    assert page.sent[-1] >= page.result.solve_time > 0
    assert f"server alone: {1e3 * page.sent[-1]:.0f} ms" in page.words("latency")
    assert not page.seen  # nobody looks, so nobody has seen it
    assert "no browser answered" in page.words("latency")
    assert "holds" in page.words("verdict")


def test_the_page_outlives_a_solve_that_fails(page, monkeypatch):
    before, solution = page.shown, page.result.solution

    def fails(*_, **__):
        raise mjhcmc.DivergedError("the simulation diverged: take smaller amplitudes")

    with monkeypatch.context() as patch:
        patch.setattr(live_solver, "hcmc", fails)
        page.slider("hip").value = 2.0
        results_after(page, before + 1)
    assert "not solved" in page.words("verdict")
    assert "take smaller amplitudes" in page.words("verdict")
    assert page.result.solution is solution  # what was there stays
    page.slider("hip").value = 3.0
    results_after(page, before + 2)
    assert "holds" in page.words("verdict")


def test_a_patient_is_beside_the_healthy(page):
    before = page.shown
    page.slider("gain").value = 0.05
    results_after(page, before + 1)
    wait_for(lambda: "of it reflex" in page.words("beside") and "…" not in page.words("beside"))
    assert page.result.reflex.any()


def answers(what):
    """A browser that answers so, and how often it was asked."""
    asked = []

    def get_item(key, timeout):
        asked.append(timeout)
        if isinstance(what, Exception):
            raise what
        time.sleep(what)

    return SimpleNamespace(local_storage=SimpleNamespace(get_item=get_item)), asked


def test_an_answer_takes_as_long_as_the_browser_does():
    client, asked = answers(0.03)
    assert 0.03 <= echo(client, 2.0) < 2.0
    assert asked == [2.0]
    assert echo(answers(RuntimeError("Failed to read localStorage: it is shut"))[0], 1.0) is not None
    assert echo(answers(RuntimeError("the client disconnected before returning a response"))[0], 1.0) is None
    assert echo(answers(TimeoutError("it did not"))[0], 1.0) is None


def test_a_slider_in_a_browser_is_timed_to_its_answer(page):
    results_after(page, 1)
    before, (client, asked) = page.shown, answers(0.2)
    page._ask(SimpleNamespace(client=client))
    results_after(page, before + 1)
    assert len(asked) == 1
    assert page.seen[-1] >= page.sent[-1] + 0.2
    assert f"{1e3 * page.seen[-1]:.0f} ms</span> from slider to drawn curves" in page.words("latency")
    page._ask(SimpleNamespace(client=answers(TimeoutError("it is gone"))[0]))
    results_after(page, before + 2)
    assert len(page.seen) == 1
    assert "no browser answered" in page.words("latency")


def test_what_the_server_alone_took_is_not_called_drawn(healthy):
    words = latency_words((), (0.052,), healthy)
    assert "52 ms from slider event to excitations sent" in words
    assert "52 ms</span>" not in words
    assert ">80 ms</span> from slider to drawn" in latency_words((0.07, 0.08), (0.052,), healthy)
    assert "median of 2: 75 ms" in latency_words((0.07, 0.08), (0.052,), healthy)


def test_slides_are_told_in_millimetres_and_by_their_own_limit(healthy):
    """The hip as a slide that is 20 mm off beside a knee that is .5 deg off: twice its limit, and half of it."""
    solution = healthy.solution
    rotation = solution.dof_is_rotation.copy()
    rotation[0] = False
    error = np.array([0.02, np.deg2rad(0.5), 0.0])
    verdict = replace(healthy.verdict, tracking_max=tuple(error), peak_reserve_share=(10.2, 0.5, 0.0001))
    fake = SimpleNamespace(
        error=None, notes=(), verdict=verdict, reflex=healthy.reflex, cocontraction=healthy.cocontraction,
        solution=SimpleNamespace(
            dof_is_rotation=rotation, dof_names=solution.dof_names, roles=solution.roles,
            excitation=solution.excitation, peak_moment=solution.peak_moment,
        ),
    )  # fmt: skip
    assert numbers_of(fake)["largest tracking error"] == "20 mm"
    assert numbers_of(fake)["reserve / peak moment"] == "1020 %"
    assert "tracking RMS ≤ 1 deg, of slides 10 mm" in verdict_words(fake)
    assert "slides" not in verdict_words(healthy)


def test_a_port_that_is_taken_is_told_before_the_work(page):
    from mjhcmc.viewing.live import live_page

    with pytest.raises(mjhcmc.SettingsError, match="give another port") as error:
        live_page(port=page.server.get_port(), open_browser=False, block=False, say=lambda line: None)
    assert str(page.server.get_port()) in str(error.value)


@pytest.mark.parametrize("bad", [{"port": -1}, {"port": 80.5}, {"dt": 0.0}, {"host": "no.such.host.invalid"}])
def test_bad_settings_are_refused(bad):
    pytest.importorskip("viser")
    from mjhcmc.viewing.live import live_page

    with pytest.raises(mjhcmc.SettingsError):
        live_page(**{"port": 0} | bad, open_browser=False, block=False)


def test_without_viser_the_extra_is_named(monkeypatch):
    from mjhcmc.viewing.live import live_page

    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(mjhcmc.SettingsError, match=r'pip install "mjhcmc\[view\]"'):
        live_page(port=0, open_browser=False, block=False)


def test_the_command_hands_on_its_options(run, monkeypatch):
    asked = {}
    monkeypatch.setattr("mjhcmc.viewing.live.live_page", lambda model, **rest: asked.update(rest, model=model))
    outcome = run("live", "--model", "leg8", "--dt", "0.02", "--port", "0", "--no-open")
    assert outcome.code == 0
    assert (asked["model"], asked["dt"], asked["port"], asked["open_browser"]) == ("leg8", 0.02, 0, False)
    assert asked["host"] == "127.0.0.1"


def test_an_interrupt_ends_the_page(monkeypatch):
    """Ctrl-C reaches the main thread, which waits; what the page runs is ended."""
    import signal

    from mjhcmc.viewing import server

    if threading.current_thread() is not threading.main_thread():
        pytest.skip("interrupts reach the main thread alone")
    ended, said = [], []
    fake = SimpleNamespace(get_host=lambda: "127.0.0.1", get_port=lambda: 1234, stop=lambda: ended.append("server"))
    threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
    server.serve(
        fake, "replay", open_browser=False, block=True, say=said.append, close=lambda: ended.append("threads")
    )  # fmt: skip
    assert ended == ["threads", "server"]
    assert said[0].startswith("replay: http://127.0.0.1:1234")
