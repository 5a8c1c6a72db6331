"""The semantic scene graph: vehicles as nodes, and an edge where the lanes relate two of them.

All children of a batch make one graph, without an edge between children. Units are SI, nothing is scaled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.scene_graph.edges import EDGE_COLUMNS, KINDS, Edges, Located, scene_edges
from scex_sumo.behaviors.scene_graph.nodes import HISTORY_COLUMNS, NODE_COLUMNS, node_features, node_history
from scex_sumo.derived import derived
from scex_sumo.errors import UsageError
from scex_sumo.road import Road
from scex_sumo.roads.index import RoadIndex, road_index
from scex_sumo.roads.matching import Matches, match
from scex_sumo.scene import SceneHistory, SeedScene, States

__all__ = ["EDGE_COLUMNS", "HISTORY_COLUMNS", "KINDS", "NODE_COLUMNS", "SceneGraph", "scene_graph"]

RADIUS_M = 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneGraph:
    """The semantic scene graphs of all children of a batch; node = child * V + vehicle.

    Attributes:
        child: (N,) index into the batch.
        vehicle: (N,) index into the seed scene's vehicles.
        node: (N, F) features of the vehicles, columns as in `NODE_COLUMNS`.
        node_columns: names of the F columns.
        history: (N, 11, 5) the last second in the node's own present frame, oldest first, columns as in
            `HISTORY_COLUMNS`.
        history_columns: names of the 5 columns.
        edge_index: (2, E) source and target; the target is influenced by the source. Sorted by target, then
            by source.
        edge_kind: (E,) index into `KINDS`: the source is ahead of the target on its way (0), behind it (1),
            on a lane beside (2), or the ways of both meet ahead of both (3).
        edge: (E, G) features of the edges, columns as in `EDGE_COLUMNS`.
        edge_columns: names of the G columns.
        on_road: (N,) False for a vehicle that no mapped lane fits; it has no edges.
        lane_id: (N,) lane that the vehicle most probably is on; arbitrary where `on_road` is False.
        arc: (N,) arc length of its foot point on that lane, m; 0 where `on_road` is False.
    """

    child: IntArray
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


def scene_graph(
    history: SceneHistory | SeedScene, road: Road | None = None, *, radius: float = RADIUS_M
) -> SceneGraph:
    """Build the semantic scene graphs of all children at once.

    The graph of a history is remembered as long as the history lives: models that share a batch share it.

    Args:
        history: the present of a batch of children; or a seed scene, whose graph has one child.
        road: the map; None takes that of the seed scene.
        radius: edges reach so far, m, centre to centre.

    Raises:
        UsageError: there is no road, or the radius is no length.
    """
    scene = history if isinstance(history, SeedScene) else history.scene
    road = scene.road if road is None else road
    if road is None:
        raise UsageError(f"scene graph of {scene.name}: the scene has no road; give road=read_map(...)")
    if not radius > 0:
        raise UsageError(f"scene graph: radius is {radius}; needs a length above 0 m")
    return _build(history, road, radius)


@derived
def _build(given: SceneHistory | SeedScene, road: Road, radius: float) -> SceneGraph:
    history = SceneHistory.of_scene(given) if isinstance(given, SeedScene) else given
    children, vehicles = history.now.shape
    now = history.now.map(np.ravel)
    index = road_index(road)
    place = _locate(index, match(road, now.x, now.y, now.heading), len(now.x))
    edges = _edges(history, now, place, index, radius)
    return SceneGraph(
        child=np.repeat(np.arange(children), vehicles),
        vehicle=np.tile(np.arange(vehicles), children),
        node=node_features(history, place, index),
        node_columns=NODE_COLUMNS,
        history=node_history(history),
        history_columns=HISTORY_COLUMNS,
        edge_index=np.stack([edges.source, edges.target]),
        edge_kind=edges.kind,
        edge=edges.features,
        edge_columns=EDGE_COLUMNS,
        on_road=place.probability[0] > 0,
        lane_id=index.lane_id[place.lane[0]] if len(index.lane_id) else place.lane[0],
        arc=place.s[0],
    )


def _locate(index: RoadIndex, found: Matches, count: int) -> Located:
    """The two most probable lanes of each of N vehicles."""
    place = Located.nowhere(count)
    rank = np.arange(len(found.vehicle)) - np.searchsorted(found.vehicle, found.vehicle)
    for k in range(len(place.lane)):
        row = rank == k
        vehicle = found.vehicle[row]
        place.lane[k, vehicle] = np.searchsorted(index.lane_id, found.lane_id[row])
        for table, values in (
            (place.s, found.s),
            (place.offset, found.offset),
            (place.heading_error, found.heading_error),
            (place.probability, found.probability),
        ):
            table[k, vehicle] = values[row]
    return place


def _edges(history: SceneHistory, now: States, place: Located, index: RoadIndex, radius: float) -> Edges:
    """Relate the pairs of one child that are near enough and on the road."""
    children, vehicles = history.now.shape
    x, y = history.now.x, history.now.y
    near = (x[:, :, None] - x[:, None, :]) ** 2 + (y[:, :, None] - y[:, None, :]) ** 2 <= radius**2
    on_road = (place.probability[0] > 0).reshape(children, vehicles)
    near &= on_road[:, :, None] & on_road[:, None, :]
    near[:, np.arange(vehicles), np.arange(vehicles)] = False
    flat = np.flatnonzero(near)
    target = flat // vehicles
    source = target // vehicles * vehicles + flat % vehicles
    length = np.tile(history.scene.length, children)
    return scene_edges(target, source, now, length, place, index.relations)
