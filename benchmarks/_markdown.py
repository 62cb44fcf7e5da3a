"""What the benchmark scripts share: Markdown tables, and their place in a document."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from mjhcmc.io.files import written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
JOINTS = ("hip", "knee", "ankle")


def grid(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A Markdown table; all columns but the first to the right."""
    header = list(header)
    lines = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)])


def digits(value: float, n: int = 3) -> str:
    """n significant digits, without needless zeros; powers of ten only under 1e-4."""
    return f"{value:.{n}g}"


def marks(script: str) -> tuple[str, str]:
    """The comments in a document between which a script's tables stand."""
    return f"<!-- tables: benchmarks/{script} -->", f"<!-- end: benchmarks/{script} -->"


def into(document: str, script: str, tables: str) -> str:
    """The document with a script's tables replaced.

    Raises:
        SystemExit: the document has no place, or more than one, for them.
    """
    begin, end = marks(script)
    if document.count(begin) != 1 or document.count(end) != 1:
        raise SystemExit(f"the document needs {begin} and {end} once each")
    head, rest = document.split(begin)
    return f"{head}{begin}\n\n{tables}\n\n{end}{rest.split(end)[1]}"


def save_png(figure: Figure, path: Path) -> None:
    """Only the PNG of a figure."""
    from mjhcmc.plotting import save_figure

    with tempfile.TemporaryDirectory() as folder, written_whole(path) as temporary:
        temporary.write_bytes(save_figure(figure, Path(folder) / path.stem)[0].read_bytes())


def main(
    script: str,
    what: str,
    markdown: Callable[[], str],
    figures: Callable[[Path], None] | None = None,
    document: Path = ROOT / "docs" / "accuracy.md",
) -> None:
    """Print a script's tables; with --write put them into their document, and its figures beside it."""
    parser = argparse.ArgumentParser(prog=script, description=what)
    parser.add_argument(
        "--write",
        type=Path,
        nargs="?",
        const=document,
        metavar="DOCUMENT",
        help=f"put the tables into a document (docs/{document.name}), and the figures, if any, beside it",
    )
    path = parser.parse_args().write
    if path:
        into(path.read_text(encoding="utf-8"), script, "")  # refuse before the work begins
    tables = markdown()
    print(tables)
    if path:
        text = into(path.read_text(encoding="utf-8"), script, tables)
        with written_whole(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
        if figures is not None:
            figures(path.parent)
