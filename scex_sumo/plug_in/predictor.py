"""Predictors: functions from history, neighbours, lanes or graph to trajectories, as behaviour models."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import ScexError, UsageError
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.motion import map_plan
from scex_sumo.geometry.polylines import wrap
from scex_sumo.plug_in.inputs import ARRAYS, Surroundings, predictor_inputs
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.graphs.graph import SceneGraph

INPUTS: Final = (*ARRAYS, "graph", "node", "rng")
"""Parameters that a function may have: arrays, the scene graph, the vehicles' nodes, a generator."""

MOVING_M = 0.05  # per step; below 0.5 m/s the motion says little about the heading
NEEDED = f"(n, H, 2), (n, H, 3) or (n, H, 4) with H of at least {PLAN_STEPS}"


class Predictor:
    """Adapter from a function that predicts trajectories in the vehicle's own frame to a `BatchBehavior`.

    The function is called with the inputs that its parameters name, see `INPUTS` and `predictor_inputs`. It
    returns (n, H >= 30, 2 to 4): x, y (m), and optionally heading (rad) and speed (m/s), one row per step of
    0.1 s. Missing headings and speeds follow the motion.

    Without ``batched`` it is called once per future, because matrix products depend on the number of rows.

    Example:
        >>> def straight(history):
        ...     way = 0.1 * history[:, -1, 4:] * np.arange(1, 31)
        ...     return np.stack([way, np.zeros_like(way)], axis=-1)
        >>> scex.Predictor(straight).inputs
        ('history',)
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
            inputs: names of its arguments; None takes its parameters.
            batched: call it once for all futures; its rows must not depend on each other.
        """
        self.function, self.__name__ = function, name_of(function)
        self.inputs = tuple(inputs) if inputs is not None else wanted_inputs(function)
        self.batched = batched
        self.surroundings = Surroundings() if surroundings is None else surroundings
        unknown = [name for name in self.inputs if name not in INPUTS]
        if unknown or not self.inputs:
            asks = f"asks for {unknown[0]!r}" if unknown else "asks for nothing"
            raise UsageError(f"predictor {name_of(function)}: {asks}; there are: {', '.join(INPUTS)}")
        if batched and "rng" in self.inputs:
            raise UsageError(f"predictor {name_of(function)}: rng belongs to one future; leave out batched")

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Predict for all vehicles; see `BatchBehavior.plan`."""
        names = [name for name in self.inputs if name in ARRAYS]
        arrays = predictor_inputs(history, road, vehicles, self.surroundings, names)
        graph: SceneGraph | None = None
        if "graph" in self.inputs:
            from scex_sumo.graphs.graph import scene_graph  # few runs need it

            graph = scene_graph(history, road)
        count, calls, predicted = history.now.shape[1], self._calls(vehicles), list[FloatArray]()
        for members in calls:
            asked = vehicles[members]
            future = 0 if self.batched else int(asked.future[0])
            given: dict[str, Any] = {name: values[members] for name, values in arrays.items()}
            if graph is not None:
                given["graph"] = graph if self.batched else graph_of_future(graph, future, count)
            if "node" in self.inputs:
                given["node"] = (asked.future * count if self.batched else 0) + asked.vehicle
            if "rng" in self.inputs:
                given["rng"] = rng[future]
            predicted.append(trajectories(self.function(**given), len(members)))
        whole = np.zeros((len(vehicles), PLAN_STEPS, 4))
        if calls:
            whole[np.concatenate(calls)] = completed(np.concatenate(predicted))
        x, y, heading, speed = np.moveaxis(whole, -1, 0)
        now = history.now[vehicles.future, vehicles.vehicle]
        return map_plan(now, States(x=x, y=y, heading=heading, speed=speed.copy()))

    def _calls(self, vehicles: VehicleIndex) -> list[IntArray]:
        if self.batched or len(vehicles) == 0:
            return [np.arange(len(vehicles))] if len(vehicles) else []
        order = np.argsort(vehicles.future, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(vehicles.future[order])) + 1)


def trajectories(predicted: Any, count: int) -> FloatArray:
    """Check a function's result for `count` vehicles, and cut it to (n, 30, 2 to 4)."""
    if np.iscomplexobj(predicted):  # NumPy would drop the imaginary parts
        raise ScexError(f"returned complex numbers, needs {NEEDED}")
    try:
        values = np.asarray(predicted, dtype=np.float64)
    except (TypeError, ValueError):
        raise ScexError(f"returned {type(predicted).__name__}, no array; needs {NEEDED}") from None
    shape = values.shape
    if len(shape) != 3 or shape[0] != count or shape[1] < PLAN_STEPS or shape[2] not in (2, 3, 4):
        raise ScexError(f"returned trajectories of shape {shape}, needs {NEEDED}, n = {count}")
    return values[:, :PLAN_STEPS]


def completed(values: FloatArray) -> FloatArray:
    """Add missing headings and speeds: (n, 30, 2 to 4) to (n, 30, 4) x, y, heading, speed.

    A heading follows the motion, and stays below 0.5 m/s; a vehicle that moves against its heading reverses.
    """
    columns = values.shape[2]
    moves_m = np.diff(values[..., :2], axis=1, prepend=0.0)
    length = np.hypot(moves_m[..., 0], moves_m[..., 1])
    heading = values[..., 2] if columns > 2 else _headings(moves_m, length)
    if columns == 4:
        speed = values[..., 3]
    else:
        ahead = np.cos(heading) * moves_m[..., 0] + np.sin(heading) * moves_m[..., 1]
        speed = np.copysign(length, ahead) / STEP_S
    return np.stack([values[..., 0], values[..., 1], heading, speed], axis=-1)


def _headings(moves_m: FloatArray, length: FloatArray) -> FloatArray:
    heading = np.zeros(length.shape)
    before = np.zeros(len(length))
    for step in range(length.shape[1]):
        dx, dy = moves_m[:, step, 0], moves_m[:, step, 1]
        back = np.where(np.cos(before) * dx + np.sin(before) * dy < 0, -1.0, 1.0)
        direction = np.arctan2(back * dy, back * dx)
        before = np.where(length[:, step] > MOVING_M, before + wrap(direction - before), before)
        heading[:, step] = before
    return heading


def graph_of_future(graph: SceneGraph, future: int, vehicles: int) -> SceneGraph:
    """Return the scene graph of one future of a batch."""
    nodes = slice(future * vehicles, (future + 1) * vehicles)
    edges = graph.edge_index[1] // vehicles == future
    own: dict[str, Any] = {name: getattr(graph, name)[edges] for name in ("edge_kind", "edge")}
    of_nodes = ("vehicle", "node", "history", "on_road", "lane_id", "arc")
    own |= {name: getattr(graph, name)[nodes] for name in of_nodes}
    own["edge_index"] = graph.edge_index[:, edges] - future * vehicles
    return replace(graph, future=np.zeros(vehicles, dtype=np.int64), **own)


def name_of(function: Callable[..., Any]) -> str:
    """Return a function's name for messages."""
    return str(getattr(function, "__name__", type(function).__name__))


def wanted_inputs(function: Callable[..., Any]) -> tuple[str, ...]:
    """Return a function's parameters that are inputs or have no default."""
    empty = inspect.Parameter.empty
    named = inspect.signature(function).parameters.values()
    return tuple(p.name for p in named if p.name in INPUTS or p.default is empty)
