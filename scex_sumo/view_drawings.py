"""What is drawn beside the vehicles: their ways, the children's titles, and whose colour is which."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scex_sumo.colors import Rgb
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States
from scex_sumo.tiles import tile_id

OTHER_RGB = (255, 0, 200)  # pedestrians and cyclists
_LINE = 1.4  # from line to line of text, in heights of a letter
_LETTER = 0.4  # width of a letter likewise
_LEGEND_COLUMNS = 3
_WINDOW_ASPECT = 1.5
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """A child and the tile that it is shown in, None in a net that is not tiled.

    Attributes:
        child: the child.
        slot: of its tile.
        offset: of its tile, m.
    """

    child: ChildView
    slot: int | None
    offset: tuple[int, int]

    def id(self, name: str) -> str:
        """An id in the tile."""
        return name if self.slot is None else tile_id(self.slot, name)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What is in view: all tiles, titles above them and a legend below.

    Attributes:
        left: edge of the westernmost map, m.
        bottom: edge of the southernmost map, m.
        right: edge of the easternmost map, m.
        top: edge of the northernmost map, m.
        line_m: height of a letter, m.
        entries: names and colours of the legend.
    """

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
        # sumo-gui's 100 % is what shows the net in a window of, usually, about these proportions.
        height, needed = self.top - self.bottom, (self.right - self.left) / _WINDOW_ASPECT
        zoom = 100.0 * max(height, needed) / max(height + above + below, needed)
        return zoom, (self.left + self.right) / 2, (self.top + above + self.bottom - below) / 2


def frame_of(
    bounds: tuple[float, float, float, float],
    offsets: Sequence[tuple[int, int]],
    entries: Sequence[tuple[str, Rgb]],
) -> Frame:
    """The frame of tiles.

    Args:
        bounds: smallest x, y and largest x, y of the map, m.
        offsets: of the tiles, m.
        entries: names and colours of the legend.
    """
    left, bottom, right, top = bounds
    left, right = left + min(dx for dx, _ in offsets), right + max(dx for dx, _ in offsets)
    bottom, top = bottom + min(dy for _, dy in offsets), top + max(dy for _, dy in offsets)
    line_m = 0.02 * math.hypot(right - left, top - bottom)
    return Frame(left=left, bottom=bottom, right=right, top=top, line_m=line_m, entries=tuple(entries))


def legend_entries(
    seed: SeedScene, models: Sequence[str], colors: Mapping[str, Rgb]
) -> list[tuple[str, Rgb]]:
    """Models in alphabetical order, and pedestrians and cyclists where there are any."""
    entries = [(model, colors[model]) for model in sorted(set(models))]
    if seed.obstacles is not None and seed.obstacles.present.any():
        entries.append(("pedestrians and cyclists", OTHER_RGB))
    return entries


def draw_children(shown: Sequence[Shown], colors: Mapping[str, Rgb], frame: Frame, map_top: float) -> str:
    """The way of each vehicle, and the children's titles above their tiles."""
    lines = []
    for s in shown:
        dx, dy = s.offset
        for v, model in enumerate(s.child.models):
            track = s.child.states[v, max(s.child.past - 1, 0) :]
            way = zip((track.x + dx).tolist(), (track.y + dy).tolist(), strict=True)
            shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in way)
            lines.append(_poly(s.id(f"way.{v}"), shape, colors[model], fill=False))
        title = f"child {s.child.number}" + (f" · {s.child.title}" if s.child.title else "")
        lines.append(_text(title, frame.left + dx, map_top + dy + 0.5 * frame.line_m, frame.line_m))
    return "".join(lines)


def draw_legend(frame: Frame) -> str:
    """Below the tiles: which colour is whose."""
    lines, line_m = [], frame.line_m
    widest = max((len(name) for name, _ in frame.entries), default=0)
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
