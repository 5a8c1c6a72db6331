"""Replay of futures in sumo-gui without Python: ``sumo-gui -c future_0007.sumocfg``.

Colours show the behaviour models, thin lines the paths from the seed scene on.
For futures side by side the net is cropped. Only shapes change: lanes outside of the box shrink to dots on
its border, so that ids and connections stay.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr as quoted

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.colors import OTHER_RGB, Rgb
from scex_sumo.converters.net.sumo_net import points_of
from scex_sumo.converters.tracks.road_users import PEOPLE, obstacle_kinds, road_user
from scex_sumo.converters.xml import net_root
from scex_sumo.scene import STEP_S, SeedScene
from scex_sumo.views.fcd import FcdTracks, LaneFinder, write_fcd
from scex_sumo.world.drawings import (
    WINDOW_SIZE,
    Frame,
    FutureView,
    TiledFuture,
    draw_futures,
    draw_ids,
    draw_legend,
    draw_seams,
    frame_of,
    legend_entries,
    letter_height,
    readable,
    write_view_settings,
)
from scex_sumo.world.tiles import template_of
from scex_sumo.world.vehicle_types import given_type

if TYPE_CHECKING:
    from scex_sumo.converters.net.sumo_net import SumoNet

Box = tuple[float, float, float, float]
_SHORTEST_M = 0.5
_DOT_M = 0.1
_GRID_MARGIN_M, _GRID_AROUND_M = 12.0, 15.0
_GRID_ASPECT = 1.6  # width by height of all tiles, above their legend


def write_view(
    folder: Path, net: SumoNet, scene: SeedScene, futures: Sequence[FutureView], colors: Mapping[str, Rgb]
) -> Path:
    """Write files that show one future in sumo-gui, or several side by side, and return the file to open."""
    grid = len(futures) > 1
    name = f"grid_{len(futures)}" if grid else f"future_{futures[0].number:04d}"
    folder.mkdir(parents=True, exist_ok=True)
    shown = _cropped(folder / name, net, futures) if grid else net.path
    template = template_of(shown)
    layout = template.window_layout(len(futures), margin_m=_GRID_MARGIN_M)
    net_file, additional = net.path, [net.extras] if net.extras is not None else []
    if grid:  # whose views are too small for markings
        net_file, additional = folder / f"{name}.net.xml", []
        template.write(net_file, range(len(futures)), layout)
    tiled = [
        TiledFuture(future=future, slot=slot if grid else None, offset=layout.offset(slot))
        for slot, future in enumerate(futures)
    ]
    groups = [group for s in tiled for group in _groups(scene, s)]
    write_fcd(folder / f"{name}.fcd.xml", groups, LaneFinder(shown))
    entries = legend_entries(scene, [model for future in futures for model in future.models], colors)
    frame = frame_of(template.bounds, [s.offset for s in tiled], entries)
    if not grid:
        frame = frame.closer(futures[0].looked_at)
    drawn = draw_seams(_junctions(shown), tiled) + draw_futures(tiled, colors, frame)
    drawn += draw_legend(frame)
    letter_m = 0.0
    if not grid:
        letter_m = frame.exaggeration * letter_height([key for group in groups for key in group.ids])
        drawn += _choose_ids(folder / f"{name}.ids.txt", groups, futures[0], letter_m, frame)
    additional.append(folder / f"{name}.add.xml")
    types = _types(scene, futures, colors)
    lights = _delayed(net_file, (futures[0].past - 1) * STEP_S)
    additional[-1].write_text(f"<additional>\n{types}{lights}{drawn}</additional>\n", encoding="utf-8")
    write_view_settings(
        folder / f"{name}.view.xml",
        frame,
        letter_m=letter_m,
        chosen=True,
        lights=bool(lights),
        pause_s=(futures[0].stop_state + 1) * STEP_S,
    )
    return _write_configuration(folder, name, net_file, additional, futures[0].states.shape[1], ids=not grid)


def _junctions(net: Path) -> list[FloatArray]:
    shapes = [points_of(junction.get("shape", "")) for junction in net_root(net).iter("junction")]
    return [shape for shape in shapes if len(shape) > 2]


def _cropped(stem: Path, net: SumoNet, futures: Sequence[FutureView]) -> Path:
    states = [future.states for future in futures]
    xs, ys = (np.concatenate([getattr(s, axis) for s in states], axis=None) for axis in ("x", "y"))
    xs, ys = xs[np.isfinite(xs)], ys[np.isfinite(ys)]
    around = _GRID_AROUND_M
    box = xs.min() - around, ys.min() - around, xs.max() + around, ys.max() + around
    box = _filling(box, len(futures))
    return crop_net(net.path, box, stem.with_name(f"{stem.name}.cropped.net.xml"))


def _filling(box: Box, count: int) -> Box:
    """Return a box around a box, so that a grid of ``count`` of them fills the window."""
    left, low, right, high = box
    wide, tall = right - left + _GRID_MARGIN_M, high - low + _GRID_MARGIN_M
    columns = min(
        range(1, count + 1), key=lambda n: max(math.ceil(count / n) * tall, n * wide / _GRID_ASPECT)
    )
    aspect = _GRID_ASPECT * math.ceil(count / columns) / columns
    x, y = max(aspect * tall - wide, 0.0) / 2, max(wide / aspect - tall, 0.0) / 2
    return left - x, low - y, right + x, high + y


def _delayed(net: Path, by_s: float) -> str:
    """Return the lights of a net, later by the time before the seed scene that a replay shows."""
    delayed = ""
    # Of several programmes SUMO takes the last one.
    for light in {light.get("id"): light for light in net_root(net).iter("tlLogic")}.values():
        light.attrib |= {"programID": "replay", "offset": f"{float(light.get('offset', '0')) + by_s:.2f}"}
        delayed += ElementTree.tostring(light, encoding="unicode")
    return delayed


def _choose_ids(
    path: Path, groups: Sequence[FcdTracks], future: FutureView, letter_m: float, frame: Frame
) -> str:
    step, here = future.stop_state, [(group, n) for group in groups for n in range(len(group.ids))]
    here.sort(key=lambda entry: entry[0] is not groups[0] or entry[1] not in future.event)
    here = [(group, n) for group, n in here if group.present[n, step]]
    names = [group.ids[n] for group, n in here]
    kinds = ["person" if group.walks[n] else "vehicle" for group, n in here]
    x, y = (np.array([getattr(group.states, axis)[n, step] for group, n in here]) for axis in ("x", "y"))
    event, beside = list(range(len(future.event))), ""
    kept = readable(names, x, y, letter_m)
    if not set(event) <= set(kept):
        rest = [n for n in range(len(here)) if n not in event]
        kept = [rest[k] for k in readable([names[n] for n in rest], x[rest], y[rest], letter_m)]
        beside = draw_ids([names[n] for n in event], x[event], y[event], frame.line_m)
    path.write_text("".join(f"{kinds[n]}:{names[n]}\n" for n in kept), encoding="utf-8")
    return beside


def _groups(scene: SeedScene, tiled: TiledFuture) -> list[FcdTracks]:
    def group(
        names: Sequence[str], models: Sequence[str], kinds: Sequence[str], length: FloatArray, **tracks: Any
    ) -> FcdTracks:
        return FcdTracks(
            ids=[tiled.id(name) for name in names],
            types=[_type_id(model, kinds[n], n) for n, model in enumerate(models)],
            walks=np.array([road_user(kind) == "pedestrian" for kind in kinds], dtype=np.bool_),
            length=length,
            tile=tiled.slot,
            offset=tiled.offset,
            **tracks,
        )

    states, models, others = tiled.future.states, tiled.future.models, scene.obstacles
    present = np.isfinite(states.x)
    vehicles = group(scene.names, models, scene.types, scene.length, states=states, present=present)
    if others is None:
        return [vehicles]
    # Frame 1 of a future is the second of the eleven past states of a seed scene.
    columns = np.minimum(np.arange(1, states.shape[1] + 1), others.states.shape[1] - 1)
    there, names, other = others.present[:, columns], [f"P{name}" for name in others.ids], ["other"]
    present = np.logical_or.accumulate(there, axis=1)  # without gaps
    present &= np.logical_or.accumulate(there[:, ::-1], axis=1)[:, ::-1]
    tracks = {"states": others.states[:, columns], "present": present}
    kinds = obstacle_kinds(others)
    return [vehicles, group(names, other * len(names), kinds, others.length, **tracks)]


def _type_id(model: str, kind: str, number: int) -> str:
    """Return the id of a type; that of people says who they are, because FCD says nothing else."""
    user = road_user(kind)
    name = f"{model}.{user}" if user in PEOPLE else model
    return f"{re.sub('[^A-Za-z0-9_.=-]', '_', name)}.{number}"


def _types(scene: SeedScene, futures: Sequence[FutureView], colors: Mapping[str, Rgb]) -> str:
    def line(model: str, number: int, kind: str, length: float, width: float, rgb: Rgb) -> str:
        own_class = user if (user := road_user(kind)) in PEOPLE else "ignoring"
        size = kind, float(length), float(width)
        return given_type(_type_id(model, kind, number), *size, rgb, own_class=own_class)

    lines = [
        line(model, v, scene.types[v], scene.length[v], scene.width[v], colors[model])
        for v in range(scene.vehicles)
        for model in sorted({future.models[v] for future in futures})
    ]
    if (others := scene.obstacles) is not None:
        sizes = zip(obstacle_kinds(others), others.length, others.width, strict=True)
        lines += [line("other", o, *size, OTHER_RGB) for o, size in enumerate(sizes)]
    return "".join(lines)


def _write_configuration(
    folder: Path, name: str, net: Path, additional: Sequence[Path], steps: int, *, ids: bool
) -> Path:
    def relative(path: Path) -> str:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()

    options = {
        "net-file": relative(net),
        "additional-files": ",".join(relative(path) for path in additional),
        "device.fcd-replay.files": f"{name}.fcd.xml",
        "gui-settings-file": f"{name}.view.xml",
        "step-length": str(STEP_S),
        "end": f"{(steps + 2) * STEP_S:.1f}",
        # Logged trajectories may leave the lanes and overlap.
        "ignore-route-errors": "true",
        "insertion-checks": "none",
        "collision.action": "none",
        "time-to-teleport": "-1",
        "no-warnings": "true",
        "no-step-log": "true",
        "xml-validation": "never",
        "start": "true",
        "window-size": WINDOW_SIZE,
    } | ({"selection-file": f"{name}.ids.txt"} if ids else {})
    lines = "".join(f"    <{key} value={quoted(value)}/>\n" for key, value in options.items())
    path = folder / f"{name}.sumocfg"
    path.write_text(f"<configuration>\n{lines}</configuration>\n", encoding="utf-8")
    return path


def crop_net(net: Path, box: Box, out: Path) -> Path:
    """Write a net with shapes cropped to a box (smallest x, y, largest x, y, m), and return the file."""
    root = net_root(net)
    for lane in root.iter("lane"):
        lane.attrib.pop("outlineShape", None)
        if not _crop_shape(lane, box, closed=False):
            x, y = _into(box, *points_of(lane.get("shape", ""))[0].tolist())
            lane.set("shape", f"{x:.2f},{y:.2f} {x + _DOT_M:.2f},{y:.2f}")
    for edge in root.iter("edge"):
        edge.attrib.pop("shape", None)
    for junction in root.iter("junction"):
        x, y = _into(box, float(junction.get("x", "0")), float(junction.get("y", "0")))
        junction.attrib |= {"x": f"{x:.2f}", "y": f"{y:.2f}"}
        if not _crop_shape(junction, box, closed=True):
            junction.attrib.pop("shape", None)
    for connection in root.iter("connection"):
        connection.attrib.pop("shape", None)
    root.attrib = {key: value for key, value in root.attrib.items() if "}" not in key}
    ElementTree.ElementTree(root).write(out, encoding="utf-8", xml_declaration=True)
    return out


def _into(box: Box, x: float, y: float) -> tuple[float, float]:
    return min(max(x, box[0]), box[2] - _DOT_M), min(max(y, box[1]), box[3])


def _crop_shape(element: ElementTree.Element, box: Box, *, closed: bool) -> bool:
    points = points_of(element.get("shape", ""))
    if len(points) < (4 if closed else 2) or not np.isfinite(points).all():
        return False
    whole = shapely.make_valid(shapely.Polygon(points)) if closed else shapely.LineString(points)
    parts = shapely.get_parts(shapely.clip_by_rect(whole, *box))
    wanted = [piece for piece in parts if piece.geom_type == ("Polygon" if closed else "LineString")]
    if not wanted:
        return False
    best = max(wanted, key=lambda piece: float(piece.length))
    if best.length < _SHORTEST_M:
        return False
    line = best.exterior if closed else best
    element.set("shape", " ".join(f"{x:.2f},{y:.2f}" for x, y in shapely.get_coordinates(line)))
    return True
