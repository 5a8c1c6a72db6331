"""Small CommonRoad scenarios written by hand, in metres, for tests.

write_scenario(tmp_path / "two.xml", [
    Lanelet(1, left=[(0, 3), (50, 3)], right=[(0, 0), (50, 0)], successors=[2]),
    Lanelet(2, left=[(50, 3), (90, 3)], right=[(50, 0), (90, 0)], predecessors=[1]),
])
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

Point = Sequence[float]  # (x, y) or (x, y, z), m


@dataclass(frozen=True, kw_only=True)
class StopLine:
    """A stop line: its ends (none: the lanelet's end) and what it refers to."""

    points: Sequence[Point] = ()
    signs: Sequence[int] = ()
    lights: Sequence[int] = ()


@dataclass(frozen=True)
class Lanelet:
    """A lanelet; neighbours as (id, ``same`` or ``opposite``)."""

    lanelet_id: int | str
    left: Sequence[Point]
    right: Sequence[Point]
    successors: Sequence[int] = ()
    predecessors: Sequence[int] = ()
    left_of: tuple[int, str] | None = None
    right_of: tuple[int, str] | None = None
    types: Sequence[str] = ("urban",)
    one_way: Sequence[str] = ()
    both_ways: Sequence[str] = ()
    left_marking: str = ""
    right_marking: str = ""
    signs: Sequence[int] = ()
    lights: Sequence[int] = ()
    stop_line: StopLine | None = None
    speed_limit: str = ""  # m/s, of version 2018b only


@dataclass(frozen=True)
class Sign:
    """A traffic sign with one element."""

    sign_id: int
    written: str
    values: Sequence[str] = ()


@dataclass(frozen=True)
class Vehicle:
    """A recorded obstacle: states (step, x, y, heading, speed), the first of them its initial state."""

    vehicle_id: int
    states: Sequence[tuple[int, float, float, float, float]]
    kind: str = "car"
    length: float = 4.5
    width: float = 1.8


def straight(
    lanelet_id: int, x: float, y: float, length: float, width: float = 3.0, **rest: object
) -> Lanelet:
    """A lanelet along +x; (x, y) is where its centreline begins."""
    left = [(x, y + width / 2), (x + length, y + width / 2)]
    right = [(x, y - width / 2), (x + length, y - width / 2)]
    return Lanelet(lanelet_id, left, right, **rest)  # type: ignore[arg-type]


def scenario(
    lanelets: Sequence[Lanelet],
    *,
    signs: Sequence[Sign] = (),
    lights: Sequence[int] = (),
    intersections: Mapping[int, Sequence[Sequence[int]]] | None = None,
    vehicles: Sequence[Vehicle] = (),
    version: str = "2020a",
    benchmark: str = "DEU_Test-1_1_T-1",
    step_s: float = 0.1,
    place: Point | None = (48.0, 11.0),
) -> str:
    """The text of a scenario."""
    where = ""
    if place is not None:
        where = (
            f"<location><geoNameId>-999</geoNameId><gpsLatitude>{place[0]}</gpsLatitude>"
            f"<gpsLongitude>{place[1]}</gpsLongitude></location>"
        )
    parts = [where, *(_lanelet(lanelet) for lanelet in lanelets)]
    for sign in signs:
        values = "".join(f"<additionalValue>{value}</additionalValue>" for value in sign.values)
        parts.append(
            f'<trafficSign id="{sign.sign_id}"><trafficSignElement><trafficSignID>{sign.written}'
            f"</trafficSignID>{values}</trafficSignElement></trafficSign>"
        )
    parts += [f'<trafficLight id="{light}"><cycle/></trafficLight>' for light in lights]
    for number, groups in (intersections or {}).items():
        incoming = "".join(
            f'<incoming id="{number + k}">{_refs("incomingLanelet", group)}</incoming>'
            for k, group in enumerate(groups, start=1)
        )
        parts.append(f'<intersection id="{number}">{incoming}</intersection>')
    parts += [_vehicle(vehicle) for vehicle in vehicles]
    return (
        f'<?xml version="1.0"?><commonRoad timeStepSize="{step_s}" commonRoadVersion="{version}" '
        f'benchmarkID="{benchmark}" author="" affiliation="" source="" date="2026-01-01">'
        f"{''.join(parts)}</commonRoad>"
    )


def write_scenario(path: Path, lanelets: Sequence[Lanelet], **rest: object) -> Path:
    """Write a scenario; see ``scenario``."""
    path.write_text(scenario(lanelets, **rest), encoding="utf-8")  # type: ignore[arg-type]
    return path


def _points(points: Sequence[Point]) -> str:
    names = ("x", "y", "z")
    return "".join(
        "<point>" + "".join(f"<{n}>{v}</{n}>" for n, v in zip(names, p, strict=False)) + "</point>"
        for p in points
    )


def _refs(tag: str, refs: Sequence[int]) -> str:
    return "".join(f'<{tag} ref="{ref}"/>' for ref in refs)


def _words(tag: str, words: Sequence[str]) -> str:
    return "".join(f"<{tag}>{word}</{tag}>" for word in words)


def _lanelet(lanelet: Lanelet) -> str:
    sides = "".join(
        f"<{tag}>{_points(points)}{_words('lineMarking', [marking] if marking else [])}</{tag}>"
        for tag, points, marking in (
            ("leftBound", lanelet.left, lanelet.left_marking),
            ("rightBound", lanelet.right, lanelet.right_marking),
        )
    )
    neighbours = "".join(
        f'<{tag} ref="{side[0]}" drivingDir="{side[1]}"/>'
        for tag, side in (("adjacentLeft", lanelet.left_of), ("adjacentRight", lanelet.right_of))
        if side is not None
    )
    line = ""
    if lanelet.stop_line is not None:
        refs = _refs("trafficSignRef", lanelet.stop_line.signs)
        refs += _refs("trafficLightRef", lanelet.stop_line.lights)
        line = (
            f"<stopLine>{_points(lanelet.stop_line.points)}<lineMarking>solid</lineMarking>{refs}</stopLine>"
        )
    return (
        f'<lanelet id="{lanelet.lanelet_id}">{sides}{_refs("predecessor", lanelet.predecessors)}'
        f"{_refs('successor', lanelet.successors)}{neighbours}{line}"
        f"{_words('speedLimit', [lanelet.speed_limit] if lanelet.speed_limit else [])}"
        f"{_words('laneletType', lanelet.types)}{_words('userOneWay', lanelet.one_way)}"
        f"{_words('userBidirectional', lanelet.both_ways)}{_refs('trafficSignRef', lanelet.signs)}"
        f"{_refs('trafficLightRef', lanelet.lights)}</lanelet>"
    )


def _vehicle(vehicle: Vehicle) -> str:
    states = [
        f"<position>{_points([(x, y)])}</position><orientation><exact>{heading}</exact></orientation>"
        f"<time><exact>{step}</exact></time><velocity><exact>{speed}</exact></velocity>"
        for step, x, y, heading, speed in vehicle.states
    ]
    path = "".join(f"<state>{state}</state>" for state in states[1:])
    shape = f"<rectangle><length>{vehicle.length}</length><width>{vehicle.width}</width></rectangle>"
    return (
        f'<dynamicObstacle id="{vehicle.vehicle_id}"><type>{vehicle.kind}</type><shape>{shape}</shape>'
        f"<initialState>{states[0]}</initialState><trajectory>{path}</trajectory></dynamicObstacle>"
    )
