"""The scene graph of small scenes, from distances one can measure by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import UsageError
from scex_sumo.graphs.graph import EDGE_COLUMNS, KINDS, NODE_COLUMNS, SceneGraph, scene_graph
from scex_sumo.road import Road
from scex_sumo.scene import Obstacles, SceneHistory, SeedScene
from tests.behaviors.roads import fork, lane, present, road, scene_of, straight
from tests.seeds import people_of, steady

LENGTH = 4.5  # of the vehicles that `scene_of` makes


def edges(graph: SceneGraph) -> dict[tuple[int, int], str]:
    """Kind by (source, target)."""
    return {(int(s), int(t)): KINDS[k] for (s, t), k in zip(graph.edge_index.T, graph.edge_kind, strict=True)}


def feature(graph: SceneGraph, source: int, target: int, name: str) -> float:
    row = np.flatnonzero((graph.edge_index[0] == source) & (graph.edge_index[1] == target))
    assert len(row) == 1, f"no edge from {source} to {target}"
    return float(graph.edge[row[0], EDGE_COLUMNS.index(name)])


def node(graph: SceneGraph, name: str) -> list[float]:
    return graph.node[:, NODE_COLUMNS.index(name)].tolist()


CHAIN = road(
    lane(1, [(0.0, 0.0), (50.0, 0.0)], successors=(2,)),
    lane(2, [(50.0, 0.0), (300.0, 0.0)], predecessors=(1,)),
)


def test_the_vehicle_in_front_is_ahead_and_the_one_behind_is_behind() -> None:
    graph = scene_graph(scene_of((40.0, 0.0, 0.0, 10.0), (70.0, 0.0, 0.0, 8.0)), CHAIN)
    assert edges(graph) == {(1, 0): "ahead", (0, 1): "behind"}
    assert feature(graph, 1, 0, "path_distance") == pytest.approx(30.0)
    assert feature(graph, 0, 1, "path_distance") == pytest.approx(-30.0)
    assert feature(graph, 1, 0, "speed_difference") == pytest.approx(-2.0)
    assert feature(graph, 0, 1, "speed_difference") == pytest.approx(2.0)


def test_vehicles_on_one_way_relate_up_to_100_m_along_it() -> None:
    near, far = (
        scene_of((40.0, 0.0, 0.0, 9.0), (139.9, 0.0, 0.0, 9.0)),
        scene_of((40.0, 0.0, 0.0, 9.0), (140.1, 0.0, 0.0, 9.0)),
    )
    assert len(edges(scene_graph(near, CHAIN, radius=500.0))) == 2
    assert edges(scene_graph(far, CHAIN, radius=500.0)) == {}


def test_the_way_and_not_the_straight_distance_counts() -> None:
    bend = [(0.0, 0.0), (60.0, 0.0), (60.0, 20.0), (0.0, 20.0)]
    scene = scene_of((10.0, 0.0, 0.0, 9.0), (20.0, 20.0, np.pi, 9.0))
    graph = scene_graph(scene, road(lane(1, bend)))
    assert edges(graph) == {}  # 110 m along the lane, 22 m as the crow flies
    nearer = scene_of((20.0, 0.0, 0.0, 9.0), (40.0, 20.0, np.pi, 9.0))
    assert feature(scene_graph(nearer, road(lane(1, bend))), 1, 0, "path_distance") == pytest.approx(80.0)


def test_on_a_ring_the_shorter_way_round_decides_who_is_ahead() -> None:
    corners = [(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0), (0.0, 0.0)]
    ring = road(*(lane(i, corners[i : i + 2], successors=((i + 1) % 4,)) for i in range(4)))
    # From (30, 0) on: 10 m to the corner and 30 m up to (40, 30); 120 m the other way round.
    graph = scene_graph(scene_of((30.0, 0.0, 0.0, 5.0), (40.0, 30.0, np.pi / 2, 5.0)), ring)
    assert edges(graph) == {(1, 0): "ahead", (0, 1): "behind"}
    assert feature(graph, 1, 0, "path_distance") == pytest.approx(40.0)
    loop = road(lane(1, [*corners[:-1], (0.0, 2.0)], successors=(1,)))  # 158 m round
    graph = scene_graph(scene_of((5.0, 0.0, 0.0, 5.0), (0.0, 12.0, -np.pi / 2, 5.0)), loop)
    assert edges(graph) == {(1, 0): "behind", (0, 1): "ahead"}
    assert feature(graph, 0, 1, "path_distance") == pytest.approx(15.0)  # 10 m down, and 5 m on


PARALLEL = road(
    lane(1, [(0.0, 0.0), (200.0, 0.0)], left=2),
    lane(2, [(0.0, 3.5), (200.0, 3.5)], left=3, right=1),
    lane(3, [(0.0, 7.0), (200.0, 7.0)], right=2),
)


def test_a_vehicle_on_the_next_lane_is_lateral_with_the_offsets_of_both() -> None:
    graph = scene_graph(scene_of((50.0, 0.2, 0.0, 10.0), (62.0, 3.2, 0.1, 10.0)), PARALLEL)
    assert edges(graph) == {(1, 0): "lateral", (0, 1): "lateral"}
    assert feature(graph, 1, 0, "path_distance") == pytest.approx(12.0)
    assert feature(graph, 0, 1, "path_distance") == pytest.approx(-12.0)
    assert feature(graph, 1, 0, "target_offset") == pytest.approx(0.2)
    assert feature(graph, 1, 0, "source_offset") == pytest.approx(-0.3)
    assert feature(graph, 1, 0, "x") == pytest.approx(12.0)
    assert feature(graph, 1, 0, "y") == pytest.approx(3.0)
    assert feature(graph, 1, 0, "cos") == pytest.approx(np.cos(0.1))
    assert feature(graph, 1, 0, "sin") == pytest.approx(np.sin(0.1))


def test_lateral_reaches_two_lanes_and_30_m_from_bumper_to_bumper() -> None:
    def kinds(x: float, y: float) -> list[str]:
        return [*edges(scene_graph(scene_of((50.0, 0.0, 0.0, 9.0), (x, y, 0.0, 9.0)), PARALLEL)).values()]

    assert kinds(50.0, 7.0) == ["lateral", "lateral"]
    assert kinds(79.9 + LENGTH, 3.5) == ["lateral", "lateral"]
    assert kinds(80.1 + LENGTH, 3.5) == []


def crossing() -> Road:
    east = lane(1, [(-60.0, 0.0), (60.0, 0.0)])
    north = lane(2, [(0.0, -60.0), (0.0, 60.0)])
    return road(replace(east, conflicts=(2,)), replace(north, conflicts=(1,)))


def test_vehicles_that_approach_a_crossing_know_how_far_each_has_to_go() -> None:
    graph = scene_graph(scene_of((-20.0, 0.0, 0.0, 10.0), (0.0, -30.0, np.pi / 2, 10.0)), crossing())
    assert edges(graph) == {(1, 0): "intersecting", (0, 1): "intersecting"}
    assert feature(graph, 1, 0, "target_to_crossing") == pytest.approx(20.0)
    assert feature(graph, 1, 0, "source_to_crossing") == pytest.approx(30.0)
    assert feature(graph, 0, 1, "target_to_crossing") == pytest.approx(30.0)
    assert feature(graph, 1, 0, "path_distance") == 0.0
    assert [feature(graph, 1, 0, name) for name in ("x", "y")] == pytest.approx([20.0, -30.0])
    assert [feature(graph, 1, 0, name) for name in ("cos", "sin")] == pytest.approx([0.0, 1.0])


def test_who_has_left_the_crossing_with_the_rear_is_past_it() -> None:
    def kinds(x: float) -> list[str]:
        scene = scene_of((x, 0.0, 0.0, 10.0), (0.0, -30.0, np.pi / 2, 10.0))
        return [*edges(scene_graph(scene, crossing())).values()]

    assert kinds(LENGTH / 2 - 0.1) == ["intersecting", "intersecting"]
    assert kinds(LENGTH / 2 + 0.1) == []


def test_vehicles_on_the_two_branches_of_a_fork_do_not_relate() -> None:
    branches = fork()
    lanes = dict(branches.lanes)
    for own, others in ((11, (12, 13)), (12, (11, 13)), (13, (11, 12))):
        lanes[own] = replace(lanes[own], conflicts=others)
    scene = scene_of(
        (53.0, 0.3, 0.1, 9.0), (70.0, 0.0, 0.0, 9.0), (65.0, 30.0, np.pi / 2, 9.0), (40.0, 0.0, 0.0, 9.0)
    )
    found = edges(scene_graph(scene, replace(branches, lanes=lanes)))
    assert (1, 2) not in found and (2, 1) not in found
    assert (found[1, 3], found[2, 3]) == ("ahead", "ahead")  # the one before the fork may follow either


def test_the_relation_of_the_more_probable_lanes_wins() -> None:
    # Vehicle 0 is 1.4 m left of lane 1's centreline and 2.1 m right of lane 2's; the other is on lane 2.
    scene = scene_of((50.0, 1.4, 0.0, 9.0), (62.0, 3.5, 0.0, 9.0))
    graph = scene_graph(scene, PARALLEL)
    assert edges(graph)[1, 0] == "lateral"
    share = 1 / (1 + np.exp((1.4**2 - 2.1**2) / (2 * 0.8**2)))
    assert feature(graph, 1, 0, "target_probability") == pytest.approx(share)
    nearer = scene_graph(scene_of((50.0, 2.1, 0.0, 9.0), (62.0, 3.5, 0.0, 9.0)), PARALLEL)
    assert edges(nearer)[1, 0] == "ahead"
    assert feature(nearer, 1, 0, "target_probability") == pytest.approx(share)


def test_a_vehicle_off_the_map_is_a_node_without_edges() -> None:
    graph = scene_graph(scene_of((50.0, 0.0, 0.0, 9.0), (60.0, 20.0, 0.0, 9.0)), straight())
    assert edges(graph) == {}
    assert graph.on_road.tolist() == [True, False]
    for name in ("match_probability", "lane_offset", "lane_heading_error", "speed_limit"):
        assert node(graph, name)[1] == 0.0
    assert node(graph, "match_probability")[0] == 1.0


def test_nodes_tell_size_type_and_place_on_the_lane() -> None:
    scene = replace(
        scene_of(*[(20.0 * i, 0.5, 0.1, 9.0) for i in range(1, 5)]),
        types=("car", "truck_bus", "motorcycle", "tram"),
        length=np.array([4.0, 12.0, 2.0, 30.0]),
    )
    graph = scene_graph(scene, straight(limit=13.9))
    assert node(graph, "length") == [4.0, 12.0, 2.0, 30.0]
    types = [node(graph, f"is_{kind}") for kind in ("car", "truck", "motorcycle", "other")]
    assert types == np.eye(4).tolist()
    assert node(graph, "lane_offset") == pytest.approx([0.5] * 4)
    assert node(graph, "lane_heading_error") == pytest.approx([0.1] * 4)
    assert node(graph, "speed_limit") == [13.9] * 4
    assert graph.lane_id.tolist() == [1] * 4
    assert graph.arc.tolist() == pytest.approx([20.0, 40.0, 60.0, 80.0])


def turning(rate: float, braking: float) -> SeedScene:
    """A vehicle that turns and slows down, its present heading just past pi."""
    scene = scene_of((50.0, 0.0, 0.0, 9.0))
    since = 0.1 * np.arange(-10, 1)
    heading = np.pi - 0.01 + rate * since
    states = replace(
        scene.history,
        heading=np.arctan2(np.sin(heading), np.cos(heading))[None],
        speed=(9.0 - braking * since)[None],
    )
    return replace(scene, history=states)


def test_yaw_rate_and_acceleration_are_those_of_the_last_half_second() -> None:
    graph = scene_graph(turning(0.3, 2.0), straight())
    assert node(graph, "yaw_rate") == pytest.approx([0.3])
    assert node(graph, "acceleration") == pytest.approx([-2.0])
    assert node(scene_graph(turning(-0.3, 2.0), straight()), "yaw_rate") == pytest.approx([-0.3])


def walkers(*places: tuple[float, float], here: bool = True) -> Obstacles:
    states = steady(*((x, y, 0.0, 0.0) for x, y in places))
    kinds = ("pedestrian",) * len(places)
    return people_of(states, *kinds, length=0.5, width=0.5, present=np.full(states.shape, here))


def test_the_nearest_walker_in_the_corridor_ahead_is_a_feature_of_the_driver() -> None:
    others = walkers((80.0, 2.0), (70.0, -1.0), (65.0, 4.0))  # the last one stands too far beside
    graph = scene_graph(scene_of((50.0, 0.0, 0.0, 9.0), (75.0, 0.0, 0.0, 9.0), obstacles=others), straight())
    assert node(graph, "obstacle_ahead") == [1.0, 1.0]
    assert node(graph, "obstacle_distance") == pytest.approx([20.0 - LENGTH / 2, 5.0 - LENGTH / 2])
    assert node(graph, "obstacle_offset") == pytest.approx([-1.0, 2.0])


def batch(scene: SeedScene, futures: int) -> SceneHistory:
    """Futures that have drifted apart."""
    history, rng = present(scene, futures), np.random.default_rng(0)
    drift = rng.normal(0.0, 1.0, (2, *history.now.shape, 1))
    turn = rng.normal(0.0, 0.05, (*history.now.shape, 1))
    states = replace(
        history.states,
        x=history.states.x + drift[0],
        y=history.states.y + drift[1],
        heading=history.states.heading + turn,
    )
    return replace(history, states=states)


@pytest.fixture(scope="module")
def example() -> SeedScene:
    return scex.read_seed(scex.example_path("roundabout"))


def test_a_future_has_the_same_graph_alone_and_in_a_batch(example: SeedScene) -> None:
    history = batch(example, 5)
    together = scene_graph(history, example.road)
    for future in range(5):
        one = slice(future, future + 1)
        alone = scene_graph(
            replace(
                history,
                states=history.states[one],
                futures=history.futures[one],
                route_draw=history.route_draw[one],
            ),
            example.road,
        )
        mine = together.future[together.edge_index[1]] == future
        assert np.array_equal(together.edge_index[:, mine] - future * example.vehicles, alone.edge_index)
        assert np.array_equal(together.edge[mine], alone.edge)
        assert np.array_equal(together.node[together.future == future], alone.node)
        assert np.array_equal(together.history[together.future == future], alone.history)


def test_the_order_of_the_vehicles_does_not_matter(example: SeedScene) -> None:
    order = np.random.default_rng(0).permutation(example.vehicles)
    plain, shuffled = scene_graph(example), scene_graph(example.reordered(order.tolist(), name="shuffled"))
    assert np.array_equal(shuffled.node, plain.node[order])

    def named(graph: SceneGraph, names: np.ndarray) -> dict[tuple[int, int], list[float]]:
        return {
            (int(s), int(t)): row
            for (s, t), row in zip(names[graph.edge_index].T, graph.edge.tolist(), strict=True)
        }

    assert named(shuffled, order) == named(plain, np.arange(example.vehicles))


def test_every_relation_has_its_counterpart(example: SeedScene) -> None:
    found = edges(scene_graph(example))
    back = {"ahead": "behind", "behind": "ahead", "lateral": "lateral", "intersecting": "intersecting"}
    assert {*found.values()} == {*KINDS}
    assert {(t, s): back[kind] for (s, t), kind in found.items()} == found


def test_a_seed_scene_needs_a_road() -> None:
    with pytest.raises(UsageError, match=r"scene graph of drawn: the scene has no road"):
        scene_graph(scene_of((50.0, 0.0, 0.0, 9.0)))


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan])
def test_a_radius_is_a_length(radius: float) -> None:
    with pytest.raises(UsageError, match="radius is"):
        scene_graph(scene_of((50.0, 0.0, 0.0, 9.0)), straight(), radius=radius)
