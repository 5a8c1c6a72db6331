"""Drawings in sumo-gui (tracks, rings, titles, legend, ids), and its view settings."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.colors import OTHER_RGB, Rgb, model_colors
from scex_sumo.converters.net.sumo_net import shape_text
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States
from scex_sumo.world.tiles import WINDOW_ASPECT, TileLayout, TileTemplate, tile_id

Bounds = tuple[float, float, float, float]
_LINE = 1.4  # line height, in letters
_LETTER = 0.4  # width of a letter, in heights
_LEGEND_COLUMNS = 3
_WINDOW_ASPECTS = (1.85, 2.1)  # usual widths by heights
_LETTER_SHARE = 0.03  # of the window's height
_AROUND_M = 25.0  # vehicles
_RING_M, _RING_WIDTH_M, _RING_POINTS, _RING_RGB = 4.0, 0.3, 48, (214, 64, 58)
_TRACK_LAYER = 30  # between markings and vehicles

LETTER_M = 2.0  # letters of vehicle ids
_WIDE_M = 2.6  # widest id in a lane
_ID_WIDTH, _ID_HEIGHT = 0.52, 1.1  # of sumo-gui's letters, in heights

WINDOW_SIZE = "1400,900"
_SIZE_PER_M = 10.0  # sumo-gui's text size for letters of 1 m
_SIZE_PER_PX = 3.2  # and of 1 px at any zoom
GRASS = "214,219,209"
ASPHALT = "74,78,84"
_SEAM_LAYER, _SEAM_M = -1, 0.1
_ENTRY = '                <entry color="{}"{}/>'
_ROADS = (
    *("road", "sidewalk", "bike lane", "green verge", "waterway", "railway", "rails on road"),
    *("no passenger", "no road or rail", "crossing", "walkingarea"),
)
_JUNCTIONS = ("", ' name="waterway"', ' name="railway"', ' name="airway"')

_SETTINGS = """<viewsettings>
    <scheme name="scex-sumo">
        <opengl dither="0" fps="0" drawBoundaries="0"/>
        <background backgroundColor="{grass}" showGrid="0"/>
        <edges laneEdgeMode="0" laneShowBorders="0" showLinkDecals="0" showLinkRules="{lights}" showRails="0"
               hideConnectors="0" showDirection="0" showSublanes="0" showLaneDirection="0" minSize="0">
            <colorScheme name="uniform">
{roads}
            </colorScheme>
        </edges>
        <vehicles vehicleMode="0" vehicleQuality="2" vehicle_minSize="1"
                  vehicle_exaggeration="{exaggeration:.2f}" vehicle_constantSize="0" showBlinker="0"
                  drawMinGap="0" drawBrakeGap="0"
                  vehicleName_show="{names}" vehicleName_onlySelected="{chosen}"
                  vehicleName_size="{name_size}" vehicleName_color="20,22,26"
                  vehicleName_bgColor="255,255,255,200" vehicleName_constantSize="0"/>
        <persons personMode="0" personQuality="2" person_minSize="1" person_exaggeration="{exaggeration:.2f}"
                 personName_show="{names}" personName_onlySelected="{chosen}"
                 personName_size="{name_size}" personName_color="20,22,26"
                 personName_bgColor="255,255,255,200" personName_constantSize="0"/>
        <junctions junctionMode="0" drawLinkTLIndex_show="0" drawLinkJunctionIndex_show="0" drawShape="1"
                   junctionName_show="0" drawCrossingsAndWalkingareas="0">
            <colorScheme name="uniform">
{junctions}
            </colorScheme>
        </junctions>
        <additionals addMode="0" addName_show="0"/>
        <pois poiMode="0" poi_minSize="0" poi_exaggeration="1" poiName_show="1"
              poiName_size="{text_size}" poiName_color="20,22,26" poiName_bgColor="{grass},170"
              poiName_constantSize="{text_constant}"/>
        <polys polyMode="0" poly_minSize="0" polyName_show="0"/>
        <legend showSizeLegend="1" showColorLegend="0"/>
    </scheme>
    <delay value="{delay}"/>
{viewport}{pause}</viewsettings>
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class FutureView:
    """Future to be shown.

    Attributes:
        states: (V, T) from 0.1 s on: past, seed scene, future.
        models: (V,) behaviour models.
        past: number of past states; the last one is the seed scene.
        event: vehicles with a ring; without them all are in view.
        stop: index of the state to stop at; None: the last one.
    """

    number: int
    states: States
    models: Sequence[str]
    title: str = ""
    past: int = HISTORY_STEPS
    event: Sequence[int] = ()
    stop: int | None = None

    @property
    def looked_at(self) -> States:
        """States in view: all, or those of the event at the stop."""
        if not self.event:
            return self.states
        return self.states[list(self.event), self.stop_state : self.stop_state + 1]

    @property
    def stop_state(self) -> int:
        """Index of the state to stop at."""
        return self.states.shape[1] - 1 if self.stop is None else self.stop


@dataclass(frozen=True, kw_only=True, eq=False)
class TiledFuture:
    """Future with its tile.

    Attributes:
        slot: None in a net without tiles.
        offset: m.
    """

    future: FutureView
    slot: int | None
    offset: tuple[int, int]

    def id(self, name: str) -> str:
        """Return an id in the tile."""
        return name if self.slot is None else tile_id(self.slot, name)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Visible frame: tiles, titles above them, legend below.

    Attributes:
        net: smallest x, y and largest x, y of all tiles, m; ``view`` of the visible part.
        line_m: height of a letter, m.
        entries: names and colours of the legend.
    """

    net: Bounds
    view: Bounds
    line_m: float
    entries: tuple[tuple[str, Rgb], ...]

    @property
    def viewport(self) -> tuple[float, float, float]:
        """Zoom of sumo-gui in percent, and centre."""
        left, bottom, right, top = self.view
        top += 2.0 * self.line_m
        if self.entries:
            bottom -= (math.ceil(len(self.entries) / _LEGEND_COLUMNS) * _LINE + 1.0) * self.line_m
        view = left, bottom, right, top
        zoom = min(100.0 * _window_height(self.net, a) / _window_height(view, a) for a in _WINDOW_ASPECTS)
        return zoom, (left + right) / 2, (top + bottom) / 2

    @property
    def exaggeration(self) -> float:
        """Factor of vehicle sizes, 1 to 3, for visibility."""
        return min(max(_window_height(self.view) / 200.0, 1.0), 3.0)

    def closer(self, states: States) -> Frame:
        """Return the frame around these states."""
        low = float(states.x.min()) - _AROUND_M, float(states.y.min()) - _AROUND_M
        high = float(states.x.max()) + _AROUND_M, float(states.y.max()) + _AROUND_M
        left, bottom, right, top = self.net
        view = max(left, low[0]), max(bottom, low[1]), min(right, high[0]), min(top, high[1])
        return self.on(view if view[0] < view[2] and view[1] < view[3] else (*low, *high))

    def on(self, view: Bounds) -> Frame:
        """Return the frame with these bounds in view, e.g. those of one of many tiles."""
        return replace(self, view=view, line_m=_LETTER_SHARE * _window_height(view))


def _window_height(bounds: Bounds, aspect: float = WINDOW_ASPECT) -> float:
    left, bottom, right, top = bounds
    return max(top - bottom, (right - left) / aspect)


def frame_of(bounds: Bounds, offsets: Sequence[tuple[int, int]], entries: Sequence[tuple[str, Rgb]]) -> Frame:
    """Return the frame of a map with bounds in m, at tile offsets in m."""
    (left, bottom, right, top), (xs, ys) = bounds, zip(*offsets, strict=True)
    net = left + min(xs), bottom + min(ys), right + max(xs), top + max(ys)
    return Frame(net=net, view=net, line_m=_LETTER_SHARE * _window_height(net), entries=tuple(entries))


def legend_entries(
    scene: SeedScene, models: Sequence[str], colors: Mapping[str, Rgb]
) -> list[tuple[str, Rgb]]:
    """Return the models in alphabetical order, then pedestrians and cyclists if present."""
    entries = [(model, colors[model]) for model in sorted(set(models))]
    if scene.obstacles is not None and scene.obstacles.present.any():
        entries.append(("pedestrians and cyclists", OTHER_RGB))
    return entries


def draw_futures(shown: Sequence[TiledFuture], colors: Mapping[str, Rgb], frame: Frame) -> str:
    """Draw tracks, rings, and titles above the tiles."""
    lines, way_m = [], max(0.25, 0.003 * _window_height(frame.view))
    for s in shown:
        dx, dy = s.offset
        for v, model in enumerate(s.future.models):
            track = s.future.states[v, max(s.future.past - 1, 0) :]
            points = zip((track.x + dx).tolist(), (track.y + dy).tolist(), strict=True)
            shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
            lines.append(_poly(s.id(f"way.{v}"), shape, colors[model], line_m=way_m))
        title = f"future {s.future.number}" + (f" · {s.future.title}" if s.future.title else "")
        x, y = frame.view[0] + dx, frame.view[3] + dy + 0.5 * frame.line_m
        lines.append(_text(title, x, y, frame.line_m))
        lines += [_ring(s, vehicle) for vehicle in s.future.event]
    return "".join(lines)


def draw_seams(junctions: Sequence[FloatArray], shown: Sequence[TiledFuture]) -> str:
    """Draw outlines of junctions, shapes (P, 2), as asphalt below the road: lanes end before them."""
    lines = []
    for s in shown:
        for number, shape in enumerate(junctions):
            text = shape_text(np.concatenate([shape, shape[:1]]) + s.offset, 2)
            key, look = s.id(f"seam.{number}"), f'fill="0" lineWidth="{_SEAM_M}" layer="{_SEAM_LAYER}"'
            lines.append(f'    <poly id="{key}" color="{ASPHALT}" {look} shape="{text}"/>\n')
    return "".join(lines)


def _ring(shown: TiledFuture, vehicle: int) -> str:
    state = shown.future.states[vehicle, shown.future.stop_state]
    x, y = float(state.x) + shown.offset[0], float(state.y) + shown.offset[1]
    angles = [2 * math.pi * k / _RING_POINTS for k in range(_RING_POINTS + 1)]
    shape = " ".join(f"{x + _RING_M * math.cos(a):.2f},{y + _RING_M * math.sin(a):.2f}" for a in angles)
    return _poly(shown.id(f"ring.{vehicle}"), shape, _RING_RGB, line_m=_RING_WIDTH_M)


def draw_ids(names: Sequence[str], x: FloatArray, y: FloatArray, line_m: float) -> str:
    """Draw overlapping ids of ringed vehicles at x, y (N,), m, each beside its ring."""
    order = np.argsort(x, kind="stable").tolist()
    left = np.array(x)
    left[order] += np.linspace(-1.0, 1.0, len(order)) * (_RING_M + line_m)
    left -= 0.5 * _LETTER * np.array([len(name) for name in names]) * line_m
    return "".join(_text(names[n], left[n], y[n], line_m) for n in order)


def draw_legend(frame: Frame) -> str:
    """Draw the legend below the tiles."""
    lines, line_m, (left, bottom, _, _) = [], frame.line_m, frame.view
    entry_m = (3.0 + max((len(name) for name, _ in frame.entries), default=0) * _LETTER) * line_m
    for n, (name, rgb) in enumerate(frame.entries):
        row, column = divmod(n, _LEGEND_COLUMNS)
        x, y = left + column * entry_m, bottom - (row + 1) * _LINE * line_m
        corners = ((0.0, 0.0), (1.5, 0.0), (1.5, 0.8), (0.0, 0.8))
        square = " ".join(f"{x + cx * line_m:.2f},{y + (cy - 0.4) * line_m:.2f}" for cx, cy in corners)
        lines.append(_poly(f"legend.{n}", square, rgb))
        lines.append(_text(name, x + 2.0 * line_m, y, line_m))
    return "".join(lines)


def _poly(key: str, shape: str, rgb: Rgb, *, line_m: float | None = None) -> str:
    color = ",".join(str(c) for c in rgb)
    style = 'fill="1"' if line_m is None else f'fill="0" lineWidth="{line_m:.2f}"'
    return f'    <poly id="{key}" color="{color}" {style} layer="{_TRACK_LAYER}" shape="{shape}"/>\n'


def _text(text: str, x: float, y: float, line_m: float) -> str:
    middle = x + 0.5 * _LETTER * len(text) * line_m
    place = f'x="{middle:.2f}" y="{y:.2f}" width="0.01" height="0.01"'
    return f'    <poi id="{shown_text(text)}" color="0,0,0,0" layer="{_TRACK_LAYER}" {place}/>\n'


def shown_text(text: str) -> str:
    """Return a text as the id of a point of interest, which has no blanks and no separators in SUMO."""
    return re.sub(r"[|\\'\";,<>&]", "_", re.sub(r"\s", "\N{NO-BREAK SPACE}", text))


def letter_height(names: Sequence[str]) -> float:
    """Return the letter height in m with which the longest id fits into a lane."""
    longest = max((len(name) for name in names), default=1)
    return min(LETTER_M, _WIDE_M / (_ID_WIDTH * longest))


def readable(names: Sequence[str], x: FloatArray, y: FloatArray, letter_m: float) -> list[int]:
    """Return indices of ids at x, y (N,), m, that overlap no earlier one."""
    half = np.array([_ID_WIDTH * len(name) for name in names]) * letter_m / 2
    kept: list[int] = []
    for n in range(len(names)):
        over = np.abs(x[kept] - x[n]) < half[kept] + half[n]
        if not (over & (np.abs(y[kept] - y[n]) < _ID_HEIGHT * letter_m)).any():
            kept.append(n)
    return kept


def write_view_settings(
    path: Path,
    frame: Frame,
    *,
    letter_m: float = 0.0,
    chosen: bool = False,
    delay_ms: int = 100,
    pause_s: float | None = None,
    lights: bool = False,
    text_px: float | None = None,
    true_size: bool = False,
) -> None:
    """Write sumo-gui's view settings.

    Args:
        letter_m: height of vehicle ids; 0: no ids.
        chosen: ids of selected vehicles only.
        lights: show traffic lights, as bars at the ends of lanes.
        text_px: size of texts at any zoom; None: that of the frame, in m.
        true_size: vehicles are not exaggerated.
    """
    text = _SETTINGS.format(
        grass=GRASS,
        roads="\n".join(_ENTRY.format(ASPHALT, f' name="{kind}"') for kind in _ROADS),
        junctions="\n".join(_ENTRY.format(ASPHALT, kind) for kind in _JUNCTIONS),
        names=int(letter_m > 0),
        chosen=int(chosen),
        lights=int(lights),
        name_size=f"{_SIZE_PER_M * letter_m:.2f}",
        text_size=f"{_SIZE_PER_M * frame.line_m if text_px is None else _SIZE_PER_PX * text_px:.2f}",
        text_constant=int(text_px is not None),
        delay=delay_ms,
        viewport='    <viewport zoom="{:.2f}" x="{:.2f}" y="{:.2f}" angle="0"/>\n'.format(*frame.viewport),
        exaggeration=1.0 if true_size else frame.exaggeration,
        pause="" if pause_s is None else f'    <breakpoint time="{pause_s:.2f}"/>\n',
    )
    path.write_text(text, encoding="utf-8")


def write_window(
    extras: Path | None,
    folder: Path,
    template: TileTemplate,
    layout: TileLayout,
    slots: Sequence[int],
    models: Sequence[str],
) -> tuple[list[Path], list[str]]:
    """Write markings, legend and view settings of a live window; return additional files and SUMO's options.

    ``extras``: drawing of the net; ``models``: those that the legend names.
    """
    additional = []
    if extras is not None:
        additional.append(folder / "tiles.add.xml")
        TileTemplate(extras).write(additional[-1], slots, layout)
    bounds, offsets = template.bounds, [layout.offset(slot) for slot in slots]
    entries = list(zip(models, model_colors(models), strict=True))
    frame = frame_of(bounds, offsets, entries).on(bounds)
    additional.append(folder / "legend.add.xml")
    additional[-1].write_text(f"<additional>\n{draw_legend(frame)}</additional>\n", encoding="utf-8")
    letter_m = LETTER_M * frame.exaggeration if len(slots) == 1 else 0.0
    write_view_settings(folder / "view.xml", frame, letter_m=letter_m)
    return additional, ["--gui-settings-file", str(folder / "view.xml"), "--window-size", WINDOW_SIZE]
