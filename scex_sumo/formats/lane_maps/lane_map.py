"""Maps of lane polylines: bounds, relations and conflicts of lanes, from what a format has of them."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.file import Findings
from scex_sumo.converters.lanelet.tags import GERMANY, LEFT_HAND, default_speed_mps
from scex_sumo.formats.lane_maps.lane_links import Ends, Sides, connected, overlapping
from scex_sumo.geometry.bounds import mean_line, mean_width_m
from scex_sumo.geometry.polylines import along, heading, length_of, project, samples, without_repeats, wrap
from scex_sumo.road import Area, Georeference, Lane, Marking, Regulation, Road
from scex_sumo.roads.side import side_of

MAX_M = 1e8
FAR_M = 1e5  # coordinates beyond this are moved by whole kilometres
MIN_LENGTH_M = 0.01
WIDTH_M, WIDTHS_M = 3.5, (2.5, 5.0)  # without bounds: the usual width, and its limits
JOINT_M, JOINT_RAD = 0.5, math.radians(45.0)  # ends of lanes that follow each other
BESIDE_M, BESIDE_RAD = 3.0, math.radians(20.0)  # along, of neighbours
MIN_LIMIT_MPS, MAX_LIMIT_MPS = 1.0, 70.0
MAX_CORNER = 3.0  # corners of borders reach out at most this many times the half width


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnLane:
    """One lane as a map draws it; polylines are (P, 2 or 3) in m, in driving direction.

    Attributes:
        name: the map's; a positive number becomes the lane's id.
        centre: None: half-way between the bounds.
        left: None: half a width beside the centreline, so ``right``.
        width_m: without bounds; None or nan: the median of the other lanes.
        limit_mps: None: the country's.
        inside: in an intersection, where no lane change is allowed.
        closed: sides, ``left`` or ``right``, whose marking forbids a change, or one, as ``left leftwards``.
        reverse_of: name, an id, of the lane that this one drives in the opposite direction; it also follows
            lanes, and is followed by lanes, that it meets and that do not name it.
        successors: names; None: lanes that begin where this one ends.
        predecessors: names; None: lanes that this one succeeds.
        left_neighbours: names; None: the lane beside it, so ``right_neighbours``.
    """

    name: Hashable
    centre: Any = None
    left: Any = None
    right: Any = None
    width_m: float | None = None
    kind: str = "vehicle"
    subtype: str = "road"
    location: str = "urban"
    limit_mps: float | None = None
    inside: bool = False
    closed: tuple[str, ...] = ()
    successors: Sequence[Hashable] | None = None
    predecessors: Sequence[Hashable] | None = None
    left_neighbours: Sequence[Hashable] | None = None
    right_neighbours: Sequence[Hashable] | None = None
    reverse_of: int | None = None


@dataclass(kw_only=True, eq=False)
class DrawnMap(Findings):
    """What a map of lane polylines draws.

    Attributes:
        crosswalks: outlines (P, 2) by name.
        lines: markings: kind, subtype and polyline, as Lanelet2 names them.
        lit: lanes with a traffic light, by name, with the place where to stop (None if not known).
        stops: lanes with a stop or yield sign, by name: ``stop`` or ``yield``.
        priority: lanes that give way, and those that go before them.
        moved: coordinates beyond 100 km are moved by whole kilometres.
        left_hand: traffic drives on the left; None if the map does not say so.
    """

    path: Path
    lanes: list[DrawnLane] = field(default_factory=list)
    crosswalks: list[Any] = field(default_factory=list)
    lines: list[tuple[str, str, Any]] = field(default_factory=list)
    lit: dict[Hashable, Any] = field(default_factory=dict)
    stops: dict[Hashable, str] = field(default_factory=dict)
    priority: list[tuple[Sequence[Hashable], Sequence[Hashable]]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    moved: bool = True
    left_hand: bool | None = None

    def lane_ids(self) -> dict[Hashable, int]:
        """Lane ids by name: the names if all are positive numbers, else 1, 2, ... in the map's order."""
        names = [lane.name for lane in self.lanes]
        if all(isinstance(name, int) and 0 < name < 2**53 for name in names):
            return {name: int(name) for name in names}  # type: ignore[call-overload]
        return {name: number for number, name in enumerate(dict.fromkeys(names), start=1)}

    @cached_property
    def frame(self) -> FloatArray:
        """(2,) whole kilometres, m, by which coordinates beyond 100 km are moved."""
        drawn = (line for lane in self.lanes for line in (lane.centre, lane.left))
        lines = [line for line in map(polyline, drawn) if len(line)]
        points = np.concatenate([np.empty((0, 2)), *lines])
        far = self.moved and len(points) and float(np.abs(points).max()) > FAR_M
        return np.floor(points.min(axis=0) / 1000.0) * 1000.0 if far else np.zeros(2)


def polyline(points: Any, frame: FloatArray | float = 0.0) -> FloatArray:
    """Convert points to (P, 2) m from a place, without repeats; empty if they are no finite polyline."""
    try:
        line = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty((0, 2))
    if line.ndim != 2 or line.shape[1] < 2 or not (np.abs(line[:, :2]) <= MAX_M).all():
        return np.empty((0, 2))
    return without_repeats(line[:, :2] - frame)


def drawn_road(drawn: DrawnMap, *, name: str, country: str | None = None, projection: str = "") -> Road:
    """Build the road of a map of lane polylines.

    Args:
        country: whose limits hold where the map has none; None: Germany.
        projection: of the coordinates, as PROJ; empty if it is unknown.

    Raises:
        MapError: no lane for cars is usable.
    """
    ids, frame = drawn.lane_ids(), drawn.frame
    lanes = _lanes(drawn, ids, country or GERMANY)
    if not any(lane.kind == "vehicle" for lane in lanes.values()):
        why = "; ".join(drawn.notes()) or "it holds no lane for cars"
        raise MapError(f"{drawn.path}: no usable lane for cars ({why}); name another map")
    of = {ids[lane.name]: lane for lane in drawn.lanes}

    def may_change(left: int, right: int, leftwards: bool) -> bool:
        directions = ("", " leftwards" if leftwards else " rightwards")
        sides = (("right", of[left]), ("left", of[right]))
        return not any(
            lane.inside or f"{side}{direction}" in lane.closed
            for side, lane in sides
            for direction in directions
        )

    lanes = connected(drawn, lanes, *_links(drawn, ids, lanes), may_change)
    lanes = overlapping(lanes, {i: _heights(of[i], lane, frame) for i, lane in lanes.items()})
    first = max(lanes) + 1
    walks = [line for outline in drawn.crosswalks if len(line := polyline(outline, frame)) > 2]
    lines = [(*line[:2], points) for line in drawn.lines if len(points := polyline(line[2], frame)) > 1]
    place = None
    if projection:
        place = Georeference(projection=projection, east_m=float(frame[0]), north_m=float(frame[1]))
    if frame.any():
        said = f"x = {frame[0]:.0f} m, y = {frame[1]:.0f} m"
        drawn.remarks.append(f"coordinates are relative to {said} of the dataset")
    side, unknown = side_of(lanes, drawn.left_hand, None if country is None else country in LEFT_HAND)
    return Road(
        name=name,
        lanes=lanes,
        regulations=tuple(_regulations(drawn, ids, lanes)),
        markings=tuple(
            Marking(line_id=k, kind=kind, subtype=subtype, points=points)
            for k, (kind, subtype, points) in enumerate(lines or _borders(lanes), start=1)
        ),
        areas=tuple(Area(area_id=k, kind="crosswalk", outline=walk) for k, walk in enumerate(walks, first)),
        georeference=place,
        notes=(*drawn.notes(), *drawn.remarks, *unknown),
        left_hand=side,
    )


def _lanes(drawn: DrawnMap, ids: Mapping[Hashable, int], country: str) -> dict[int, Lane]:
    lines: dict[int, tuple[DrawnLane, FloatArray, list[FloatArray]]] = {}
    for drawn_lane in drawn.lanes:
        drawn_lines = (drawn_lane.left, drawn_lane.right, drawn_lane.centre)
        left, right, centre = (polyline(line, drawn.frame) for line in drawn_lines)
        bounds = [left, right] if len(left) > 1 and len(right) > 1 else []
        if len(centre) < 2 and bounds:
            centre = without_repeats(mean_line(bounds))
        if len(centre) < 2 or length_of(centre) < MIN_LENGTH_M:
            drawn.note("lanes left out, no usable line", str(drawn_lane.name)[:24])
        elif ids[drawn_lane.name] in lines:
            drawn.note("lanes with one name, the first kept", str(drawn_lane.name)[:24])
        else:
            lines[ids[drawn_lane.name]] = drawn_lane, centre, bounds
    widths = [width for lane, *_ in lines.values() if (width := lane.width_m) and math.isfinite(width)]
    usual = float(np.clip(np.median(widths), *WIDTHS_M)) if widths else WIDTH_M
    lanes, unlimited = {}, set()
    for i, (drawn_lane, centre, bounds) in sorted(lines.items()):
        width = float(np.nan_to_num(np.clip(drawn_lane.width_m or math.nan, *WIDTHS_M), nan=usual))
        left, right = bounds or (beside(centre, side * width / 2) for side in (1, -1))
        tags = {"subtype": drawn_lane.subtype, "location": drawn_lane.location}
        speed = default_speed_mps(tags, drawn_lane.kind, country)
        if drawn_lane.limit_mps and MIN_LIMIT_MPS <= drawn_lane.limit_mps <= MAX_LIMIT_MPS:
            speed = drawn_lane.limit_mps
        elif drawn_lane.kind == "vehicle":
            unlimited.add(i)
        lanes[i] = Lane(
            lane_id=i,
            centreline=centre,
            left_bound=left,
            right_bound=right,
            width_m=mean_width_m(left, right) if bounds else width,
            speed_limit_mps=speed,
            kind=drawn_lane.kind,
            reverse_of=drawn_lane.reverse_of,
            subtype=drawn_lane.subtype,
            location=drawn_lane.location,
        )
    if not all(bounds for *_, bounds in lines.values()):
        said = "lanes without bounds: half a width beside the centreline"
        drawn.remarks.append(f"{said}, {usual:.3g} m if unknown")
    if unlimited:
        said = "/".join(map(str, sorted({round(3.6 * lanes[i].speed_limit_mps) for i in unlimited})))
        drawn.remarks.append(f"{len(unlimited)} lanes have no speed limit: {said} km/h by their type")
    return lanes


def _heights(drawn: DrawnLane, lane: Lane, frame: FloatArray) -> FloatArray:
    """Return a line of the lane with heights, (P, 3), if the map has them; else the centreline."""
    for points in (drawn.centre, drawn.left):
        line = np.asarray(() if points is None else points, dtype=np.float64)
        if line.ndim == 2 and line.shape[1] == 3 and np.isfinite(line).all():
            return np.asarray(line - np.append(frame, 0.0))
    return lane.centreline


def _links(
    drawn: DrawnMap, ids: Mapping[Hashable, int], lanes: Mapping[int, Lane]
) -> tuple[tuple[Ends, Ends], tuple[Sides, Sides]]:
    cars = {i: lane for i, lane in lanes.items() if lane.kind == "vehicle"}
    of = {ids[lane.name]: lane for lane in drawn.lanes if ids[lane.name] in lanes}
    joined, left_of = {}, {}
    if any(of[i].successors is None or of[i].reverse_of for i in cars):
        joined = _joined(cars)
    if any(of[i].successors is None for i in cars):
        drawn.remarks.append("lanes without successors in the map: lanes whose ends meet are joined")
    if any(of[i].left_neighbours is None for i in cars):
        left_of = _side_by_side(cars)
        drawn.remarks.append("lanes without neighbours in the map: lanes side by side are neighbours")
    right_of = {j: i for i, j in left_of.items()}

    def named(names: Iterable[Hashable]) -> list[int]:
        return [ids[name] for name in names if name in ids]

    def beside(i: int, names: Sequence[Hashable] | None, otherwise: Mapping[int, int]) -> int | None:
        """Return the neighbour along most of a lane that leads the same way; None if there is none."""
        if names is None:
            return otherwise.get(i)
        return next((j for j in named(names) if j in cars and _along_most(lanes[i], lanes[j])), None)

    behind: dict[int, list[int]] = {}
    after, before, left, right = {}, {}, {}, {}
    for i, lane in of.items():
        joins = lane.successors is None or lane.reverse_of
        after[i] = [j for j in joined.get(i, ()) if joins or of[j].reverse_of]
        after[i] += named(lane.successors or ())
        left[i] = beside(i, lane.left_neighbours, left_of)
        right[i] = beside(i, lane.right_neighbours, right_of)
        for j in after[i]:
            behind.setdefault(j, []).append(i)
    for i, lane in of.items():
        joins = lane.predecessors is None or lane.reverse_of
        before[i] = [j for j in behind.get(i, ()) if joins or of[j].reverse_of]
        before[i] += named(lane.predecessors or ())
    return (after, before), (left, right)


def _along_most(a: Lane, b: Lane) -> bool:
    for lane, other in ((a, b), (b, a)):
        _, points = samples(lane.centreline, max(length_of(lane.centreline) / 10.0, 0.1))
        s, gap = project(points, other.centreline)
        short = s[-1] - s[0] < 0.7 * length_of(other.centreline)
        if short or np.median(gap) > 1.5 * max(a.width_m, b.width_m):
            return False
    return True


def _places(lanes: Mapping[int, Lane]) -> FloatArray:
    """Return (3, n, 3) x, y and heading of starts, middles and ends."""
    rows = []
    for lane in lanes.values():
        line, size = lane.centreline, length_of(lane.centreline)
        (x, y), (u, v) = along(line, size * np.array([0.45, 0.55]))
        middle = (*along(line, size / 2), math.atan2(v - y, u - x))
        rows.append([(*line[0], heading(line, end=False)), middle, (*line[-1], heading(line, end=True))])
    return np.array(rows).transpose(1, 0, 2)


def _joined(lanes: Mapping[int, Lane]) -> dict[int, list[int]]:
    ids = list(lanes)
    starts, _, ends = _places(lanes)
    following = {}
    for k, i in enumerate(ids):
        near = np.hypot(*(starts[:, :2] - ends[k, :2]).T) < JOINT_M
        near &= np.abs(wrap(starts[:, 2] - ends[k, 2])) < JOINT_RAD
        following[i] = [ids[m] for m in np.flatnonzero(near) if m != k]
    return following


def _side_by_side(lanes: Mapping[int, Lane]) -> dict[int, int]:
    ids = list(lanes)
    widths = np.array([lane.width_m for lane in lanes.values()])
    places = _places(lanes)
    left_of = {}
    for k, i in enumerate(ids):
        fits: BoolArray = np.ones(len(ids), bool)
        across = np.zeros(len(ids))
        for rows in places:
            step, angle = rows[:, :2] - rows[k, :2], rows[k, 2]
            c, s = math.cos(angle), math.sin(angle)
            ahead, aside = step @ np.array([c, s]), step @ np.array([-s, c])
            usual = (widths + widths[k]) / 2.0
            fits &= (np.abs(ahead) < BESIDE_M) & (aside > 0.5 * usual) & (aside < 1.5 * usual)
            fits &= np.abs(wrap(rows[:, 2] - angle)) < BESIDE_RAD
            across += aside
        if fits.any():
            left_of[i] = ids[int(np.argmin(np.where(fits, across, np.inf)))]
    rights = list(left_of.values())
    return {i: j for i, j in left_of.items() if rights.count(j) == 1}


def _regulations(
    drawn: DrawnMap, ids: Mapping[Hashable, int], lanes: Mapping[int, Lane]
) -> Iterable[Regulation]:
    number = max(lanes) + len(drawn.crosswalks) + 1
    for name, sign in drawn.stops.items():
        if (lane := ids.get(name)) in lanes and lane is not None:
            yield Regulation(element_id=(number := number + 1), kind=sign, lanes=(lane,), yielding=(lane,))
    for sides in drawn.priority:
        low, high = (tuple(ids[name] for name in names if ids.get(name) in lanes) for names in sides)
        if low and high:
            number, both = number + 1, low + high
            yield Regulation(element_id=number, kind="right_of_way", lanes=both, yielding=low, priority=high)
    for name, place in drawn.lit.items():
        if (lane := ids.get(name)) in lanes and lane is not None:
            number += 1
            places = [] if place is None else [np.asarray(place, np.float64)[:2] - drawn.frame]
            lines = tuple(_stop_line(lanes[lane], point) for point in places)
            yield Regulation(
                element_id=number, kind="traffic_light", lanes=(lane,), stop_lines=lines, lights=(number,)
            )


def _stop_line(lane: Lane, place: FloatArray) -> FloatArray:
    s = np.clip(
        project(place[None], lane.centreline)[0][0], 0.05, max(length_of(lane.centreline) - 0.05, 0.05)
    )
    before, here, after = along(lane.centreline, s + np.array([-0.05, 0.0, 0.05]))
    ahead = (after - before) / max(math.dist(after, before), 1e-9)
    aside = np.array([-ahead[1], ahead[0]]) * lane.width_m / 2.0
    return np.stack((here + aside, here - aside))


def _borders(lanes: Mapping[int, Lane]) -> list[tuple[str, str, FloatArray]]:
    lines: list[tuple[str, str, FloatArray]] = []
    for lane in lanes.values():
        if lane.kind == "vehicle":
            changes = "dashed" if lane.left is not None else "solid"
            lines.append(("line_thin" if lane.adjacent_left else "road_border", changes, lane.left_bound))
            if lane.adjacent_right is None:
                lines.append(("road_border", "", lane.right_bound))
    return lines


def beside(line: FloatArray, offset: float) -> FloatArray:
    """A polyline beside another one, point by point; positive offsets are on the left, m."""
    step = np.diff(line, axis=0)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.hypot(*step.T)[:, None]
    before, after = np.vstack([normal[:1], normal]), np.vstack([normal, normal[-1:]])
    both = before + after
    scale = np.maximum((both**2).sum(axis=1) / 2, 2 / MAX_CORNER)
    return np.asarray(line + offset * both / scale[:, None])
