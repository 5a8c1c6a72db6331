"""XML of others: no declared types, limited depth, errors of one line; what SUMO's programs read alike."""

from __future__ import annotations

import contextlib
import io
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from scex_sumo.base.errors import MapError
from scex_sumo.converters.naming import open_binary

MAX_DEPTH = 100  # elements within each other; no format needs 20
_BEGINNING = 1000  # bytes
_ENCODING = re.compile(rb"""<\?xml[^>]*encoding\s*=\s*["']([^"']*)""")


def unpacked(path: Path) -> bytes:
    """Read a file, gzipped or not."""
    try:
        with open_binary(path) as file:
            return file.read()
    except (FileNotFoundError, IsADirectoryError) as error:
        problem = "no such file" if isinstance(error, FileNotFoundError) else "is a folder"
        raise MapError(f"{path}: {problem}; check its path") from None
    except (OSError, EOFError, zlib.error) as error:
        raise MapError(f"{path}: cannot be unpacked ({error}); fetch the file again") from None


def xml_root(
    path: Path, content: bytes | None = None, remedy: str = "build the net again with netconvert"
) -> Element:
    """Parse a file, packed or not, or its content."""
    content = unpacked(path) if content is None else content
    try:
        with as_value_error():
            refuse_declarations(io.BytesIO(content))
            root = ElementTree.fromstring(content)
        level, depth = [root], 1
        while level := [child for element in level for child in element]:
            depth = checked_depth(depth + 1)
    except (LookupError, ValueError) as error:
        raise MapError(f"{path}: {error}; {remedy}") from None
    return root


def refuse_declarations(file: BinaryIO) -> None:
    """Raise a `ValueError` if a file declares a type."""

    def begun(*_: object) -> None:  # after the root element begins, nothing can be declared
        raise StopIteration

    def refuse(*_: object) -> None:
        raise ValueError("has a DOCTYPE, which could read other files")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.StartDoctypeDeclHandler = begun, refuse
    with contextlib.suppress(StopIteration):
        parser.ParseFile(file)


def checked_depth(depth: int) -> int:
    """Return a depth of elements; raise a `ValueError` if it is too large."""
    if depth > MAX_DEPTH:
        raise ValueError(f"has more than {MAX_DEPTH} elements within each other")
    return depth


@contextlib.contextmanager
def as_value_error() -> Iterator[None]:
    """Turn errors of the parser in the block into a `ValueError`."""
    try:
        yield
    except (ElementTree.ParseError, expat.ExpatError) as error:
        raise ValueError(f"not XML ({error})") from None


def is_utf8(content: bytes) -> bool:
    """Return whether XML is encoded as all parsers read it alike: UTF-8, by declaration and first bytes."""
    encoding = _ENCODING.search(content[:_BEGINNING])
    declared = encoding is None or encoding[1].lower() in (b"utf-8", b"us-ascii")
    return declared and b"\0" not in content[:_BEGINNING]


def is_left_hand(root: Element) -> bool:
    """Return whether traffic drives on the left in a net."""
    return root.get("lefthand") in ("true", "1")


def change_words(root: Element) -> tuple[str, str]:
    """Return the attributes of a lane for changes to the next higher and the next lower index.

    SUMO names them by the driver's sides.
    """
    return ("changeRight", "changeLeft") if is_left_hand(root) else ("changeLeft", "changeRight")


def permits(element: Element, kind: str, allow: str = "allow", disallow: str = "disallow") -> bool:
    """Return whether a lane or a connection of a net is open to a class of vehicles."""
    allowed, closed = (set(element.get(name, "").split()) for name in (allow, disallow))
    return bool({kind, "all"} & allowed) if allowed else not {kind, "all"} & closed


def net_root(path: Path) -> Element:
    """Return the XML root element of a net."""
    root = xml_root(path)
    if root.tag != "net":
        raise MapError(f"{path}: no SUMO net, its root element is <{root.tag}>; give a SUMO .net.xml")
    return root
