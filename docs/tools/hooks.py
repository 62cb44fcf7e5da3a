"""What MkDocs is told beyond mkdocs.yml: pages made from files of the repository, so that no text is there twice.

README.md is the front page; CONTRIBUTING.md, CHANGELOG.md and benchmarks/README.md are pages, the examples are one.
`docs/command-line.md` gets the help of every command. Links to files that are no page become plain names.
"""

from __future__ import annotations

import posixpath
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    import click

ROOT = Path(__file__).resolve().parents[2]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "benchmarks/README.md": "benchmarks.md",
}
COMMANDS = re.compile(r"<!-- commands -->.*<!-- end: commands -->", re.DOTALL)
NAMES = {"emg": "EMG", "hill": "Hill", "mujoco": "MuJoCo", "myosuite": "MyoSuite"}

_LINK = re.compile(r"(?P<image>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<target>[^)\s]+)\)")
_PATH = re.compile(r"(?:docs/)?[\w/-]+\.md")
_FENCED = re.compile(r"^(```.*?^```)$", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that lie elsewhere in the repository."""
    for source, page in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=text))
    files.append(File.generated(config, "examples.md", content=examples()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Links as the site needs them, and the help of the commands."""
    home = {target: source for source, target in PAGES.items()}
    where = home.get(page.file.src_uri, posixpath.join("docs", page.file.src_uri))
    markdown = COMMANDS.sub(lambda _: command_line(), markdown)
    parts = _FENCED.split(markdown)  # code stays as it is
    return "".join(part if part.startswith("```") else relink(part, where, page.file.src_uri, files) for part in parts)


def relink(text: str, where: str, page: str, files: Files) -> str:
    """The text of a repository file `where`, its relative links as seen from the page `page` of the site."""

    def link(found: re.Match[str]) -> str:
        target, _, anchor = found["target"].partition("#")
        if not target or "://" in target or target.startswith("mailto:"):
            return found[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(where), target))
        if not (ROOT / path).exists():
            return found[0]  # strict mode will tell
        uri = page_of(path)
        if uri is None or files.get_file_from_path(uri) is None:
            return found["text"] if "`" in found["text"] else f"`{path}`"
        text = name_of(found["text"])
        seen = posixpath.relpath(uri, posixpath.dirname(page) or ".")
        anchor = example_anchor(path) if uri == "examples.md" else anchor
        return f"{found['image']}[{text}]({seen}{'#' + anchor if anchor else ''})"

    return _LINK.sub(link, text)


def name_of(text: str) -> str:
    """A link's text; where it is a file's path, what readers of the site call that page."""
    return text.removeprefix("docs/").removesuffix(".md") if _PATH.fullmatch(text) else text


def page_of(path: str) -> str | None:
    """The page of the site that shows a file of the repository; None where there is none."""
    if path in PAGES:
        return PAGES[path]
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    return "examples.md" if path.split("/")[0] == "examples" else None


def example_anchor(path: str) -> str:
    """Where an example stands on the page of examples."""
    return Path(path).stem.replace("_", "-") if path.endswith(".py") else ""


def examples() -> str:
    """All examples, one after the other."""
    parts = ["# Examples", "Each is a script of its own in the folder `examples/`, and the tests run it."]
    for path in sorted((ROOT / "examples").glob("*.py")):
        title = " ".join(NAMES.get(word, word) for word in path.stem[3:].split("_"))
        heading = f"## {title[0].upper()}{title[1:]} {{ #{example_anchor(path.name)} }}"
        parts += [heading, f"`examples/{path.name}`", f"```python\n{path.read_text(encoding='utf-8')}```"]
    return "\n\n".join(parts)


def command_line() -> str:
    """The help of every command, as it prints itself."""
    sys.path.insert(0, str(ROOT))
    try:
        from mjhcmc.cli import cli
    finally:
        sys.path.pop(0)
    return "\n\n".join(_help(cli, "mjhcmc", None))


def _help(command: click.Command, name: str, parent: click.Context | None) -> list[str]:
    import click

    context = click.Context(command, info_name=name, parent=parent, terminal_width=96, max_content_width=96,
                            help_option_names=["-h", "--help"])  # fmt: skip
    parts = [f"## {context.command_path}", f"```text\n{command.get_help(context).rstrip()}\n```"]
    if isinstance(command, click.Group):
        for sub in command.list_commands(context):
            found = command.get_command(context, sub)
            if found is not None and not found.hidden:
                parts += _help(found, sub, context)
    return parts
