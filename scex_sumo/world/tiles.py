"""Tiles: copies of a SUMO net side by side, one for each future of a batch.

A tile has prefixed ids and coordinates moved by whole metres. Its offset depends on the slot alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr as quoted

from scex_sumo.base.errors import SimulationError, listed
from scex_sumo.converters.net.allowed import SIMULATED, prune

TILE_SLOTS = 64
"""Number of tile slots; a future i with its own tile is in slot ``i % TILE_SLOTS``."""

TILE_COLUMNS = 8
WINDOW_ASPECT = 1.5  # least usual width by height of sumo-gui's view
TILE_MARGIN_M = 1000.0  # 20 s at 50 m/s

# Attributes with ids, per element.
_IDS: dict[str, tuple[str, ...]] = {
    "edge": ("id", "from", "to", "bidi", "crossingEdges"),
    "lane": ("id",),
    "neigh": ("lane",),
    "junction": ("id", "incLanes", "intLanes"),
    "connection": ("from", "to", "via", "tl"),
    "conflict": ("from", "to"),
    "tlLogic": ("id",),
    "roundabout": ("nodes", "edges"),
    "poly": ("id",),
    "poi": ("id",),
}
_ONCE = frozenset({"location", "type"})  # the same for all tiles
# Prohibitions repeat the requests; the logic of actuated lights needs detectors.
_LEFT_OUT = frozenset({"prohibition", "condition", "assignment", "function"})
_LOGIC = ("earlyTarget", "finalTarget")  # conditions of phases

# Placeholders in a template; no characters of XML 1.0.
_PREFIX, _COORDINATE = "\x01", "\x02"


def tile_prefix(slot: int) -> str:
    """Return the id prefix of a tile, e.g. ``t12_``."""
    return f"t{slot}_"


def tile_id(slot: int, name: str) -> str:
    """Return an id in a tile; a leading colon stays in front."""
    return prefixed(tile_prefix(slot), name)


def prefixed(prefix: str, name: str) -> str:
    """Return an id with a prefix; a leading colon stays in front."""
    return f":{prefix}{name[1:]}" if name.startswith(":") else prefix + name


@dataclass(frozen=True, kw_only=True)
class TileLayout:
    """Positions of tiles: slot 0 at the map's own coordinates, the others to its east and north.

    Attributes:
        pitch_x: whole metres between columns.
        pitch_y: whole metres between rows; negative for rows that go south.
    """

    pitch_x: int
    pitch_y: int
    columns: int = TILE_COLUMNS

    def offset(self, slot: int) -> tuple[int, int]:
        """Return the offset of a slot, whole metres."""
        row, column = divmod(slot, self.columns)
        return column * self.pitch_x, row * self.pitch_y


class TileTemplate:
    """Net or additional file (``poly``, ``poi``), parsed once for all copies."""

    def __init__(self, path: Path) -> None:
        """Read the file."""
        try:
            root = ElementTree.parse(path).getroot()
        except (OSError, ElementTree.ParseError) as error:
            raise SimulationError(f"{path}: cannot be read as a SUMO file: {error}") from error
        if left_out := prune(root):
            raise SimulationError(f"{path}: {listed(left_out)} cannot be copied to tiles; remove it")
        self._path = path
        self._root = root.tag
        self._head = "".join(f" {k}={quoted(v)}" for k, v in root.attrib.items())
        self._edges = {
            edge.get("id", ""): sum(len(lane.get("shape", "").split()) for lane in edge.iter("lane"))
            for edge in root.iter("edge")
            if "function" not in edge.attrib
        }
        self.lanes = sum(1 for _ in root.iter("lane"))  # internal ones included
        for element in list(root.iter()):
            element.tail, element.text = "\n", None
            for child in [c for c in element if c.tag in _LEFT_OUT or c.get("key") == SIMULATED]:
                element.remove(child)
            if element.tag not in _ONCE:
                _mark(element)
        texts = [(e.tag in _ONCE, ElementTree.tostring(e, encoding="unicode")) for e in root]
        self._once = "".join(text for once, text in texts if once)
        # Literal text, x, text, y, text, ...
        self._parts = "".join(text for once, text in texts if not once).split(_COORDINATE)

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest x, y and largest x, y of all coordinates, m."""
        xs, ys = ([float(value) for value in self._parts[k::4]] for k in (1, 3))
        if not xs:
            raise SimulationError(f"{self._path}: holds no lanes; convert the map again")
        return min(xs), min(ys), max(xs), max(ys)

    @property
    def plainest_edge(self) -> str:
        """Id of the edge with the fewest points: SUMO scans a vehicle's route at every move."""
        if not self._edges:
            raise SimulationError(f"{self._path}: holds no edges; convert the map again")
        return min(self._edges, key=lambda edge: self._edges[edge])

    def layout(self, *, margin_m: float = TILE_MARGIN_M) -> TileLayout:
        """Return a layout with at least ``margin_m`` between maps."""
        left, bottom, right, top = self.bounds
        return TileLayout(
            pitch_x=math.ceil((right - left + margin_m) / 10) * 10,
            pitch_y=math.ceil((top - bottom + margin_m) / 10) * 10,
        )

    def window_layout(self, count: int, *, margin_m: float) -> TileLayout:
        """Return a layout in reading order, with the number of columns that shows tiles largest."""
        wide = self.layout(margin_m=margin_m)

        def height(columns: int) -> float:
            return max(-(-count // columns) * wide.pitch_y, columns * wide.pitch_x / WINDOW_ASPECT)

        columns = min(range(1, count + 1), key=height)
        return TileLayout(pitch_x=wide.pitch_x, pitch_y=-wide.pitch_y, columns=columns)

    def write(self, path: Path, slots: Sequence[int], layout: TileLayout) -> None:
        """Write the copies of some slots, in any order."""
        offsets = [layout.offset(slot) for slot in slots]
        columns = {dx: [_moved(x, dx) for x in self._parts[1::4]] for dx in {o[0] for o in offsets}}
        rows = {dy: [_moved(y, dy) for y in self._parts[3::4]] for dy in {o[1] for o in offsets}}
        parts = list(self._parts)
        with path.open("w", encoding="utf-8") as file:
            file.write(f'<?xml version="1.0" encoding="UTF-8"?>\n<{self._root}{self._head}>\n{self._once}')
            for slot, (dx, dy) in zip(slots, offsets, strict=True):
                parts[1::4], parts[3::4] = columns[dx], rows[dy]
                file.write("".join(parts).replace(_PREFIX, tile_prefix(slot)))
            file.write(f"</{self._root}>\n")


def template_of(path: Path) -> TileTemplate:
    """Return the template of a net; the last one is reused for the same content."""
    content = path.read_bytes() if path.is_file() else b""
    if not _last or _last[0][0] != content:
        _last[:] = [(content, TileTemplate(path))]
    return _last[0][1]


_last: list[tuple[bytes, TileTemplate]] = []


def _mark(element: ElementTree.Element) -> None:
    attributes = element.attrib
    for key in _LOGIC:
        attributes.pop(key, None)
    for key in _IDS.get(element.tag, ()):
        if key in attributes:
            attributes[key] = " ".join(prefixed(_PREFIX, name) for name in attributes[key].split())
    for key in ("shape", "outlineShape"):
        if key in attributes:
            points = (point.split(",") for point in attributes[key].split())
            attributes[key] = " ".join(",".join([*map(_marked, xyz[:2]), *xyz[2:]]) for xyz in points)
    if "x" in attributes and "y" in attributes:
        x, y = attributes.pop("x"), attributes.pop("y")  # x before y, as in shapes
        attributes |= {"x": _marked(x), "y": _marked(y)}


def _marked(value: str) -> str:
    return f"{_COORDINATE}{value}{_COORDINATE}"


def _moved(number: str, metres: int) -> str:
    return number if metres == 0 else str(Decimal(number) + metres)
