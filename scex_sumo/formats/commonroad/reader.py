"""Reader of CommonRoad maps; only here: commonroad-io."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

from scex_sumo.base.errors import MapError
from scex_sumo.base.importing import extra_for
from scex_sumo.converters.lanelet.left_hand import CODES, drives_left_at
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import MapFormat
from scex_sumo.formats.commonroad.file import CommonRoadFile, open_commonroad, read_lanelets
from scex_sumo.formats.commonroad.lanes import (
    Sign,
    drawn_areas,
    drawn_markings,
    driven_both_ways,
    lanes_of,
    may_change,
    rules_of,
    with_reverse,
)
from scex_sumo.formats.lane_maps.lane_links import Links, connected
from scex_sumo.formats.lane_maps.overlaps import overlapping
from scex_sumo.formats.recognition import is_commonroad
from scex_sumo.road import Road
from scex_sumo.roads.side import side_of

ReadSign: TypeAlias = Callable[[ElementTree.Element, str], str]


def read_commonroad_road(path: str | Path, *, origin: tuple[float, float] | None = None, **_: object) -> Road:
    """Read the road network of a CommonRoad scenario, version 2018b or 2020a.

    Centrelines lie half-way between the bounds. A lane change is allowed across every marking except a solid
    line or a curb. Speed limits are those of signs (2018b: lanelets), else Germany's. Conflicts are found by
    geometry. A lanelet that cars use both ways gives two lanes. Defects are noted.

    ``origin``: None for the file's location; coordinates stay.
    """
    name_of_sign, words = _library()
    file = open_commonroad(path)
    lanelets = read_lanelets(file, words)
    if not lanelets:
        raise MapError(
            f"{path}: no usable lanelet ({'; '.join(file.notes())}); mend the map, e.g. in CommonRoad's "
            "scenario designer"
        )
    with _quiet():
        signs = _signs(file, name_of_sign)
    links = Links(
        after={i: one.successors for i, one in lanelets.items()},
        before={i: one.predecessors for i, one in lanelets.items()},
        left={i: one.left_neighbour for i, one in lanelets.items()},
        right={i: one.right_neighbour for i, one in lanelets.items()},
    )
    lanes = connected(file, links, lanes_of(file, lanelets, signs), partial(may_change, lanelets))
    lanes = with_reverse(lanes, driven_both_ways(lanelets, lanes))
    lanes = overlapping(lanes, {i: lanelets[lane.reverse_of or i].centre for i, lane in lanes.items()})
    told = None if file.country in ("", "ZAM") else file.country in CODES
    side, unknown = side_of(lanes, told, None if file.origin is None else drives_left_at(file.origin))
    return Road(
        name=map_name(path),
        lanes=lanes,
        regulations=rules_of(file, lanelets, lanes, signs),
        markings=drawn_markings(lanelets),
        areas=drawn_areas(lanes),
        origin=origin or file.origin or (0.0, 0.0),
        notes=(*file.notes(), *unknown),
        left_hand=side,
    )


def _library() -> tuple[ReadSign, dict[str, set[str]]]:
    with extra_for("CommonRoad maps need commonroad-io", "formats"):
        from commonroad.common.common_lanelet import LaneletType, LineMarking, RoadUser
        from commonroad.common.reader.file_reader_xml import TrafficSignElementFactory
        from commonroad.scenario.traffic_sign import SupportedTrafficSignCountry

    def sign(element: ElementTree.Element, country: str) -> str:
        known = {c.value for c in SupportedTrafficSignCountry}
        # Zamunda is CommonRoad's country of no country; its signs are Germany's.
        where = SupportedTrafficSignCountry(country if country in known else "ZAM")
        read = TrafficSignElementFactory.create_from_xml_node(element, where)
        return str(read.traffic_sign_element_id.name)

    users = {user.value for user in RoadUser}
    return sign, {
        "laneletType": {word.value for word in LaneletType},
        "lineMarking": {word.value for word in LineMarking},
        "userOneWay": users,
        "userBidirectional": users,
    }


@contextmanager
def _quiet() -> Iterator[None]:
    logger = logging.getLogger("commonroad")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _signs(file: CommonRoadFile, name_of_sign: ReadSign) -> dict[int, tuple[Sign, ...]]:
    signs: dict[int, tuple[Sign, ...]] = {}
    for i, element in file.elements("trafficSign").items():
        read = []
        for part in element.findall("trafficSignElement"):
            written = (part.findtext("trafficSignID") or "").strip()
            name = name_of_sign(part, file.country) if written else "UNKNOWN"
            values = tuple((value.text or "").strip() for value in part.findall("additionalValue"))
            if name == "UNKNOWN":
                file.note("signs that commonroad-io does not know, left out", i)
            read.append(Sign(name=name, written=written, values=values))
        signs[i] = tuple(read)
    return signs


COMMONROAD = MapFormat(is_mine=is_commonroad, read=read_commonroad_road, tracks=lambda path: path)
