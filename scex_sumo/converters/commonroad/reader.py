"""CommonRoad maps: the one module that imports commonroad-io."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.commonroad.file import CommonRoadFile, read_commonroad_file
from scex_sumo.converters.commonroad.lanes import (
    Lanelet,
    areas,
    connected,
    driven_both_ways,
    lanes_of,
    markings,
    regulations,
)
from scex_sumo.converters.commonroad.reverse import with_reverse
from scex_sumo.converters.commonroad.rules import Sign
from scex_sumo.converters.formats import map_name
from scex_sumo.errors import MissingExtraError
from scex_sumo.road import Road
from scex_sumo.roads.overlaps import overlapping

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
    which the format does not have, are found by geometry. A lanelet that cars may use both ways gives two
    lanes; the second has ``reverse_of`` set. What is broken is mended or left out, and said in the road's
    notes.

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
    lanes = connected(file, lanelets, lanes_of(file, lanelets, signs))
    lanes = with_reverse(lanes, driven_both_ways(lanelets, lanes))
    lanes = overlapping(lanes, {i: lanelets[lane.reverse_of or i].centre for i, lane in lanes.items()})
    return Road(
        name=map_name(path),
        lanes=lanes,
        regulations=regulations(file, lanelets, lanes, signs),
        markings=markings(lanelets),
        areas=areas(lanes),
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


def _lanelets(file: CommonRoadFile, library: _CommonRoad) -> dict[int, Lanelet]:
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
            lanelets[i] = _lanelet(library.lanelet(element))
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


def _lanelet(read: _Lanelet) -> Lanelet:
    """What is used of commonroad-io's lanelet, as plain data."""
    line = read.stop_line
    return Lanelet(
        left=_floats(read.left_vertices),
        right=_floats(read.right_vertices),
        centre=_floats(read.center_vertices),
        types=_values(read.lanelet_type),
        one_way=_values(read.user_one_way),
        both_ways=_values(read.user_bidirectional),
        left_marking=str(read.line_marking_left_vertices.value),
        right_marking=str(read.line_marking_right_vertices.value),
        successors=frozenset(read.successor),
        predecessors=frozenset(read.predecessor),
        left_neighbour=read.adj_left if read.adj_left_same_direction else None,
        right_neighbour=read.adj_right if read.adj_right_same_direction else None,
        signs=frozenset(read.traffic_signs) | _named(line, "traffic_sign_ref"),
        lights=frozenset(read.traffic_lights) | _named(line, "traffic_light_ref"),
        stop_line=None if line is None else _floats([line.start, line.end])[:, :2],
    )


def _floats(points: Any) -> FloatArray:
    return np.asarray(points, dtype=np.float64)


def _values(words: Iterable[Any]) -> frozenset[str]:
    """Words of commonroad-io's enumerations as the file has them."""
    return frozenset(str(word.value) for word in words)


def _named(stop_line: Any, kind: str) -> frozenset[int]:
    """Signs or lights that a stop line refers to."""
    return frozenset(getattr(stop_line, kind, None) or ())
