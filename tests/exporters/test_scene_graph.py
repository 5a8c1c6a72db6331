"""The picture of a scene graph shows each relation once."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch

import scex_sumo as scex
from scex_sumo.exporters.scene_graph import scene_graph_panel
from tests.behaviors.roads import lane, road, scene_of

PARALLEL = road(lane(1, [(0.0, 0.0), (200.0, 0.0)], left=2), lane(2, [(0.0, 3.5), (200.0, 3.5)], right=1))
SCENE = scene_of((50.0, 0.0, 0.0, 9.0), (70.0, 0.0, 0.0, 7.0), (55.0, 3.5, 0.0, 9.0), (90.0, 30.0, 0.0, 9.0))


def test_each_relation_is_one_line_and_arrows_point_ahead() -> None:
    graph = scex.scene_graph(SCENE, PARALLEL)
    axes = Figure().subplots()
    scene_graph_panel(axes, PARALLEL, SCENE, graph)
    drawn = [patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)]
    assert len(drawn) == 3 == len(graph.edge_kind) / 2
    (arrow,) = [patch for patch in drawn if type(patch.get_arrowstyle()).__name__ == "CurveFilledB"]
    ends = arrow._posA_posB  # matplotlib has no public getter
    assert [tuple(end) for end in ends] == [(50.0, 0.0), (70.0, 0.0)]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["longitudinal (1)", "lateral (2)", "intersecting (0)"]
