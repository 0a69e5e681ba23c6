"""Elements, attributes and numbers of a robot description in XML, each refused by name where it cannot be used."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError, near_matches
from bumpstop.model.inertia import Matrix3, Vector3, matrix3, vector3
from bumpstop.model.joint import rotation_from_rpy

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MAX_BYTES = 5_000_000
# Many small elements take longer than one long text.
MAX_ELEMENTS = 200_000
MAX_NAME_LENGTH = 200
# Wide enough for any machine and any unit slip, narrow enough that no product of them overflows.
_MAX = {"m": 1e3, "rad": 1e3, "kg": 1e6, "kg m2": 1e6, "": 1e9}

_NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?", re.ASCII)


def parse(path: Path, kind: str = "a URDF file") -> Element:
    """The root element of a file of a kind. Whatever could expand, grow or read further files is refused."""
    # Imports are light: built-in robots need no XML.
    from xml.etree.ElementTree import ParseError

    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    where, wanted = str(path), f"wanted {kind}"
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(where, f"cannot be read ({error.strerror or error})", wanted) from None
    except ValueError as error:  # a NUL character in the path
        raise InputError(where, f"cannot be read ({error})", wanted) from None
    if len(content) > MAX_BYTES:
        raise InputError(where, f"is longer than {MAX_BYTES} bytes", wanted)
    try:
        root: Element = fromstring(content, forbid_dtd=True)
    except DefusedXmlException:
        problem = "has a document type or entities, which can be made to fill the memory"
        raise InputError(where, problem, f"{wanted} without them") from None
    except ParseError as error:
        if b"xacro:" in content:  # with a prefix that nobody declared
            raise _xacro(where) from None
        raise InputError(where, f"is not XML ({error})", wanted) from None
    except (ValueError, LookupError) as error:  # encodings that Python or expat does not know
        raise InputError(where, f"is not XML ({error})", f"{wanted} in UTF-8") from None
    return root


def local(element: Element) -> str:
    """The tag without its namespace: some exporters give the whole file one."""
    return str(element.tag).rpartition("}")[2]


def children(parent: Element, tag: str) -> list[Element]:
    """Those of this tag, in any namespace."""
    return [element for element in parent if local(element) == tag]


def refuse_xacro(root: Element, where: str) -> None:
    """Refuse files that are not expanded yet, and those with more elements than a robot has."""
    for number, element in enumerate(root.iter()):
        if number >= MAX_ELEMENTS:
            raise InputError(where, f"has more than {MAX_ELEMENTS} elements", "wanted fewer")
        space = str(element.tag).rpartition("}")[0]
        if "xacro" in space or any("${" in text or "$(" in text for text in element.attrib.values()):
            raise _xacro(where)


def _xacro(where: str) -> InputError:
    return InputError(where, "is a xacro file, not yet a URDF", "expand it first: xacro FILE.xacro > FILE.urdf")


def check_elements(parent: Element, known: tuple[str, ...], where: str) -> None:
    """Refuse elements whose name is nearly that of a known one; others are somebody's extension."""
    for element in parent:
        tag = local(element)
        if tag not in known and difflib.get_close_matches(tag[:MAX_NAME_LENGTH].casefold(), known, n=1, cutoff=0.75):
            raise InputError(where, f"<{cut(tag)}> is not an element of a URDF there", near_matches(cut(tag), known))


def only(parent: Element, tag: str, where: str) -> Element | None:
    """The one child of this tag, or None."""
    found = children(parent, tag)
    if len(found) > 1:
        raise InputError(where, f"has {len(found)} <{tag}>", "wanted one")
    return found[0] if found else None


def needed(parent: Element, tag: str, where: str) -> Element:
    """The one child of this tag."""
    element = only(parent, tag, where)
    if element is None:
        raise InputError(where, f"has no <{tag}>", "wanted one")
    return element


def check_attributes(element: Element, known: Iterable[str], where: str) -> None:
    """Refuse attributes that are not known; those of a namespace are somebody's extension."""
    for key in element.attrib:
        if "}" not in key and key not in known:
            raise InputError(where, f"{cut(key)!r} is not one of its attributes", near_matches(cut(key), known))


def name_of(element: Element, attribute: str, where: str) -> str:
    """An attribute that is a name."""
    name = element.get(attribute)
    if name is None or not name.strip():
        raise InputError(where, f"<{local(element)}> has no {attribute}", f'wanted {attribute}="..."')
    if len(name) > MAX_NAME_LENGTH:
        raise InputError(where, f"{cut(name)!r} is longer than {MAX_NAME_LENGTH} characters", "wanted a shorter name")
    return name


def numbers(element: Element, attribute: str, count: int, unit: str, where: str) -> list[float]:
    """Numbers of an attribute, all finite and of a size that something real can have."""
    text = element.get(attribute)
    field = f"{where} {local(element)} {attribute}"
    wanted = "wanted a number" if count == 1 else f"wanted {count} numbers"
    if text is None:
        raise InputError(field, "is missing", wanted)
    words = text.split()
    if len(words) != count:
        raise InputError(field, f"{cut(text)!r} has {len(words)} values", wanted)
    values = []
    for word in words:
        if not _NUMBER.fullmatch(word):
            raise InputError(field, f"{cut(word)!r} is not a finite number", wanted)
        value = float(word)
        if not abs(value) <= _MAX[unit]:
            raise InputError(field, f"{cut(word)} is too large", f"wanted at most {_MAX[unit]:g} {unit}".rstrip())
        values.append(value)
    return values


def cut(text: str) -> str:
    """Text of a file as a message can show it."""
    return text if len(text) <= 60 else text[:57] + "..."


def origin_of(parent: Element, where: str) -> tuple[Vector3, Matrix3]:
    """Position [m] and orientation that ``<origin>`` gives; where it is absent, the parent's own."""
    element = only(parent, "origin", where)
    position, rotation = [0.0, 0.0, 0.0], np.eye(3)
    if element is not None:
        check_attributes(element, ("xyz", "rpy"), f"{where} origin")
        if "xyz" in element.attrib:
            position = numbers(element, "xyz", 3, "m", where)
        if "rpy" in element.attrib:
            rotation = rotation_from_rpy(*numbers(element, "rpy", 3, "rad", where))
    return vector3(position), matrix3(rotation)


def largest_angle(parent: Element) -> float:
    """Of the ``rpy`` of an ``<origin>`` that :func:`origin_of` has read, as written [rad]."""
    return max(
        (abs(float(word)) for origin in children(parent, "origin") for word in origin.get("rpy", "").split()),
        default=0.0,
    )
