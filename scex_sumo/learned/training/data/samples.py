"""Training samples: scene graphs with every vehicle's candidate paths and recorded future."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.paths import BEHIND_M, SeedPaths, seed_paths
from scex_sumo.extrapolation.loop.rollout import history_at
from scex_sumo.geometry.polylines import wrap
from scex_sumo.graphs.graph import scene_graph
from scex_sumo.learned.inputs.path_inputs import path_inputs
from scex_sumo.learned.training.data.perturb import standing_gap, stopping_way
from scex_sumo.learned.training.data.targets import along_paths, fading, right_paths, smooth_return
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, SeedScene, States, VehicleIndex

CATCH_UP_S = 4.0  # within which a driver ahead or behind gets to the recorded one's place
MAX_AHEAD_M = 8.0  # further off along the path, the recorded driver is no target
MAX_ASIDE_M = 2.0
MAX_SLOPE = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingSamples:
    """G scene graphs one after the other; N nodes, E edges, P pairs of a vehicle and a candidate path.

    Attributes:
        start: (P, 4) speed in m/s, offset in m, heading error in rad, offset of the perturbation in m.
    """

    site: IntArray  # (G,) number of the graph's site
    nodes: IntArray  # (G,) number of nodes of each graph; so ``edges`` and ``pairs``
    edges: IntArray
    pairs: IntArray
    node: FloatArray  # (N, F) features, as in `SceneGraph`; so ``history`` (N, 11, 5)
    history: FloatArray
    pose: FloatArray  # (N, 3) x, y (m) and heading on the map
    edge_index: IntArray  # (2, E) source and target within the graph
    edge: FloatArray  # (E, K) features
    pair_node: IntArray  # (P,) the vehicle, within the graph
    feature: FloatArray  # (P, D), as in `PathInputs`
    right: BoolArray  # (P,) True for the path that the vehicle took
    s: FloatArray  # (P, H) m, target: way along the path; 0 where the path is not right
    d: FloatArray  # (P, H) m, target: offset from the path
    start: FloatArray
    xy: FloatArray  # (P, H, 2) the target in the vehicle's own frame, m

    def __len__(self) -> int:
        return len(self.nodes)

    def at(self, site: int, shift: FloatArray) -> TrainingSamples:
        """Return the samples of a site whose map lies ``shift`` (2,) m elsewhere."""
        pose = self.pose - np.append(shift, 0.0)
        return replace(self, site=np.full(len(self), site), pose=pose)

    @classmethod
    def concatenate(cls, several: Sequence[TrainingSamples]) -> TrainingSamples:
        """Join samples."""
        joined = {}
        for f in fields(cls):
            axis = 1 if f.name == "edge_index" else 0
            joined[f.name] = np.concatenate([getattr(samples, f.name) for samples in several], axis=axis)
        return cls(**joined)


def scene_samples(
    scene: SeedScene,
    road: Road,
    states: States,
    *,
    seen: States | None = None,
    blocked: IntArray | None = None,
    step: int = 0,
) -> TrainingSamples | None:
    """Make samples of a scene, one graph for each of C futures; None if no vehicle can be learned from.

    The target is the recorded motion from the same time on; a vehicle elsewhere comes back smoothly. All
    vehicles are nodes; `learnable` ones are learned from.

    Args:
        states: (C, V, 11) what the vehicles did, oldest first.
        seen: (C, V, 11) what the drivers see of it; None for the same.
        blocked: the only vehicles to be learned from, which stop behind an obstacle on their way.
    """
    usable = learnable(scene, step) if blocked is None else blocked
    if not len(usable):
        return None
    assert scene.future is not None and scene.future_valid is not None
    futures, count, paths = states.shape[0], scene.vehicles, seed_paths(scene, road)
    recorded, future = scene.now if step == 0 else scene.future[:, step - 1], scene.future[:, step:]
    valid = scene.future_valid[usable, step:]
    path, owner, right = right_paths(paths, usable, recorded[usable], future[usable], valid)
    vehicles = VehicleIndex(
        future=np.repeat(np.arange(futures), len(path)), vehicle=np.tile(usable[owner], futures)
    )
    path, draws = np.tile(path, futures), np.zeros((futures, count))
    history = history_at(scene, states if seen is None else seen, np.arange(futures), draws, step=step)
    actual = states[:, :, -1][vehicles.future, vehicles.vehicle]
    true = recorded[vehicles.vehicle], future[vehicles.vehicle][:, :PLAN_STEPS]
    gap = None if blocked is None else standing_gap(history, vehicles, paths, path)[1]
    goals, keep = _goals(paths, path, vehicles, history, actual, *true, gap)
    vehicles = vehicles[keep]
    inputs = path_inputs(history, road, vehicles, paths, path[keep])
    graph, now = scene_graph(history, road), history.now
    graph_of_edge = graph.edge_index[1] // count
    order = np.argsort(graph_of_edge, kind="stable")
    return TrainingSamples(
        site=np.zeros(futures, dtype=np.int64),
        nodes=np.full(futures, count),
        edges=np.bincount(graph_of_edge, minlength=futures),
        pairs=np.bincount(vehicles.future, minlength=futures),
        node=graph.node.astype(np.float32),
        history=graph.history.astype(np.float32),
        pose=np.stack([now.x, now.y, now.heading], -1).reshape(-1, 3),
        edge_index=graph.edge_index[:, order] % count,
        edge=graph.edge[order].astype(np.float32),
        pair_node=vehicles.vehicle,
        feature=inputs.features.astype(np.float32),
        right=np.tile(right, futures)[keep],
        **{name: values[keep].astype(np.float32) for name, values in goals.items()},
    )


def learnable(scene: SeedScene, step: int = 0) -> IntArray:
    """Return vehicles with a whole recorded second before and 3 s after a step."""
    if scene.future_valid is None or scene.future_valid.shape[1] < step + PLAN_STEPS:
        return np.zeros(0, dtype=np.int64)
    recorded = scene.future_valid[:, : step + PLAN_STEPS].all(axis=1)
    return np.flatnonzero(recorded & (scene.recorded_steps >= HISTORY_STEPS))


def _goals(
    paths: SeedPaths,
    path: IntArray,
    vehicles: VehicleIndex,
    history: SceneHistory,
    actual: States,
    recorded: States,
    future: States,
    gap: FloatArray | None,
) -> tuple[dict[str, Any], BoolArray]:
    """Return the targets (P, ...) of vehicles along their paths, and (P,) whether they are near enough."""
    present = history.now[vehicles.future, vehicles.vehicle]
    expected = BEHIND_M + history.step * STEP_S * history.scene.now.speed[vehicles.vehicle]
    s_then, d_then, s_true, d_true = along_paths(paths, path, recorded, future, expected)
    s_now, d_now, heading = paths.foot_points(path, present.x, present.y, expected)
    s_here, d_here, _ = paths.foot_points(path, actual.x, actual.y, expected)
    aside, ahead = d_here - d_then, s_here - s_then
    lean = np.tan(np.clip(wrap(actual.heading - recorded.heading), -MAX_SLOPE, MAX_SLOPE))
    if gap is None:
        keep, gain = fading(STEP_S * np.arange(1.0, future.x.shape[1] + 1) / CATCH_UP_S)
        catching = ahead[:, None] * keep + (actual.speed - recorded.speed)[:, None] * CATCH_UP_S * gain
        travelled = np.maximum.accumulate(np.maximum(s_true + catching - s_now[:, None], 0.0), axis=1)
        near = np.abs(ahead) <= MAX_AHEAD_M
    else:
        s_true = np.maximum.accumulate(np.maximum(s_true, s_then[:, None]), axis=1)
        travelled = np.minimum(s_true - s_then[:, None], stopping_way(present.speed, gap, PLAN_STEPS))
        places = zip(s_now[:, None] + travelled, s_true, d_true, strict=True)
        d_true = np.array([np.interp(*place) for place in places]).reshape(d_true.shape)
        near = np.ones(len(path), dtype=np.bool_)
    d = d_true + smooth_return(aside, lean, actual.speed, travelled)
    arc_length = (s_now[:, None] + travelled).ravel()
    px, py, cos, sin, *_ = paths.at(np.repeat(path, d.shape[1]), arc_length).reshape(6, *d.shape)
    goals = {
        "s": travelled,
        "d": d,
        "start": np.stack([present.speed, d_now, wrap(present.heading - heading), aside], -1),
        "xy": np.stack(present.ahead_and_left(px - d * sin, py + d * cos), -1),
    }
    return goals, near & (np.abs(aside) <= MAX_ASIDE_M)
