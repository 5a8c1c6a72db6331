"""Pictures of the docs, drawn anew from the code: ``make docs-pictures``, or with names for some of them.

Run: ``python docs/make_pictures.py [NAME...]``, about half a minute for all; what needs an extra that is not
there is skipped. Pictures of studies are photographs of the pages that the commands named there write.
"""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Callable, Sequence
from math import cos, hypot, pi, sin
from pathlib import Path
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from PIL import Image

import scex_sumo as scex
from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MissingExtraError
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.evaluation.pair_values import evaluate_pairs
from scex_sumo.exporters.request import Request
from scex_sumo.exporters.video import Film
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.page.figures.drawing import STYLE
from scex_sumo.road import Road
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, States

IMAGES = Path(__file__).resolve().parent / "images"
# Of the example roundabout: a moment, two vehicles, and the place where their ways meet, m.
CROSSING_S, CROSSING, PLACE = 9.1, (10, 11), (1022.5, 997.7)
ATTENTION_S = 6.0  # a moment in which it matters on the roundabout
NEAR_M, WAITS_M = 3.0, 5.0  # a vehicle that comes so near passes, or waits
BLUE, RED, GREY = "#1f5fa8", "#b5342b", "#777777"


def report() -> None:
    """Animate the report of the example in a browser: its two worst encounters; needs playwright."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise MissingExtraError("the animation of the report needs playwright and chromium") from None
    shots = []
    seek = "(slider, step) => { slider.value = step; slider.dispatchEvent(new Event('input')) }"
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as browsers:
        run = scex.extrapolate(scex.read_seed(scex.example_path("roundabout")), out=Path(folder, "out"))
        page_path = run.written["report"]
        browser = browsers.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox", "--disable-gpu", "--disable-quic"]
        )
        page = browser.new_page(viewport={"width": 1180, "height": 760})
        page.goto(page_path.as_uri())
        for row in (0, 1):
            page.locator("#encounters tr.go").nth(row).click()
            page.evaluate("window.scrollTo(0, 0)")
            for step in range(0, run.info["steps"] + 1, 2):
                page.locator("#time").evaluate(seek, step)
                page.wait_for_timeout(60)
                shot = Image.open(io.BytesIO(page.screenshot()))
                shots.append(shot.resize((826, 532), Image.Resampling.LANCZOS))
        browser.close()
    both = Image.new("RGB", (826, 2 * 532))  # one palette, of the first and the last frame
    both.paste(shots[0], (0, 0))
    both.paste(shots[-1], (0, 532))
    palette = both.quantize(96)
    frames = [shot.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE) for shot in shots]
    frames[0].save(
        IMAGES / "report.gif", save_all=True, append_images=frames[1:], duration=160, loop=0, optimize=True
    )


def scene_graph() -> None:
    """The example roundabout with its semantic scene graph."""
    title = "One moment on the example roundabout, and its scene graph"
    scene = scex.read_seed(scex.example_path("roundabout"))
    scex.plot_scene_graph(scene, IMAGES / "scene_graph.png", title=title)


def attention() -> None:
    """What is planned for several attention weights; needs the extra ``learned``."""
    scene = scex.read_seed(scex.example_path("roundabout"), time=ATTENTION_S)
    scex.plot_attention(scene, IMAGES / "attention.png", around_m=32.0)


def converter() -> None:
    """Lanelets of an example map, and what they become in the SUMO net."""
    road = read_road(scex.example_path("urban_intersection"))
    figure = Figure(figsize=(15, 5.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    draw_lanelets(left, road)
    with tempfile.TemporaryDirectory() as folder:
        root = ElementTree.parse(convert(road, Path(folder) / "net.net.xml").path).getroot()
    whole, arm = ((972.0, 1032.0), (972.0, 1032.0)), ((1000.0, 1026.0), (996.0, 1012.0))
    frame(left, *whole, "Lanelets and their centrelines")
    for axes, window, title in (
        (middle, whole, "SUMO: edges (blue), ways through junctions (red)"),
        (right, arm, "Eastern arm: only what overlaps lies in the junction"),
    ):
        draw_net(axes, root)
        frame(axes, *window, title)
    with mpl.rc_context({"svg.hashsalt": "converter"}):
        figure.savefig(IMAGES / "converter.svg", metadata={"Date": None})


def draw_lanelets(axes: Axes, road: Road) -> None:
    """Outlines and centrelines with direction."""
    for lane in road.vehicle_lanes.values():
        outline = np.vstack([lane.left_bound, lane.right_bound[::-1]])
        axes.fill(*outline.T, facecolor="#eef3f8", edgecolor="#7a8ba0", linewidth=0.7, alpha=0.6)
    for lane in road.vehicle_lanes.values():
        axes.plot(*lane.centreline.T, color="#44546a", linewidth=0.7, linestyle=(0, (5, 3)))
        arrow(axes, lane.centreline, "#44546a")


def draw_net(axes: Axes, root: ElementTree.Element) -> None:
    """Junction areas, edges, connections."""
    shapes = {part: shape_of(part) for tag in ("junction", "lane") for part in root.iter(tag)}
    for part, shape in shapes.items():
        inside = part.get("id", "").startswith(":")
        if part.tag == "junction":
            axes.fill(*shape.T, color="#d9d9d9", linewidth=0)
            continue
        axes.plot(*shape.T, color=RED if inside else BLUE, linewidth=0.9 if inside else 2.0)
        if not inside:
            arrow(axes, shape, BLUE)
            axes.plot(*shape[[0, -1]].T, ".", color=BLUE, markersize=5)


def shape_of(part: ElementTree.Element) -> FloatArray:
    """A SUMO shape as (P, 2)."""
    return np.array([[float(v) for v in pair.split(",")] for pair in part.get("shape", "").split()])


def arrow(axes: Axes, shape: FloatArray, color: str) -> None:
    """An arrowhead at the end of a line."""
    axes.annotate("", shape[-1], shape[-2], arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 0})


def frame(axes: Axes, x: tuple[float, float], y: tuple[float, float], title: str) -> None:
    """Equal axes over a part of the map."""
    axes.set(aspect="equal", xlim=x, ylim=y, xticks=[], yticks=[])
    axes.set_title(title, fontsize=10)


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


def value_of(metric: str, vehicles: Sequence[Vehicle], paths: Sequence[Path2], preset: str) -> float:
    """Of the first vehicle that has one."""
    now = np.zeros(1, dtype=np.int64)
    nodes = np.array(paths, dtype=float)[None, None]
    planned = PlannedPaths(x=nodes[..., 0], y=nodes[..., 1], index=now, column=now)
    return float(
        evaluate_pairs(scene_of(vehicles), planned, preset=preset, metrics=(metric,))[metric].value[0]
    )


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


def generated() -> None:
    """Twenty generated scenes of an example map beside twenty of SUMO's demand; needs the extra ``train``."""
    sys.path.insert(0, str(IMAGES.parents[1] / "benchmarks"))
    from generated_scenes import draw

    path = scex.example_path("urban_intersection")
    sides = {
        title: [scex.synthetic_seed(path, vehicles=12, like=like, seed=k) for k in range(20)]
        for title, like in (("generate", "recorded"), ("SUMO's demand", "sumo"))
    }
    draw(IMAGES / "generated.png", sides, {path.stem: shapely.box(930.0, 930.0, 1070.0, 1070.0)})


def metrics() -> None:
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
        value = value_of(metric, vehicles, paths, "paper")
        axes.set_title(f"{title} = {value:.2f}{unit}", fontsize=9, loc="left")
        left = min(x for x, *_ in vehicles) - 5
        axes.set_xlim(left, left + 52)
        axes.set_ylim(low, low + (14 if axes in panels[0] else 26))
        return value

    ttc, pttc, gap, wttc, distance, tq = panels.flat
    panel(ttc, "ttc", column, ahead, "TTC: d / (v_f − v_l)", " s", -8)
    span(ttc, (0, 2.5), (30, 2.5), "d: centres (preset paper)")
    span(ttc, (LENGTH / 2, -6.5), (30 - LENGTH / 2, -6.5), "d: bumpers (preset path)")
    panel(pttc, "pttc", braking, ahead, "PTTC: the leader keeps braking", " s", -8)
    panel(gap, "gap_time", crossing, across, "gap time: |s₁/v₁ − s₂/v₂|", " s", -16)
    span(gap, (-18, 2), (0, 2), "s₁")
    gap.annotate("", (2, 0), (2, -12), arrowprops={"arrowstyle": "|-|", "mutation_scale": 3, "color": GREY})
    gap.annotate("s₂", (2.5, -6), fontsize=8, color=GREY)
    half = WIDTH / 2
    gap.add_patch(Polygon([(-half, -half), (half, -half), (half, half), (-half, half)], color="#e0b040"))
    gap.annotate("conflict area (preset path)", (2, 4.5), fontsize=7, color=GREY)
    reach(wttc, oncoming, panel(wttc, "wttc", oncoming, apart, "WTTC: the discs touch", " s", -11))
    panel(distance, "distance", oncoming, apart, "distance of the centres", " m", -11)
    distance.plot([0, 32], [0, 3.5], color=GREY, linewidth=1)
    panel(tq, "tq", flow, onward, "traffic quality of the blue vehicle", "", -11)
    tq.add_patch(Circle((0, 0), (0.36 * 10) ** 2 + LENGTH + 10, fill=False, color=BLUE, linestyle=":"))
    tq.annotate("r: counts neighbours", (28, 8), fontsize=7, color=BLUE)
    tq.annotate("smallest distance: 2.2 m, blue to upper red", (-4, 9), fontsize=7, color=GREY)
    with mpl.rc_context({"svg.hashsalt": "metrics"}):
        figure.savefig(IMAGES / "metrics.svg", metadata={"Date": None})


def going_first() -> None:
    """Two futures of one moment, drawn by `joint_predictor`: in each another vehicle goes first."""
    scene = scex.read_seed(scex.example_path("roundabout"), time=CROSSING_S)
    with tempfile.TemporaryDirectory() as folder, mpl.rc_context(STYLE):
        run = scex.extrapolate(
            scene,
            models="joint_predictor",
            futures=24,
            steps=70,
            reference=None,
            out=Path(folder, "out"),
        )
        pair = [scene.track_ids.tolist().index(track) for track in CROSSING]
        ways = np.array([[(v.x, v.y) for v in (run.states(c)[k] for k in pair)] for c in range(run.futures)])
        least = np.hypot(*(np.moveaxis(ways, 2, 0) - np.reshape(PLACE, (2, 1, 1, 1)))).min(axis=-1)
        hit = set(run.collisions["future"].to_pylist())
        meet = [c for c in range(run.futures) if c not in hit and least[c].max() < WAITS_M]
        first = [next(c for c in meet if least[c, k] < NEAR_M < least[c, 1 - k]) for k in (0, 1)]
        request = Request(run=run, futures=tuple(first), encounter=CROSSING)
        films = [Film(request, future, (400, 400)) for future in first]
        shots = [
            Image.fromarray(np.hstack([film.picture(float(k)) for film in films]))
            for k in range(LOGGED_HISTORY - 1, LOGGED_HISTORY + 70, 2)
        ]
    palette = shots[-1].quantize(64)
    frames = [shot.quantize(palette=palette, dither=Image.Dither.NONE) for shot in shots]
    frames[0].save(
        IMAGES / "going_first.gif",
        save_all=True,
        append_images=frames[1:],
        duration=200,
        loop=0,
        optimize=True,
    )


def handover() -> None:
    """One future in sumo-gui beside what was exported of it; needs a screen or Xvfb."""
    import handover_picture

    handover_picture.main()


PICTURES: dict[str, Callable[[], None]] = {
    made.__name__: made
    for made in (report, scene_graph, attention, going_first, converter, generated, metrics, handover)
}


def main(names: Sequence[str]) -> None:
    """Draw the pictures named, or all."""
    unknown = set(names) - PICTURES.keys()
    if unknown:
        sys.exit(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(PICTURES)}")
    IMAGES.mkdir(exist_ok=True)
    for name in names or PICTURES:
        try:
            PICTURES[name]()
            print(f"drawn: {name}")
        except MissingExtraError as error:
            print(f"skipped: {name}: {error}")


if __name__ == "__main__":
    main(sys.argv[1:])
