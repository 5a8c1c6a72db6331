"""Pictures of a run: densities, cumulative densities, the scene with its futures. Only here: matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.registry import metric_of, side_of
from scex_sumo.reports.run_table import counted
from scex_sumo.results.run import Run
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, LOGGED_HISTORY, SeedScene, States

_CURVE, _CRITICAL, _RECORDED = "#1f4e79", "#c0392b", "#222222"
STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",  # text stays text: searchable, and editable for a paper
    "svg.hashsalt": "scex-sumo",  # the same picture has the same bytes
    "figure.dpi": 100,
}


def draw_run(run: Run, scene: SeedScene) -> list[Path]:
    """Write all pictures of a run into its result folder; returns their paths."""
    folder = run.folder
    files = draw_densities(run, folder / "densities") + draw_cumulative(run, folder / "cumulative")
    if scene.road is not None:
        title = (
            f"{scene.name}: {run.children} futures of {counted(scene.vehicles, 'vehicle')}, "
            f"{run.info['steps'] / 10:g} s"
        )
        files.append(draw_scene(scene.road, scene, futures_of(run, scene), folder / "scene.png", title=title))
    return files


def futures_of(run: Run, scene: SeedScene) -> list[FloatArray]:
    """Simulated centres of each vehicle: V arrays (C, 1 + T, 2), the seed scene first, m."""
    tracks = run.tracks
    frames = LOGGED_HISTORY + run.info["steps"]
    shape = (run.children, scene.vehicles, frames)
    points = np.stack([np.asarray(tracks[c]).reshape(shape) for c in ("x", "y")], axis=-1)
    return [points[:, vehicle, LOGGED_HISTORY - 1 :] for vehicle in range(scene.vehicles)]


def draw_densities(run: Run, stem: Path) -> list[Path]:
    """Write the density of each of the 12 metric columns as SVG and PNG, one panel each.

    Args:
        run: a finished run.
        stem: path without ending.
    """
    return save(_panels(run, "density", density_panel), stem)


def draw_cumulative(run: Run, stem: Path) -> list[Path]:
    """Write the cumulative density of each column with its 95 % band as SVG and PNG."""
    return save(_panels(run, "cumulative density", cumulative_panel), stem)


def axis_label(column: str) -> str:
    """Name and unit of a metric column."""
    return metric_of(column).titled("–")


def panel_title(column: str) -> str:
    """What a metric column holds of each child."""
    found = metric_of(column)
    return f"{found.name}: {'mean of scenes' if column.endswith('_mean') else found.critical}"


def panel_grid(
    panels: int, *, across: int = 4, size: tuple[float, float] = (2.875, 2.4), **options: Any
) -> tuple[Figure, Any]:
    """Figure and (rows, across) axes, each of a size in inches; those beyond the panels stay empty."""
    down = -(-panels // across)
    options |= {"figsize": (size[0] * across, size[1] * down), "layout": "constrained", "squeeze": False}
    figure, grid = plt.subplots(down, across, **options)
    for axes in grid.flat[panels:]:
        axes.set_axis_off()
    return figure, grid


def _panels(run: Run, what: str, draw: Callable[[Run, str, Axes], None]) -> Figure:
    with plt.rc_context(STYLE):
        columns = run.columns
        figure, grid = panel_grid(len(columns))
        for axes, column in zip(grid.flat, columns, strict=False):
            axes.set_xlabel(axis_label(column))
            axes.set_title(panel_title(column), loc="left")
            if not np.isfinite(run.samples(column)).any():
                axes.text(0.5, 0.5, "defined in no child", ha="center", va="center", transform=axes.transAxes)
                axes.set_yticks([])
                continue
            draw(run, column, axes)
            defined = len(run.samples(column))
            if defined < run.children:
                note = f"defined in\n{defined}/{run.children}"
                axes.text(0.98, 0.82, note, ha="right", va="top", transform=axes.transAxes, color="#666666")
        for axes in grid[:, 0]:
            axes.set_ylabel(what)
        scene = run.info["seed_scene"]
        figure.suptitle(
            f"{scene['name']}   {counted(scene['vehicles'], 'vehicle')}, "
            f"{counted(run.children, 'child scenario')}",
            x=0.01,
            ha="left",
            fontsize=10,
        )
        handles, labels = _legend(run)
        if handles:
            figure.legend(handles, labels, loc="upper right", ncols=len(handles), frameon=False)
    return figure


def _legend(run: Run) -> tuple[list[Line2D], list[str]]:
    handles = [Line2D([], [], color=_CRITICAL, linewidth=1)]
    labels = ["threshold, critical side shaded"]
    if run.recorded is not None:
        handles.append(Line2D([], [], color=_RECORDED, linewidth=1.2, linestyle="--"))
        labels.append("recorded future")
    return handles, labels


def density_panel(run: Run, column: str, axes: Axes) -> None:
    """Draw the density of a metric with its threshold and recorded value."""
    curve = run.density(column)
    axes.fill_between(curve.x, curve.pdf, color=_CURVE, alpha=0.18, linewidth=0)
    axes.plot(curve.x, curve.pdf, color=_CURVE, linewidth=1.2)
    axes.set_ylim(bottom=0)
    _mark(run, column, axes, curve.x)


def cumulative_panel(run: Run, column: str, axes: Axes) -> None:
    """Draw the cumulative density of a metric with its band, threshold and recorded value."""
    curve = run.density(column)
    low, high = curve.band
    axes.fill_between(curve.x, low, high, color=_CURVE, alpha=0.18, linewidth=0)
    axes.plot(curve.x, curve.cdf, color=_CURVE, linewidth=1.2)
    axes.set_ylim(0, 1)
    _mark(run, column, axes, curve.x)


def _mark(run: Run, column: str, axes: Axes, x: FloatArray) -> None:
    """Threshold and recorded value as vertical lines; the view stays where most of the children are."""
    left, right = _view(run, column, x)
    recorded = run.recorded_value(column)
    if recorded is not None and left <= recorded <= right:
        axes.axvline(recorded, color=_RECORDED, linewidth=1.2, linestyle="--")
    elif recorded is not None:
        note = f"recorded {recorded:.3g} →" if recorded > right else f"← recorded {recorded:.3g}"
        axes.text(0.98, 0.12, note, ha="right", transform=axes.transAxes, color=_RECORDED, fontsize=7)
    threshold = run.thresholds.get(column)
    if threshold is not None:
        if left < threshold < right:
            axes.axvline(threshold, color=_CRITICAL, linewidth=1)
        critical = (left, threshold) if side_of(column) == "left" else (threshold, right)
        low, high = max(critical[0], left), min(critical[1], right)
        if low < high:
            axes.axvspan(low, high, color=_CRITICAL, alpha=0.07, linewidth=0)
        share = f"P = {run.p_critical(column).value:.1%}"
        axes.text(0.98, 0.95, share, ha="right", va="top", transform=axes.transAxes, color=_CRITICAL)
    beyond = float(np.mean(run.samples(column) > right))
    if beyond > 0:
        note = f"{max(beyond, 0.001):.1%} beyond →"
        axes.text(0.98, 0.04, note, ha="right", transform=axes.transAxes, color="#666666", fontsize=7)
    axes.set_xlim(left, right)


def _view(run: Run, column: str, x: FloatArray) -> tuple[float, float]:
    """Range of the x axis: the density but for a far tail, with recorded value and threshold if near."""
    samples = run.samples(column)
    first, third = np.quantile(samples[np.isfinite(samples)], [0.25, 0.75])
    spread = max(float(third - first), 0.25)
    left, right = max(float(x[0]), first - 5 * spread), min(float(x[-1]), third + 5 * spread)
    marks = [run.recorded_value(column), run.thresholds.get(column)]
    for mark in marks:
        margin = 0.5 * (right - left)
        if mark is not None and left - margin <= mark <= right + margin:
            left, right = min(left, mark - 0.1), max(right, mark + 0.1)
    return left, right


def draw_scene(
    road: Road, scene: SeedScene, futures: Sequence[FloatArray], path: Path, *, title: str = ""
) -> Path:
    """Draw a seed scene with the paths of its children.

    Args:
        road: the map.
        scene: the vehicles.
        futures: (C, T, 2) centres of each vehicle in all children, one array per vehicle.
        path: PNG or SVG file.
        title: above the picture.
    """
    low, high = _extent(scene, futures)
    wide, tall = (high - low) * 9 / max(high - low)
    size = (max(wide, 3.5) + 0.8, max(tall, 1.5) + 0.8)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=size, layout="constrained")
        scene_panel(axes, road, scene, futures)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.set_title(title, loc="left")
        figure.savefig(path, dpi=150)
        plt.close(figure)
    return path


def scene_panel(axes: Axes, road: Road, scene: SeedScene, futures: Sequence[FloatArray]) -> None:
    """Draw the road, the vehicles of a seed scene, and the paths of its children, as `draw_scene` does.

    Pedestrians and cyclists are dots.
    """
    draw_road(axes, road)
    palette = plt.get_cmap("turbo")
    for vehicle, lines in enumerate(futures):
        color = palette((vehicle + 0.5) / max(scene.vehicles, 1))
        paths = LineCollection(list(lines), colors=[color], linewidths=0.8, alpha=0.12, zorder=3)
        axes.add_collection(paths)
    boxes = list(vehicle_boxes(scene))
    axes.add_collection(
        PolyCollection(boxes, facecolors="#222222", edgecolors="white", linewidths=0.6, zorder=5)
    )
    others = scene.obstacles
    if others is not None:
        here = others.present[:, HISTORY_STEPS]
        at = others.states[here, HISTORY_STEPS]
        axes.scatter(at.x, at.y, s=14, color="#d6189c", edgecolors="white", linewidths=0.5, zorder=6)
    low, high = _extent(scene, futures)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")


def _extent(scene: SeedScene, futures: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner of what there is to see, m."""
    centres = np.array([scene.now.x, scene.now.y]).T
    reach = np.concatenate([centres, *[lines.reshape(-1, 2) for lines in futures]])
    return reach.min(axis=0) - 10, reach.max(axis=0) + 10


def draw_road(axes: Axes, road: Road) -> None:
    """Asphalt of the vehicle lanes, and the lines on it."""
    lanes = [
        np.concatenate([lane.left_bound, lane.right_bound[::-1]]) for lane in road.vehicle_lanes.values()
    ]
    axes.add_collection(PolyCollection(lanes, facecolors="#d9d9d9", edgecolors="none", zorder=1))
    bounds = [b for lane in road.vehicle_lanes.values() for b in (lane.left_bound, lane.right_bound)]
    axes.add_collection(LineCollection(bounds, colors="white", linewidths=0.6, zorder=2))


def vehicle_boxes(scene: SeedScene, states: States | None = None) -> FloatArray:
    """(V, 4, 2) corners of the vehicles in (V,) states, at the moment of the seed scene by default, m."""
    now = scene.now if states is None else states
    along = np.stack([np.cos(now.heading), np.sin(now.heading)], axis=-1) * scene.length[:, None] / 2
    across = np.stack([-np.sin(now.heading), np.cos(now.heading)], axis=-1) * scene.width[:, None] / 2
    centre = np.stack([now.x, now.y], axis=-1)
    return np.stack(
        [centre + along + across, centre + along - across, centre - along - across, centre - along + across],
        axis=1,
    )


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as SVG and PNG, and close it; returns the paths."""
    files = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    with plt.rc_context(STYLE):
        figure.savefig(files[0], metadata={"Date": None})
        figure.savefig(files[1], dpi=150)
    plt.close(figure)
    return files
