"""Panels of a run: densities, cumulative densities, the scene with its futures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.registry import side_of
from scex_sumo.reports.pictures import sheet
from scex_sumo.results.run import Run
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, LOGGED_HISTORY, SeedScene, States
from scex_sumo.statistics.density import Density

_CURVE, CRITICAL, RECORDED, _LIKELY = "#1f4e79", "#c0392b", "#222222", "#2e8b57"
_MARGIN_M = 10.0
_LABEL_SHARE = 0.11  # of a panel's width, that a label takes


def futures_of(run: Run, scene: SeedScene) -> list[FloatArray]:
    """Simulated centres of each vehicle: V arrays (C, 1 + T, 2), the seed scene first, m."""
    shape = (run.children, scene.vehicles, LOGGED_HISTORY + run.info["steps"])
    x, y = (np.asarray(run.tracks[c]).reshape(shape)[..., LOGGED_HISTORY - 1 :] for c in ("x", "y"))
    return ways(x, y)


def ways(x: FloatArray, y: FloatArray) -> list[FloatArray]:
    """(C, V, T) centres as V arrays (C, T, 2)."""
    points = np.stack([x, y], axis=-1)
    return [points[:, vehicle] for vehicle in range(x.shape[1])]


def density_panel(run: Run, column: str, axes: Axes) -> None:
    """Draw the density of a metric, that of what is likely, its threshold and its recorded value."""
    curve = run.density(column)
    sheet.filled(axes, curve.x, np.zeros_like(curve.x), curve.pdf, curve.pdf, _CURVE)
    if run.reference is not None and len(run.reference.samples(column)):
        likely = run.reference.density(column)
        axes.plot(likely.x, likely.pdf, color=_LIKELY, linewidth=1.2)
        sheet.note(axes, 0.95, "likely", _LIKELY, fontsize=7)
    axes.set_ylim(0, 1.05 * max((float(np.max(line.get_ydata())) for line in axes.lines), default=0) or 1)
    _mark(run, column, axes, curve.x)
    _atoms(curve, axes)


def _atoms(curve: Density, axes: Axes) -> None:
    """Values that many children share, as stems; the largest shares are written where there is room."""
    (left, right), most = axes.get_xlim(), max((atom.share for atom in curve.atoms), default=1.0)
    place = axes.get_xaxis_transform()  # heights are shares of the panel: a stem has no density
    labelled: list[float] = []
    seen = [atom for atom in curve.atoms if left <= atom.value <= right]
    for atom in sorted(seen, key=lambda atom: -atom.share):
        height = 0.85 * atom.share / most
        axes.plot([atom.value] * 2, [0, height], color=_CURVE, linewidth=2, transform=place)
        if all(abs(atom.value - x) > _LABEL_SHARE * (right - left) for x in labelled):
            labelled.append(atom.value)
            axes.text(
                atom.value,
                height + 0.01,
                f"{atom.share:.0%}",
                size=6,
                color=_CURVE,
                ha="center",
                transform=place,
            )


def cumulative_panel(run: Run, column: str, axes: Axes) -> None:
    """Draw the cumulative density of a metric with its band, threshold and recorded value."""
    curve = run.density(column)
    sheet.filled(axes, curve.x, *curve.band, curve.cdf, _CURVE)
    axes.set_ylim(0, 1)
    _mark(run, column, axes, curve.x)


def _mark(run: Run, column: str, axes: Axes, x: FloatArray) -> None:
    """Threshold and recorded value as vertical lines; the view stays where most of the children are."""
    recorded, threshold = run.recorded_value(column), run.thresholds.get(column)
    left, right = sheet.span(run.samples(column), float(x[0]), float(x[-1]), (recorded, threshold))
    if recorded is not None and left <= recorded <= right:
        axes.axvline(recorded, color=RECORDED, linewidth=1.2, linestyle="--")
    elif recorded is not None:
        words = f"recorded {recorded:.3g} →" if recorded > right else f"← recorded {recorded:.3g}"
        sheet.note(axes, 0.15, words, RECORDED, fontsize=7)
    if threshold is not None:
        if left < threshold < right:
            axes.axvline(threshold, color=CRITICAL, linewidth=1)
        critical = (left, threshold) if side_of(column) == "left" else (threshold, right)
        low, high = max(critical[0], left), min(critical[1], right)
        if low < high:
            axes.axvspan(low, high, color=CRITICAL, alpha=0.07, linewidth=0)
        axes.set_title(f"P = {run.p_critical(column).value:.1%}", loc="right", color=CRITICAL)
    beyond = float(np.mean(run.samples(column) > right))
    if beyond > 0:
        sheet.note(axes, 0.04, f"{max(beyond, 0.001):.1%} beyond →", fontsize=7)
    axes.set_xlim(left, right)


def scene_panel(axes: Axes, road: Road, scene: SeedScene, futures: Sequence[FloatArray]) -> None:
    """Draw the road, the vehicles of a seed scene, and the paths of its children.

    Pedestrians and cyclists are dots.
    """
    draw_road(axes, road)
    palette = mpl.colormaps["turbo"]
    for vehicle, lines in enumerate(futures):
        color = palette((vehicle + 0.5) / max(scene.vehicles, 1))
        paths = LineCollection(list(lines), colors=[color], linewidths=0.8, alpha=0.12, zorder=3)
        axes.add_collection(paths)
    draw_vehicles(axes, scene, facecolors="#222222", edgecolors="white", zorder=5)
    look_at(axes, *extent(scene, _MARGIN_M, futures))


def look_at(axes: Axes, low: FloatArray, high: FloatArray) -> None:
    """Show a map from its lower left to its upper right corner, m."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")


def extent(
    scene: SeedScene, margin_m: float, futures: Sequence[FloatArray] = ()
) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner of what there is to see, m."""
    centres = np.column_stack([scene.now.x, scene.now.y])
    reach = np.concatenate([centres, *[lines.reshape(-1, 2) for lines in futures]])
    return reach.min(axis=0) - margin_m, reach.max(axis=0) + margin_m


def draw_road(axes: Axes, road: Road) -> None:
    """Asphalt of the vehicle lanes, and the lines on it."""
    bounds = [(lane.left_bound, lane.right_bound) for lane in road.vehicle_lanes.values()]
    areas = [np.concatenate([left, right[::-1]]) for left, right in bounds]
    axes.add_collection(PolyCollection(areas, facecolors="#d9d9d9", edgecolors="none", zorder=1))
    lines = [line for pair in bounds for line in pair]
    axes.add_collection(LineCollection(lines, colors="white", linewidths=0.6, zorder=2))


def draw_vehicles(axes: Axes, scene: SeedScene, **style: Any) -> None:
    """Vehicles of a seed scene as boxes, pedestrians and cyclists as magenta dots."""
    axes.add_collection(PolyCollection(list(vehicle_boxes(scene)), linewidths=0.6, **style))
    if scene.obstacles is not None:
        here = scene.obstacles.present[:, HISTORY_STEPS]
        at = scene.obstacles.states[here, HISTORY_STEPS]
        axes.scatter(at.x, at.y, s=14, color="#d6189c", edgecolors="white", linewidths=0.5, zorder=6)


def vehicle_boxes(scene: SeedScene, states: States | None = None) -> FloatArray:
    """(V, 4, 2) corners of the vehicles in (V,) states, at the moment of the seed scene by default, m."""
    now = scene.now if states is None else states
    along = np.stack([np.cos(now.heading), np.sin(now.heading)], axis=-1) * scene.length[:, None] / 2
    across = np.stack([-np.sin(now.heading), np.cos(now.heading)], axis=-1) * scene.width[:, None] / 2
    centre = np.stack([now.x, now.y], axis=-1)
    corners = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return np.stack([centre + a * along + b * across for a, b in corners], axis=1)
