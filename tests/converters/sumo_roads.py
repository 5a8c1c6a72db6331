"""Small roads drawn by hand, and SUMO nets read with nothing but an XML parser."""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import sumo
from shapely import Polygon

from scex_sumo.base.arrays import FloatArray
from scex_sumo.road import Lane, Regulation, Road
from tests.seeds import lane_along

SUMO = Path(sumo.SUMO_HOME) / "bin" / "sumo"


def lane(
    lane_id: int,
    points: Sequence[tuple[float, float]] | FloatArray,
    *,
    to: tuple[int, ...] = (),
    left: int | None = None,
    right: int | None = None,
    **fields: Any,
) -> Lane:
    """A lane of constant width; neighbours named here may be changed to."""
    sides = {"left": left, "right": right, "adjacent_left": left, "adjacent_right": right}
    return lane_along(lane_id, points, successors=to, **sides, **fields)


def road(lanes: Iterable[Lane], rules: Sequence[Regulation] = ()) -> Road:
    """A road of lanes, with predecessors and overlaps worked out."""
    known = {one.lane_id: one for one in lanes}
    areas = {i: Polygon(np.vstack([x.left_bound, x.right_bound[::-1]])).buffer(0) for i, x in known.items()}
    done = {}
    for i, one in known.items():
        before = tuple(j for j, other in known.items() if i in other.successors)
        near = {i, one.left, one.right, *one.successors, *before}
        near |= {j for j, other in known.items() if i in (other.left, other.right)}
        over = tuple(
            j
            for j in known
            if j not in near
            and "vehicle" == one.kind == known[j].kind
            and areas[i].intersection(areas[j]).area > 0.1
        )
        done[i] = replace(one, predecessors=before, conflicts=over)
    return Road(name="drawn", lanes=done, regulations=tuple(rules))


def arc(centre: tuple[float, float], radius: float, start: float, end: float) -> FloatArray:
    """Points on a circle between two angles in degrees, a point per 5 degrees or so."""
    angles = np.radians(np.linspace(start, end, max(3, round(abs(end - start) / 5) + 1)))
    return np.stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)], axis=1)


class NetFile:
    """What a net says, by names."""

    def __init__(self, path: Path) -> None:
        self.root = ET.parse(path).getroot()
        self.lanes = {x.get("id", ""): x for x in self.root.iter("lane")}
        self.shapes = {name: _points(x.get("shape", "")) for name, x in self.lanes.items()}
        outer = [x for x in self.root.iter("connection") if not x.get("from", "").startswith(":")]
        self.connections = {x.get("via", ""): x for x in outer}
        self.foes: set[tuple[str, str]] = set()
        self.yields: set[tuple[str, str]] = set()
        for junction in self.root.iter("junction"):
            links = junction.get("intLanes", "").split()
            for request in junction.iter("request"):
                own = links[int(request.get("index", ""))]
                for pairs, key in ((self.foes, "foes"), (self.yields, "response")):
                    row = request.get(key, "")[::-1]
                    pairs |= {(own, other) for other, bit in zip(links, row, strict=True) if bit == "1"}

    def via(self, start: str, end: str) -> str:
        """The internal lane of the connection between two edges."""
        [name] = [n for n, c in self.connections.items() if (c.get("from"), c.get("to")) == (start, end)]
        return name

    def state(self, start: str, end: str) -> str | None:
        """The state of the link between two edges."""
        return self.connections[self.via(start, end)].get("state")


def _points(text: str) -> FloatArray:
    return np.array([[float(v) for v in pair.split(",")] for pair in text.split()])


def load(path: Path, *more: str) -> str:
    """What sumo has to say about a net: nothing, if it is well."""
    command = [str(SUMO), "-n", str(path), "--end", "1", "--no-step-log", "--xml-validation", "never", *more]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    return run.stderr + ("" if run.returncode == 0 else f"exit status {run.returncode}")
