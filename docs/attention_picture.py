"""Picture of the Graph Image Predictor's plans for several attention weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from scex_sumo.base.arrays import FloatArray
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.geometry.rectangles import outlines
from scex_sumo.page.figures.drawing import draw_road, look_at, save, sheet
from scex_sumo.scene import STEP_S, Plan, SceneHistory, SeedScene, VehicleIndex

_VALUES = (0.0, 0.25, 0.5, 0.75, 1.0)
_SPEED_PANELS = 3


def draw_attention(scene: SeedScene, path: Path, around_m: float) -> None:
    """Draw the plans of a scene's vehicles for several attention weights.

    The picture is centred on the vehicle whose plans differ most, beside the planned speeds of the three
    visible vehicles whose plans differ most. A plan ends in the outline of the vehicle after 3 s.
    """
    plans = [_plan(scene, f"graph_image_predictor:attention={w:g}") for w in _VALUES]
    order = _most_different(plans)
    centre = _middle(scene, plans, order[0])
    order = [v for v in order if np.abs(_middle(scene, plans, v) - centre).max() < around_m][:_SPEED_PANELS]
    with sheet(9, 5.4) as figure:
        grid = figure.add_gridspec(len(order), 2, width_ratios=[1.7, 1])
        whole = figure.add_subplot(grid[:, 0])
        _draw_plans(whole, scene, plans, order)
        look_at(whole, centre - around_m, centre + around_m)
        for place, vehicle in enumerate(order):
            axes = figure.add_subplot(grid[place, 1])
            _draw_speeds(axes, scene, plans, vehicle)
            axes.set_title("ABC"[place], loc="left", fontweight="bold")
        figure.axes[-1].set_xlabel("time [s]")
        save(figure, path, dpi=130)


def _plan(scene: SeedScene, model: str) -> Plan:
    assert scene.road is not None
    history = SceneHistory.of_scene(scene)
    driver = build(parse_models(model)[0])
    return driver.plan(history, scene.road, VehicleIndex.everyone(history), [np.random.default_rng(0)])


def _most_different(plans: Sequence[Plan]) -> list[int]:
    ends = np.stack([np.stack([plan.x[:, -1], plan.y[:, -1]], -1) for plan in plans])
    spread = np.hypot(*(ends.max(axis=0) - ends.min(axis=0)).T)
    return [int(v) for v in np.argsort(-spread, kind="stable")]


def _draw_plans(axes: Axes, scene: SeedScene, plans: Sequence[Plan], order: Sequence[int]) -> None:
    assert scene.road is not None
    draw_road(axes, scene.road)
    for box in outlines(scene.now, scene.length, scene.width):
        axes.fill(*box.T, facecolor="#222222", edgecolor="white", linewidth=0.6, zorder=5)
    for number, (plan, w) in enumerate(zip(plans, _VALUES, strict=True)):
        x, y = (np.column_stack([a, b]) for a, b in ((scene.now.x, plan.x), (scene.now.y, plan.y)))
        color = _color(w)
        lines = axes.plot(x.T, y.T, color=color, linewidth=1.4, zorder=4 - 0.1 * number)
        lines[0].set_label(f"w = {w:g}")
        for box in outlines(plan[:, -1], scene.length, scene.width):
            axes.fill(*box.T, facecolor="none", edgecolor=color, linewidth=1.2, zorder=6)
    for name, vehicle in zip("ABC", order, strict=False):
        at = (float(scene.now.x[vehicle]), float(scene.now.y[vehicle]))
        axes.annotate(name, at, xytext=(9, 9), textcoords="offset points", fontweight="bold", zorder=7)
    axes.set_title("plans of 3 s; w = 1 looks at the scene graph alone, w = 0 at the road alone", loc="left")
    axes.legend(loc="best", frameon=True, framealpha=0.9)


def _draw_speeds(axes: Axes, scene: SeedScene, plans: Sequence[Plan], vehicle: int) -> None:
    past = scene.history.speed[vehicle]
    before = STEP_S * np.arange(1 - len(past), 1)
    axes.plot(before, past, color="#222222", linewidth=1.4)
    for plan, w in zip(plans, _VALUES, strict=True):
        ahead = STEP_S * np.arange(plan.speed.shape[1] + 1)
        axes.plot(ahead, [past[-1], *plan.speed[vehicle]], color=_color(w), linewidth=1.4)
    axes.set(ylabel="speed [m/s]", xlim=(before[0], STEP_S * plans[0].speed.shape[1]))
    axes.set_ylim(bottom=min(0.0, float(axes.get_ylim()[0])))


def _color(w: float) -> tuple[float, float, float, float]:
    return mpl.colormaps["plasma"](0.9 * w)


def _middle(scene: SeedScene, plans: Sequence[Plan], vehicle: int) -> FloatArray:
    here = np.array([scene.now.x[vehicle], scene.now.y[vehicle]])
    ends = np.array([(plan.x[vehicle, -1], plan.y[vehicle, -1]) for plan in plans])
    middle: FloatArray = (here + ends[np.argmax(np.hypot(*(ends - here).T))]) / 2
    return middle
