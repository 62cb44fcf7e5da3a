"""The XML of an OpenSim document: parsed safely, and its elements read with messages that name them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from mjhcmc.errors import ModelError
from mjhcmc.io.osim_functions import (
    CubicSpline,
    OsimFunction,
    PiecewiseLinear,
    Polynomial,
    Scaled,
    UnknownFunction,
)
from mjhcmc.io.xml import NoDoctype

_SPLINES = ("SimmSpline", "NaturalCubicSpline", "natCubicSpline")


def parse_document(path: Path) -> tuple[ET.Element, int]:
    """The root of an OpenSim document, and its version (20303, 30000, 40000 ...).

    Raises:
        ModelError: the file is missing, cannot be read, is not XML, or not an OpenSim document.
    """
    remedy = "give a model that OpenSim saved (.osim)"
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise ModelError(f"{path}: no such file: check the path") from None
    except IsADirectoryError:
        raise ModelError(f"{path}: is a folder: name the .osim file in it") from None
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({error.strerror}): check its permissions") from error
    try:
        parser = ET.XMLParser(target=NoDoctype())
        parser.feed(raw)
        root: ET.Element = parser.close()
    except (ET.ParseError, ValueError, LookupError) as error:  # LookupError: an encoding that nobody knows
        raise ModelError(f"{path}: not XML that can be read ({' '.join(str(error).split())}): {remedy}") from None
    if root.tag != "OpenSimDocument":
        raise ModelError(f"{path}: its root element is {root.tag}, not OpenSimDocument: {remedy}")
    version = root.get("Version", "")
    if not version.isdigit():
        raise ModelError(f"{path}: OpenSimDocument has the version {version!r}: {remedy}")
    return root, int(version)


@dataclass(frozen=True)
class Reader:
    """Reads the elements of one document.

    Attributes:
        path: The file, for messages.
    """

    path: Path

    def error(self, element: ET.Element, problem: str, remedy: str) -> ModelError:
        """An error that names the file and the element."""
        return ModelError(f"{self.path}: {label(element)}: {problem}: {remedy}")

    def text(self, element: ET.Element, *tags: str, default: str | None = None) -> str:
        """The text of the first child with one of the tags.

        Raises:
            ModelError: there is none, and no default.
        """
        for tag in tags:
            child = element.find(tag)
            if child is not None:
                return (child.text or "").strip()
        if default is None:
            raise self.error(element, f"no {tags[0]}", "save the model with OpenSim again")
        return default

    def numbers(
        self, element: ET.Element, *tags: str, count: int | None = None, default: tuple[float, ...] | None = None
    ) -> tuple[float, ...]:
        """The finite numbers in the first child with one of the tags.

        Raises:
            ModelError: there is none and no default, or it does not hold so many finite numbers.
        """
        if default is not None and all(element.find(tag) is None for tag in tags):
            return default
        words = self.text(element, *tags).split()
        try:
            values = tuple(float(word) for word in words)
        except ValueError:
            values = (math.nan,)
        if not values or not all(math.isfinite(value) for value in values) or (count or len(values)) != len(values):
            shown = " ".join(words)[:60]
            wanted = "numbers" if count is None else "one number" if count == 1 else f"{count} numbers"
            raise self.error(element, f"{tags[0]} is {shown!r}", f"write {wanted}")
        return values

    def number(self, element: ET.Element, *tags: str, default: float | None = None) -> float:
        """The one number in the first child with one of the tags; errors as `numbers`."""
        return self.numbers(element, *tags, count=1, default=None if default is None else (default,))[0]

    def positive(self, element: ET.Element, *tags: str, default: float | None = None) -> float:
        """A number that must be over zero.

        Raises:
            ModelError: it is missing without default, no number, or not over zero.
        """
        value = self.number(element, *tags, default=default)
        if value <= 0:
            raise self.error(element, f"{tags[0]} is {value:g}", "give a number over zero")
        return value

    def vector(
        self, element: ET.Element, *tags: str, default: tuple[float, float, float] | None = None
    ) -> tuple[float, float, float]:
        """Three numbers; errors as `numbers`."""
        x, y, z = self.numbers(element, *tags, count=3, default=default)
        return x, y, z

    def function(self, element: ET.Element) -> OsimFunction:
        """The function that an element is.

        Raises:
            ModelError: its numbers are missing or make no function.
        """
        tag = element.tag
        if tag == "Constant":
            return Polynomial((self.number(element, "value", default=0.0),))
        if tag in ("LinearFunction", "PolynomialFunction"):
            return Polynomial(self.numbers(element, "coefficients"))
        if tag == "MultiplierFunction":
            inner = element.find("function")
            parts = [] if inner is None else list(inner)
            if len(parts) != 1:
                raise self.error(element, "no function in it", "save the model with OpenSim again")
            return Scaled(self.function(parts[0]), self.number(element, "scale", default=1.0))
        if tag in _SPLINES or tag == "PiecewiseLinearFunction":
            x, y = self.numbers(element, "x"), self.numbers(element, "y")
            rising = all(a < b for a, b in pairwise(x))
            if len(x) != len(y) or len(x) < 2 or not rising:
                raise self.error(
                    element, f"{len(x)} x and {len(y)} y", "write at least two of each, as many x as y, x rising"
                )
            return CubicSpline(x, y) if tag in _SPLINES else PiecewiseLinear(x, y)
        return UnknownFunction(str(self.path), tag)

    def function_in(self, element: ET.Element) -> OsimFunction | None:
        """The function that an element holds, or None where it holds none.

        Since version 4 it is a child named ``function``, before that the only child of the child ``function``; a
        path point's is the only child of ``x_location`` and the like.
        """
        holder = element.find("function")
        if holder is not None:
            children = list(holder)
            return self.function(children[0]) if len(children) == 1 else None
        for child in element:
            if (
                child.get("name") == "function"
                or child.tag.endswith("Function")
                or child.tag in (*_SPLINES, "Constant")
            ):
                return self.function(child)
        return None


def label(element: ET.Element) -> str:
    """What messages call an element: its tag, and its name where it has one."""
    name = element.get("name")
    return f"{element.tag} {name}" if name else str(element.tag)


def last_word(path: str) -> str:
    """The name at the end of a component path, ``/bodyset/pelvis`` or ``../pelvis`` or ``pelvis``."""
    return path.strip().rstrip("/").rsplit("/", 1)[-1]
