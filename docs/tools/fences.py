"""The code blocks of a Markdown document: where each is, in which language, and why it is not run, if it is not.

A block that cannot run stands after a comment with the reason, and nothing between them:

    <!-- not run: opens a window -->

One that runs where something is installed that not every computer has stands after

    <!-- needs: OpenGL -->

Languages that run are bash and python; text, json, xml and the like are to be read. A text block after a line that ends
in "prints" or "prints:" is what the block before it prints, to the letter.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RUN = ("bash", "python")
READ = ("text", "json", "xml", "csv", "r", "matlab", "yaml", "toml")

_FENCE = re.compile(r"^(?P<indent> *)(?P<fence>`{3,}|~{3,})(?P<info>.*)$")
_COMMENT = re.compile(r"^\s*<!-- (?P<kind>not run|needs):(?P<words>.*)-->\s*$")
_PRINTS = re.compile(r"\bprints:?\s*$")
_COMMAND = re.compile(r"^\s*(?:\$ )?(?:mjhcmc|pip|python3?) ", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block of a document.

    Attributes:
        document: the file.
        line: of the opening fence, from 1.
        language: what stands after the fence, empty if nothing does.
        text: what is inside, without the fence's own indentation.
        not_run: the reason of the comment before it; None where there is no such comment.
        needs: what the comment before it says that it needs; None where there is no such comment.
        printed: whether it is what the block before it prints.
    """

    document: Path
    line: int
    language: str
    text: str
    not_run: str | None
    needs: str | None = None
    printed: bool = False

    @property
    def hides_commands(self) -> bool:
        """Whether it is text, and so never run, and has commands in it."""
        return self.language == "text" and not self.printed and _COMMAND.search(self.text) is not None

    @property
    def runs(self) -> bool:
        """Whether it is to be run."""
        return self.language in RUN and self.not_run is None

    @property
    def place(self) -> str:
        """Document and line, as editors know to open them."""
        return f"{self.document.relative_to(ROOT).as_posix()}:{self.line}"


def documents() -> list[Path]:
    """README, CONTRIBUTING, and every page of docs."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(document: Path) -> list[Block]:
    """The fenced blocks of a document, in order.

    Raises:
        ValueError: a fence is never closed.
    """
    found = []
    lines = document.read_text(encoding="utf-8").splitlines()
    k = 0
    while k < len(lines):
        opening = _FENCE.match(lines[k])
        if opening is None:
            k += 1
            continue
        indent, fence = opening["indent"], opening["fence"]
        end = next((j for j in range(k + 1, len(lines)) if lines[j].strip() == fence), None)
        if end is None:
            raise ValueError(f"{document.name}:{k + 1}: this block is never closed with {fence}")
        comment = _COMMENT.match(lines[k - 1]) if k else None
        said = {comment["kind"]: comment["words"].strip()} if comment else {}
        text = "\n".join(line.removeprefix(indent) for line in lines[k + 1 : end]) + "\n"
        language = opening["info"].strip()
        above = next((line for line in reversed(lines[:k]) if line.strip()), "")
        printed = language == "text" and _PRINTS.search(above) is not None
        found.append(Block(document, k + 1, language, text, said.get("not run"), said.get("needs"), printed))
        k = end + 1
    return found


def indented(document: Path) -> list[int]:
    """Lines that begin an indented code block: without a language, so nobody can say whether they run."""
    lines = document.read_text(encoding="utf-8").splitlines()
    inside: set[int] = set()
    for block in blocks(document):
        inside.update(range(block.line - 1, block.line + block.text.count("\n") + 1))
    return [
        k + 1
        for k, line in enumerate(lines)
        if k not in inside and line.startswith("    ") and line.strip() and not (k and lines[k - 1].strip())
    ]
