"""Reader of CommonRoad maps; only here: commonroad-io."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias
from xml.etree import ElementTree

from scex_sumo.base.errors import MapError
from scex_sumo.base.importing import extra_for
from scex_sumo.converters.lanelet.tags import LEFT_HAND, drives_left_at
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import MapFormat
from scex_sumo.formats.commonroad.file import CommonRoadFile, parse_commonroad
from scex_sumo.formats.commonroad.lanes import Sign, drawn_lines, read_lanelets, rules_of, with_opposite
from scex_sumo.formats.lane_maps.lane_map import drawn_road
from scex_sumo.formats.recognition import is_commonroad
from scex_sumo.road import Area, Road

ReadSign: TypeAlias = Callable[[ElementTree.Element, str], str]


def read_commonroad_road(path: str | Path, *, origin: tuple[float, float] | None = None, **_: object) -> Road:
    """Read the road network of a CommonRoad scenario, version 2018b or 2020a.

    Centrelines lie half-way between the bounds. A lane change is allowed across every marking except a solid
    line or a curb. Speed limits are those of signs (2018b: lanelets), else Germany's. Conflicts are found by
    geometry. A lanelet that cars use both ways gives two lanes. Defects are noted.

    ``origin``: None for the file's location; coordinates stay.
    """
    name_of_sign, words = _library()
    file = CommonRoadFile(path=Path(path), root=parse_commonroad(Path(path)), moved=False)
    if file.root.find("lanelet") is None:
        raise MapError(f"{path}: a CommonRoad file without lanelets; name one with a road network")
    with _quiet():
        signs = _signs(file, name_of_sign)
    lanelets = read_lanelets(file, words, signs)
    file.lanes += with_opposite(lanelets).values()
    file.lines = drawn_lines(lanelets)
    known = file.country not in ("", "ZAM")
    file.left_hand = (
        file.country in LEFT_HAND if known else drives_left_at(file.origin) if file.origin else None
    )
    road = drawn_road(file, name=map_name(path))
    others = (lane for lane in road.lanes.values() if lane.kind != "vehicle")  # drawn as regions
    return replace(
        road,
        regulations=rules_of(file, lanelets, road.lanes, signs),
        markings=road.markings if file.lines else (),
        areas=tuple(Area(area_id=x.lane_id, kind=x.subtype, outline=x.outline) for x in others),
        origin=origin or file.origin or (0.0, 0.0),
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
