"""Example seeds: their maps are drawn, SUMO drives on them, and the tracks are recorded.

Run as ``python -m example_maps.make_examples [FOLDER]``; without a folder it replaces the package's files.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from example_maps import motorway_merge, roundabout, urban_intersection
from example_maps.drawing import MapDrawing
from scex_sumo.base.errors import SimulationError, UsageError
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.generators.demand import Network, Trip
from scex_sumo.generators.drive import Drive, record
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from scex_sumo.scenarios import EXAMPLES, example_path
from scex_sumo.scene import STEP_S, States

HEADER = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
CYCLIST = "pedestrian/bicycle"  # INTERACTION has one word for both
CYCLIST_RIGHT_M = 0.9  # of the middle of the lane
WALK_MPS = 1.35
PEDESTRIAN_M = 0.5
APPROACH_M = 6.0  # on the pavement, before and after
AT_KERB_S = 2.0  # into the recording
RIDING_S = 18.0
CLEARANCE_M = 1.5


@dataclass(frozen=True, kw_only=True)
class Example:
    """Recipe for the recording of an example seed.

    Attributes:
        vehicles: on the map at most.
        start_s: start of the recording, after the warm-up.
        every_s: mean time between vehicles on a lane into the map, at the beginning and at the end.
        on_foot: add a pedestrian on the zebra crossing and a cyclist.
    """

    vehicles: int
    seed: int
    start_s: float
    length_s: float = 18.0
    every_s: tuple[float, float] = (8.0, 8.0)
    on_foot: bool = False


RECIPES = {
    "roundabout": Example(vehicles=14, seed=22, start_s=60.0, every_s=(9.0, 9.0)),
    "motorway_merge": Example(vehicles=14, seed=42, start_s=60.0, every_s=(7.0, 7.0)),
    "urban_intersection": Example(vehicles=20, seed=136, start_s=60.0, every_s=(10.0, 10.0), on_foot=True),
}
_DRAWINGS = {
    "roundabout": roundabout.draw,
    "motorway_merge": motorway_merge.draw,
    "urban_intersection": urban_intersection.draw,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Track:
    kind: str
    first_step: int
    states: States
    length_m: float
    width_m: float


def draw(name: str) -> MapDrawing:
    """Draw the map of an example seed; raises `UsageError` if the name is unknown."""
    if name not in _DRAWINGS:
        raise UsageError(f"unknown example seed {name!r}; known: {', '.join(EXAMPLES)}")
    return _DRAWINGS[name]()


def make(name: str, folder: Path) -> None:
    """Write the map and the tracks of an example seed into a folder."""
    map_path = folder / f"{name}.osm"
    draw(name).write(map_path)
    _write(map_path.with_suffix(".csv"), _record(read_road(map_path), RECIPES[name]), RECIPES[name])


def _record(road: Road, recipe: Example) -> list[_Track]:
    rng = np.random.default_rng(recipe.seed)
    with tempfile.TemporaryDirectory(prefix="scex-sumo-") as folder:
        net = convert(road, Path(folder) / "map.net.xml")
        recording = record(
            net.path,
            at_most=recipe.vehicles,
            duration_s=recipe.start_s + recipe.length_s + 2.0,
            every_s=recipe.every_s,
            rng=rng,
            also=[_cyclist(Network(net.path), recipe.start_s, rng)] if recipe.on_foot else [],
        )
    first, last = round(recipe.start_s / STEP_S), round((recipe.start_s + recipe.length_s) / STEP_S)
    seen = recording.present[first : last + 1]
    tracks = []
    for vehicle in np.flatnonzero(seen.any(axis=0)):
        step = first + int(np.argmax(seen[:, vehicle]))
        tracks.append(_track(recording, int(vehicle), step))
    if recipe.on_foot:
        tracks.append(_pedestrian(road, tracks, first, last))
    return tracks


def _track(recording: Drive, vehicle: int, step: int) -> _Track:
    trip = recording.trips[vehicle]
    stretch, states = recording.drives
    steps = np.flatnonzero(stretch[:, vehicle] == stretch[step, vehicle])
    states = states[steps, vehicle]
    if trip.kind == CYCLIST:
        states = _shifted(states, CYCLIST_RIGHT_M)
    sizes = {"length_m": trip.length_m, "width_m": trip.width_m}
    return _Track(kind=trip.kind, first_step=int(steps[0]), states=states, **sizes)


def _shifted(states: States, right_m: float) -> States:
    x = states.x + right_m * np.sin(states.heading)
    y = states.y - right_m * np.cos(states.heading)
    return States(x=x, y=y, heading=states.heading, speed=states.speed)


def _cyclist(network: Network, start_s: float, rng: np.random.Generator) -> Trip:
    """Return a cyclist that is on its way when the recording starts."""
    origin = network.origins[0]
    edges = network.random_route(origin, rng)
    if edges is None:
        raise SimulationError(f"no way from edge {origin[0]} to the edge of the map for the cyclist")
    driver = {"carFollowModel": "EIDM", "maxSpeed": "5.2", "accel": "0.9", "decel": "2.5", "minGap": "1.5"}
    return Trip(
        depart_s=start_s - RIDING_S,
        lane=origin[1],
        edges=edges,
        kind=CYCLIST,
        length_m=1.8,
        width_m=0.6,
        driver=driver,
    )


def _pedestrian(road: Road, others: list[_Track], first: int, last: int) -> _Track:
    """Return a pedestrian that walks to the zebra crossing, waits for a gap, and crosses."""
    line = next(lane.centreline for lane in road.lanes.values() if lane.kind == "pedestrian")
    across = float(np.hypot(*(line[-1] - line[0])))
    pace = WALK_MPS * STEP_S
    to_kerb = np.arange(-APPROACH_M, 0.0, pace)
    over = np.arange(0.0, across + APPROACH_M, pace)
    begin = first - len(to_kerb) + round(AT_KERB_S / STEP_S)
    for wait in range(last - begin):
        along = np.concatenate([to_kerb, np.zeros(wait), over])
        direction = (line[-1] - line[0]) / across
        points = line[0] + along[:, None] * direction
        heading = np.full(len(along), np.arctan2(direction[1], direction[0]))
        speed = np.gradient(along, STEP_S)
        states = States(x=points[:, 0], y=points[:, 1], heading=heading, speed=speed)
        walk = _Track(
            kind=CYCLIST, first_step=begin, states=states, length_m=PEDESTRIAN_M, width_m=PEDESTRIAN_M
        )
        if all(_gap(walk, other) > CLEARANCE_M for other in others):
            return walk
    raise SimulationError("nobody lets the pedestrian cross; choose another seed for the example")


def _gap(one: _Track, other: _Track) -> float:
    """Return the smallest distance between two road users at the same step, m; inf if they never meet."""
    begin = max(one.first_step, other.first_step)
    end = min(one.first_step + one.states.shape[0], other.first_step + other.states.shape[0])
    if end <= begin:
        return float("inf")
    steps = (track.states[begin - track.first_step : end - track.first_step] for track in (one, other))
    sizes = ((np.array(track.length_m), np.array(track.width_m)) for track in (one, other))
    first, second = (Rectangles.of(way, *size) for way, size in zip(steps, sizes, strict=True))
    return float(rectangle_distance(first, second).min())


def _write(path: Path, tracks: list[_Track], recipe: Example) -> None:
    first = round(recipe.start_s / STEP_S)
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(f"{HEADER}\n")
        writer = csv.writer(file, lineterminator="\n")
        for number, track in enumerate(sorted(tracks, key=lambda track: track.first_step), 1):
            writer.writerows(_rows(number, track, first, first + round(recipe.length_s / STEP_S)))


def _rows(number: int, track: _Track, first: int, last: int) -> Iterator[list[str]]:
    begin, end = max(first, track.first_step), min(last + 1, track.first_step + track.states.shape[0])
    heading = np.angle(np.exp(1j * track.states.heading))
    for step in range(begin, end):
        k, frame = step - track.first_step, step - first + 1
        speed, psi = track.states.speed[k], heading[k]
        numbers = (track.states.x[k], track.states.y[k], speed * np.cos(psi), speed * np.sin(psi), psi)
        size = (f"{track.length_m:.2f}", f"{track.width_m:.2f}")
        yield [str(number), str(frame), str(100 * frame), track.kind, *(f"{v:.3f}" for v in numbers), *size]


def main(arguments: list[str]) -> None:
    """Write all example seeds into the named folder, or into the package."""
    for name in EXAMPLES:
        make(name, Path(arguments[0]) if arguments else example_path(name).parent)


if __name__ == "__main__":
    main(sys.argv[1:])
