"""CommonRoad maps: the one module that imports commonroad-io."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from scex_sumo.converters.commonroad_file import CommonRoadFile, element_id, read_commonroad_file
from scex_sumo.converters.commonroad_rules import (
    CARS,
    Sign,
    drawn_as,
    lane_kind,
    lane_tags,
    may_cross,
    priority_regulations,
    sign_regulations,
    sign_speed_mps,
)
from scex_sumo.converters.lane_conflicts import overlapping
from scex_sumo.converters.lane_geometry import bounds_cross, mean_width_m, without_repeats
from scex_sumo.converters.lanelet_tags import default_speed_mps
from scex_sumo.errors import MissingExtraError
from scex_sumo.road import Area, Lane, Marking, Regulation, Road
from scex_sumo.scene import FloatArray

GAP_M = 1.0  # successors that begin farther away than this are not where their predecessor ends
# commonroad-io is untyped here: its lanelets are Any, and go no further than this module.
_Lanelet = Any


@dataclass(frozen=True, kw_only=True, eq=False)
class _CommonRoad:
    """What is used of commonroad-io.

    Attributes:
        lanelet: reads a lanelet from its element; raises anything on what it does not understand.
        sign: reads the name of a sign from its element and the country.
        words: what it understands by tag of the element, e.g. every ``laneletType``.
    """

    lanelet: Callable[[ElementTree.Element], _Lanelet]
    sign: Callable[[ElementTree.Element, str], str]
    words: Mapping[str, set[str]]


def read_commonroad_road(path: str | Path, *, origin: tuple[float, float] | None = None) -> Road:
    """Read the road network of a CommonRoad scenario.

    Bounds, successors and neighbours are the file's own; centrelines are commonroad-io's, half-way between
    the bounds point by point. A lane change is allowed across every marking but a solid line or a curb.
    Speed limits are the signs' (2018b: the lanelets' own), else Germany's for the lanelet's type. Conflicts,
    which the format does not have, are found by geometry. What is broken is mended or left out, and said in
    the road's notes.

    Args:
        path: an ``.xml`` or ``.xml.gz`` file, version 2018b or 2020a.
        origin: latitude and longitude where its coordinates are 0, 0; None takes the file's location. It
            changes no coordinate: CommonRoad's are in metres already.

    Raises:
        MapError: the file cannot be read, or has no usable lanelet.
        MissingExtraError: commonroad-io is not installed.
    """
    library = _library()
    file = read_commonroad_file(path)
    with _quiet():
        lanelets = _lanelets(file, library)
        signs = _signs(file, library)
    lanes = _lanes(file, lanelets, signs)
    lanes = _connected(file, lanelets, lanes)
    heights = {i: _heights(lanelets[i]) for i in lanes}
    lanes = overlapping(lanes, heights)
    stop_lines = _stop_lines(lanelets)
    name = Path(path).name.removesuffix(".gz").removesuffix(".xml")
    return Road(
        name=name,
        lanes=lanes,
        regulations=_regulations(file, lanelets, lanes, signs, stop_lines),
        markings=_markings(lanelets, stop_lines),
        areas=tuple(
            Area(
                area_id=i,
                kind=lane.subtype,
                outline=np.concatenate([lane.left_bound, lane.right_bound[::-1]]),
            )
            for i, lane in lanes.items()
            if lane.kind != "vehicle"
        ),
        origin=origin or file.origin or (0.0, 0.0),
        notes=file.notes(),
    )


def _library() -> _CommonRoad:
    try:
        from commonroad.common.common_lanelet import LaneletType, LineMarking, RoadUser
        from commonroad.common.reader.file_reader_xml import LaneletFactory, TrafficSignElementFactory
        from commonroad.scenario.traffic_sign import SupportedTrafficSignCountry
    except ImportError as error:
        raise MissingExtraError(
            f"CommonRoad maps need commonroad-io ({error}); install it: pip install 'scex-sumo[formats]'"
        ) from None

    def sign(element: ElementTree.Element, country: str) -> str:
        known = {c.value for c in SupportedTrafficSignCountry}
        # Zamunda is CommonRoad's country of no country; its signs are Germany's.
        where = SupportedTrafficSignCountry(country if country in known else "ZAM")
        read = TrafficSignElementFactory.create_from_xml_node(element, where)
        return str(read.traffic_sign_element_id.name)

    users = {user.value for user in RoadUser}
    return _CommonRoad(
        lanelet=LaneletFactory.create_from_xml_node,
        sign=sign,
        words={
            "laneletType": {word.value for word in LaneletType},
            "lineMarking": {word.value for word in LineMarking},
            "userOneWay": users,
            "userBidirectional": users,
        },
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Without commonroad-io's log of what it does not know: the road's notes say it."""
    logger = logging.getLogger("commonroad")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _lanelets(file: CommonRoadFile, library: _CommonRoad) -> dict[int, _Lanelet]:
    """Every lanelet that commonroad-io can read, by id."""
    lanelets = {}
    for i, element in file.lanelets.items():
        for parent in (element, *element.iter("leftBound"), *element.iter("rightBound")):
            for child in list(parent):
                known = library.words.get(child.tag)
                if known is not None and child.text not in known:
                    parent.remove(child)
                    file.note(f"lanelets with a {child.tag} that CommonRoad does not have, left out", i)
        for line in element.findall("stopLine"):
            if not _is_stop_line(line, library.words["lineMarking"]):
                element.remove(line)
                file.note("lanelets with an unusable stop line, left out", i)
        try:
            lanelets[i] = library.lanelet(element)
        # commonroad-io checks with assertions and stumbles over what is not there.
        except (AssertionError, AttributeError, IndexError, KeyError, TypeError, ValueError):
            file.note("lanelets left out, commonroad-io cannot read them", i)
    return lanelets


def _is_stop_line(line: ElementTree.Element, words: set[str]) -> bool:
    try:
        points = [(float(p.findtext("x", "")), float(p.findtext("y", ""))) for p in line.findall("point")]
    except ValueError:
        return False
    return len(points) in (0, 2) and bool(np.isfinite(points).all()) and line.findtext("lineMarking") in words


def _signs(file: CommonRoadFile, library: _CommonRoad) -> dict[int, tuple[Sign, ...]]:
    """Elements of every sign by id."""
    signs: dict[int, tuple[Sign, ...]] = {}
    for i, element in file.elements("trafficSign").items():
        read = []
        for part in element.findall("trafficSignElement"):
            written = (part.findtext("trafficSignID") or "").strip()
            name = library.sign(part, file.country) if written else "UNKNOWN"
            values = tuple((value.text or "").strip() for value in part.findall("additionalValue"))
            if name == "UNKNOWN":
                file.note("signs that commonroad-io does not know, left out", i)
            read.append(Sign(name=name, written=written, values=values))
        signs[i] = tuple(read)
    return signs


def _xy(line: Any) -> FloatArray:
    return without_repeats(np.asarray(line, dtype=np.float64)[:, :2])


def _heights(lanelet: _Lanelet) -> FloatArray | None:
    """(P, 3) centreline with heights, or None where the map is flat."""
    centre = np.asarray(lanelet.center_vertices, dtype=np.float64)
    return centre if centre.shape[1] == 3 else None


def _values(words: Iterable[Any]) -> set[str]:
    """Words of commonroad-io's enumerations as the file has them."""
    return {str(word.value) for word in words}


def _lanes(
    file: CommonRoadFile, lanelets: Mapping[int, _Lanelet], signs: Mapping[int, tuple[Sign, ...]]
) -> dict[int, Lane]:
    """Lanes by themselves, without their relations to others."""
    lanes = {}
    limited = set()
    for i, lanelet in lanelets.items():
        left, right = _xy(lanelet.left_vertices), _xy(lanelet.right_vertices)
        centreline = _xy(lanelet.center_vertices)
        if len(centreline) < 2:
            file.note("lanelets left out, no length between their bounds", i)
            continue
        if bounds_cross(left, right):
            file.note("bounds cross each other or themselves, the lane's shape may be off", i)
        types = _values(lanelet.lanelet_type)
        both_ways = _values(lanelet.user_bidirectional)
        kind = lane_kind(types, _values(lanelet.user_one_way) | both_ways)
        if kind == "vehicle" and both_ways & CARS:
            file.note("lanelets that cars may drive both ways, taken one way", i)
        tags = lane_tags(types)
        speed = _speed(file, i, lanelet, signs)
        if speed is not None:
            limited.add(i)
        lanes[i] = Lane(
            lane_id=i,
            centreline=centreline,
            left_bound=left,
            right_bound=right,
            width_m=mean_width_m(left, right),
            speed_limit_mps=speed or default_speed_mps(tags, kind),
            kind=kind,
            subtype=tags["subtype"],
            location=tags["location"],
        )
    _remark_limits(file, [lane for lane in lanes.values() if lane.kind == "vehicle"], limited)
    return lanes


def _remark_limits(file: CommonRoadFile, lanes: list[Lane], limited: set[int]) -> None:
    """Say which limits are ours; recorded maps often have none at all."""
    unsigned = [lane for lane in lanes if lane.lane_id not in limited]
    if unsigned:
        kmh = "/".join(
            str(limit) for limit in sorted({round(lane.speed_limit_mps * 3.6) for lane in unsigned})
        )
        file.remarks.append(
            f"{len(unsigned)} of {len(lanes)} lanelets have no speed limit: {kmh} km/h by their type"
        )


def _speed(
    file: CommonRoadFile, i: int, lanelet: _Lanelet, signs: Mapping[int, tuple[Sign, ...]]
) -> float | None:
    """Speed limit that the file gives, m/s."""
    elements = [sign for s in sorted(lanelet.traffic_signs) for sign in signs.get(s, ())]
    own = file.lanelets[i].findtext("speedLimit")  # 2018b
    if own is not None:
        elements.append(Sign(name="MAX_SPEED", written="speedLimit", values=(own,)))
    try:
        return sign_speed_mps(elements)
    except ValueError:
        file.note("speed limits that are none in m/s, left out", i)
        return None


def _connected(
    file: CommonRoadFile, lanelets: Mapping[int, _Lanelet], lanes: dict[int, Lane]
) -> dict[int, Lane]:
    """The same lanes with successors, predecessors and neighbours, each known to both sides."""
    driven = {i for i, lane in lanes.items() if lane.kind == "vehicle"}
    pairs = {(i, j) for i in driven for j in lanelets[i].successor if j in driven}
    behind = {(j, i) for i in driven for j in lanelets[i].predecessor if j in driven}
    for i, j in pairs ^ behind:
        file.note("successors that only one of the two lanelets knows, kept", f"{i}-{j}")
    pairs |= behind
    for i, j in pairs:
        if np.hypot(*(lanes[i].centreline[-1] - lanes[j].centreline[0])) > GAP_M:
            file.note(f"successors that begin more than {GAP_M:g} m from the end", f"{i}-{j}")
    beside = {(i, lanelets[i].adj_left) for i in driven if lanelets[i].adj_left_same_direction is True}
    other = {(lanelets[j].adj_right, j) for j in driven if lanelets[j].adj_right_same_direction is True}
    for i, j in beside ^ other:
        if i in driven and j in driven:
            file.note("neighbours that only one of the two lanelets knows, left out", f"{i}-{j}")
    # (lane, its left neighbour)
    left_of = dict(sorted((i, j) for i, j in beside & other if i in driven and j in driven))
    right_of = {j: i for i, j in left_of.items()}
    result = dict(lanes)
    for i in driven:
        left, right = left_of.get(i), right_of.get(i)
        result[i] = replace(
            lanes[i],
            successors=tuple(sorted(b for a, b in pairs if a == i)),
            predecessors=tuple(sorted(a for a, b in pairs if b == i)),
            adjacent_left=left,
            adjacent_right=right,
            left=left if left and _may_change(lanelets[left], lanelets[i], leftwards=True) else None,
            right=right if right and _may_change(lanelets[i], lanelets[right], leftwards=False) else None,
        )
    return result


def _may_change(left: _Lanelet, right: _Lanelet, *, leftwards: bool) -> bool:
    """Whether the line between two lanelets may be crossed, as either of them has it."""
    lines = (left.line_marking_right_vertices, right.line_marking_left_vertices)
    return all(may_cross(line.value, leftwards=leftwards) for line in lines)


def _stop_lines(lanelets: Mapping[int, _Lanelet]) -> dict[int, FloatArray]:
    """(2, 2) stop line of each lane that has one."""
    found = {}
    for i, lanelet in lanelets.items():
        if lanelet.stop_line is not None:
            ends = (lanelet.stop_line.start, lanelet.stop_line.end)
            found[i] = np.array([end[:2] for end in ends], dtype=np.float64)
    return found


def _regulations(
    file: CommonRoadFile,
    lanelets: Mapping[int, _Lanelet],
    lanes: Mapping[int, Lane],
    signs: Mapping[int, tuple[Sign, ...]],
    stop_lines: Mapping[int, FloatArray],
) -> tuple[Regulation, ...]:
    """Signs, priority at intersections, and lights, by ascending id of their element."""
    driven = [i for i, lane in lanes.items() if lane.kind == "vehicle"]
    users = {
        s: tuple(
            i for i in driven if s in lanelets[i].traffic_signs or _named(lanelets[i], "traffic_sign_ref", s)
        )
        for s in signs
    }
    lane_signs = {
        i: tuple(sign for s in sorted(lanelets[i].traffic_signs) for sign in signs[s]) for i in driven
    }
    found = sign_regulations(signs, users, stop_lines)
    found += priority_regulations(_incoming(file, set(driven)), lane_signs)
    for light in file.elements("trafficLight"):
        lit = tuple(
            i
            for i in driven
            if light in lanelets[i].traffic_lights or _named(lanelets[i], "traffic_light_ref", light)
        )
        if lit:
            lines = tuple(stop_lines[i] for i in lit if i in stop_lines)
            found.append(
                Regulation(
                    element_id=light, kind="traffic_light", lanes=lit, stop_lines=lines, lights=(light,)
                )
            )
    return tuple(sorted(found, key=lambda rule: (rule.element_id, rule.kind)))


def _named(lanelet: _Lanelet, kind: str, element: int) -> bool:
    """Whether the lanelet's stop line refers to a sign or light."""
    return lanelet.stop_line is not None and element in (getattr(lanelet.stop_line, kind) or ())


def _incoming(file: CommonRoadFile, driven: set[int]) -> dict[int, list[tuple[int, ...]]]:
    """Groups of incoming lanes of each intersection."""
    return {
        i: [
            tuple(
                ref
                for lanelet in group.findall("incomingLanelet")
                if (ref := element_id(lanelet, "ref")) in driven and ref is not None
            )
            for group in element.findall("incoming")
        ]
        for i, element in file.elements("intersection").items()
    }


def _markings(lanelets: Mapping[int, _Lanelet], stop_lines: Mapping[int, FloatArray]) -> tuple[Marking, ...]:
    """Lines to draw; one that two lanelets share is drawn once, ids are the reader's own."""
    found: dict[bytes, tuple[str, str, FloatArray]] = {}
    for lanelet in lanelets.values():
        sides = (
            (lanelet.left_vertices, lanelet.line_marking_left_vertices),
            (lanelet.right_vertices, lanelet.line_marking_right_vertices),
        )
        for vertices, marking in sides:
            drawn, points = drawn_as(marking.value), _xy(vertices)
            if drawn is not None and points[::-1].tobytes() not in found:
                found.setdefault(points.tobytes(), (*drawn, points))
    for points in stop_lines.values():
        found.setdefault(points.tobytes(), ("stop_line", "", points))
    return tuple(
        Marking(line_id=number, kind=kind, subtype=subtype, points=points)
        for number, (kind, subtype, points) in enumerate(found.values(), start=1)
    )
