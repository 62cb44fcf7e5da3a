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
NOT_RUN = 21
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
    page.write_text(
        "<!-- needs: OpenGL -->\n```bash\nmjhcmc view out/ --image a.png\n```\nIt prints:\n\n```text\nmjhcmc 1\n```\n\n"
        "The blueprints\n```text\n$ mjhcmc view out/\n```\n```text\ntwo\npip install .\n```\n```text\na = mjhcmc\n```\n"
    )
    found = fences.blocks(page)
    assert [(b.needs, b.runs, b.printed, b.hides_commands) for b in found] == [
        ("OpenGL", True, False, False), (None, False, True, False), (None, False, False, True),
        (None, False, False, True), (None, False, False, False),
    ]  # fmt: skip
    page.write_text("```python\na = 1\n")
    with pytest.raises(ValueError, match=r"page\.md:1: this block is never closed"):
        fences.blocks(page)


@pytest.mark.parametrize("name", PAGES)
def test_every_block_has_a_language_and_every_exception_a_reason(name):
    found = fences.blocks(ROOT / name)
    for before, block in zip([None, *found], found, strict=False):
        assert block.language in fences.RUN + fences.READ, f"{block.place}: {block.language or 'no language'}"
        assert not block.hides_commands, f"{block.place}: commands in a block of text are never run: call it bash"
        assert block.needs in (None, "OpenGL"), f"{block.place}: nothing looks whether there is {block.needs}"
        assert not block.printed or (before is not None and before.runs), f"{block.place}: nothing runs that prints it"
        if block.not_run is not None:
            assert len(block.not_run) > 3, f"{block.place}: no reason"
    assert not fences.indented(ROOT / name), "indented blocks have no language: fence them"
    comments = re.findall(r"^\s*<!-- (?:not run|needs):", (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    assert len(comments) == sum(block.not_run is not None or block.needs is not None for block in found), (
        "a comment without a block"
    )


def test_only_a_block_that_needs_opengl_is_left_out_where_there_is_none(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(DOCS))
    import test_blocks

    def run(text, needs):
        return test_blocks.run_bash(fences.Block(DOCS / "install.md", 1, "bash", text, None, needs), tmp_path)

    none = f"echo 'Error: {test_blocks.NO_OPENGL}: there is no display' >&2; exit 2"
    assert run("echo drawn", "OpenGL") == "drawn\n"
    assert run(none, "OpenGL") is None
    for text, needs in ((none, None), ("echo broken >&2; exit 2", "OpenGL")):
        with pytest.raises(pytest.fail.Exception, match="exit code 2"):
            run(text, needs)


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


@pytest.fixture
def validation(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import validation

    return validation


def a_claim(validation, has, holds, *limits, **more):
    return validation.Claim("Size", "at most {0}.", "page", "a.py", 0, has, holds, limits, **more)


def table(column, *values):
    """One row a value, named a, b, c, ..."""
    rows = (f"| {chr(97 + i)} | {value} |" for i, value in enumerate(values))
    return "\n".join([f"| muscle | {column} |", "|---|---:|", *rows])


def test_claims_are_judged_row_by_row(validation):
    small = a_claim(validation, "x", validation.below("x"), 1, silent="it is not there")
    found = validation.judged(small, table("x", "0.5", "2", "–", "1/1.2e-3", "0.5/3", "", "-5"))
    assert (found.met, found.missed, found.unasked) == (["a", "d", "g"], ["b", "e"], ["c", "f"])
    with pytest.raises(SystemExit, match="no row"):
        validation.judged(small, table("x", "", "–"))
    aims = a_claim(validation, "x", validation.reached("x"))
    found = validation.judged(aims, table("x", "0.5 (reached)", "2 (not reached)", "3 (MISSED)", "5"))
    assert (found.met, found.missed, found.unasked) == (["a"], ["b", "c", "d"], [])
    alike = a_claim(validation, "r", validation.correlates("r"), 0.9, about=validation.of_a_muscle, silent="it rests")
    rows = table("r", "0.95, 0.010", "–, 0.003", "0.5, 0.9", "1.00, 0.2") + "\n| **median** | 0.2 |"
    found = validation.judged(alike, rows)
    assert (found.met, found.missed, found.unasked) == (["a", "d"], ["c"], ["b"])
    between = a_claim(validation, "x", validation.first_within("x"), 0.6, 0.8)
    assert validation.judged(between, table("x", "0.5", "0.6", "0.8 (9)", "0.81")).met == ["b", "c"]
    assert validation.numbers("**−10/3e-4**") == [-10.0, 3e-4]


@pytest.mark.parametrize(
    "cell", ["nan", "NaN", "inf", "-inf", "failed", "?", "n/a", "none", "nan, 0.2", "inf (0)", "no 0.2"]
)
def test_what_is_no_number_fails_a_claim(cell, validation):
    """Whatever a script writes where it found nothing must not pass for a row that was not asked."""
    for holds in (validation.below("x"), validation.first_within("x"), validation.correlates("x")):
        claim = a_claim(validation, "x", holds, 0.7, silent="it is not there")
        good = "0.7"
        found = validation.judged(claim, table("x", good, cell, "–"))
        assert (found.met, found.missed, found.unasked) == (["a"], ["b"], ["c"])
    assert validation.judged(
        a_claim(validation, "x", validation.reached("x")), table("x", "1 (reached)", f"{cell} (reached)")
    ).missed == ["b"]
    row = {"computes in": "float64"} | {f"{m} {w}": "1e-15" for m in ("leg8", "oblique") for w in ("M", "bias", "tau")}
    assert validation.engines_agree(row, 1e-9, 1e-4) is True
    assert validation.engines_agree(row | {"oblique M": cell}, 1e-9, 1e-4) is False
    assert validation.as_exact({"MuJoCo RK4": "1e-3", "RK4, 60 digits": "1e-3"}, 1.1, 1e-11) is True
    assert validation.as_exact({"MuJoCo RK4": cell, "RK4, 60 digits": "1e-3"}, 1.1, 1e-11) is False
    assert validation.as_exact({"MuJoCo RK4": "1e-12", "RK4, 60 digits": cell}, 1.1, 1e-11) is False


def test_engines_are_held_to_their_precision(validation):
    row = {f"{m} {w}": "1e-6" for m in ("leg8", "oblique") for w in ("M", "bias", "tau")} | {"": "agrees"}
    assert validation.engines_agree(row | {"computes in": "float32"}, 1e-9, 1e-4) is True
    assert validation.engines_agree(row | {"computes in": "float64"}, 1e-9, 1e-4) is False


def test_a_page_says_what_was_not_asked_and_takes_its_limits_from_the_test(validation):
    rows = table("x", "0.5", "–")
    with pytest.raises(SystemExit, match="say nothing, and no reason is given: b"):
        validation.judged(a_claim(validation, "x", validation.below("x"), 0.7), rows)
    claim = a_claim(validation, "x", validation.below("x"), 0.7, silent="it rests", told=lambda row: f"{row['x']} of 9")
    text = validation.section(claim, validation.judged(claim, rows), rows)
    assert "at most .7. **Holds** in all 1 rows. Not asked: b, where it rests. Left out: 0.5 of 9; – of 9." in text
    assert [validation.plain(limit) for limit in (0.9, 1e-9, 2, 0.01, 1e-11)] == [".9", "1e-9", "2", ".01", "1e-11"]
    for claim in validation.CLAIMS:
        typed = re.sub(r"\{\d\}|60 digits|RK4|leg8|90 %", "", claim.words)
        assert not re.search(r"\d", typed), f"{claim.title}: a number that is no limit of its test"
        assert claim.words.format(*claim.limits).count("{") == 0
        assert {int(i) for i in re.findall(r"\{(\d)\}", claim.words)} == set(range(len(claim.limits))), claim.title
