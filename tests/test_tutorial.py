"""The tutorial can be typed as it says: its Python blocks at the prompt of ``python``, one after another."""

import code
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs" / "tools"))
from fences import ROOT, blocks


class Prompt(code.InteractiveConsole):
    """Reads what is typed as Python's own prompt does, and runs nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.refused: list[str] = []

    def runcode(self, code):
        """Not run: `pytest docs` does."""

    def showsyntaxerror(self, *args, **more):
        self.refused.append(str(sys.exc_info()[1]))


def typed(text: str) -> list[str]:
    """What the prompt refuses of a block, typed line by line, with one Enter more at its end."""
    prompt = Prompt()
    for line in text.splitlines():
        prompt.push(line)
    return prompt.refused + (["it waits for more"] if prompt.push("") else [])


PYTHON = [block for block in blocks(ROOT / "docs" / "tutorial.md") if block.language == "python"]


@pytest.mark.parametrize("block", PYTHON, ids=lambda block: block.place)
def test_a_block_can_be_typed(block):
    assert typed(block.text) == []


def test_the_prompt_refuses_what_pythons_own_does():
    assert typed("for k in range(2):\n    print(k)\nprint(3)\n") != []
    assert typed("f(\n") == ["it waits for more"]
    assert len(PYTHON) > 3
