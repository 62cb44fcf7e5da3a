"""Help and completion: at once, complete, with examples that the commands would take."""

import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest
from click.shell_completion import ShellComplete

from mjhcmc import assets, cosine, integrators, methods, muscle_choice, qp_back_ends, sharing
from mjhcmc.cli import cli
from mjhcmc.cli_completion import SHELLS, VALUES

ROOT = Path(__file__).resolve().parents[1]


def commands(group=cli, before=()):
    """Every command that does something, by the words that call it."""
    found = {}
    for name, command in group.commands.items():
        words = (*before, name)
        found |= commands(command, words) if isinstance(command, click.Group) else {words: command}
    return found


COMMANDS = commands()


def examples_in(text: str) -> list[list[str]]:
    """Command lines that stand below Example(s), without what is said of them behind two spaces."""
    lines = [line.strip() for line in re.split(r"Examples?:", text, maxsplit=1)[-1].splitlines()]
    lines = lines if lines[0] else lines[1:]
    lines = lines[: next((i for i, line in enumerate(lines) if not line), len(lines))]
    return [shlex.split(re.split(r"\s{2,}", line)[0]) for line in lines]


# --- help -------------------------------------------------------------------------------------------------------


def test_help_is_there_at_once():
    def seconds():
        began = time.perf_counter()
        done = subprocess.run([sys.executable, "-m", "mjhcmc", "--help"], cwd=ROOT, capture_output=True, check=True)
        assert b"Examples:" in done.stdout
        return time.perf_counter() - began

    assert min(seconds() for _ in range(3)) < 0.5


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom mjhcmc.cli import main\n"
        "try:\n    main(['solve', '--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = ('mujoco', 'numpy', 'scipy', 'numba', 'pandas', 'pyarrow', 'qpsolvers', 'matplotlib', 'plotly', "
        "'viser', 'gymnasium', 'dm_control')\n"
        "print([name for name in heavy if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"


@pytest.mark.parametrize("group", [(), ("patients",)], ids=str)
def test_every_command_has_a_whole_line(run, group):
    text = run(*group, "--help").out
    assert "Examples:" in text
    listed = text.partition("Commands:")[2].partition("Examples:")[0]
    for name in (cli.commands["patients"] if group else cli).commands:
        line = next(line for line in listed.splitlines() if line.split()[:1] == [name])
        assert len(line.split()) > 2
        assert not line.endswith("...")


def test_examples_of_the_first_page_stay_apart_and_are_right(run):
    examples = examples_in(run().out)  # nothing typed: as --help
    assert len(examples) >= 5
    for program, *words in examples:
        assert program == "mjhcmc"
        assert takes(words)


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_command_has_examples_that_it_takes(words, run):
    outcome = run(*words, "-h")
    assert outcome.code == 0
    assert outcome.out.startswith(f"Usage: mjhcmc {' '.join(words)} ")
    examples = examples_in(outcome.out)
    assert examples, "an Example that stays formatted (click's \\b)"
    assert any(tuple(each[1 : 1 + len(words)]) == words for each in examples)
    for program, *typed in examples:
        assert program == "mjhcmc"
        assert takes(typed)


def takes(words) -> bool:
    """Whether the command line takes these words, up to doing it: options, arguments and their kinds."""
    group, rest, context = cli, list(words), click.Context(cli, **cli.context_settings)
    while isinstance(group, click.Group):
        group = group.commands[rest.pop(0)]
        context = click.Context(group, parent=context)
    group.make_context("example", rest, parent=context.parent).close()
    return True


# --- completion -------------------------------------------------------------------------------------------------


def offered(*words) -> list[tuple[str, str]]:
    """What a shell is offered for the last of these words."""
    found = ShellComplete(cli, {}, "mjhcmc", "_MJHCMC_COMPLETE").get_completions(list(words[:-1]), words[-1])
    return [(item.type, item.value) for item in found]


def plain(*words) -> set[str]:
    return {value for kind, value in offered(*words) if kind == "plain"}


def test_commands_and_options_complete():
    assert plain("") == set(cli.commands)
    assert plain("so") == {"solve"}
    assert plain("patients", "g") == {"generate", "grade"}
    assert {"--model", "--method", "--moments", "--map"} <= plain("solve", "--m")
    assert plain("completion", "") == set(SHELLS)


def test_values_complete():
    assert plain("solve", "--model", "") == set(assets.model_names())
    assert plain("check", "leg8_") == {"leg8_gait"}
    assert plain("solve", "--method", "s") == {"static"}
    assert plain("reproduce", "--movement", "") == {"fast", "slow"}
    assert plain("solve", "--curves", "") == set(muscle_choice.HILL_CURVES)


def test_files_complete():
    assert offered("solve", "wal") == [("file", "wal")]
    assert offered("solve", "walk.mot", "--osim", "") == [("file", "")]
    assert offered("solve", "--model", "./arm") == [("file", "./arm")]  # no shipped name begins like this


def test_parts_of_the_model_complete(tmp_path):
    assert plain("solve", "--disable", "gl") == {"glut_max"}
    assert plain("solve", "--track", "") == {"hip", "knee", "ankle"}
    assert "pelvis_tx" in plain("solve", "--osim", "subject.osim", "--prescribe", "")
    arm = tmp_path / "arm.xml"
    arm.write_text(
        "<mujoco><default><joint damping='1'/></default><worldbody><body><joint name='elbow'/></body></worldbody>"
        "<actuator><muscle name='biceps'/><muscle name='triceps'/></actuator></mujoco>"
    )
    assert plain("solve", "--model", str(arm), "--disable", "") == {"biceps", "triceps"}
    assert plain("solve", "--model", str(arm), "--free", "") == {"elbow"}
    for nothing in ("<mujoco>", "no model"):
        arm.write_text(nothing)
        assert plain("solve", "--model", str(arm), "--disable", "") == set()
    assert plain("view", "out", "--camera", "t") == {"top"}


def test_folders_complete_as_folders():
    for words in (("solve", "a.mot", "--out"), ("reproduce", "--out"), ("patients", "show")):
        assert offered(*words, "wal") == [("dir", "wal")]


def test_where_there_are_choices_help_does_not_say_text():
    for words, command in COMMANDS.items():
        for option in command.params:
            if isinstance(option, click.Option) and option.name in {"model", *VALUES}:
                assert option.metavar, f"{' '.join(words)} --{option.name}"


def test_values_are_those_of_the_library():
    assert VALUES["method"] == tuple(methods.METHODS)
    assert VALUES["cost"] == sharing.COSTS
    assert VALUES["muscle"] == muscle_choice.MUSCLES
    assert VALUES["curves"] == muscle_choice.HILL_CURVES
    assert VALUES["integrator"] == tuple(integrators.SCHEMES)
    assert VALUES["movement"] == tuple(cosine.COSINE_PERIODS)
    for solver in VALUES["solver"]:
        qp_back_ends.check_solver(solver)


def test_other_values_are_judged_by_the_library_as_before(run, mot, tmp_path):
    outcome = run("solve", mot(), "--method", "hcmcc", "--out", tmp_path / "out")
    assert outcome.code == 2
    assert outcome.errors == ["mjhcmc: error: unknown method 'hcmcc': choose one of hcmc, cmc, static"]


@pytest.mark.parametrize("shell", SHELLS)
def test_scripts_ask_the_program(run, shell):
    outcome = run("completion", shell)
    assert outcome.code == 0
    assert f"_MJHCMC_COMPLETE={shell}_complete" in outcome.out


def test_the_program_answers_a_shell(capsys, monkeypatch):
    """As bash asks: the words and which of them, in variables of the environment."""
    from mjhcmc.cli import main

    monkeypatch.setenv("_MJHCMC_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", "mjhcmc solve --method ")
    monkeypatch.setenv("COMP_CWORD", "3")
    with pytest.raises(SystemExit) as stop:
        main([])
    assert stop.value.code == 0
    assert capsys.readouterr().out.split() == ["plain,hcmc", "plain,cmc", "plain,static"]


@pytest.mark.parametrize("arguments", [("tcsh",), (), ("bash", "zsh"), ("--shell", "bash")])
def test_another_shell_is_one_line(run, arguments):
    outcome = run("completion", *arguments)
    assert outcome.code == 2
    assert len(outcome.errors) == 1
    if arguments == ("tcsh",):
        assert "'tcsh' is not one of 'bash', 'zsh', 'fish'" in outcome.errors[0]


@pytest.mark.parametrize("arguments", [("--thorogh",), ("now",)])
def test_the_doctor_takes_no_more(run, arguments):
    outcome = run("doctor", *arguments)
    assert outcome.code == 2
    assert len(outcome.errors) == 1


# --- an installation that is not whole -----------------------------------------------------------------------------


def test_a_package_that_is_missing_is_one_line(run, monkeypatch):
    monkeypatch.setattr("mjhcmc.muscle_choice.check_muscle", lambda *_: __import__("no_such_package"))
    outcome = run("reproduce", "--json")
    assert outcome.code == 2
    assert outcome.errors == [
        "mjhcmc: error: No module named 'no_such_package': mjhcmc doctor tells what is missing here, and how to "
        "install it"
    ]


def test_no_place_for_compiled_code_is_one_line(run, monkeypatch):
    def refuse(*_):
        raise RuntimeError("cannot cache function 'push': no locator available for file 'x.py'")

    monkeypatch.setattr("mjhcmc.muscle_choice.check_muscle", refuse)
    outcome = run("reproduce", "--json")
    assert outcome.code == 2
    assert len(outcome.errors) == 1
    assert outcome.errors[0].endswith("set NUMBA_CACHE_DIR to a folder that you may write to")


def test_a_gl_back_end_that_is_none_is_named_in_one_line():
    environment = {**os.environ, "MUJOCO_GL": "bogus"}
    done = subprocess.run(
        [sys.executable, "-m", "mjhcmc", "check", "leg8"], cwd=ROOT, capture_output=True, text=True, env=environment
    )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "MUJOCO_GL: bogus" in done.stderr
    assert "mjhcmc doctor" in done.stderr
