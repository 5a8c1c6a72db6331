"""Cropped net for children side by side.

Only shapes change: lanes outside of the box shrink to dots on its border, so that ids and connections stay.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import shapely

from scex_sumo.converters.net.reader import net_root, points_of

Box = tuple[float, float, float, float]
_SHORTEST_M = 0.5
_DOT_M = 0.1


def crop_net(net: Path, box: Box, out: Path) -> Path:
    """Write a net with shapes cropped to a box (smallest x, y, largest x, y, m), and return the file."""
    root = net_root(net)
    for lane in root.iter("lane"):
        lane.attrib.pop("outlineShape", None)
        if not _crop_shape(lane, box, closed=False):
            x, y = _into(box, *points_of(lane.get("shape", ""))[0].tolist())
            lane.set("shape", f"{x:.2f},{y:.2f} {x + _DOT_M:.2f},{y:.2f}")
    for edge in root.iter("edge"):
        edge.attrib.pop("shape", None)
    for junction in root.iter("junction"):
        x, y = _into(box, float(junction.get("x", "0")), float(junction.get("y", "0")))
        junction.attrib |= {"x": f"{x:.2f}", "y": f"{y:.2f}"}
        if not _crop_shape(junction, box, closed=True):
            junction.attrib.pop("shape", None)
    for connection in root.iter("connection"):
        connection.attrib.pop("shape", None)
    _write(out, "net", root, root)
    return out


def crop_extras(extras: Path, box: Box, out: Path) -> Path:
    """Write the lines and areas of an additional file within a box, and return the file."""
    root = ElementTree.parse(extras).getroot()
    kept = [poly for poly in root.iter("poly") if _crop_shape(poly, box, closed=poly.get("fill") == "1")]
    _write(out, "additional", root, kept)
    return out


def _write(out: Path, tag: str, root: ElementTree.Element, children: Iterable[ElementTree.Element]) -> None:
    made = ElementTree.Element(tag, {key: value for key, value in root.attrib.items() if "}" not in key})
    made.extend(children)
    ElementTree.ElementTree(made).write(out, encoding="utf-8", xml_declaration=True)


def _into(box: Box, x: float, y: float) -> tuple[float, float]:
    return min(max(x, box[0]), box[2] - _DOT_M), min(max(y, box[1]), box[3])


def _crop_shape(element: ElementTree.Element, box: Box, *, closed: bool) -> bool:
    points = points_of(element.get("shape", ""))
    if len(points) < (4 if closed else 2) or not np.isfinite(points).all():
        return False
    whole = shapely.make_valid(shapely.Polygon(points)) if closed else shapely.LineString(points)
    parts = shapely.get_parts(shapely.clip_by_rect(whole, *box))
    wanted = [part for part in parts if part.geom_type == ("Polygon" if closed else "LineString")]
    if not wanted:
        return False
    best = max(wanted, key=lambda part: float(part.length))
    if best.length < _SHORTEST_M:
        return False
    line = best.exterior if closed else best
    element.set("shape", " ".join(f"{x:.2f},{y:.2f}" for x, y in shapely.get_coordinates(line)))
    return True
