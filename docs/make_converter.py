"""Draw docs/images/converter.svg: lanelets of an example map, and what they become in the SUMO net.

Run: ``python docs/make_converter.py``.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.net.convert import convert
from scex_sumo.road import Road

HERE = Path(__file__).resolve().parent
IMAGE = HERE / "images" / "converter.svg"
MAP = HERE.parent / "scex_sumo" / "scenarios" / "data" / "urban_intersection.osm"
WINDOW = (972.0, 1032.0, 972.0, 1032.0)  # around the intersection, m
CLOSE = (1000.0, 1026.0, 996.0, 1012.0)  # its eastern arm
ROAD, INSIDE, AREA = "#1f5fa8", "#b5342b", "#d9d9d9"


def points(text: str | None) -> FloatArray:
    """A SUMO shape as (P, 2)."""
    return np.array([[float(v) for v in pair.split(",")] for pair in (text or "").split()])


def draw_lanelets(axes: Axes, road: Road) -> None:
    """Outlines and centrelines with direction."""
    for lane in road.vehicle_lanes.values():
        outline = np.vstack([lane.left_bound, lane.right_bound[::-1]])
        axes.fill(*outline.T, facecolor="#eef3f8", edgecolor="#7a8ba0", linewidth=0.7, alpha=0.6)
    for lane in road.vehicle_lanes.values():
        axes.plot(*lane.centreline.T, color="#44546a", linewidth=0.7, linestyle=(0, (5, 3)))
        arrow(axes, lane.centreline, "#44546a")


def draw_net(axes: Axes, net: Path) -> None:
    """Junction areas, edges, connections."""
    root = ET.parse(net).getroot()
    for junction in root.iter("junction"):
        axes.fill(*points(junction.get("shape")).T, color=AREA, linewidth=0)
    for lane in root.iter("lane"):
        inside = lane.get("id", "").startswith(":")
        shape = points(lane.get("shape"))
        axes.plot(*shape.T, color=INSIDE if inside else ROAD, linewidth=0.9 if inside else 2.0)
        if not inside:
            arrow(axes, shape, ROAD)
            axes.plot(*shape[[0, -1]].T, ".", color=ROAD, markersize=5)


def arrow(axes: Axes, shape: FloatArray, color: str) -> None:
    """An arrowhead at the end of a line."""
    axes.annotate("", shape[-1], shape[-2], arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 0})


def frame(axes: Axes, window: tuple[float, float, float, float], title: str) -> None:
    """Equal axes over a part of the map."""
    axes.set_aspect("equal")
    axes.set_xlim(window[0], window[1])
    axes.set_ylim(window[2], window[3])
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(title, fontsize=10)


def main() -> None:
    """Convert the example map and draw both sides."""
    road = read_road(MAP)
    plt.rcParams["svg.hashsalt"] = "converter"
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(15, 5.2), layout="constrained")
    draw_lanelets(left, road)
    frame(left, WINDOW, "Lanelets and their centrelines")
    with tempfile.TemporaryDirectory() as folder:
        net = convert(road, Path(folder) / "net.net.xml").path
        for axes in (middle, right):
            draw_net(axes, net)
    frame(middle, WINDOW, "SUMO: edges (blue), ways through junctions (red)")
    frame(right, CLOSE, "Eastern arm: only what overlaps lies in the junction")
    IMAGE.parent.mkdir(exist_ok=True)
    figure.savefig(IMAGE, metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    main()
