"""Mirror image of a SUMO net: lanes, links and lights stay; y, turns and lane changes change sides."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.converters.xml import is_left_hand

_SIDES = {"changeLeft": "changeRight", "changeRight": "changeLeft"}
_TURNS = str.maketrans("lLrRtT", "rRlLTt")
_SHAPES = ("shape", "outlineShape")
_BOUNDARIES = ("convBoundary", "origBoundary")


@lru_cache(maxsize=1)
def mirrored_content(content: str | bytes) -> str:
    """Return the image of a net: one with traffic on the left has traffic on the right, and back."""
    root = ElementTree.fromstring(content)
    if is_left_hand(root):
        del root.attrib["lefthand"]
    else:
        root.set("lefthand", "true")
    for element in root.iter():
        for name in _SHAPES:
            if name in element.attrib:
                element.set(name, " ".join(map(_mirrored_point, element.attrib[name].split())))
        if element.attrib.keys() & _SIDES:
            element.attrib = {_SIDES.get(name, name): value for name, value in element.attrib.items()}
        if "x" in element.attrib and "y" in element.attrib:
            element.set("y", _negated(element.attrib["y"]))
        if element.tag == "connection":
            element.set("dir", element.get("dir", "").translate(_TURNS))
        if element.tag == "location":
            element.set("netOffset", _mirrored_point(element.get("netOffset", "0,0")))
            for name in _BOUNDARIES:
                x, low, to_x, high = element.get(name, "0,0,0,0").split(",")
                element.set(name, ",".join((x, _negated(high), to_x, _negated(low))))
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def mirrored_net(net: SumoNet, folder: Path) -> SumoNet:
    """Write the image of a net into a folder, without a drawing."""
    path = folder / net.path.name
    path.write_text(mirrored_content(net.path.read_bytes()), encoding="utf-8")
    return SumoNet(path=path, extras=None, lanes=net.lanes, notes=net.notes, losses=net.losses)


def _mirrored_point(point: str) -> str:
    x, y, *height = point.split(",")
    return ",".join((x, _negated(y), *height))


def _negated(number: str) -> str:
    """Return the text of a number with the other sign; 0 has none."""
    if not number.strip("-0."):
        return number.lstrip("-")
    return number[1:] if number.startswith("-") else f"-{number}"
