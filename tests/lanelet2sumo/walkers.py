"""Maps with crosswalks, SUMO's cars and people on them, and how often a moving car touches a person."""

from __future__ import annotations

import math
import random
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from scex_sumo.lanelet2sumo.reader import NetContent, read_net
from scex_sumo.road import Lane, Road
from tests.converters.sumo_roads import SUMO, lane
from tests.lanelet2sumo.judge.driving import border_routes

CAR_M, CAR_WIDTH_M = 4.7, 1.8
PERSON_M = 0.2  # radius of a person's body
MOVING_MPS = 0.5
STEP_S = 0.1


ROUNDABOUT_ARMS = (-93.0, -14.0, 84.0, 178.0)  # headings of the arms of the example maps, degrees
CENTRE = (1000.0, 1000.0)


def crosswalk(
    lane_id: int, heading_deg: float, radius: float, ends: tuple[float, float], width: float = 4.0
) -> Lane:
    """A crosswalk across an arm, at a distance from the middle; ``ends`` in m to the left of the arm."""
    c, s = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    points = [(CENTRE[0] + radius * c - s * d, CENTRE[1] + radius * s + c * d) for d in ends]
    return replace(lane(lane_id, points, width=width, kind="pedestrian"), subtype="crosswalk")


def with_lanes(road: Road, *more: Lane) -> Road:
    """A road with more lanes."""
    return replace(road, lanes={**road.lanes, **{one.lane_id: one for one in more}})


def contacts(
    net_path: Path, *, end_s: float = 300.0, cars_s: float = 2.0, people_s: float = 1.0
) -> list[str]:
    """Pairs of a moving car and a person on a crossing that touch, with the place and the first time."""
    net = read_net(net_path)
    root = ET.parse(net_path).getroot()
    demand, fcd = net_path.with_name("walk.rou.xml"), net_path.with_name("walk.fcd.xml")
    demand.write_text(_demand(net, root, end_s, cars_s, people_s))
    command = [SUMO, "-n", net_path, "-r", demand, "--fcd-output", fcd, "--step-length", STEP_S, "--seed", 1]
    command += ["--fcd-output.attributes", "id,x,y,angle,speed,edge,lane", "--end", end_s]
    command += ["--time-to-teleport", -1, "--xml-validation", "never", "--no-step-log", "--no-warnings"]
    subprocess.run(list(map(str, command)), check=True, capture_output=True, timeout=300)
    return list(_touches(fcd))


def _demand(net: NetContent, root: ET.Element, end_s: float, cars_s: float, people_s: float) -> str:
    draw = random.Random(0)
    car = f'<vType id="car" vClass="passenger" length="{CAR_M}" width="{CAR_WIDTH_M}"/>'
    trips = []
    routes, walks = border_routes(net), sorted(_walks(root))
    for k in range(int(end_s / cars_s)):
        edges = " ".join(draw.choice(routes))
        vehicle = f'<vehicle id="c{k}" type="car" depart="{k * cars_s}" departSpeed="max" departLane="best">'
        trips.append((k * cars_s, f'{vehicle}<route edges="{edges}"/></vehicle>'))
    for k in range(int(end_s / people_s)):
        edges = draw.choice(walks)
        person = f'<person id="p{k}" depart="{k * people_s}"><walk edges="{edges}"/></person>'
        trips.append((k * people_s, person))
    return f"<routes>{car}{''.join(text for _, text in sorted(trips))}</routes>"


def _walks(root: ET.Element) -> Iterator[str]:
    """Walks over each crossing, both ways, from a sidewalk to a sidewalk."""
    inner = {e.get("id"): e.get("function") for e in root.iter("edge") if e.get("function")}
    steps: dict[str, set[str]] = {}
    people = {e.get("id", "") for e in root.iter("edge") for x in e if "pedestrian" in x.get("allow", "")}
    for c in root.iter("connection"):
        one, other = c.get("from", ""), c.get("to", "")
        if one in people and other in people:
            steps.setdefault(one, set()).add(other)
            steps.setdefault(other, set()).add(one)
    for crossing in (i for i, function in inner.items() if function == "crossing" and i in steps):
        sides = [_sidewalks(area, crossing, steps, inner) for area in sorted(steps[crossing])]
        if len(sides) == 2:
            yield from (f"{a} {b}" for p, q in (sides, sides[::-1]) for a in p for b in q if a != b)


def _sidewalks(area: str, last: str, steps: dict[str, set[str]], inner: dict[str, str]) -> list[str]:
    """The first sidewalks behind a walking area, over further crossings if need be."""
    queue, seen, found = [area], {last, area}, []
    for one in queue:
        for other in sorted(steps.get(one, ())):
            if other not in inner:
                found.append(other)
            elif other not in seen:
                seen.add(other)
                queue.append(other)
    return found[:2]


def _touches(fcd: Path) -> Iterator[str]:
    known = set[tuple[str | None, str | None]]()
    for _, step in ET.iterparse(fcd):
        if step.tag != "timestep":
            continue
        cars = [c for c in step if c.tag == "vehicle" and float(c.get("speed", "")) > MOVING_MPS]
        people = [p for p in step if p.tag == "person" and "_c" in p.get("edge", "")]
        if cars and people:
            boxes = shapely.polygons([_box(c) for c in cars])
            points = shapely.points([(float(p.get("x", "")), float(p.get("y", ""))) for p in people])
            near = shapely.STRtree(points).query(boxes, predicate="dwithin", distance=PERSON_M)
            for i, j in near.T.tolist():
                car, person = cars[i], people[j]
                pair = car.get("id"), person.get("id")
                if pair not in known:
                    known.add(pair)
                    yield " ".join(
                        [f"t={step.get('time')}", *(f"{k}={car.get(k)}" for k in ("id", "lane", "speed"))]
                        + [f"{k}={person.get(k)}" for k in ("id", "edge", "x", "y", "speed")]
                    )
        step.clear()


def _box(car: ET.Element) -> list[tuple[float, float]]:
    x, y = float(car.get("x", "")), float(car.get("y", ""))
    angle = np.radians(90.0 - float(car.get("angle", "")))
    c, s = np.cos(angle), np.sin(angle)
    local = [(0, 1), (0, -1), (-CAR_M, -1), (-CAR_M, 1)]
    return [(x + c * u - s * v * CAR_WIDTH_M / 2, y + s * u + c * v * CAR_WIDTH_M / 2) for u, v in local]
