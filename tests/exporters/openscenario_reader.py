"""OpenSCENARIO read independently of the writer: where the boxes of a file are, and when. For tests alone."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from scex_sumo.base.arrays import FloatArray


def box_centres(file: Path, times: FloatArray) -> dict[str, FloatArray]:
    """(T, 3) x, y and heading of the middle of the bounding box of each entity that follows a trajectory."""
    root = ET.parse(file).getroot()
    found = {}
    for entity in root.iter("ScenarioObject"):
        name = entity.get("name", "")
        centre = entity.find(".//BoundingBox/Center")
        assert centre is not None
        ahead, aside = (float(centre.get(axis, "nan")) for axis in "xy")
        if not len(table := _vertices(root, name)):  # it is free
            continue
        x, y, heading = (np.interp(times, table[:, 0], column) for column in table.T[1:])
        c, s = np.cos(heading), np.sin(heading)
        found[name] = np.stack([x + c * ahead - s * aside, y + s * ahead + c * aside, heading], axis=1)
    return found


def _vertices(root: ET.Element, name: str) -> FloatArray:
    for group in root.iter("ManeuverGroup"):
        actor = group.find("Actors/EntityRef")
        if actor is not None and actor.get("entityRef") == name:
            rows = []
            for vertex in group.iter("Vertex"):
                place = vertex.find("Position/WorldPosition")
                assert place is not None
                rows.append([float(vertex.get("time", "nan")), *(float(place.get(k, "nan")) for k in "xyh")])
            return np.array(rows)
    return np.empty((0, 4))
