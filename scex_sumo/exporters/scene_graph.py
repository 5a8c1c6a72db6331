"""Scene graph: export to networkx and PyTorch Geometric, and a picture with its seed scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import UsageError
from scex_sumo.base.importing import extra_for
from scex_sumo.geometry.rectangles import outlines
from scex_sumo.graphs.graph import KINDS, RADIUS_M, SceneGraph, scene_graph
from scex_sumo.page.figures.drawing import STYLE, draw_road, draw_vehicles, save
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

if TYPE_CHECKING:
    from networkx import DiGraph
    from torch_geometric.data import HeteroData

# Each relation once per pair: `ahead` is the reverse of `behind`.
_STYLES: dict[int, tuple[str, str, Any]] = {
    0: ("longitudinal", "#1f6fb4", "-"),
    2: ("lateral", "#2e9a5b", "-"),
    3: ("intersecting", "#d0453a", (0, (4, 2))),
}
_BOX, _ALONE = "#8fa3b8", "#c4c4c4"  # vehicles with edges, and without
_MARGIN_M = 12.0
_BEND = 0.16  # keeps edges over a common lane apart
_FRONT = np.array([(0.25, 0.5), (0.25, -0.5)])  # of a box, see `outlines`


@checked
def to_networkx(graph: SceneGraph, future: int = 0) -> DiGraph[int]:
    """Convert the graph of one future, an index into the batch, to a `networkx.DiGraph`.

    Nodes are vehicle indices, with `SceneGraph.node_columns`, ``history`` (11, 5), ``lane_id`` and ``arc``
    (None off the road). Edges have ``kind`` (of `KINDS`) and `SceneGraph.edge_columns`.

    Raises:
        MissingExtraError: networkx is not installed.
        UsageError: the batch has no such future.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> scex.to_networkx(scex.scene_graph(scene)).number_of_nodes()
        14
    """
    with extra_for("this export needs networkx", "learned"):
        import networkx
    nodes = np.flatnonzero(graph.future == future)
    if not len(nodes):
        count = len(np.unique(graph.future))
        raise UsageError(f"scene graph: future {future} of a batch of {count}; choose 0 to {count - 1}")
    result: DiGraph[int] = networkx.DiGraph()
    for node in nodes:
        place = (int(graph.lane_id[node]), float(graph.arc[node])) if graph.on_road[node] else (None, None)
        named = dict(zip(graph.node_columns, graph.node[node].tolist(), strict=True))
        named |= {"history": graph.history[node].copy(), "lane_id": place[0], "arc": place[1]}
        result.add_node(int(graph.vehicle[node]), **named)
    source, target = graph.vehicle[graph.edge_index]
    for k in np.flatnonzero(graph.future[graph.edge_index[1]] == future):
        named = dict(zip(graph.edge_columns, graph.edge[k].tolist(), strict=True))
        result.add_edge(int(source[k]), int(target[k]), kind=KINDS[graph.edge_kind[k]], **named)
    return result


@checked
def to_hetero_data(graph: SceneGraph) -> HeteroData:
    """Convert the graphs of all futures to one `torch_geometric.data.HeteroData`.

    Nodes ``vehicle`` have ``x`` (N, F), ``history`` (N, 11, 5), ``future`` (N,), ``vehicle`` (N,). Edges
    ``("vehicle", kind, "vehicle")`` have ``edge_index`` (2, E), ``edge_attr`` (E, G). Floats are float32.
    Names of columns: ``node_columns``, ``history_columns``, ``edge_columns``.

    Raises:
        MissingExtraError: torch or torch-geometric is not installed.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> scex.to_hetero_data(scex.scene_graph(scene))["vehicle"].x.shape[0]
        14
    """
    with extra_for("this export needs PyTorch Geometric", "learned"):
        import torch
        from torch_geometric.data import HeteroData
    data = HeteroData()
    nodes: Any = data["vehicle"]
    nodes.x = torch.tensor(graph.node, dtype=torch.float32)
    nodes.history = torch.tensor(graph.history, dtype=torch.float32)
    nodes.future, nodes.vehicle = torch.tensor(graph.future), torch.tensor(graph.vehicle)
    for number, kind in enumerate(KINDS):
        mine = graph.edge_kind == number
        edges: Any = data["vehicle", kind, "vehicle"]
        edges.edge_index = torch.tensor(graph.edge_index[:, mine])
        edges.edge_attr = torch.tensor(graph.edge[mine], dtype=torch.float32)
    for name in ("node_columns", "history_columns", "edge_columns"):
        setattr(data, name, getattr(graph, name))
    return data


@checked
def plot_scene_graph(
    scene: SeedScene, path: str | Path, *, road: Road | None = None, radius: float = RADIUS_M, title: str = ""
) -> Path:
    """Draw a seed scene from above with its scene graph, and return the file.

    Longitudinal edges are arrows from the vehicle behind to the one ahead. Vehicles without an edge are grey,
    pedestrians and cyclists magenta dots; numbers are track ids.

    Args:
        road: None takes that of the seed scene; without one there is a `UsageError`.
        radius: of the graph, m.
        title: empty takes the scene's name and number of vehicles.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> scex.plot_scene_graph(scene, "graph.png").name
        'graph.png'
    """
    graph = scene_graph(scene, road, radius=radius)
    road = scene.road if road is None else road
    assert road is not None
    centres = np.column_stack([scene.now.x, scene.now.y])
    low, high = centres.min(axis=0) - _MARGIN_M, centres.max(axis=0) + _MARGIN_M
    wide, tall = (high - low) * 9 / max(high - low)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(max(wide, 5.0), max(tall, 2.0) + 0.9), layout="constrained")
        axes = figure.subplots()
        scene_graph_panel(axes, road, scene, graph)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.set(xlabel="x [m]", ylabel="y [m]")
        off = int((~graph.on_road).sum())
        known = f"{scene.name}: {scene.vehicles} vehicles{f', {off} off the mapped lanes' if off else ''}"
        axes.set_title(title or known, loc="left")
        save(figure, path, dpi=150, bbox_inches="tight")
    return Path(path)


def scene_graph_panel(axes: Axes, road: Road, scene: SeedScene, graph: SceneGraph) -> None:
    """Draw road, vehicles, edges of the first future, and a legend."""
    draw_road(axes, road)
    _draw_edges(axes, scene, graph)
    mine = graph.future == 0
    colors = np.where(np.isin(np.flatnonzero(mine), graph.edge_index), _BOX, _ALONE).tolist()
    draw_vehicles(axes, scene, facecolors=colors, edgecolors="#3a3a3a", zorder=3)
    fronts = outlines(scene.now, scene.length, scene.width, _FRONT)
    axes.add_collection(LineCollection(list(fronts), colors="#3a3a3a", linewidths=0.8, zorder=3))
    axes.scatter(scene.now.x, scene.now.y, s=9, color="#222222", zorder=6)
    beside: dict[str, Any] = {"xytext": (5, 5), "textcoords": "offset points", "fontsize": 7, "zorder": 7}
    beside["bbox"] = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
    for v in range(scene.vehicles):
        axes.annotate(str(scene.track_ids[v]), (scene.now.x[v], scene.now.y[v]), **beside)
    axes.legend(handles=_legend(graph), loc="upper left", framealpha=0.9, fontsize=7)


def _draw_edges(axes: Axes, scene: SeedScene, graph: SceneGraph) -> None:
    source, target = graph.edge_index
    for kind, (_, color, line) in reversed(_STYLES.items()):
        chosen = (graph.edge_kind == kind) & (target < scene.vehicles)
        if kind != 0:
            chosen &= source < target
        tails, heads = (target, source) if kind == 0 else (source, target)
        for a, b in zip(tails[chosen], heads[chosen], strict=True):
            ends = [(scene.now.x[v], scene.now.y[v]) for v in (a, b)]
            style = {"arrowstyle": "-|>" if kind == 0 else "-", "mutation_scale": 8, "linestyle": line}
            edge = FancyArrowPatch(*ends, connectionstyle=f"arc3,rad={_BEND}", shrinkA=2, shrinkB=2, **style)
            edge.set(color=color, linewidth=1.0, alpha=0.85, zorder=5)
            axes.add_patch(edge)


def _legend(graph: SceneGraph) -> list[Line2D]:
    kinds = graph.edge_kind[graph.future[graph.edge_index[1]] == 0]
    counts = {kind: int((kinds == kind).sum()) // (1 if kind == 0 else 2) for kind in _STYLES}
    return [
        Line2D([], [], color=color, linestyle=line, linewidth=1.4, label=f"{name} ({counts[kind]})")
        for kind, (name, color, line) in _STYLES.items()
    ]
