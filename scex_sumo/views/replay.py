"""Child scenarios as files that plain sumo-gui opens: ``sumo-gui -c child_0007.sumocfg``, without Python.

sumo-gui replays the logged trajectories (FCD) on the converted net with its markings; vehicles have the
colour of their behaviour model, thin lines show where each of them goes from the seed scene on.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.arrays import BoolArray
from scex_sumo.files import quoted
from scex_sumo.scene import STEP_S, SeedScene
from scex_sumo.views.crop import crop_extras, crop_net
from scex_sumo.views.fcd import FcdTracks, LaneFinder, write_fcd
from scex_sumo.world.gui.colors import Rgb
from scex_sumo.world.gui.drawings import (
    OTHER_RGB,
    ChildView,
    Frame,
    Shown,
    draw_children,
    draw_ids,
    draw_legend,
    frame_of,
    legend_entries,
)
from scex_sumo.world.gui.names import letter_height, readable
from scex_sumo.world.gui.settings import write_view_settings
from scex_sumo.world.tiles import TileLayout, TileTemplate, template_of
from scex_sumo.world.vehicle_types import given_type

if TYPE_CHECKING:
    from scex_sumo.converters.net.sumo_net import SumoNet
_GRID_MARGIN_M, _GRID_AROUND_M = 15.0, 25.0
_WINDOW = "1400,900"


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadNet:
    """What views need of a net.

    Attributes:
        lanes: to be found.
        template: its extent.
    """

    lanes: LaneFinder
    template: TileTemplate

    @classmethod
    def of(cls, path: Path) -> ReadNet:
        """Read a net."""
        return cls(lanes=LaneFinder(path), template=template_of(path))


def write_view(
    folder: Path,
    net: SumoNet,
    scene: SeedScene,
    children: Sequence[ChildView],
    colors: Mapping[str, Rgb],
    *,
    snapshots: tuple[tuple[float, str], ...] = (),
    again: ReadNet | None = None,
) -> Path:
    """Write what sumo-gui needs to show one child, or several side by side in reading order.

    Args:
        folder: where to write; the net is referred to by a relative path.
        children: with the same number of steps.
        colors: RGB of each behaviour model, 0 to 255.
        snapshots: times in s and names of pictures that sumo-gui writes then.
        again: the net of views of one child each, read and used for several.

    Returns:
        The file to open: ``child_NUMBER.sumocfg``, or ``grid_N.sumocfg`` of N children.
    """
    grid = len(children) > 1
    name = f"grid_{len(children)}" if grid else f"child_{children[0].number:04d}"
    folder.mkdir(parents=True, exist_ok=True)
    source = _cropped(folder / name, net, children) if grid else (net.path, net.extras)
    read = again or ReadNet.of(source[0])
    template = read.template
    layout = template.window_layout(len(children), margin_m=_GRID_MARGIN_M)
    net_file, additional = net.path, [net.extras] if net.extras is not None else []
    if grid:
        net_file, additional = _write_tiles(folder / name, source[1], template, layout, len(children))
    shown = [
        Shown(child=child, slot=slot if grid else None, offset=layout.offset(slot))
        for slot, child in enumerate(children)
    ]
    groups = [group for s in shown for group in _groups(scene, s)]
    write_fcd(folder / f"{name}.fcd.xml", groups, read.lanes)
    entries = legend_entries(scene, [model for child in children for model in child.models], colors)
    frame = frame_of(template.bounds, [s.offset for s in shown], entries)
    if not grid:
        frame = frame.closer(children[0].looked_at)
    drawn = draw_children(shown, colors, frame) + draw_legend(frame)
    letter_m = 0.0
    if not grid:
        letter_m = frame.exaggeration * letter_height([key for group in groups for key in group.ids])
        drawn += _choose_ids(folder / f"{name}.ids.txt", groups, children[0], letter_m, frame)
    additional.append(folder / f"{name}.add.xml")
    types = _types(scene, children, colors)
    additional[-1].write_text(f"<additional>\n{types}{drawn}</additional>\n", encoding="utf-8")
    write_view_settings(
        folder / f"{name}.view.xml",
        frame,
        letter_m=letter_m,
        chosen=True,
        snapshots=snapshots,
        # At the end sumo-gui would ask whether to close; who comes for the pictures only wants it to end.
        pause_s=None if snapshots else _stop_s(children[0]),
    )
    return _write_configuration(folder, name, net_file, additional, children[0].states.shape[1], ids=not grid)


def _cropped(stem: Path, net: SumoNet, children: Sequence[ChildView]) -> tuple[Path, Path | None]:
    """Net and markings around where the vehicles of some children are and go."""
    states = [child.states for child in children]
    xs, ys = (np.concatenate([getattr(s, axis) for s in states], axis=None) for axis in ("x", "y"))
    around = _GRID_AROUND_M
    box = xs.min() - around, ys.min() - around, xs.max() + around, ys.max() + around
    file = crop_net(net.path, box, stem.with_name(f"{stem.name}.cropped.net.xml"))
    if net.extras is None:
        return file, None
    return file, crop_extras(net.extras, box, stem.with_name(f"{stem.name}.cropped.add.xml"))


def _stop_s(child: ChildView) -> float:
    """When sumo-gui stops, s: after the last state, or at that of the event."""
    return (child.stop_state + 1) * STEP_S


def _choose_ids(
    path: Path, groups: Sequence[FcdTracks], child: ChildView, letter_m: float, frame: Frame
) -> str:
    """Select the vehicles whose ids sumo-gui writes on them: those that can be read where it stops.

    Returns:
        What is drawn in place of the ids of an event that cannot: both, beside their ring.
    """
    at, here = child.stop_state, [(group, n) for group in groups for n in range(len(group.ids))]
    here.sort(key=lambda entry: entry[0] is not groups[0] or entry[1] not in child.event)
    here = [(group, n) for group, n in here if group.present[n, at]]
    names = [group.ids[n] for group, n in here]
    x, y = (np.array([getattr(group.states, axis)[n, at] for group, n in here]) for axis in ("x", "y"))
    event, beside = list(range(len(child.event))), ""
    kept = readable(names, x, y, letter_m)
    if not set(event) <= set(kept):
        rest = [n for n in range(len(here)) if n not in event]
        kept = [rest[k] for k in readable([names[n] for n in rest], x[rest], y[rest], letter_m)]
        beside = draw_ids([names[n] for n in event], x[event], y[event], frame.line_m)
    path.write_text("".join(f"vehicle:{names[n]}\n" for n in kept), encoding="utf-8")
    return beside


def _write_tiles(
    stem: Path, drawn: Path | None, template: TileTemplate, layout: TileLayout, count: int
) -> tuple[Path, list[Path]]:
    """Copies of the net side by side, and of what is drawn on it; returns their files."""
    net_file, extras = stem.with_name(f"{stem.name}.net.xml"), stem.with_name(f"{stem.name}.extras.xml")
    template.write(net_file, range(count), layout)
    if drawn is None:
        return net_file, []
    TileTemplate(drawn).write(extras, range(count), layout)
    return net_file, [extras]


def _groups(scene: SeedScene, shown: Shown) -> list[FcdTracks]:
    steps = shown.child.states.shape[1]
    vehicles = FcdTracks(
        ids=[shown.id(str(track)) for track in scene.track_ids],
        types=[_type_id(model, v) for v, model in enumerate(shown.child.models)],
        length=scene.length,
        states=shown.child.states,
        present=np.ones(shown.child.states.shape, dtype=bool),
        tile=shown.slot,
        offset=shown.offset,
    )
    others = scene.obstacles
    if others is None:
        return [vehicles]
    # Frame 1 of a child is the second of the eleven states that a seed scene holds of the past.
    columns = np.minimum(np.arange(1, steps + 1), others.states.shape[1] - 1)
    obstacles = FcdTracks(
        ids=[shown.id(f"P{name}") for name in others.ids],
        types=[f"other.{o}" for o in range(len(others.ids))],
        length=others.length,
        states=others.states[:, columns],
        present=_without_gaps(others.present[:, columns]),
        tile=shown.slot,
        offset=shown.offset,
    )
    return [vehicles, obstacles]


def _without_gaps(present: BoolArray) -> BoolArray:
    """SUMO replays a track step by step and would close a gap in it by a jump in time."""
    return (
        np.logical_or.accumulate(present, axis=1)
        & np.logical_or.accumulate(present[:, ::-1], axis=1)[:, ::-1]
    )


def _type_id(model: str, vehicle: int) -> str:
    return f"{re.sub('[^A-Za-z0-9_.=-]', '_', model)}.{vehicle}"


def _types(scene: SeedScene, children: Sequence[ChildView], colors: Mapping[str, Rgb]) -> str:
    """A type for each vehicle and model: it has the vehicle's size and the model's colour."""
    lines = []
    for v in range(scene.vehicles):
        size = scene.types[v], float(scene.length[v]), float(scene.width[v])
        for model in sorted({child.models[v] for child in children}):
            lines.append(given_type(_type_id(model, v), *size, colors[model]))
    if (others := scene.obstacles) is not None:
        for o, kind in enumerate(others.types):
            size = kind, float(others.length[o]), float(others.width[o])
            lines.append(given_type(f"other.{o}", *size, OTHER_RGB))
    return "".join(lines)


def _write_configuration(
    folder: Path, name: str, net: Path, additional: Sequence[Path], steps: int, *, ids: bool
) -> Path:
    """The file that sumo-gui opens; other files are named relative to it."""

    def relative(path: Path) -> str:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()

    options = {
        "net-file": relative(net),
        "additional-files": ",".join(relative(path) for path in additional),
        "device.fcd-replay.files": f"{name}.fcd.xml",
        "gui-settings-file": f"{name}.view.xml",
        "step-length": str(STEP_S),
        "end": f"{(steps + 2) * STEP_S:.1f}",
        # The trajectories go where they go: on and off the lanes, and through one another.
        "ignore-route-errors": "true",
        "insertion-checks": "none",
        "collision.action": "none",
        "time-to-teleport": "-1",
        "no-warnings": "true",
        "no-step-log": "true",
        "xml-validation": "never",
        "start": "true",
        "window-size": _WINDOW,
    } | ({"selection-file": f"{name}.ids.txt"} if ids else {})
    lines = "".join(f"    <{key} value={quoted(value)}/>\n" for key, value in options.items())
    path = folder / f"{name}.sumocfg"
    path.write_text(f"<configuration>\n{lines}</configuration>\n", encoding="utf-8")
    return path
