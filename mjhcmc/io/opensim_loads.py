"""OpenSim's XML, read without OpenSim: external loads, and the names of a model's bodies."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

from mjhcmc.errors import MotionError
from mjhcmc.io.columns import listed
from mjhcmc.io.xml import NoDoctype

_NONE = ("", "unassigned")  # in small letters: how OpenSim writes that a text is not given
_YES, _NO = ("true", "1"), ("false", "0")


@dataclass(frozen=True)
class LoadEntry:
    """One load as a file describes it: names of bodies and of columns, still the file's.

    Attributes:
        label: what the file calls it.
        body: body that it acts on.
        force: the beginning of the three columns' names, or the three names; None where there is no force.
        point: likewise of the point; None: the body's origin.
        torque: likewise of the free torque; None: none.
        force_frame: body in whose frame force and torque are; "ground" is the ground.
        point_frame: likewise of the point.
        source: the data source that the load itself names, or empty.
        is_disabled: True where the file switches it off.
    """

    label: str
    body: str
    force: str | tuple[str, ...] | None
    point: str | tuple[str, ...] | None = None
    torque: str | tuple[str, ...] | None = None
    force_frame: str = "ground"
    point_frame: str = "ground"
    source: str = ""
    is_disabled: bool = False


@dataclass(frozen=True)
class LoadsDocument:
    """What an external-loads file says.

    Attributes:
        path: the file.
        entries: its loads, in order; at least one.
        datafile: the table that it names, as written; empty where it names none.
    """

    path: Path
    entries: tuple[LoadEntry, ...]
    datafile: str


def read_loads_xml(path: Path) -> LoadsDocument:
    """Read an OpenSim external-loads file (ExternalLoads of ExternalForce, OpenSim 2.3.1 and later).

    Raises:
        MotionError: the file cannot be read, is no XML or declares entities, has no loads, or a load names no body or
            neither force nor torque.
    """
    root = _root(path, "an OpenSim external-loads file")
    found = next(root.iter("ExternalLoads"), None)
    if found is None:
        inside = [child.tag for child in root] if root.tag == "OpenSimDocument" else [root.tag]
        remedy = "give the model as osim, and its loads here" if "Model" in inside else "give an ExternalLoads file"
        raise MotionError(f"{path}: no ExternalLoads, but {listed(inside) or 'nothing'}: {remedy}")
    old = next(found.iter("PrescribedForce"), None)
    if old is not None:
        raise MotionError(
            f"{path}: load {old.get('name', '')!r} is a PrescribedForce, as before OpenSim 2.3.1: load and save the "
            "file with a newer OpenSim"
        )
    entries = tuple(_entry(path, i, node) for i, node in enumerate(found.iter("ExternalForce"), 1))
    if not entries:
        raise MotionError(f"{path}: its ExternalLoads hold no ExternalForce: add one a loaded body")
    own = found.find("datafile")
    return LoadsDocument(path, entries, "" if own is None else _given(own.text))


def read_body_names(path: Path) -> tuple[str, ...]:
    """Names of the bodies of an OpenSim model, without the ground.

    Raises:
        MotionError: the file cannot be read, is no XML, or has no bodies.
    """
    root = _root(path, "an OpenSim model")
    names = [node.get("name", "") for bodies in root.iter("BodySet") for node in bodies.iter("Body")]
    names = [name for name in names if name and name != "ground"]
    if not names:
        raise MotionError(f"{path}: no BodySet with bodies: give an OpenSim model (.osim) as osim")
    return tuple(names)


def bare_name(name: str) -> str:
    """A component's own name out of a path such as /bodyset/calcn_r."""
    return name.rstrip("/").rpartition("/")[2]


def _root(path: Path, what: str) -> ET.Element:
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise MotionError(f"{path}: no such file: check the path") from None
    except IsADirectoryError:
        raise MotionError(f"{path}: is a folder: name a file in it") from None
    except OSError as error:
        raise MotionError(f"{path}: cannot be read ({error.strerror}): check its permissions") from error
    if not raw.strip():
        raise MotionError(f"{path}: the file is empty: write it again")
    try:
        return ET.fromstring(raw, parser=ET.XMLParser(target=NoDoctype()))
    except ET.ParseError as error:
        line, column = error.position
        why = str(error).partition(":")[0]
        raise MotionError(
            f"{path}, line {line}, column {column + 1}: not sound XML ({why}): give {what}, or write it again"
        ) from None
    except (ValueError, LookupError) as error:
        why = " ".join(str(error).split())
        raise MotionError(f"{path}: cannot be taken as XML ({why}): give {what}, in UTF-8, without DOCTYPE") from None


def _entry(path: Path, i: int, node: ET.Element) -> LoadEntry:
    label = node.get("name") or f"load {i}"
    text = {child.tag: _given(child.text) for child in node}
    body = bare_name(text.get("applied_to_body", ""))
    if not body:
        raise MotionError(f"{path}: load {label!r} names no body: write it in applied_to_body")
    force, point, torque = (text.get(f"{kind}_identifier") or None for kind in ("force", "point", "torque"))
    if force is None and torque is None:
        raise MotionError(
            f"{path}: load {label!r} on {body!r} names neither force nor torque: write the beginning of the columns' "
            "names in force_identifier"
        )
    return LoadEntry(
        label,
        body,
        force,
        point if force else None,
        torque,
        bare_name(text.get("force_expressed_in_body", "")) or "ground",
        bare_name(text.get("point_expressed_in_body", "")) or "ground",
        text.get("data_source_name", ""),
        _flag(path, label, text, "isDisabled", False) or not _flag(path, label, text, "appliesForce", True),
    )


def _flag(path: Path, label: str, text: dict[str, str], key: str, default: bool) -> bool:
    word = text.get(key, "").lower()
    if word and word not in (*_YES, *_NO):
        raise MotionError(f"{path}: load {label!r} has {key} {text[key]!r}: write true or false")
    return word in _YES if word else default


def _given(text: str | None) -> str:
    """A text without blanks around it; empty where it says that nothing is given."""
    word = (text or "").strip()
    return "" if word.lower() in _NONE else word
