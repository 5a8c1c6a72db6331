"""Pictures of the docs, drawn anew from the code: ``make docs-pictures``, or with names for some of them.

Run: ``python docs/make_pictures.py [NAME...]``, about a minute for all; what needs an extra that is absent is
skipped. ``docs/images/digests.json`` holds what each shows, so that a test tells which are old.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image

import scex_sumo as scex
from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.colors import model_colors
from scex_sumo.base.errors import MissingExtraError
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.exporters.request import Request
from scex_sumo.exporters.video import Film
from scex_sumo.geometry.rectangles import outlines
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.page.figures.drawing import STYLE
from scex_sumo.road import Road
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, States

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
# Of the example roundabout: a moment, two vehicles, and the place where their ways meet, m.
CROSSING_S, CROSSING, PLACE = 9.1, (10, 11), (1022.5, 997.7)
FAN_MIDDLE, FAN_HALF_M = (1012.0, 995.0), 30.0  # part of the map in the film of all futures, m
ATTENTION_S = 6.0  # a moment in which it matters on the roundabout
NEAR_M, WAITS_M = 3.0, 5.0  # a vehicle that comes so near passes, or waits
BLUE, RED, GREY, INK = "#1f5fa8", "#b5342b", "#777777", "#181e26"


def fan_out() -> None:
    """One moment on the example roundabout, and all of its futures at once: every vehicle of every future."""
    scene = scex.read_seed(scex.example_path("roundabout"))
    with tempfile.TemporaryDirectory() as folder:
        run = scex.extrapolate(scene, reference=None, out=Path(folder, "out"))
        states = States.stack([run.states(future) for future in range(run.futures)], axis=0)
        hits = run.collisions.filter(pc.invert(run.collisions["consequence"]))
        models = [model for future in range(run.futures) for model in run.models_of(future)]
        axes = film_ground(run.road)
    names = sorted(set(models))
    colors = dict(zip(names, np.array(model_colors(names)) / 255, strict=True))
    axes.legend(handles=[Patch(color=colors[n], label=n) for n in names], loc="lower right", framealpha=1.0)
    words = axes.text(0.02, 0.97, "", transform=axes.transAxes, va="top", fontsize=15)
    pictures = []
    for frame in range(states.shape[-1]):
        later = frame - LOGGED_HISTORY + 1
        now, style = states[:1, :, frame], {"facecolors": INK}
        words.set_text(f"one moment: {scene.vehicles} vehicles")
        if later > 0:
            now, style = (
                states[..., frame],
                {"facecolors": [colors[model] for model in models], "alpha": 0.04},
            )
            words.set_text(f"{run.futures} futures, {later * STEP_S:.1f} s later; × a collision")
            add_trails(axes, states[..., frame - 1 : frame + 1], style)
            new = hits.filter(pc.equal(hits["step"], later))
            axes.plot(new["x"], new["y"], "x", color="#c00000", markersize=11, markeredgewidth=2.5, zorder=5)
        bodies = outlines(now, scene.length, scene.width).reshape(-1, 4, 2)
        drawn = PolyCollection(list(bodies), linewidths=0, **style)
        axes.add_collection(drawn, autolim=False)
        pictures.append((picture_of(axes), 1500 if later == 0 else 100))
        drawn.remove()
    pictures[-1] = pictures[-1][0], 2500
    save_film(IMAGES / "fan_out.gif", pictures)


def film_ground(road: Road) -> Axes:
    """Axes over a whole picture, with the lanes of a part of a map."""
    figure = Figure(figsize=(9, 5), dpi=80)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    for lane in road.vehicle_lanes.values():
        axes.fill(*np.vstack([lane.left_bound, lane.right_bound[::-1]]).T, color="#dde1e6", linewidth=0)
    (x, y), half = FAN_MIDDLE, FAN_HALF_M
    axes.set(xlim=(x - 1.8 * half, x + 1.8 * half), ylim=(y - half, y + half))
    return axes


def add_trails(axes: Axes, states: States, style: dict[str, Any]) -> None:
    """Draw the last step of every vehicle of every future."""
    lines = np.stack([states.x, states.y], axis=-1).reshape(-1, 2, 2)
    trails = LineCollection(list(lines), colors=style["facecolors"], linewidths=0.8, alpha=style["alpha"])
    axes.add_collection(trails, autolim=False)


def picture_of(axes: Axes) -> Image.Image:
    """What the axes show now."""
    canvas: Any = axes.figure.canvas
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def save_film(path: Path, pictures: Sequence[tuple[Image.Image, int]]) -> None:
    """Write pictures, each with the time for which it is shown in ms, as a GIF of one palette."""
    palette = pictures[-1][0].quantize(64)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture, _ in pictures]
    times = [shown_ms for _, shown_ms in pictures]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)


def scene_graph() -> None:
    """The example roundabout with its semantic scene graph."""
    title = "One moment on the example roundabout, and its scene graph"
    scene = scex.read_seed(scex.example_path("roundabout"))
    scex.plot_scene_graph(scene, IMAGES / "scene_graph.png", title=title)


def attention() -> None:
    """What is planned for several attention weights; needs the extra ``learned``."""
    import attention_picture

    scene = scex.read_seed(scex.example_path("roundabout"), time=ATTENTION_S)
    attention_picture.draw_attention(scene, IMAGES / "attention.png", around_m=32.0)


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


def generated() -> None:
    """Twenty generated scenes of an example map beside twenty of SUMO's demand; needs the extra ``train``."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(4, 11, figsize=(16, 4.4), width_ratios=[1] * 5 + [0.1] + [1] * 5)
    figure.subplots_adjust(left=0.0, right=0.93, bottom=0.0, top=0.94, wspace=0.02, hspace=0.02)
    path, shown = scex.example_path("urban_intersection"), (930.0, 1070.0)
    lanes = [lane.centreline for lane in read_road(path).vehicle_lanes.values()]
    for first, title, like in ((0, "generate", "recorded"), (6, "SUMO's demand", "sumo")):
        axes[0, first + 2].set_title(title)
        for k in range(20):
            scene = scex.synthetic_seed(path, vehicles=12, like=like, seed=k)
            axis, now = axes[k // 5, first + k % 5], scene.now
            axis.add_collection(LineCollection(lanes, colors="0.85", linewidths=0.6))
            corners = outlines(now, scene.length, scene.width)
            boxes = PolyCollection(corners, array=now.speed, cmap="viridis")
            boxes.set_clim(0.0, 20.0)
            boxes.set(edgecolor="face", linewidth=2.0)  # larger than life, to be seen
            axis.add_collection(boxes)
            axis.set(xlim=shown, ylim=shown, aspect="equal")
    for axis in axes.flat:
        axis.set_axis_off()
    figure.colorbar(boxes, cax=figure.add_axes((0.95, 0.15, 0.01, 0.7)), label="speed [m/s]")
    figure.savefig(IMAGES / "generated.png", dpi=75)


def metrics() -> None:
    """Each metric on a small scene, with the value that the package computes."""
    sys.path.insert(0, str(ROOT / "docs"))
    import metrics_picture

    metrics_picture.draw_metrics(IMAGES / "metrics.svg")


def going_first() -> None:
    """Two futures of one moment, drawn by `joint_predictor`: in each another vehicle goes first."""
    scene = scex.read_seed(scex.example_path("roundabout"), time=CROSSING_S)
    with tempfile.TemporaryDirectory() as folder, mpl.rc_context(STYLE):
        run = scex.extrapolate(
            scene, models="joint_predictor", futures=24, steps=70, reference=None, out=Path(folder, "out")
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
    save_film(IMAGES / "going_first.gif", [(shot, 200) for shot in shots])


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture of the docs.

    Attributes:
        draw: draws it; None if the program named by `made_by` does.
        shows: files, or bytes, of what it shows: if they change, the picture is old.
    """

    draw: Callable[[], None] | None = None
    made_by: str = ""
    files: tuple[str, ...]
    shows: Callable[[], Iterable[Path | bytes]]

    def digest(self) -> str:
        """SHA-256 of what it shows and of the code that draws it."""
        digest = hashlib.sha256()
        for part in ([] if self.draw is None else [inspect.getsource(self.draw).encode()], self.shows()):
            for item in part:
                digest.update(item if isinstance(item, bytes) else item.read_bytes())
        return digest.hexdigest()


def answer() -> bytes:
    """Moment and share of collisions of the README's answer, which a test compares with the program's."""
    words = (ROOT / "README.md").read_text(encoding="utf-8").split("```text\n")[1].split("```")[0]
    collisions = re.search(r"^any .*?(\d+) ± ", words, re.MULTILINE)
    assert collisions is not None
    return f"{words.splitlines()[0]} {collisions[1]}".encode()


def net() -> bytes:
    """The SUMO net of an example map."""
    with tempfile.TemporaryDirectory() as folder:
        road = read_road(scex.example_path("urban_intersection"))
        return convert(road, Path(folder) / "net.net.xml").path.read_bytes()


def of_package(*patterns: str) -> Callable[[], list[Path]]:
    """Files of the package."""
    return lambda: [path for pattern in patterns for path in sorted((ROOT / "scex_sumo").glob(pattern))]


PICTURES: dict[str, Picture] = {
    "fan_out": Picture(draw=fan_out, files=("fan_out.gif",), shows=lambda: [answer()]),
    "scene_graph": Picture(draw=scene_graph, files=("scene_graph.png",), shows=of_package("graphs/*.py")),
    "attention": Picture(
        draw=attention,
        files=("attention.png",),
        shows=lambda: [
            ROOT / "docs" / "attention_picture.py",
            *of_package("learned/trained/graph_image_predictor*")(),
        ],
    ),
    "going_first": Picture(
        draw=going_first,
        files=("going_first.gif",),
        shows=of_package("learned/trained/joint_predictor*", "exporters/video.py", "base/colors.py"),
    ),
    "converter": Picture(draw=converter, files=("converter.svg",), shows=lambda: [net()]),
    "generated": Picture(draw=generated, files=("generated.png",), shows=of_package("generators/data/*")),
    "metrics": Picture(
        draw=metrics,
        files=("metrics.svg",),
        shows=lambda: [ROOT / "docs" / "metrics_picture.py", *of_package("metrics/formulas/*.py")()],
    ),
    "sample_size": Picture(
        made_by="python benchmarks/paper.py, which needs recordings",
        files=("sample_size.png",),
        shows=lambda: [ROOT / "benchmarks" / "paper.py"],
    ),
    "live": Picture(
        made_by="xvfb-run -a python -m benchmarks.live film docs/images/live.mp4",
        files=("live.png", "live.mp4"),
        shows=of_package("live/painter.py"),
    ),
}
DIGESTS = IMAGES / "digests.json"
"""What each picture showed when it was made; `tests/test_docs_pictures.py` compares."""


def note(name: str) -> None:
    """Note that a picture is made of what is there now."""
    known = json.loads(DIGESTS.read_text()) if DIGESTS.is_file() else {}
    known[name] = PICTURES[name].digest()
    DIGESTS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")


def main(names: Sequence[str]) -> None:
    """Draw the pictures named, or all."""
    unknown = set(names) - PICTURES.keys()
    if unknown:
        sys.exit(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(PICTURES)}")
    for name in names or PICTURES:
        picture = PICTURES[name]
        if picture.draw is None and name not in names:
            print(f"left: {name}: {picture.made_by}; then name it here")
            continue
        former = {
            IMAGES / file: (IMAGES / file).read_bytes() for file in picture.files if (IMAGES / file).is_file()
        }
        try:
            if picture.draw is not None:
                for path in former:  # a picture that another program wrote is not replaced
                    path.unlink()
                picture.draw()
        except Exception as error:
            for path, content in former.items():
                path.write_bytes(content)
            if not isinstance(error, MissingExtraError):
                raise
            print(f"skipped: {name}: {error}")
            continue
        note(name)
        print(f"made: {name}")


if __name__ == "__main__":
    main(sys.argv[1:])
