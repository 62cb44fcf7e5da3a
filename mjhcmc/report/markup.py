"""Pieces of HTML: everything that came from outside is escaped here, once."""

from __future__ import annotations

import html
import json
from collections.abc import Iterable, Sequence
from typing import Any


class Html(str):
    """Text that is HTML already; any other text is escaped where it is put in."""

    __slots__ = ()


def escaped(text: object) -> Html:
    """The text as HTML; what is HTML stays as it is."""
    return text if isinstance(text, Html) else Html(html.escape(str(text), quote=True))


def joined(parts: Iterable[object], between: str = "\n") -> Html:
    """Parts after each other, each escaped where it has to be."""
    return Html(between.join(escaped(part) for part in parts))


def element(name: str, *content: object, **attributes: object) -> Html:
    """``<name attributes>content</name>``.

    Attributes lose a trailing ``_`` and have ``-`` for other ``_``; True stands alone, None and False are left out.
    """
    words = [name]
    for key, value in attributes.items():
        attribute = key.rstrip("_").replace("_", "-")
        if value is True:
            words.append(attribute)
        elif value is not None and value is not False:
            words.append(f'{attribute}="{html.escape(str(value), quote=True)}"')
    return Html(f"<{' '.join(words)}>{joined(content, '')}</{name}>")


def table(
    head: Sequence[object], rows: Iterable[Sequence[object]], caption: str, *, numeric: bool = True
) -> Html:  # fmt: skip
    """A table that scrolls by itself where it is too wide; the first column heads its rows.

    Args:
        head: titles of the columns.
        rows: cells.
        caption: what the table tells.
        numeric: whether the cells after the first are numbers, and stand at the right.
    """
    top = element("tr", *(element("th", cell, scope="col") for cell in head))
    body = [
        element("tr", element("th", row[0], scope="row"), *(element("td", cell) for cell in row[1:])) for row in rows
    ]
    return element(
        "div",
        element(
            "table",
            element("caption", caption), element("thead", top), element("tbody", *body),
            class_="numbers" if numeric else "words",
        ),
        class_="scroll", tabindex="0", role="region", aria_label=caption,
    )  # fmt: skip


def paragraphs(*texts: object) -> Html:
    """A paragraph each, empty ones left out."""
    return joined(element("p", text) for text in texts if text)


def bullets(texts: Iterable[object], class_: str | None = None) -> Html:
    """A list; empty where there is nothing to list."""
    items = [element("li", text) for text in texts]
    return element("ul", *items, class_=class_) if items else Html("")


def section(name: str, title: str, *content: object) -> Html:
    """A section of the page under a heading of second order, for the table of contents to lead to."""
    return element(
        "section", element("h2", title, id=f"{name}-title"), *content, id=name, aria_labelledby=f"{name}-title"
    )


def json_in_script(name: str, value: Any) -> Html:
    """Data for scripts: no ``<``, ``>`` or ``&`` is left that could end the element; NaN is refused."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Html(f'<script type="application/json" id="{html.escape(name, quote=True)}">{text}</script>')
