"""Pedestrians, cyclists and replayed vehicles in SUMO's world: persons on crossings and lanes, or beside.

``person.moveToXY`` of libsumo 1.28 takes a lane for the wanted edge. On walking areas it shifts persons by
up to 12 m, and crashes if one comes to them from a lane in a junction. So moved persons are never on them:
SUMO's drivers see them on crossings and lanes. One that changes between these is removed and added again.
Moved persons face along the crossing's lane, whatever their angle: one that walks against it stands at the
lane's begin, where it is still before all vehicles. Persons of a simulation that are on a sidewalk or about
to cross walk by themselves: SUMO's drivers wait for a person that comes to a crossing.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import shapely
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.converters.net.sumo_net import LANE_WIDTH_M, points_of
from scex_sumo.converters.tracks.road_users import obstacle_kinds, road_user
from scex_sumo.converters.xml import permits
from scex_sumo.intention import Walk
from scex_sumo.scene import HISTORY_STEPS, REPLAYED, Obstacles, SeedScene, States
from scex_sumo.world.batch import MATCH_M, NO_LANE, OWN_LANE, RunningBatch, obstacle_id, to_sumo
from scex_sumo.world.session import ANY_ROUTE
from scex_sumo.world.tiles import tile_id
from scex_sumo.world.vehicle_types import PERSON, WALKER, TypeBook, road_class

LANE: Final = "lane"
NOWHERE: Final = ""
WALKS: Final = "walks"
_ANY_CLASS = 4  # of moveToXY's keepRoute
_NO_MATCH_M = 1e-6
_STAGE_S = 1e6
_BEGIN_M = 0.1
_STANDS_MPS, _WALKS_MPS = 0.3, 1.39
REACH_M = 250.0  # between vehicles that can meet within some seconds


class WalkingPlaces:
    """Crossings of a net, and its lanes for cars.

    Attributes:
        edge: id of an edge, on which persons are added.
        for_cyclists: whether bicycles may be where cars may be, and nowhere else.
    """

    def __init__(self, net: ElementTree.Element) -> None:
        """Collect the places of a net."""
        self._crossings, shapes, lanes, apart = list[str](), list[Any](), list[Any](), False
        self._lines: list[Any] = []
        self._sidewalks: dict[str, tuple[Any, float]] = {}
        self.edge = ""
        for edge in net.iter("edge"):
            function = edge.get("function", "normal")
            walks = function in ("crossing", "walkingarea")
            for lane in edge.iter("lane"):
                cars, bicycles = permits(lane, "passenger"), permits(lane, "bicycle")
                apart |= cars != bicycles
                if function == "crossing":
                    self._crossings.append(lane.get("id", ""))
                    shapes.append(_area(lane))
                    self._lines.append(shapely.LineString(points_of(lane.get("shape", ""))))
                elif not walks and permits(lane, "pedestrian"):
                    line = shapely.LineString(points_of(lane.get("shape", "")))
                    scale = float(lane.get("length", line.length)) / line.length
                    self._sidewalks.setdefault(edge.get("id", ""), (line, scale))
                if not walks and cars:
                    lanes.append(_area(lane))
                    self.edge = self.edge or (edge.get("id", "") if function == "normal" else "")
        self.for_cyclists = not apart
        self._shapes, self._lanes = shapely.STRtree(shapes), shapely.STRtree(lanes)

    def along(self, walk: Walk, x: float, y: float) -> float | None:
        """Return the place of a person on the first edge of its walk, m; None if it cannot go on from there.

        A person on a crossing cannot.
        """
        point = shapely.Point(x, y)
        if not walk.edges or not self._sidewalks.keys() >= set(walk.edges):
            return None
        if len(self._shapes.query(point, predicate="intersects")):
            return None
        line, scale = self._sidewalks[walk.edges[0]]
        return float(line.project(point)) * scale

    def road_class(self, kind: str) -> str:
        """Return SUMO's class for a recorded type; bicycles have their own where they use cars' lanes."""
        return "bicycle" if self.for_cyclists and road_user(kind) == "bicycle" else road_class(kind)

    def find(
        self, x: FloatArray, y: FloatArray, angle: FloatArray
    ) -> tuple[NDArray[np.object_], FloatArray, FloatArray]:
        """Return the places (N,) of persons, a crossing's lane, `LANE` or `NOWHERE`, and where to put them.

        ``angle`` in degrees, as SUMO has it.
        """
        x, y = x.copy(), y.copy()
        points, places = shapely.points(x, y), np.full(len(x), NOWHERE, dtype=object)
        places[self._lanes.query(points, predicate="intersects")[0]] = LANE
        for point, crossing in self._shapes.query(points, predicate="intersects").T.tolist():
            places[point] = self._crossings[crossing]
            begin, end = self._lines[crossing].interpolate([_BEGIN_M, -_BEGIN_M])
            ahead = np.radians(angle[point])
            if (end.x - begin.x) * np.sin(ahead) + (end.y - begin.y) * np.cos(ahead) < 0:
                x[point], y[point] = begin.x, begin.y
        return places, x, y


@lru_cache(maxsize=1)
def walking_places(net: bytes) -> WalkingPlaces:
    """Return the walking places of a net by the content of its file; the last ones are reused."""
    return WalkingPlaces(ElementTree.fromstring(net))


class People:
    """Pedestrians, cyclists and replayed vehicles of a batch, for SUMO's drivers and for sumo-gui."""

    def __init__(
        self, sumo: Any, places: WalkingPlaces, scene: SeedScene, batch: RunningBatch, types: TypeBook
    ) -> None:
        self._sumo, self.places = sumo, places
        self._scene, self._batch, self._types = scene, batch, types
        self._place: dict[str, str] = {}

    def put(self, key: str, kind: str, slot: int, place: str, pose: Sequence[float]) -> None:
        """Set the pose of a person after the next step; its place is as of `WalkingPlaces.find`."""
        calls = self._sumo.person
        if self._place.get(key) != place:
            self._remove(key)
            calls.add(key, tile_id(slot, self.places.edge), 0.0, typeID=kind)
            calls.appendWaitingStage(key, _STAGE_S)
            self._place[key] = place
        wanted, route, reach = "", OWN_LANE, MATCH_M
        if place == NOWHERE:
            reach = _NO_MATCH_M
        elif place != LANE:
            wanted, route = tile_id(slot, place), OWN_LANE + _ANY_CLASS
        calls.moveToXY(key, wanted, *pose, route, reach)

    def _walk(self, key: str, kind: str, slot: int, walk: Walk, at_m: float, speed_mps: float) -> None:
        """Let SUMO walk a person from now on, from a place on its first edge."""
        if key not in self._place:
            calls, edges = self._sumo.person, [tile_id(slot, edge) for edge in walk.edges]
            calls.add(key, edges[0], at_m, typeID=kind)
            calls.appendWalkingStage(key, edges, walk.arrival_m)
            calls.setSpeed(key, speed_mps)
            self._place[key] = WALKS

    def _remove(self, key: str) -> None:
        """Remove a person, if it is there."""
        place = self._place.pop(key, None)
        if place is not None and (place != WALKS or key in self._sumo.person.getIDList()):
            self._sumo.person.remove(key)

    def remove_put(self) -> None:
        """Remove all that do not walk by themselves."""
        for key in [key for key, place in self._place.items() if place != WALKS]:
            self._remove(key)

    def put_obstacles(self, others: Obstacles, states: States, present: BoolArray) -> None:
        """Set the states (O,) after the next step, in futures with SUMO drivers or a watcher."""
        batch, types = self._batch, self._types
        front_x, front_y, angle = to_sumo(states, others.length)
        kinds, (places, front_x, front_y) = obstacle_kinds(others), self.places.find(front_x, front_y, angle)
        starts = self._starts(others)
        for future in np.flatnonzero(batch.mixed):
            slot, (dx, dy) = batch.slots[future], batch.offset[:, future, 0]
            for o in obstacles_in_reach(self._scene):
                key = obstacle_id(slot, others.ids[o])
                if key in batch.loaded:
                    continue
                pose = float(front_x[o] + dx), float(front_y[o] + dy), float(angle[o])
                if road_user(kinds[o]) != "pedestrian":
                    self._put_vehicle(key, o, kinds[o], slot, pose if present[o] else None)
                elif not present[o]:
                    self._remove(key)
                elif (at_m := starts[o]) is not None:
                    speed = float(others.states.speed[o, : HISTORY_STEPS + 1].max())  # in the last second
                    speed = speed if speed > _STANDS_MPS else _WALKS_MPS
                    self._walk(key, types.obstacle(o) + WALKER, slot, others.walks[o], at_m, speed)
                else:
                    self.put(key, types.obstacle(o) + PERSON, slot, places[o], pose)

    def _put_vehicle(
        self, key: str, o: int, kind: str, slot: int, pose: tuple[float, float, float] | None
    ) -> None:
        calls, there = self._sumo.vehicle, self._batch.obstacles
        if pose is None:
            if key in there:
                calls.remove(key)
                there.remove(key)
            return
        if key not in there:
            calls.add(key, tile_id(slot, ANY_ROUTE), self._types.obstacle(o))
            calls.setVehicleClass(key, self.places.road_class(kind))
            there.add(key)
        calls.moveToXY(key, "", NO_LANE, *pose, OWN_LANE, MATCH_M)

    def _starts(self, others: Obstacles) -> list[float | None]:
        """Return where persons (O,) of a simulation begin on their walks, m; None of others."""
        x, y, _ = to_sumo(others.states[:, HISTORY_STEPS], others.length)
        walks = others.walks or [Walk()] * len(others.ids)
        starts = zip(walks, x.tolist(), y.tolist(), strict=True)
        return [self.places.along(walk, *start) for walk, *start in starts]

    def put_pedestrians(self, poses: tuple[FloatArray, FloatArray, FloatArray]) -> None:
        """Set the poses (C, V) of pedestrians that take part after the next step."""
        batch = self._batch
        x, y, angle = (values[batch.walking] for values in poses)
        futures, vehicles = np.nonzero(batch.walking)
        dx, dy = batch.offset[:, futures, 0]
        places, at_x, at_y = self.places.find(x - dx, y - dy, angle)
        columns = futures, vehicles, places, at_x + dx, at_y + dy, angle
        for future, v, place, *pose in zip(*(column.tolist() for column in columns), strict=True):
            key, slot = batch.id_of(future, v), batch.slots[future]
            self.put(key, self._types.overridden(v) + PERSON, slot, place, pose)


@owner_cache
def obstacles_in_reach(scene: SeedScene) -> list[int]:
    """Return the obstacles of SUMO's world: replayed vehicles far from all simulated ones are left out."""
    if (others := scene.obstacles) is None:
        return []
    now, there = scene.now, others.states[:, HISTORY_STEPS]
    apart = np.hypot(there.x[:, None] - now.x, there.y[:, None] - now.y).min(axis=1)
    return [o for o, kind in enumerate(others.types) if kind != REPLAYED or apart[o] <= REACH_M]


def _area(lane: ElementTree.Element) -> Any:
    half = float(lane.get("width", LANE_WIDTH_M)) / 2
    return shapely.LineString(points_of(lane.get("shape", ""))).buffer(half, cap_style="flat")
