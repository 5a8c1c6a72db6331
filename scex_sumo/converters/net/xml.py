"""XML of SUMO's files: nets, routes, states."""

from __future__ import annotations

import zlib
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from scex_sumo.base.errors import MapError
from scex_sumo.converters.naming import open_binary


def unpacked(path: Path) -> bytes:
    """Read a net or another file of SUMO's, gzipped or not."""
    try:
        with open_binary(path) as file:
            return file.read()
    except FileNotFoundError:
        raise MapError(f"{path}: no such net; convert the map first") from None
    except (OSError, EOFError, zlib.error) as error:
        raise MapError(f"{path}: cannot be read: {error}; check the path of the net") from None


def xml_root(path: Path, content: bytes) -> Element:
    """Parse the content of a net or another file of SUMO's."""
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter of its encoding
        raise MapError(f"{path}: not XML ({error}); build the net again with netconvert") from None


def is_left_hand(root: Element) -> bool:
    """Return whether traffic drives on the left in a net."""
    return root.get("lefthand") in ("true", "1")


def net_root(path: Path) -> Element:
    """Return the XML root element of a net."""
    root = xml_root(path, unpacked(path))
    if root.tag != "net":
        raise MapError(f"{path}: no SUMO net, its root element is <{root.tag}>; give a SUMO .net.xml")
    return root
