"""CommonRoad 2020a scenario: lanelets, vehicles as obstacles, a planning problem.

The XML is written without commonroad-io, whose interface changes; tests read it with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.files import write_atomic
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.exporters.commonroad_road import add, number_text, road_elements
from scex_sumo.exporters.request import Request
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, States

_GOAL_M = (8.0, 4.0)  # length and width around the ego's last place
_GOAL_STEPS = 5  # before the end
_TYPES = {"van": "car", "tram": "train"}  # where CommonRoad differs


def write_commonroad(request: Request) -> list[Path]:
    """Write a scenario for each child; an ego also gets a planning problem from its seed state to its end.

    Time step 0 is the first logged frame; with an ego, it is the seed scene, and the ego is no obstacle.
    """
    ego, files = request.ego_index(), []
    for child in request.children:
        name = _benchmark(request.road.name, child)
        root = _root(name, request.file_stem(child))
        road, used = road_elements(request.road, request.scene.track_ids.tolist())
        root.extend(road)
        root.extend(_obstacles(request, child, ego, used))
        if ego is not None:
            root.append(_task(request, child, ego, max(used) + 1_000_000))
        ET.indent(root)
        file = request.folder / f"{name}.xml"
        write_atomic(file, ET.tostring(root, encoding="utf-8", xml_declaration=True))
        files.append(file)
    return files


def _benchmark(road: str, child: int) -> str:
    letters = "".join(c for c in road.title() if c.isalnum())
    return f"ZAM_{letters}-1_{child + 1}_T-1"


def _root(name: str, source: str) -> ET.Element:
    root = ET.Element(
        "commonRoad",
        timeStepSize=number_text(STEP_S),
        commonRoadVersion="2020a",
        author="scex-sumo",
        affiliation="",
        source=source,
        benchmarkID=name,
        date="2020-01-01",  # fixed, for reproducible bytes
    )
    location = add(root, "location")
    for tag, value in (("geoNameId", "-999"), ("gpsLatitude", "999"), ("gpsLongitude", "999")):
        add(location, tag, value)
    add(add(root, "scenarioTags"), "simulated")
    return root


def _obstacles(request: Request, child: int, ego: int | None, used: set[int]) -> Iterable[ET.Element]:
    scene, states = request.scene, request.run.states(child)
    first = 0 if ego is None else LOGGED_HISTORY - 1
    free = max([*used, *scene.track_ids.tolist()]) + 1
    for v, track_id in enumerate(scene.track_ids.tolist()):
        if v != ego:
            number = track_id if track_id > 0 and track_id not in used else free + v
            size = float(scene.length[v]), float(scene.width[v])
            yield _obstacle(number, scene.types[v], size, states[v, first:], 0)
    others = scene.obstacles
    for o, kind in enumerate(others.types if others is not None else ()):
        assert others is not None
        frames = request.obstacle_frames()
        present = np.flatnonzero(others.present[o, frames][first:])
        if len(present):
            track = others.states[o, frames][first:][present[0] : present[-1] + 1]
            size = float(others.length[o]), float(others.width[o])
            yield _obstacle(free + scene.vehicles + o, kind, size, track, int(present[0]))


def _obstacle(number: int, kind: str, size: Sequence[float], states: States, first: int) -> ET.Element:
    element = ET.Element("dynamicObstacle", id=str(number))
    add(element, "type", _TYPES.get(road_user(kind), road_user(kind)))
    box = add(add(element, "shape"), "rectangle")
    add(box, "length", number_text(size[0]))
    add(box, "width", number_text(size[1]))
    rows = np.stack([states.x, states.y, states.heading, states.speed], axis=1)
    _state(add(element, "initialState"), rows[0], first)
    if len(rows) > 1:
        line = add(element, "trajectory")
        for t, row in enumerate(rows[1:], start=first + 1):
            _state(add(line, "state"), row, t)
    return element


def _state(element: ET.Element, row: FloatArray, step: int) -> None:
    point = add(add(element, "position"), "point")
    add(point, "x", number_text(row[0]))
    add(point, "y", number_text(row[1]))
    for tag, value in (("orientation", row[2]), ("time", step), ("velocity", row[3])):
        add(add(element, tag), "exact", str(value) if tag == "time" else number_text(value))


def _task(request: Request, child: int, ego: int, number: int) -> ET.Element:
    states = request.run.states(child)[ego]
    steps = states.shape[0] - LOGGED_HISTORY
    now, end = states[LOGGED_HISTORY - 1], states[-1]
    task = ET.Element("planningProblem", id=str(number))
    start = add(task, "initialState")
    _state(start, np.array([now.x, now.y, now.heading, now.speed]), 0)
    for tag in ("yawRate", "slipAngle"):
        add(add(start, tag), "exact", "0.0")
    goal = add(task, "goalState")
    box = add(add(goal, "position"), "rectangle")
    length, width = _GOAL_M
    for tag, value in (("length", length), ("width", width), ("orientation", float(end.heading))):
        add(box, tag, number_text(value))
    centre = add(box, "center")
    add(centre, "x", number_text(float(end.x)))
    add(centre, "y", number_text(float(end.y)))
    time = add(goal, "time")
    add(time, "intervalStart", str(max(steps - _GOAL_STEPS, 1)))
    add(time, "intervalEnd", str(steps))
    return task
