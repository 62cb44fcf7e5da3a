"""Every code block of the documentation runs: ``pytest docs``, apart from the tests, since it takes minutes.

A document is one test. Its blocks run in order, in a folder that is empty but for the files that `tools/folder.py`
makes for the document: bash blocks by ``bash -euo pipefail``, Python blocks with the names of those before, as if a
reader typed them in. Where a page says what a block prints, that is compared. What needs OpenGL is left out where there
is none, and the document then counts as skipped; not so where MJHCMC_REQUIRE_BROWSER says that it was installed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import types
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "tools"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from fences import ROOT, Block, blocks, documents
from folder import prepare
from needs import missing

LONGEST = 180  # s, for one bash block
NO_OPENGL = "pictures cannot be drawn"  # how mjhcmc says it

TO_RUN = {path.relative_to(ROOT).as_posix(): path for path in documents() if any(b.runs for b in blocks(path))}


@pytest.fixture(scope="session")
def commands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `mjhcmc` and `python` of the interpreter that runs the tests, to come first on PATH."""
    folder = tmp_path_factory.mktemp("bin")
    for name, arguments in (("mjhcmc", "-m mjhcmc "), ("python", ""), ("python3", "")):
        script = folder / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments}"$@"\n')
        script.chmod(0o755)
    return folder


@pytest.mark.filterwarnings("default::mjhcmc.errors.MjhcmcWarning")
@pytest.mark.parametrize("name", TO_RUN)
def test_blocks_run(
    name: str, tmp_path: Path, commands: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The blocks of one document, in order."""
    found = [block for block in blocks(TO_RUN[name]) if block.runs or block.printed]
    left_out = []
    prepare(name, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{commands}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("MPLBACKEND", "agg")
    namespace = types.ModuleType("__main__")  # what is typed in lives in a module: dataclasses look for it
    printed: str | None = None
    for block in found:
        if block.printed:
            assert printed is None or printed == block.text, f"{block.place}: printed is now\n{printed}"
        elif block.language == "bash":
            printed = run_bash(block, tmp_path)
            if printed is None:
                left_out.append(f"{block.place} needs {block.needs}")
            capfd.readouterr()
        else:
            run_python(block, namespace)
            printed = capfd.readouterr().out
    shutil.rmtree(tmp_path)
    if left_out:
        missing(", ".join(left_out))


def run_bash(block: Block, folder: Path) -> str | None:
    """Run a block as a script that ends at the first error.

    Returns:
        What it prints; None where it needs OpenGL, says so, and there is none.
    """
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block.text],
        cwd=folder, capture_output=True, text=True, timeout=LONGEST, stdin=subprocess.DEVNULL, check=False,
    )  # fmt: skip
    if done.returncode and block.needs == "OpenGL" and NO_OPENGL in done.stderr:
        return None
    if done.returncode:
        pytest.fail(
            f"{block.place}: exit code {done.returncode}\n{block.text}\n{done.stdout[-2000:]}{done.stderr}", False
        )
    return done.stdout


def run_python(block: Block, namespace: types.ModuleType) -> None:
    """Run a block among the names of those before."""
    try:
        code = compile("\n" * block.line + block.text, str(block.document), "exec")  # the document's own line numbers
        exec(code, namespace.__dict__)
    except Exception as error:
        error.add_note(f"in the block at {block.place}")
        raise
