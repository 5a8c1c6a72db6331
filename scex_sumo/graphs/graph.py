"""Semantic scene graph of all futures of a batch, without edges between futures; SI units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import SEEN_COLUMNS, seen_from
from scex_sumo.graphs.edges import EDGE_COLUMNS, KINDS, MATCHES, Located, scene_edges
from scex_sumo.road import Road
from scex_sumo.roads.matching import Matches, match
from scex_sumo.roads.relations import LaneRelations, road_index
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, States

__all__ = ["EDGE_COLUMNS", "HISTORY_COLUMNS", "KINDS", "NODE_COLUMNS", "SceneGraph", "scene_graph"]

RADIUS_M = 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneGraph:
    """The semantic scene graphs of all futures of a batch; node = future * V + vehicle.

    Attributes:
        future: (N,) index into the batch.
        vehicle: (N,) index into the seed scene's vehicles.
        node: (N, F) features, columns as in `NODE_COLUMNS`.
        history: (N, 11, 5) the last second in the node's present frame, oldest first, columns as in
            `HISTORY_COLUMNS`.
        edge_index: (2, E) source and target, sorted by target, then by source. The source influences the
            target.
        edge_kind: (E,) index into `KINDS`: the source is ahead of the target (0), behind it (1), on a lane
            beside (2), or their ways meet ahead of both (3).
        edge: (E, G) features, columns as in `EDGE_COLUMNS`.
        on_road: (N,) False for a vehicle without a fitting lane; it has no edges.
        lane_id: (N,) most probable lane; arbitrary off the road.
        arc: (N,) arc length on that lane, m; 0 off the road.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> graph = scex.scene_graph(scene)
        >>> graph.node.shape[0], graph.edge_index.shape[0]
        (14, 2)
    """

    future: IntArray
    vehicle: IntArray
    node: FloatArray
    node_columns: tuple[str, ...]
    history: FloatArray
    history_columns: tuple[str, ...]
    edge_index: IntArray
    edge_kind: IntArray
    edge: FloatArray
    edge_columns: tuple[str, ...]
    on_road: BoolArray
    lane_id: IntArray
    arc: FloatArray


@checked
def scene_graph(
    history: SceneHistory | SeedScene, road: Road | None = None, *, radius: float = RADIUS_M
) -> SceneGraph:
    """Build the semantic scene graphs of all futures; kept with the history.

    Args:
        history: a batch of futures, or a seed scene as the only future.
        road: the map; None takes that of the seed scene.
        radius: largest length of an edge, centre to centre, m.

    Raises:
        UsageError: there is no road, or the radius is not positive.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> scex.scene_graph(scene).node_columns[:3]
        ('length', 'width', 'is_car')
    """
    scene = history if isinstance(history, SeedScene) else history.scene
    road = scene.road if road is None else road
    if road is None:
        raise UsageError(f"scene graph of {scene.name}: the scene has no road; give road=read_map(...)")
    if not radius > 0:
        raise UsageError(f"scene graph: radius is {radius}; needs a length above 0 m")
    return _build(history, road, radius)


@owner_cache
def _build(given: SceneHistory | SeedScene, road: Road, radius: float) -> SceneGraph:
    history = SceneHistory.of_scene(given) if isinstance(given, SeedScene) else given
    futures, vehicles = history.now.shape
    now, seen = history.now.map(np.ravel), seen_from(history.now, history.states)
    index = road_index(road)
    place = _locate(index, match(road, now.x, now.y, now.heading), len(now.x))
    edge_index, kind, edge = _edges(history, now, place, index, radius)
    return SceneGraph(
        future=np.repeat(np.arange(futures), vehicles),
        vehicle=np.tile(np.arange(vehicles), futures),
        node=node_features(history, place, index),
        node_columns=NODE_COLUMNS,
        history=seen.reshape(-1, *seen.shape[2:]),
        history_columns=HISTORY_COLUMNS,
        edge_index=edge_index,
        edge_kind=kind,
        edge=edge,
        edge_columns=EDGE_COLUMNS,
        on_road=place.probability[0] > 0,
        lane_id=index.lane_id[place.lane[0]] if len(index.lane_id) else place.lane[0],
        arc=place.s[0],
    )


def _locate(index: LaneRelations, matches: Matches, count: int) -> Located:
    place = Located(np.zeros((MATCHES, count), dtype=np.int64), *np.zeros((4, MATCHES, count)))
    rank = np.arange(len(matches.vehicle)) - np.searchsorted(matches.vehicle, matches.vehicle)
    for k in range(MATCHES):
        ranked = rank == k
        vehicle = matches.vehicle[ranked]
        place.lane[k, vehicle] = np.searchsorted(index.lane_id, matches.lane_id[ranked])
        for name in ("s", "offset", "heading_error", "probability"):
            getattr(place, name)[k, vehicle] = getattr(matches, name)[ranked]
    return place


def _edges(
    history: SceneHistory, now: States, place: Located, index: LaneRelations, radius: float
) -> tuple[IntArray, IntArray, FloatArray]:
    futures, vehicles = history.now.shape
    x, y = history.now.x, history.now.y
    near = (x[:, :, None] - x[:, None, :]) ** 2 + (y[:, :, None] - y[:, None, :]) ** 2 <= radius**2
    on_road = (place.probability[0] > 0).reshape(futures, vehicles)
    near &= on_road[:, :, None] & on_road[:, None, :]
    near[:, np.arange(vehicles), np.arange(vehicles)] = False
    flat = np.flatnonzero(near)
    target = flat // vehicles
    source = target // vehicles * vehicles + flat % vehicles
    length = np.tile(history.scene.length, futures)
    return scene_edges(target, source, now, length, place, index)


TYPES = ("car", "truck", "motorcycle", "other")
NODE_COLUMNS = (
    "length",  # m
    "width",
    *(f"is_{kind}" for kind in TYPES),
    "speed",  # m/s
    "yaw_rate",  # rad/s
    "acceleration",  # m/s²
    "match_probability",  # of the most probable lane; this and the next three are 0 off the road
    "lane_offset",  # m, from the centreline, left positive
    "lane_heading_error",  # rad, vehicle minus lane
    "speed_limit",  # m/s, of the lane
    "obstacle_ahead",  # 1 if a pedestrian or cyclist is in the corridor ahead; else 0, and the next two
    "obstacle_distance",  # m, from the front bumper to the obstacle's centre
    "obstacle_offset",  # m, left positive
)
HISTORY_COLUMNS = SEEN_COLUMNS
SLOPE_STEPS = 5  # 0.5 s
CORRIDOR_M = 30.0  # ahead of the front bumper
CORRIDOR_HALF_WIDTH_M = 3.0  # to either side
_WORDS = {"motor": 2, "truck": 1, "bus": 1, "trailer": 1, "car": 0, "van": 0}


def node_features(history: SceneHistory, place: Located, index: LaneRelations) -> FloatArray:
    """Return (C * V, F) `NODE_COLUMNS`."""
    futures, vehicles = history.now.shape
    features = np.zeros((futures, vehicles, len(NODE_COLUMNS)))
    scene = history.scene
    features[..., 0], features[..., 1] = scene.length, scene.width
    kind = np.array([_type_of(name) for name in scene.types], dtype=np.int64)
    features[..., 2:6] = kind[:, None] == np.arange(len(TYPES))
    recent = slice(-SLOPE_STEPS - 1, None)
    features[..., 6] = history.now.speed
    features[..., 7] = slope(wrap(history.states.heading[..., recent] - history.now.heading[..., None]))
    features[..., 8] = slope(history.states.speed[..., recent])
    on_road = place.probability[0] > 0
    flat = features.reshape(-1, len(NODE_COLUMNS))
    flat[:, 9], flat[:, 10], flat[:, 11] = place.probability[0], place.offset[0], place.heading_error[0]
    flat[on_road, 12] = index.speed_limit[place.lane[0, on_road]]
    features[..., 13:] = _obstacle_ahead(history)
    return flat


def _type_of(name: str) -> int:
    return next((number for word, number in _WORDS.items() if word in name.lower()), TYPES.index("other"))


def slope(values: FloatArray) -> FloatArray:
    """Return robust changes per second of values (..., K): the median slope (Theil 1950, Sen 1968)."""
    first, second = np.triu_indices(values.shape[-1], 1)
    slopes = (values[..., second] - values[..., first]) / ((second - first) * STEP_S)
    return np.asarray(np.median(slopes, axis=-1))


def _obstacle_ahead(history: SceneHistory) -> FloatArray:
    now, nearest = history.now, np.zeros((*history.now.shape, 3))
    if history.scene.obstacles is None:
        return nearest
    obstacles, present = history.scene.obstacles.at(history.step)
    if not present.any():
        return nearest
    ahead, offset = now[..., None].ahead_and_left(obstacles.x[present], obstacles.y[present])
    distance = ahead - history.scene.length[:, None] / 2
    inside = (distance >= 0) & (distance <= CORRIDOR_M) & (np.abs(offset) <= CORRIDOR_HALF_WIDTH_M)
    future, vehicle = np.nonzero(inside.any(axis=-1))
    which = np.where(inside, distance, np.inf)[future, vehicle].argmin(axis=-1)
    nearest[future, vehicle, 0] = 1.0
    nearest[future, vehicle, 1] = distance[future, vehicle, which]
    nearest[future, vehicle, 2] = offset[future, vehicle, which]
    return nearest
