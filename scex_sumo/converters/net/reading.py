"""SUMO nets read from files: what is allowed of them, lane tables, road lines."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import InputError, MapError, listed
from scex_sumo.converters.net.allowed import prune
from scex_sumo.converters.net.links import links_of
from scex_sumo.converters.net.sumo_net import HEADER, LANE_WIDTH_M, LaneTable, SumoNet, net_file, points_of
from scex_sumo.converters.xml import is_utf8, net_root, unpacked, xml_root

_MARKUP = re.compile(rb"<\?xml-", re.IGNORECASE)
_SCHEMA = re.compile(rb"""schemaLocation\s*=\s*["'](?!https?://sumo[./-])""", re.IGNORECASE)


def allowed_content(path: Path) -> tuple[bytes, tuple[str, ...]]:
    """Return a net or drawing reduced to what is allowed, and what was left out, e.g. ``2 <inductionLoop>``.

    A file that is allowed as a whole keeps its bytes.
    """
    content = unpacked(path)
    root = xml_root(path, content)
    left_out = prune(root)
    plain = is_utf8(content) and not _MARKUP.search(content) and not _SCHEMA.search(content)
    if left_out or not plain:
        content = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content, left_out


def open_net(net_path: Path) -> SumoNet:
    """Open a net that `convert` wrote, with the files beside it; refuse files that hold more than roads."""
    table, extras = net_file(net_path, ".lanes.csv"), net_file(net_path, ".add.xml")
    for file in (net_path, table):
        if not file.is_file():
            raise MapError(f"{file}: no such file; convert the map again")
    for file in (net_path, extras):
        if file.is_file() and (left_out := allowed_content(file)[1]):
            raise MapError(
                f"{file}: changed since it was written: {listed(left_out)} in it; run again elsewhere"
            )
    return SumoNet(path=net_path, extras=extras if extras.is_file() else None, lanes=read_lane_table(table))


def read_lane_table(path: Path) -> LaneTable:
    """Read NET.lanes.csv, and the edges around junctions from NET.net.xml beside it, if it is there."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file)
        if next(reader, None) != HEADER:
            raise InputError(f"{path}: not a lane table; its first line must be {','.join(HEADER)}")
        rows = tuple((int(lanelet), sumo_lane) for lanelet, sumo_lane in reader)
    net = path.with_name(path.name.removesuffix(".lanes.csv") + ".net.xml")
    return LaneTable(rows, read_ends(net_root(net)) if net.is_file() else {})


def read_ends(root: Element) -> dict[str, tuple[str, str]]:
    """Return the edges before and after each internal SUMO lane of a net."""
    return {
        lane: (link.from_lane.rpartition("_")[0], link.to_lane.rpartition("_")[0])
        for link in links_of(root)
        for lane in link.via
    }


_BORDERS = {"curbstone", "road_border", "guard_rail", "fence", "wall"}

SURFACE, AREA, MARKING, BORDER, STOP = range(5)
"""How a line of the road is drawn; surfaces are as wide as said, areas are filled."""


class RoadLine(NamedTuple):
    """Line of a road: points (P, 2) in m, and the width of a surface, else 0."""

    kind: int
    width_m: float
    points: FloatArray


def road_lines(net: Path, box: tuple[float, float, float, float]) -> list[RoadLine]:
    """Return the road lines that touch a box; none of a missing file.

    Args:
        net: NET.net.xml, with NET.add.xml beside it.
        box: least and largest x, least and largest y, m.
    """
    lines = []
    if net.is_file():
        root = net_root(net)
        try:
            for lane in root.iter("lane"):
                width = float(lane.get("width", LANE_WIDTH_M))
                lines.append(RoadLine(SURFACE, width, points_of(lane.get("shape", ""))))
            for junction in root.iter("junction"):
                lines.append(RoadLine(AREA, 0.0, points_of(junction.get("shape", ""))))
        except ValueError as error:
            raise MapError(f"{net}: cannot be read ({error}); build the net again with netconvert") from None
    extras = net_file(net, ".add.xml")
    if extras.is_file():
        for poly in ElementTree.parse(extras).getroot().iter("poly"):
            kind = poly.get("type", "")
            if poly.get("fill") == "0":
                style = BORDER if kind in _BORDERS else STOP if kind == "stop_line" else MARKING
                lines.append(RoadLine(style, 0.0, points_of(poly.get("shape", ""))))
    low, high = box[::2], box[1::2]
    points = ((line, line.points) for line in lines if len(line.points) > 1)
    return [line for line, p in points if (p.min(0) <= high).all() and (p.max(0) >= low).all()]
