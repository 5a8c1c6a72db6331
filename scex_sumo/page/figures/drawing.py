"""Matplotlib drawing of a traffic scene from above; the user's backend stays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from scex_sumo.base.errors import UsageError, one_line
from scex_sumo.base.outputs import output
from scex_sumo.geometry.rectangles import outlines
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, SeedScene

STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",  # text stays editable
    "svg.hashsalt": "scex-sumo",  # for reproducible bytes
    "figure.dpi": 100,
}


def save(figure: Figure, path: str | Path, **how: Any) -> None:
    """Write a figure; an unknown format or an unusable path is one line."""
    with output(Path(path)) as temporary:
        try:
            figure.savefig(temporary, format=Path(path).suffix[1:], **how)
        except ValueError as error:
            raise UsageError(f"{path}: {one_line(error)}") from None


def draw_road(axes: Axes, road: Road) -> None:
    """Draw the areas and the bounds of the vehicle lanes."""
    bounds = [(lane.left_bound, lane.right_bound) for lane in road.vehicle_lanes.values()]
    areas = [np.concatenate([left, right[::-1]]) for left, right in bounds]
    axes.add_collection(PolyCollection(areas, facecolors="#d9d9d9", edgecolors="none", zorder=1))
    lines = [line for pair in bounds for line in pair]
    axes.add_collection(LineCollection(lines, colors="white", linewidths=0.6, zorder=2))


def draw_vehicles(axes: Axes, scene: SeedScene, **style: Any) -> None:
    """Draw vehicles as boxes, pedestrians and cyclists as magenta dots."""
    boxes = outlines(scene.now, scene.length, scene.width)
    axes.add_collection(PolyCollection(list(boxes), linewidths=0.6, **style))
    if scene.obstacles is not None:
        here = scene.obstacles.present[:, HISTORY_STEPS]
        people = scene.obstacles.states[here, HISTORY_STEPS]
        axes.scatter(people.x, people.y, s=14, color="#d6189c", edgecolors="white", linewidths=0.5, zorder=6)
