"""Picture of a seed scene from above with its semantic scene graph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch

from scex_sumo.arrays import FloatArray
from scex_sumo.behaviors.scene_graph.graph import RADIUS_M, SceneGraph, scene_graph
from scex_sumo.reports.run_pictures import draw_road, vehicle_boxes
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, SeedScene

# Each relation once per pair: `ahead` seen from the other end is `behind`, the other two are mutual.
_STYLES: dict[int, tuple[str, str, Any]] = {
    0: ("longitudinal", "#1f6fb4", "-"),
    2: ("lateral", "#2e9a5b", "-"),
    3: ("intersecting", "#d0453a", (0, (4, 2))),
}
_BOX, _ALONE = "#8fa3b8", "#c4c4c4"  # vehicles with edges, and without
_MARGIN_M = 12.0
_BEND = 0.16  # of the straight distance: edges over a common lane do not hide one another


def plot_scene_graph(
    scene: SeedScene, path: str | Path, *, road: Road | None = None, radius: float = RADIUS_M, title: str = ""
) -> Path:
    """Draw a seed scene from above with the edges of its semantic scene graph, coloured by kind.

    A longitudinal edge is an arrow from the vehicle behind to the one ahead; lateral and intersecting edges
    are mutual and have no head. Vehicles without an edge are grey, pedestrians and cyclists magenta dots.
    Numbers are track ids.

    Args:
        scene: the vehicles.
        path: PNG or SVG file.
        road: the map; None takes that of the seed scene.
        radius: of the graph, m.
        title: above the picture; the scene's name and what it holds where it is empty.

    Raises:
        UsageError: there is no road.
    """
    graph = scene_graph(scene, road, radius=radius)
    road = scene.road if road is None else road
    assert road is not None  # or there would be no graph
    low, high = _extent(scene)
    wide, tall = (high - low) * 9 / max(high - low)
    with plt.rc_context({"font.size": 8, "svg.fonttype": "none"}):
        figure, axes = plt.subplots(figsize=(max(wide, 5.0), max(tall, 2.0) + 0.9), layout="constrained")
        scene_graph_panel(axes, road, scene, graph)
        axes.set(
            xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]"
        )
        axes.set_title(title or _title(scene, graph), loc="left")
        figure.savefig(path, dpi=150, bbox_inches="tight")
        plt.close(figure)
    return Path(path)


def scene_graph_panel(axes: Axes, road: Road, scene: SeedScene, graph: SceneGraph) -> None:
    """Draw road, vehicles and edges of the first child of a graph, with a legend."""
    draw_road(axes, road)
    draw_edges(axes, scene, graph)
    mine = graph.child == 0
    related = np.zeros(mine.sum(), dtype=np.bool_)
    related[graph.edge_index[graph.edge_index < len(related)]] = True
    colors = [_BOX if some else _ALONE for some in related]
    boxes = list(vehicle_boxes(scene))
    axes.add_collection(
        PolyCollection(boxes, facecolors=colors, edgecolors="#3a3a3a", linewidths=0.6, zorder=3)
    )
    _noses(axes, scene)
    axes.scatter(scene.now.x, scene.now.y, s=9, color="#222222", zorder=6)
    for v in range(scene.vehicles):
        axes.annotate(
            str(scene.track_ids[v]),
            (scene.now.x[v], scene.now.y[v]),
            xytext=(5, 5),
            textcoords="offset points",
            fontsize=7,
            zorder=7,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
        )
    others = scene.obstacles
    if others is not None:
        here = others.present[:, HISTORY_STEPS]
        at = others.states[here, HISTORY_STEPS]
        axes.scatter(at.x, at.y, s=14, color="#d6189c", edgecolors="white", linewidths=0.5, zorder=6)
    axes.legend(handles=_legend(graph), loc="upper left", framealpha=0.9, fontsize=7)


def draw_edges(axes: Axes, scene: SeedScene, graph: SceneGraph) -> None:
    """Draw each relation of the first child once, longitudinal ones on top."""
    source, target = graph.edge_index
    for kind, (_, color, line) in reversed(_STYLES.items()):
        chosen = (graph.edge_kind == kind) & (target < scene.vehicles)
        if kind != 0:
            chosen &= source < target
        tails, heads = (target, source) if kind == 0 else (source, target)
        for a, b in zip(tails[chosen], heads[chosen], strict=True):
            axes.add_patch(
                FancyArrowPatch(
                    (scene.now.x[a], scene.now.y[a]),
                    (scene.now.x[b], scene.now.y[b]),
                    arrowstyle="-|>" if kind == 0 else "-",
                    connectionstyle=f"arc3,rad={_BEND}",
                    mutation_scale=8,
                    shrinkA=2,
                    shrinkB=2,
                    color=color,
                    linestyle=line,
                    linewidth=1.0,
                    alpha=0.85,
                    zorder=5,
                )
            )


def _noses(axes: Axes, scene: SeedScene) -> None:
    """A light line across each vehicle's front: which way it faces."""
    corners = vehicle_boxes(scene)
    inward = 0.25 * (corners[:, [2, 3]].mean(axis=1) - corners[:, :2].mean(axis=1))[:, None]
    axes.add_collection(
        LineCollection(list(corners[:, :2] + inward), colors="#3a3a3a", linewidths=0.8, zorder=3)
    )


def _legend(graph: SceneGraph) -> list[Line2D]:
    counts = {
        kind: int((graph.edge_kind[graph.child[graph.edge_index[1]] == 0] == kind).sum()) for kind in _STYLES
    }
    return [
        Line2D(
            [],
            [],
            color=color,
            linestyle=line,
            linewidth=1.4,
            label=f"{name} ({counts[kind] if kind == 0 else counts[kind] // 2})",
        )
        for kind, (name, color, line) in _STYLES.items()
    ]


def _title(scene: SeedScene, graph: SceneGraph) -> str:
    off = int((~graph.on_road).sum())
    return f"{scene.name}: {scene.vehicles} vehicles{f', {off} off the mapped lanes' if off else ''}"


def _extent(scene: SeedScene) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner of what there is to see, m."""
    centres = np.column_stack([scene.now.x, scene.now.y])
    return centres.min(axis=0) - _MARGIN_M, centres.max(axis=0) + _MARGIN_M
