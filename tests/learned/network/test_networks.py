"""The networks: shapes, bounds, and what may depend on what."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.graphs.graph import EDGE_COLUMNS, scene_graph
from scex_sumo.learned.driver import image_of
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS, path_inputs
from scex_sumo.learned.inputs.surface import CHANNELS, Raster, raster_of
from scex_sumo.learned.network.networks import GraphImageNet, GraphNet, Modes, Net
from scex_sumo.road import Road
from scex_sumo.scene import SceneHistory, SeedScene
from tests.behaviors import roads
from tests.learned import nets

ROAD = roads.fork()
SCENE = roads.scene_of((8.0, 0.3, 0.02, 6.0), (20.0, -0.2, 0.0, 5.0), (35.0, 0.0, 0.0, 4.0))
CLOSE = 1e-9  # float64, a dozen layers


def ask(net: Net, history: SceneHistory, road: Road, attention: float = 0.5) -> Modes:
    vehicles = roads.every(history)
    graph = scene_graph(history, road)
    inputs = path_inputs(history, road, vehicles, *chosen_paths(history, road, vehicles, "straight"))
    if isinstance(net, GraphNet):
        return net(graph, inputs)
    now = history.now
    pose = np.stack([now.x.ravel(), now.y.ravel(), now.heading.ravel()], 1)
    return net(graph, inputs, image_of(road, net), pose, np.arange(len(vehicles)), attention, free=True)


def network(kind: str, **numbers: int | bool) -> Net:
    return nets.network(kind, SCENE, ROAD, **numbers)


def image_network() -> GraphImageNet:
    net = network("hybrid")
    assert isinstance(net, GraphImageNet)
    return net


def parts(modes: Modes) -> list[np.ndarray]:
    return [part for part in modes if part is not None]


@pytest.mark.parametrize(("kind", "free"), [("graph", False), ("hybrid", True)])
def test_predictions_have_a_row_per_pair_six_modes_and_thirty_steps(kind: str, free: bool) -> None:
    modes = ask(network(kind), roads.present(SCENE, 2), ROAD)
    assert modes.logits.shape == (6, 6)
    assert modes.acceleration.shape == (6, 6, 30)
    assert modes.path_logit.shape == (6,)
    assert modes.offset.shape == (6, 6, 30)
    assert (None if modes.free is None else tuple(modes.free.shape)) == ((6, 6, 30, 2) if free else None)


def moved(turn: float, shift: tuple[float, float]) -> tuple[SeedScene, Road]:
    """Scene and fork turned about the origin, then shifted."""
    cos, sin = np.cos(turn), np.sin(turn)

    def place(points: np.ndarray) -> np.ndarray:
        return points @ np.array([[cos, sin], [-sin, cos]]) + np.array(shift)

    lanes = {}
    for key, lane in ROAD.lanes.items():
        line = place(lane.centreline)
        lanes[key] = replace(lane, centreline=line, left_bound=line, right_bound=line)
    states = SCENE.history
    at = place(np.stack([states.x, states.y], -1))
    history = replace(states, x=at[..., 0], y=at[..., 1], heading=states.heading + turn)
    return replace(SCENE, history=history), replace(ROAD, lanes=lanes)


def test_the_graph_branch_does_not_care_where_the_scene_is_and_where_north_is() -> None:
    net = network("graph")
    # The surface is a grid: rooms and the way to the end differ by its cells.
    for name in ("room_left", "room_right", "end"):
        net.path_scale.spread[PATH_COLUMNS.index(name)] = 1e9
    before = ask(net, roads.present(SCENE), ROAD)
    scene, road = moved(2.3, (812.0, -455.0))
    after = ask(net, roads.present(scene), road)
    for one, other in zip(parts(before), parts(after), strict=True):
        assert np.allclose(one, other, atol=1e-3)  # paths are resampled from other points
    assert not np.allclose(before.acceleration[0], before.acceleration[1], atol=1e-2)


@pytest.mark.parametrize("kind", ["graph", "hybrid"])
def test_futures_do_not_see_each_other(kind: str) -> None:
    net = network(kind)
    two = roads.present(SCENE, 2)
    before = ask(net, two, ROAD)
    two.states.x[1, 0] += 3.0
    after = ask(net, replace(two), ROAD)
    for one, other in zip(parts(before), parts(after), strict=True):
        assert np.allclose(one[:3], other[:3], atol=CLOSE)
        assert not np.allclose(one[3:], other[3:], atol=1e-6)


@pytest.mark.parametrize(("edges", "sees"), [(True, True), (False, False)])
def test_a_follower_is_seen_through_the_graph_alone(edges: bool, sees: bool) -> None:
    net = network("graph", edges=edges)
    history = roads.present(SCENE)
    before = ask(net, history, ROAD).acceleration[2]
    history.states.speed[0, 1] += 2.0  # the vehicle behind: no path input of the one in front
    after = ask(net, replace(history), ROAD).acceleration[2]
    assert np.allclose(before, after, atol=CLOSE) != sees


def test_full_attention_ignores_the_image_and_none_ignores_the_graph() -> None:
    net = network("hybrid")
    history = roads.present(SCENE)
    turned = replace(ROAD, markings=(), lanes={k: replace(v, left=None) for k, v in ROAD.lanes.items()})
    raster_of(turned).values[CHANNELS.index("boundary")] = 0.0  # another picture of the same road
    for attention, image_matters, graph_matters in (
        (1.0, False, True),
        (0.0, True, False),
        (0.5, True, True),
    ):
        before = ask(net, history, ROAD, attention)
        other_image = ask(net, history, turned, attention)
        assert np.allclose(before.acceleration, other_image.acceleration, atol=1e-7) != image_matters
        near = replace(history, states=history.states.repeat(1)[0])
        near.states.speed[0, 1] += 2.0
        other_graph = ask(net, near, ROAD, attention)
        assert np.allclose(before.acceleration[2], other_graph.acceleration[2], atol=1e-7) != graph_matters


@pytest.mark.parametrize("rows", [1, 127, 128, 129, 300])
def test_a_large_map_gives_the_same_features_strip_by_strip(rows: int) -> None:
    encoder = image_network().image
    values = np.random.default_rng(0).random((len(CHANNELS), rows, 40))
    strips = encoder.features_of(Raster(values=values, corner=np.zeros(2)))
    whole = encoder.features(values.transpose(1, 2, 0))
    assert np.array_equal(strips.transpose(1, 2, 0), whole)


def test_vehicles_asked_for_alone_are_seen_as_among_all() -> None:
    """What does not reach them through the layers is left out."""
    net = network("graph")
    graph = scene_graph(roads.present(SCENE, 3), ROAD)
    everyone = net.scene(graph, np.arange(len(graph.node)))
    for wanted in ([4], [8, 0, 4], [2, 2]):
        assert np.array_equal(net.scene(graph, np.array(wanted)), everyone[wanted])


def test_a_node_without_edges_gets_the_bias_and_one_with_one_edge_all_of_its_source() -> None:
    scene = network("graph").scene
    attend, node = scene.attend[0], np.random.default_rng(0).normal(size=(2, 3, 16))
    graph = scene_graph(roads.present(SCENE, 2), ROAD)
    graph = replace(graph, edge_index=np.array([[0, 5], [1, 3]]), edge=np.ones((2, len(EDGE_COLUMNS))))
    made = attend(node, graph, np.arange(2), np.arange(6), scene.edge_scale)
    assert np.allclose(made[[0, 2, 4, 5]], attend.bias)
    assert np.allclose(made[[1, 3]], attend.key(node.reshape(6, 16))[[0, 5]] + attend.bias)
