"""Picture of the metrics for docs/metrics.md: each on a small scene, with the value that the package has.

Run: ``python docs/make_pictures.py metrics``.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, pi, sin
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from scex_sumo.evaluation.tables import evaluate_pairs
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.scene import STEP_S, States

BLUE, RED, GREY = "#1f5fa8", "#b5342b", "#777777"
LENGTH, WIDTH = 4.5, 1.8  # of the vehicles beside the metrics, m
Vehicle = tuple[float, float, float, float, float]  # x, y, heading, speed, acceleration
Path2 = Sequence[tuple[float, float]]


def scene_of(vehicles: Sequence[Vehicle]) -> SceneTracks:
    """One evaluated step after one that gives everyone the acceleration."""
    x, y, heading, speed, a = np.array(vehicles, dtype=float).T
    states = States(
        x=np.stack([x, x])[None],
        y=np.stack([y, y])[None],
        heading=np.stack([heading, heading])[None],
        speed=np.stack([speed - a * STEP_S, speed])[None],
    )
    size = np.ones(len(vehicles))
    return SceneTracks(states=states, length=LENGTH * size, width=WIDTH * size, first=1)


def value_of(metric: str, vehicles: Sequence[Vehicle], paths: Sequence[Path2]) -> float:
    """Of the first vehicle that has one."""
    now = np.zeros(1, dtype=np.int64)
    nodes = np.array(paths, dtype=float)[None, None]
    planned = PlannedPaths(x=nodes[..., 0], y=nodes[..., 1], index=now, column=now)
    return float(evaluate_pairs(scene_of(vehicles), planned, metrics=(metric,))[metric].value[0])


def draw(axes: Axes, vehicles: Sequence[Vehicle], paths: Sequence[Path2] = ()) -> None:
    """Rectangles, arrows of one second of motion, planned paths."""
    for path, (x, y, *_) in zip(paths, vehicles, strict=False):
        line = np.array([(x, y), *path])
        axes.plot(line[:, 0], line[:, 1], color=GREY, linewidth=1, linestyle="--", zorder=1)
    for index, (x, y, heading, speed, a) in enumerate(vehicles):
        c, s = cos(heading), sin(heading)
        corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (LENGTH / 2, WIDTH / 2)
        color = RED if index else BLUE
        axes.add_patch(Polygon(corners @ [[c, s], [-s, c]] + (x, y), color=color, zorder=2))
        axes.annotate(
            "", (x + speed * c, y + speed * s), (x, y), arrowprops={"arrowstyle": "->", "color": color}
        )
        text = f"{speed:g} m/s" + (f", {a:g} m/s²" if a else "")
        axes.annotate(
            text, (x, y), (0, -14), textcoords="offset points", ha="center", fontsize=7, color=color
        )
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_color("#cccccc")


def span(axes: Axes, start: tuple[float, float], end: tuple[float, float], text: str) -> None:
    """A measured length."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "|-|", "mutation_scale": 3, "color": GREY})
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    axes.annotate(text, middle, (0, 4), textcoords="offset points", ha="center", fontsize=8, color=GREY)


def reach(axes: Axes, vehicles: Sequence[Vehicle], time: float, acceleration: float = 6.9) -> None:
    """The discs on which the vehicles can be after some time."""
    for index, (x, y, heading, speed, _) in enumerate(vehicles):
        centre = (x + speed * time * cos(heading), y + speed * time * sin(heading))
        radius = hypot(LENGTH, WIDTH) / 2 + acceleration * time**2 / 2
        axes.add_patch(Circle(centre, radius, fill=False, color=RED if index else BLUE, linestyle=":"))
        axes.plot(*centre, ".", color=RED if index else BLUE, markersize=3)


def draw_metrics(path: Path) -> None:
    """Each metric on a small scene, with the value that the package computes."""
    figure = Figure(figsize=(9, 6.6), layout="constrained")
    panels = figure.subplots(3, 2, height_ratios=[8, 26, 26])
    column: list[Vehicle] = [(0, 0, 0, 14, 0), (30, 0, 0, 8, 0)]
    braking: list[Vehicle] = [(0, 0, 0, 14, 0), (30, 0, 0, 8, -3)]
    ahead = [[(15, 0), (44, 0)], [(38, 0), (46, 0)]]
    crossing: list[Vehicle] = [(-18, 0, 0, 9, 0), (0, -12, pi / 2, 4, 0)]
    across = [[(0, 0), (14, 0)], [(0, 0), (0, 9)]]
    oncoming: list[Vehicle] = [(0, 0, 0, 10, 0), (32, 3.5, pi, 10, 0)]
    apart = [[(10, 0), (24, 0)], [(20, 3.5), (8, 3.5)]]
    flow: list[Vehicle] = [(0, 0, 0, 10, 0), (14, 0, 0, 12, 0), (2, 4, 0, 6, -2)]
    onward = [[(5, 0), (12, 0)], [(20, 0), (28, 0)], [(5, 4), (12, 4)]]

    def panel(
        axes: Axes,
        metric: str,
        vehicles: list[Vehicle],
        paths: list[Path2],
        title: str,
        unit: str,
        low: float,
    ) -> float:
        draw(axes, vehicles, paths)
        value = value_of(metric, vehicles, paths)
        axes.set_title(f"{title} = {value:.2f}{unit}", fontsize=9, loc="left")
        left = min(x for x, *_ in vehicles) - 5
        axes.set_xlim(left, left + 52)
        axes.set_ylim(low, low + (14 if axes in panels[0] else 26))
        return value

    ttc, pttc, gap, wttc, distance, tq = panels.flat
    panel(ttc, "ttc", column, ahead, "TTC: d / (v_f − v_l)", " s", -8)
    span(ttc, (0, 2.5), (30, 2.5), "d: centres (set paper)")
    span(ttc, (LENGTH / 2, -6.5), (30 - LENGTH / 2, -6.5), "d: bumpers (set path)")
    panel(pttc, "pttc", braking, ahead, "PTTC: the leader keeps braking", " s", -8)
    panel(gap, "gap_time", crossing, across, "gap time: |s₁/v₁ − s₂/v₂|", " s", -16)
    span(gap, (-18, 2), (0, 2), "s₁")
    gap.annotate("", (2, 0), (2, -12), arrowprops={"arrowstyle": "|-|", "mutation_scale": 3, "color": GREY})
    gap.annotate("s₂", (2.5, -6), fontsize=8, color=GREY)
    reach(wttc, oncoming, panel(wttc, "wttc", oncoming, apart, "WTTC: the discs touch", " s", -11))
    panel(distance, "distance", oncoming, apart, "distance of the centres", " m", -11)
    distance.plot([0, 32], [0, 3.5], color=GREY, linewidth=1)
    panel(tq, "tq", flow, onward, "traffic quality of the blue vehicle", "", -11)
    tq.add_patch(Circle((0, 0), (0.36 * 10) ** 2 + LENGTH + 10, fill=False, color=BLUE, linestyle=":"))
    tq.annotate("r: counts neighbours", (28, 8), fontsize=7, color=BLUE)
    tq.annotate("smallest distance: 2.2 m, blue to upper red", (-4, 9), fontsize=7, color=GREY)
    with mpl.rc_context({"svg.hashsalt": "metrics"}):
        figure.savefig(path, metadata={"Date": None})
