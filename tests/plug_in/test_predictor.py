"""Functions that predict trajectories drive vehicles; what they return is completed and put on the map."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.drivers.decorators import predictor
from scex_sumo.drivers.listing import known_models
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.geometry.polylines import wrap
from scex_sumo.graphs.graph import SceneGraph, scene_graph
from scex_sumo.plug_in.predictor import Predictor, completed, graph_of_future
from scex_sumo.plug_in.user_model import is_predictor
from tests.behaviors import roads

# One along +y, one along -x.
SCENE = roads.scene_of((10.0, 0.0, np.pi / 2, 4.0), (60.0, 0.0, np.pi, 8.0))
STEPS = 0.1 * np.arange(1, 31)


def straight(history: np.ndarray, *, factor: float = 1.0) -> np.ndarray:
    """On and on."""
    x = factor * history[:, -1, 4:] * STEPS
    return np.stack([x, 0 * x], axis=-1)


def of(*columns: np.ndarray | float) -> np.ndarray:
    """(1, 30, len(columns))."""
    return np.stack([np.broadcast_to(c, 30).astype(float) for c in columns], axis=-1)[None]


def test_trajectories_in_the_own_frame_become_a_plan_on_the_map() -> None:
    made = roads.plan(Predictor(straight), roads.straight(), roads.present(SCENE))
    assert made.x == pytest.approx(np.stack([np.full(30, 10.0), 60.0 - 8.0 * STEPS]))
    assert made.y == pytest.approx(np.stack([4.0 * STEPS, np.zeros(30)]), abs=1e-12)
    assert np.abs(wrap(made.heading - np.array([[np.pi / 2], [np.pi]]))).max() < 1e-12
    assert made.speed == pytest.approx(np.array([[4.0], [8.0]]) * np.ones(30))


def test_headings_and_speeds_follow_the_motion() -> None:
    angle = STEPS  # 1 rad/s on a circle of 5 m: 5 m/s, heading in the middle of the chord
    made = completed(of(5 * np.sin(angle), 5 * (1 - np.cos(angle))))[0]
    assert made[:, 2] == pytest.approx(angle - 0.05)
    assert made[:, 3] == pytest.approx(5 * 2 * np.sin(0.05) / 0.1)


def test_a_function_is_called_future_by_future_with_what_its_parameters_name() -> None:
    calls: list[dict[str, Any]] = []

    def watch(history: Any, neighbour_mask: Any, graph: SceneGraph, node: Any, rng: Any) -> np.ndarray:
        calls.append({"n": len(history), "mask": neighbour_mask, "graph": graph, "node": node, "rng": rng})
        return straight(history)

    history = roads.present(SCENE, 3)
    generators = roads.generators(history)
    Predictor(watch).plan(history, roads.straight(), roads.every(history), generators)
    assert [call["n"] for call in calls] == [2, 2, 2]
    assert [call["rng"] for call in calls] == generators
    for call in calls:
        assert len(call["graph"].node) == 2 and call["node"].tolist() == [0, 1]
        assert call["mask"].shape == (2, 16)


def test_a_function_that_promises_it_is_called_once_for_all_futures() -> None:
    counts = []

    def watch(history: Any, graph: SceneGraph, node: Any) -> np.ndarray:
        counts.append((len(history), len(graph.node), node.tolist()))
        return straight(history)

    history = roads.present(SCENE, 3)
    made = roads.plan(Predictor(watch, batched=True), roads.straight(), history)
    assert counts == [(6, 6, [0, 1, 2, 3, 4, 5])]
    alone = roads.plan(Predictor(straight), roads.straight(), history)
    assert np.array_equal(made.x, alone.x)


def test_a_futures_part_of_the_graph_is_the_graph_of_that_future_alone() -> None:
    follow = roads.scene_of((100.0, 0.0, 0.0, 8.0), (120.0, 0.0, 0.0, 8.0), (150.0, 0.0, 0.0, 8.0))
    three, one = roads.present(follow, 3), roads.present(follow, 1)
    part = graph_of_future(scene_graph(three, roads.straight()), 2, 3)
    alone = scene_graph(one, roads.straight())
    assert part.edge_index.size > 0
    for name in ("future", "vehicle", "node", "history", "edge_index", "edge_kind", "edge", "lane_id", "arc"):
        assert np.array_equal(getattr(part, name), getattr(alone, name)), name


def test_a_function_that_asks_for_what_there_is_not_is_refused_with_the_choices() -> None:
    def blind(history: Any, camera: Any) -> None: ...

    with pytest.raises(UsageError, match="predictor blind: asks for 'camera'; there are: history, size"):
        Predictor(blind)
    with pytest.raises(UsageError, match="asks for nothing"):
        Predictor(lambda: None)
    with pytest.raises(UsageError, match="rng belongs to one future"):
        Predictor(lambda history, rng: None, batched=True)


def test_only_functions_of_a_vehicles_inputs_are_predictors() -> None:
    def maker(neighbours: int = 3) -> None: ...

    class Driver:
        def __init__(self, history: int) -> None: ...

    assert is_predictor(straight)
    assert not is_predictor(maker) and not is_predictor(Driver) and not is_predictor(3)


@pytest.mark.usefixtures("registered_models")
def test_a_function_becomes_a_model_whose_parameters_are_its_own_and_its_surroundings() -> None:
    assert predictor("onward", neighbours=4)(straight) is straight
    built = build(parse_models("onward:factor=0.5:radius=30")[0])
    assert isinstance(built, Predictor)
    assert (built.surroundings.neighbours, built.surroundings.radius) == (4, 30.0)
    made = roads.plan(built, roads.straight(), roads.present(SCENE))
    assert made.speed[:, 0] == pytest.approx([2.0, 4.0])
    (info,) = (info for info in known_models() if info.name == "onward")
    assert info.summary == "On and on."
    assert info.parameters[:3] == ("factor=1.0", "neighbours=4", "radius=50.0")
