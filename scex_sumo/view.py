"""Child scenarios as files that plain sumo-gui opens: ``sumo-gui -c child_0007.sumocfg``, without Python.

sumo-gui replays the logged trajectories (FCD) on the converted net with its markings; vehicles have the
colour of their behaviour model, thin lines show where each of them goes from the seed scene on.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from scex_sumo.fcd import FcdTracks, LaneFinder, write_fcd
from scex_sumo.scene import HISTORY_STEPS, STEP_S, BoolArray, SeedScene, States
from scex_sumo.tiles import TileTemplate, tile_id
from scex_sumo.vehicle_types import replayed_type
from scex_sumo.view_settings import write_view_settings

if TYPE_CHECKING:
    from scex_sumo.converters.sumo_net import SumoNet

Rgb = tuple[int, int, int]
_GRID_MARGIN_M = 15.0
_OTHER_RGB = (255, 0, 200)  # pedestrians and cyclists
_LINE = 1.4  # from line to line of text, in heights of a letter
_LETTER = 0.4  # width of a letter likewise
_LEGEND_COLUMNS = 3
_TRACK_LAYER = 30  # above the markings, below the vehicles


@dataclass(frozen=True, kw_only=True, eq=False)
class ChildView:
    """A child scenario to be shown.

    Attributes:
        number: the child's number.
        states: (V, T) its vehicles, from 0.1 s on: first the past, up to the seed scene, then what follows.
        models: (V,) the behaviour model of each vehicle.
        title: what to write beside it, e.g. its most critical value.
        past: how many of the states are the past; the last of these is the seed scene.
    """

    number: int
    states: States
    models: Sequence[str]
    title: str = ""
    past: int = HISTORY_STEPS


def write_child_view(
    folder: Path,
    net: SumoNet,
    seed: SeedScene,
    child: ChildView,
    colors: Mapping[str, Rgb],
    *,
    delay_ms: int = 100,
    snapshots: tuple[tuple[float, str], ...] = (),
) -> Path:
    """Write what sumo-gui needs to show one child.

    Args:
        folder: where to write; the net is referred to by a relative path.
        net: the converted map.
        seed: the seed scene.
        child: the child.
        colors: RGB of each behaviour model, 0 to 255.
        delay_ms: pause of sumo-gui after each step.
        snapshots: times in s and names of pictures that sumo-gui writes then.

    Returns:
        The file to open, ``child_NUMBER.sumocfg``.
    """
    return _write(folder, f"child_{child.number:04d}", net, seed, [child], colors, delay_ms, snapshots)


def write_grid_view(
    folder: Path,
    net: SumoNet,
    seed: SeedScene,
    children: Sequence[ChildView],
    colors: Mapping[str, Rgb],
    *,
    delay_ms: int = 100,
    snapshots: tuple[tuple[float, str], ...] = (),
) -> Path:
    """Write what sumo-gui needs to show several children side by side, in reading order.

    Args:
        folder: where to write.
        net: the converted map.
        seed: the seed scene.
        children: the children, with the same number of steps.
        colors: RGB of each behaviour model, 0 to 255.
        delay_ms: pause of sumo-gui after each step.
        snapshots: times in s and names of pictures that sumo-gui writes then.

    Returns:
        The file to open, ``grid_N.sumocfg``.
    """
    return _write(folder, f"grid_{len(children)}", net, seed, children, colors, delay_ms, snapshots)


def _write(
    folder: Path,
    name: str,
    net: SumoNet,
    seed: SeedScene,
    children: Sequence[ChildView],
    colors: Mapping[str, Rgb],
    delay_ms: int,
    snapshots: tuple[tuple[float, str], ...],
) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    template, grid = TileTemplate(net.path), len(children) > 1
    layout = template.layout(margin_m=_GRID_MARGIN_M, columns=math.ceil(math.sqrt(len(children))))
    layout = replace(layout, pitch_y=-layout.pitch_y)  # in reading order
    net_file, additional = net.path, [net.extras] if net.extras is not None else []
    if grid:
        net_file = folder / f"{name}.net.xml"
        template.write(net_file, range(len(children)), layout)
        if net.extras is not None:
            additional = [folder / f"{name}.extras.xml"]
            TileTemplate(net.extras).write(additional[0], range(len(children)), layout)
    shown = [
        _Shown(child=child, slot=slot if grid else None, offset=layout.offset(slot))
        for slot, child in enumerate(children)
    ]
    write_fcd(folder / f"{name}.fcd.xml", [g for s in shown for g in _groups(seed, s)], LaneFinder(net.path))
    frame = _frame(seed, shown, colors, template.bounds)
    drawn = _types(seed, children, colors) + _drawings(shown, colors, frame, template.bounds[3])
    additional.append(folder / f"{name}.add.xml")
    additional[-1].write_text(f"<additional>\n{drawn}</additional>\n", encoding="utf-8")
    write_view_settings(
        folder / f"{name}.view.xml",
        delay_ms=delay_ms,
        viewport=frame.viewport,
        names=not grid,
        text_m=frame.line_m,
        snapshots=snapshots,
    )
    return _write_configuration(folder, name, net_file, additional, children[0].states.shape[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shown:
    """A child and the tile that it is shown in, None in a net that is not tiled."""

    child: ChildView
    slot: int | None
    offset: tuple[int, int]

    def id(self, name: str) -> str:
        return name if self.slot is None else tile_id(self.slot, name)


def _groups(seed: SeedScene, shown: _Shown) -> list[FcdTracks]:
    steps = shown.child.states.shape[1]
    vehicles = FcdTracks(
        ids=[shown.id(str(track)) for track in seed.track_ids],
        types=[_type_id(model, v) for v, model in enumerate(shown.child.models)],
        length=seed.length,
        states=shown.child.states,
        present=np.ones(shown.child.states.shape, dtype=bool),
        tile=shown.slot,
        offset=shown.offset,
    )
    others = seed.obstacles
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


def _types(seed: SeedScene, children: Sequence[ChildView], colors: Mapping[str, Rgb]) -> str:
    """A type for each vehicle and model: it has the vehicle's size and the model's colour."""
    lines = []
    for v in range(seed.vehicles):
        size = seed.types[v], float(seed.length[v]), float(seed.width[v])
        for model in sorted({child.models[v] for child in children}):
            lines.append(replayed_type(_type_id(model, v), *size, colors[model]))
    if (others := seed.obstacles) is not None:
        for o, kind in enumerate(others.types):
            size = kind, float(others.length[o]), float(others.width[o])
            lines.append(replayed_type(f"other.{o}", *size, _OTHER_RGB))
    return "".join(lines)


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """What is in view: all tiles, titles above them and a legend below."""

    left: float
    bottom: float
    right: float
    top: float
    line_m: float
    entries: tuple[tuple[str, Rgb], ...]

    @property
    def viewport(self) -> tuple[float, float, float]:
        """sumo-gui's zoom, in percent of what it takes to show the net, and centre."""
        rows = math.ceil(len(self.entries) / _LEGEND_COLUMNS)
        above, below = 2.0 * self.line_m, (rows * _LINE + 1.0) * self.line_m
        height = self.top - self.bottom
        zoom = 100.0 * height / (height + above + below)
        return zoom, (self.left + self.right) / 2, (self.top + above + self.bottom - below) / 2


def _frame(
    seed: SeedScene,
    shown: Sequence[_Shown],
    colors: Mapping[str, Rgb],
    bounds: tuple[float, float, float, float],
) -> _Frame:
    left, bottom, right, top = bounds
    right += max(s.offset[0] for s in shown)
    bottom += min(s.offset[1] for s in shown)
    entries = [(model, colors[model]) for model in sorted({model for s in shown for model in s.child.models})]
    if seed.obstacles is not None and seed.obstacles.present.any():
        entries.append(("pedestrians and cyclists", _OTHER_RGB))
    line_m = 0.02 * math.hypot(right - left, top - bottom)
    return _Frame(left=left, bottom=bottom, right=right, top=top, line_m=line_m, entries=tuple(entries))


def _drawings(shown: Sequence[_Shown], colors: Mapping[str, Rgb], frame: _Frame, top: float) -> str:
    """The way of each vehicle, the children's titles, and below them which colour is whose."""
    lines, line_m = [], frame.line_m
    for s in shown:
        dx, dy = s.offset
        for v, model in enumerate(s.child.models):
            track = s.child.states[v, max(s.child.past - 1, 0) :]
            way = zip((track.x + dx).tolist(), (track.y + dy).tolist(), strict=True)
            shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in way)
            lines.append(_poly(s.id(f"way.{v}"), shape, colors[model], fill=False))
        title = f"child {s.child.number}" + (f" · {s.child.title}" if s.child.title else "")
        lines.append(_text(title, frame.left + dx, top + dy + 0.5 * line_m, line_m))
    widest = max(len(name) for name, _ in frame.entries)
    for n, (name, rgb) in enumerate(frame.entries):
        row, column = divmod(n, _LEGEND_COLUMNS)
        x = frame.left + column * (3.0 + widest * _LETTER) * line_m
        y = frame.bottom - (row + 1) * _LINE * line_m
        corners = ((0.0, 0.0), (1.5, 0.0), (1.5, 0.8), (0.0, 0.8))
        square = " ".join(f"{x + cx * line_m:.2f},{y + (cy - 0.4) * line_m:.2f}" for cx, cy in corners)
        lines.append(_poly(f"legend.{n}", square, rgb, fill=True))
        lines.append(_text(name, x + 2.0 * line_m, y, line_m))
    return "".join(lines)


def _poly(key: str, shape: str, rgb: Rgb, *, fill: bool) -> str:
    color = ",".join(str(c) for c in rgb)
    style = 'fill="1"' if fill else 'fill="0" lineWidth="0.25"'
    return f'    <poly id="{key}" color="{color}" {style} layer="{_TRACK_LAYER}" shape="{shape}"/>\n'


def _text(text: str, x: float, y: float, line_m: float) -> str:
    """Text that begins at x: the id of a point too small to see, on which sumo-gui centres it."""
    middle = x + 0.5 * _LETTER * len(text) * line_m
    # SUMO allows no blanks in ids, but blanks that do not break; and neither signs that end ids in lists.
    key = re.sub(r"[|\\'\";,<>&]", "_", re.sub(r"\s", "\N{NO-BREAK SPACE}", text))
    return (
        f'    <poi id="{key}" color="0,0,0,0" layer="{_TRACK_LAYER}" x="{middle:.2f}" y="{y:.2f}"'
        ' width="0.01" height="0.01"/>\n'
    )


def _write_configuration(folder: Path, name: str, net: Path, additional: Sequence[Path], steps: int) -> Path:
    """The file that sumo-gui opens; other files are named relative to it."""

    def relative(path: Path) -> str:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()

    options = {
        "net-file": relative(net),
        "additional-files": ",".join(relative(path) for path in additional),
        "device.fcd-replay.files": f"{name}.fcd.xml",
        "gui-settings-file": f"{name}.view.xml",
        "step-length": str(STEP_S),
        "end": f"{(steps + 1) * STEP_S:.1f}",
        # The trajectories go where they go: on and off the lanes, and through one another.
        "ignore-route-errors": "true",
        "insertion-checks": "none",
        "collision.action": "none",
        "time-to-teleport": "-1",
        "no-warnings": "true",
        "no-step-log": "true",
        "xml-validation": "never",
        "start": "true",
    }
    lines = "".join(f"    <{key} value={quoteattr(value)}/>\n" for key, value in options.items())
    path = folder / f"{name}.sumocfg"
    path.write_text(f"<configuration>\n{lines}</configuration>\n", encoding="utf-8")
    return path
