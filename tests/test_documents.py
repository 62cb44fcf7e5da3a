"""What the documentation promises of itself, without running its blocks (`pytest docs` does that)."""

import re
import sys
from pathlib import Path

import pytest

import mjhcmc

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "tools"))
import fences  # noqa: E402

# Blocks that no run of the documentation reaches. One more must be worth it: the reason stands at the block.
NOT_RUN = 26
PAGES = sorted(path.relative_to(ROOT).as_posix() for path in fences.documents())


def test_blocks_are_found_as_a_reader_sees_them(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# Page\n\n<!-- not run: opens a window -->\n```bash\nmjhcmc view out/\n```\n\n1. point\n\n    ```python\n"
        "    a = 1\n    if a:\n        b = 2\n    ```\n\n~~~text\n```python\n~~~\n\n    bare\n    block\n"
    )
    found = fences.blocks(page)
    assert [(b.line, b.language, b.not_run) for b in found] == [
        (4, "bash", "opens a window"), (10, "python", None), (16, "text", None),
    ]  # fmt: skip
    assert found[1].text == "a = 1\nif a:\n    b = 2\n"
    assert [b.runs for b in found] == [False, True, False]
    assert fences.indented(page) == [20]
    page.write_text("```python\na = 1\n")
    with pytest.raises(ValueError, match=r"page\.md:1: this block is never closed"):
        fences.blocks(page)


@pytest.mark.parametrize("name", PAGES)
def test_every_block_has_a_language_and_every_exception_a_reason(name):
    for block in fences.blocks(ROOT / name):
        assert block.language in fences.RUN + fences.READ, f"{block.place}: {block.language or 'no language'}"
        if block.not_run is not None:
            assert len(block.not_run) > 3, f"{block.place}: no reason"
    assert not fences.indented(ROOT / name), "indented blocks have no language: fence them"
    comments = len(re.findall(r"^\s*<!-- not run:", (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE))
    assert comments == sum(block.not_run is not None for block in fences.blocks(ROOT / name)), (
        "a comment without a block"
    )


def test_few_blocks_are_not_run():
    found = [block for path in fences.documents() for block in fences.blocks(path)]
    left = [f"{block.place}: {block.not_run}" for block in found if block.language in fences.RUN and not block.runs]
    ran = [block for block in found if block.runs]
    assert len(left) <= NOT_RUN, "\n".join(left)
    assert len(ran) > 3 * len(left)


def test_every_public_name_is_documented_once():
    named = re.findall(r"^::: (\S+)$", "\n".join(p.read_text() for p in (DOCS / "api").glob("*.md")), re.MULTILINE)
    assert len(named) == len(set(named))
    homes = {f"mjhcmc.{home}.{name}" for name, home in mjhcmc._HOME.items()}
    assert set(mjhcmc._HOME) == set(mjhcmc.__all__)
    assert not homes - set(named), "not in docs/api"


@pytest.mark.parametrize("path", sorted(DOCS.rglob("*.png")), ids=lambda path: path.name)
def test_every_figure_is_made_by_a_script_and_shown(path):
    sources = [p.read_text(encoding="utf-8") for p in (ROOT / "benchmarks").glob("*.py")]
    assert any(f'"{path.name}"' in source for source in sources), "no benchmark writes this figure"
    assert any(f"{path.name})" in (ROOT / name).read_text(encoding="utf-8") for name in PAGES), "no page shows it"


def test_the_page_of_validation_is_as_new_as_the_others(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import _markdown
    import validation

    begin, end = _markdown.marks("validation.py")
    written = (DOCS / "validation.md").read_text(encoding="utf-8").partition(begin)[2].partition(end)[0].strip()
    assert written == validation.markdown(), "run python benchmarks/validation.py --write"


def test_claims_are_judged_row_by_row(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import validation

    claim = validation.Claim("Size", "small.", "page", "a.py", 0, "x", validation.below(1, "x"))
    table = "| case | x |\n|---|---:|\n| one | 0.5 |\n| two | 2 |\n| three | – |\n| four | 1/1.2e-3 |"
    assert validation.judged(claim, table) == (["two"], 3)
    with pytest.raises(SystemExit, match="no row"):
        validation.judged(claim, "| case | x |\n|---|---:|\n| one |  |")
    reached = validation.Claim("Aim", "met.", "page", "a.py", 0, "x", validation.reached)
    table = "| case | x |\n|---|---:|\n| one | 0.5 (reached) |\n| two | 2 (not reached) |\n| three | 5 |"
    assert validation.judged(reached, table) == (["two"], 2)
    rho = validation.Claim("r", "high.", "page", "a.py", 0, "r", validation.correlates("r", 0.9))
    table = "| muscle | r |\n|---|---:|\n| a | 0.95, 0.010 |\n| b | –, 0.003 |\n| c | 0.5, 0.9 |\n| **median** | 0.2 |"
    assert validation.judged(rho, table) == (["c"], 2)
    assert validation.numbers("−1,060 of 3e-4") == [-1060.0, 3e-4]
