"""Predictors as behaviour models: any function from history, neighbours, lanes or graph to trajectories."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.plug_in.inputs import ARRAYS, Surroundings, predictor_inputs
from scex_sumo.errors import ScexError, UsageError
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, Who

if TYPE_CHECKING:
    from scex_sumo.behaviors.scene_graph.graph import SceneGraph

INPUTS: Final = (*ARRAYS, "graph", "node", "rng")
"""What a function may name as its parameters: arrays, the scene graph and the vehicles' nodes, randomness."""

MOVING_M = 0.05  # per step: below 0.5 m/s the direction of the motion says little about the heading
NEEDED = f"(n, H, 2), (n, H, 3) or (n, H, 4) with H of at least {PLAN_STEPS}"


class Predictor:
    """Makes a `Behavior` of a function that predicts trajectories in each vehicle's own frame.

    The function is called with the inputs that its parameters name, see `INPUTS` and `predictor_inputs`, and
    returns x, y and, where it knows them, heading and speed: (n, H >= 30, 2 to 4) in m, rad and m/s, one row
    per step of 0.1 s from the next one on. Missing headings follow the motion, missing speeds too.

    It is called child by child, with the n vehicles of that child, so that no child depends on which others
    share its batch: matrix products differ in their last digits with the number of rows.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        *,
        inputs: Collection[str] | None = None,
        batched: bool = False,
        surroundings: Surroundings | None = None,
    ) -> None:
        """Wrap a function.

        Args:
            inputs: names of what it is called with; None takes its parameters.
            batched: call it once with the vehicles of all children. For a function that promises the same
                rows whatever other rows there are; it cannot ask for ``rng``.
            surroundings: how much it sees.

        Raises:
            UsageError: it asks for what there is not.
        """
        self.function = function
        self.inputs = tuple(inputs) if inputs is not None else wanted_inputs(function)
        self.batched = batched
        self.surroundings = Surroundings() if surroundings is None else surroundings
        unknown = [name for name in self.inputs if name not in INPUTS]
        if unknown or not self.inputs:
            asks = f"asks for {unknown[0]!r}" if unknown else "asks for nothing"
            raise UsageError(f"predictor {name_of(function)}: {asks}; there are: {', '.join(INPUTS)}")
        if batched and "rng" in self.inputs:
            raise UsageError(f"predictor {name_of(function)}: rng belongs to one child; leave out batched")

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Predict for all vehicles; see `Behavior.plan`.

        Raises:
            ScexError: what the function returned are no trajectories.
        """
        arrays = predictor_inputs(
            history, road, who, self.surroundings, [name for name in self.inputs if name in ARRAYS]
        )
        graph = _graph(history, road) if "graph" in self.inputs else None
        vehicles = history.now.shape[1]
        calls = self._calls(who)
        predicted = []
        for at in calls:
            child = 0 if self.batched else int(who.child[at[0]])
            given: dict[str, Any] = {name: values[at] for name, values in arrays.items()}
            if graph is not None:
                given["graph"] = graph if self.batched else graph_of_child(graph, child, vehicles)
            if "node" in self.inputs:
                given["node"] = (who.child[at] * vehicles if self.batched else 0) + who.vehicle[at]
            if "rng" in self.inputs:
                given["rng"] = rng[child]
            predicted.append(trajectories(self.function(**given), len(at)))
        whole = np.zeros((len(who), PLAN_STEPS, 4))
        if calls:
            whole[np.concatenate(calls)] = completed(np.concatenate(predicted))
        return _in_the_map(whole, history, who)

    def _calls(self, who: Who) -> list[IntArray]:
        """Rows of each call."""
        if self.batched or len(who) == 0:
            return [np.arange(len(who))] if len(who) else []
        order = np.argsort(who.child, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(who.child[order])) + 1)


def trajectories(predicted: Any, count: int) -> FloatArray:
    """What a function returned, as (n, 30, 2 to 4).

    Args:
        count: n.

    Raises:
        ScexError: it is of another shape, or no array.
    """
    try:
        values = np.asarray(predicted, dtype=np.float64)
    except (TypeError, ValueError):
        raise ScexError(f"returned {type(predicted).__name__}, no array; needs {NEEDED}") from None
    shape = values.shape
    if len(shape) != 3 or shape[0] != count or shape[1] < PLAN_STEPS or shape[2] not in (2, 3, 4):
        raise ScexError(f"returned trajectories of shape {shape}, needs {NEEDED}, n = {count}")
    return values[:, :PLAN_STEPS]


def completed(values: FloatArray) -> FloatArray:
    """Trajectories with what is missing: (n, 30, 4) x, y, heading, speed in the vehicles' own frames.

    A heading follows the motion, and stays below 0.5 m/s; a vehicle that moves back from where it heads is
    reversing. A speed is the way of the step over its time, negative when reversing.

    Args:
        values: (n, 30, 2 to 4).
    """
    given = values.shape[2]
    way = np.diff(values[..., :2], axis=1, prepend=0.0)
    length = np.hypot(way[..., 0], way[..., 1])
    heading = values[..., 2] if given > 2 else _headings(way, length)
    if given == 4:
        speed = values[..., 3]
    else:
        ahead = np.cos(heading) * way[..., 0] + np.sin(heading) * way[..., 1]
        speed = np.copysign(length, ahead) / STEP_S
    return np.stack([values[..., 0], values[..., 1], heading, speed], axis=-1)


def _headings(way: FloatArray, length: FloatArray) -> FloatArray:
    """(n, H) headings that follow the steps (n, H, 2) of these lengths, from 0 on."""
    heading = np.zeros(length.shape)
    before = np.zeros(len(length))
    for step in range(length.shape[1]):
        dx, dy = way[:, step, 0], way[:, step, 1]
        back = np.where(np.cos(before) * dx + np.sin(before) * dy < 0, -1.0, 1.0)
        direction = np.arctan2(back * dy, back * dx)
        before = np.where(length[:, step] > MOVING_M, before + wrap(direction - before), before)
        heading[:, step] = before
    return heading


def _in_the_map(own: FloatArray, history: SceneHistory, who: Who) -> Plan:
    """Trajectories (n, H, 4) in the vehicles' frames as a plan."""
    now = history.now[who.child, who.vehicle].map(lambda values: values[:, None])
    x, y, heading, speed = np.moveaxis(own, -1, 0)
    cos, sin = np.cos(now.heading), np.sin(now.heading)
    return Plan(
        x=now.x + cos * x - sin * y,
        y=now.y + sin * x + cos * y,
        heading=wrap(now.heading + heading),
        speed=speed.copy(),
    )


def _graph(history: SceneHistory, road: Road) -> SceneGraph:
    """The scene graph, whose modules few runs need."""
    from scex_sumo.behaviors.scene_graph.graph import scene_graph

    return scene_graph(history, road)


def graph_of_child(graph: SceneGraph, child: int, vehicles: int) -> SceneGraph:
    """The part of a batch's scene graph that belongs to one child; its nodes are the vehicles."""
    nodes = slice(child * vehicles, (child + 1) * vehicles)
    edges = graph.edge_index[1] // vehicles == child
    return replace(
        graph,
        child=np.zeros(vehicles, dtype=np.int64),
        vehicle=graph.vehicle[nodes],
        node=graph.node[nodes],
        history=graph.history[nodes],
        edge_index=graph.edge_index[:, edges] - child * vehicles,
        edge_kind=graph.edge_kind[edges],
        edge=graph.edge[edges],
        on_road=graph.on_road[nodes],
        lane_id=graph.lane_id[nodes],
        arc=graph.arc[nodes],
    )


def name_of(function: Callable[..., Any]) -> str:
    """What to call a function in a message."""
    return str(getattr(function, "__name__", type(function).__name__))


def wanted_inputs(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of the inputs that a function's parameters ask for; parameters with a default ask for none."""
    empty = inspect.Parameter.empty
    named = inspect.signature(function).parameters.values()
    return tuple(p.name for p in named if p.name in INPUTS or p.default is empty)
