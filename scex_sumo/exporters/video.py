"""Video of futures from above: MP4 (PyAV) or GIF, drawn by matplotlib."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from PIL import Image

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.colors import OTHER_RGB, Rgb
from scex_sumo.base.errors import UsageError
from scex_sumo.converters.net.reading import AREA, BORDER, STOP, SURFACE, RoadLine, road_lines
from scex_sumo.exporters.request import Request
from scex_sumo.geometry.rectangles import outlines
from scex_sumo.page.figures.drawing import STYLE
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, States
from scex_sumo.views.futures import colors_of
from scex_sumo.world.drawings import readable

_MP4_SIZE, _MP4_RATE = (1280, 720), 30  # px; pictures per s
_GIF_SIZE, _GIF_RATE, _GIF_COLORS = (800, 450), 10, 64
_FRAME_RATE = 10  # of a future
_STILL_S = 1.0  # the last picture stays
_DPI = 72  # a point is a pixel
_MARGIN_M, _PAIR_MARGIN_M, _MIN_HEIGHT_M = 12.0, 25.0, 50.0
_RING_M = 4.5
_TITLE_PX, _ID_PX, _LETTER = 16, 12, 0.6  # heights, and width by height
_GRASS, _ASPHALT, _PAINT, _CURB = "#e2e6e0", "#b2b8bf", "#fafafa", "#8c949c"
_INK, _RING = "#181e26", "#d02828"
_BODY = np.array([[0.36, 0.5], [0.5, 0.3], [0.5, -0.3], [0.36, -0.5], [-0.5, -0.5], [-0.5, 0.5]])
_WINDSCREEN = np.array([[0.24, 0.4], [0.12, 0.36], [0.12, -0.36], [0.24, -0.4]])


def write_mp4(request: Request) -> list[Path]:
    """Write each future as MP4 (H.264) in real time; several into a folder, or together into a file."""
    if importlib.util.find_spec("av") is None:
        raise UsageError("--to mp4 needs PyAV: pip install '.[video]' in the clone; --to gif needs nothing")
    return _write(request, "mp4", _encode_mp4)


def write_gif(request: Request) -> list[Path]:
    """Write each future as animated GIF in real time; several as of `write_mp4`."""
    return _write(request, "gif", _encode_gif)


def _write(
    request: Request, ending: str, encode: Callable[[Path, Request, tuple[int, ...]], None]
) -> list[Path]:
    if request.out is not None and request.out.suffix == f".{ending}" and not request.out.is_dir():
        shown = {request.file("", ""): request.futures}
    else:
        singles = [(future,) for future in request.futures]
        shown = dict(zip(request.files(f".{ending}"), singles, strict=True))
    for path, futures in shown.items():
        with request.output(path) as unfinished, mpl.rc_context(STYLE):
            encode(unfinished, request, futures)
    return list(shown)


def _encode_mp4(path: Path, request: Request, futures: tuple[int, ...]) -> None:
    import av

    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=_MP4_RATE)
        stream.width, stream.height = _MP4_SIZE[0], _height(_MP4_SIZE, futures) * len(futures)
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "22", "preset": "veryfast"}
        for picture in _pictures(request, futures, _MP4_SIZE, _MP4_RATE):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture)))
        container.mux(stream.encode())


def _encode_gif(path: Path, request: Request, futures: tuple[int, ...]) -> None:
    pictures = [Image.fromarray(picture) for picture in _pictures(request, futures, _GIF_SIZE, _GIF_RATE)]
    colors = pictures[-1].quantize(_GIF_COLORS)
    first, *rest = (picture.quantize(palette=colors, dither=Image.Dither.NONE) for picture in pictures)
    first.save(path, "GIF", save_all=True, append_images=rest, duration=1000 // _GIF_RATE, loop=0)


def _height(size: tuple[int, int], futures: tuple[int, ...]) -> int:
    """Return the even height of each of some futures in a picture, px."""
    return size[1] // len(futures) // 2 * 2


def _pictures(request: Request, futures: tuple[int, ...], size: tuple[int, int], rate: int) -> Iterator[Any]:
    films = [Film(request, future, (size[0], _height(size, futures))) for future in futures]
    last = LOGGED_HISTORY - 1 + int(request.run.info["steps"])
    for frame in np.arange(0, last + 1e-9, _FRAME_RATE / rate):
        picture = np.concatenate([film.picture(float(frame)) for film in films])
        yield picture
    for _ in range(round(_STILL_S * rate)):
        yield picture


class Film:
    """Film of a future from above: the ground is drawn once."""

    def __init__(self, request: Request, future: int, size: tuple[int, int]) -> None:
        """Draw road, title and legend; vehicles of an encounter or critical event are ringed."""
        run, self._scene = request.run, request.scene
        tracks = list(request.encounter or ())
        words = " and ".join(map(str, tracks))
        self._names = [str(track) for track in self._scene.track_ids]
        self._pair = [self._names.index(str(track)) for track in tracks]
        self._states, models, colors = run.states(future), run.models_of(future), colors_of(run)
        self._colors = [_shares(colors[model]) for model in models]
        low, high, self._scale = self._view(size)
        figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI, facecolor=_GRASS)
        canvas: Any = FigureCanvasAgg(figure)
        self._canvas = canvas
        self._axes = figure.add_axes((0, 0, 1, 1), xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        self._axes.set_axis_off()
        lines = road_lines(run.net.path, (low[0], high[0], low[1], high[1]))
        _draw_lines(self._axes, lines, self._scale)
        driven = ", ".join(models[v] for v in self._pair)
        title = " · ".join(filter(None, (request.name, f"future {future}", words, driven)))
        self._axes.add_artist(self._corner_text(0.008, title))
        self._draw_legend({model: colors[model] for model in sorted(set(models))})
        self._canvas.draw()
        self._ground = self._canvas.copy_from_bbox(figure.bbox)

    def picture(self, frame: float) -> Any:
        """Return (height, width, 3) bytes of a future at a frame, which may lie between two."""
        self._canvas.restore_region(self._ground)
        states = _between(self._states, frame)
        time_s = (frame - LOGGED_HISTORY + 1) * STEP_S
        words = f"{time_s:+.1f} s" if time_s <= -0.05 else f"{abs(time_s):.1f} s"
        for artist in (
            *self._recorded(frame),
            *self._others(frame),
            self._vehicles(states, facecolors=self._colors, edgecolors=_INK),
            self._vehicles(states, _WINDSCREEN, facecolors=_INK),
            *self._ids(states),
            self._corner_text(0.992, words.replace("-", "\N{MINUS SIGN}")),
        ):
            self._axes.add_artist(artist)
            self._axes.draw_artist(artist)
            artist.remove()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _view(self, size: tuple[int, int]) -> tuple[FloatArray, FloatArray, float]:
        states = self._states[self._pair] if self._pair else self._states
        places = np.stack([states.x, states.y])[:, :, LOGGED_HISTORY - 1 :].reshape(2, -1)
        low, high = np.nanmin(places, axis=1), np.nanmax(places, axis=1)
        share = 1.0 if size[1] >= _GIF_SIZE[1] else 0.5  # of the surroundings in a low picture
        margin = share * (_PAIR_MARGIN_M if self._pair else _MARGIN_M)
        scale = float(min(np.array(size) / np.maximum(high - low + 2 * margin, share * _MIN_HEIGHT_M)))
        half = np.array(size) / scale / 2
        return (low + high) / 2 - half, (low + high) / 2 + half, scale

    def _vehicles(self, states: States, outline: FloatArray = _BODY, **style: Any) -> PolyCollection:
        shapes = outlines(states, self._scene.length, self._scene.width, outline)
        return PolyCollection(list(shapes), linewidths=1, **style)

    def _recorded(self, frame: float) -> list[Artist]:
        recorded, step = self._scene.future, round(frame) - LOGGED_HISTORY
        if recorded is None or not 0 <= step < recorded.shape[1]:
            return []
        states = _between(recorded, min(frame - LOGGED_HISTORY, recorded.shape[1] - 1.0))
        valid = self._scene.future_valid
        there = np.ones(len(self._names), dtype=bool) if valid is None else valid[:, step]
        shapes = outlines(states, self._scene.length, self._scene.width, _BODY)[there]
        return [PolyCollection(list(shapes), facecolors="none", edgecolors=_INK, linewidths=1)]

    def _others(self, frame: float) -> list[Artist]:
        others, column = self._scene.obstacles, round(frame) + 1
        if others is None or column >= others.present.shape[1]:
            return []
        here = others.states[others.present[:, column], column]
        style: dict[str, Any] = {"facecolor": _shares(OTHER_RGB), "edgecolor": "white"}
        return [Circle(place, 4 / self._scale, **style) for place in zip(here.x, here.y, strict=True)]

    def _ids(self, states: States) -> Iterator[Artist]:
        rest = [v for v in range(len(self._names)) if v not in self._pair]
        names = [self._names[v] for v in rest]
        wide = np.array([_LETTER * _ID_PX * len(name) for name in names]) / self._scale
        long = self._scene.length[rest]
        beside = np.where(long < 1.3 * wide, (long + wide) / 2, 0.0)  # of small vehicles
        x, y = states.x[rest] + beside, states.y[rest]
        for k in readable(names, x, y, _ID_PX / self._scale):
            yield self._text(x[k], y[k], names[k], _INK, _ID_PX)
        radius = max(_RING_M, 14 / self._scale)
        places = np.stack([states.x, states.y], axis=1)[self._pair]
        for v, (x0, y0), away in zip(self._pair, places, _apart(states[self._pair]), strict=True):
            yield Circle((x0, y0), radius, facecolor="none", edgecolor=_RING, linewidth=3)
            dx, dy = away * (radius + 14 / self._scale)
            yield self._text(x0 + dx, y0 + dy, self._names[v], _RING, _TITLE_PX)

    def _text(self, x: float, y: float, words: str, color: str, size: int) -> Artist:
        halo = [withStroke(linewidth=4, foreground="white")]
        style: dict[str, Any] = {"ha": "center", "va": "center", "clip_on": True, "path_effects": halo}
        return Text(x, y, words, color=color, fontsize=size, transform=self._axes.transData, **style)

    def _corner_text(self, side: float, words: str) -> Artist:
        style: dict[str, Any] = {"ha": "right" if side > 0.5 else "left", "va": "top", "color": _INK}
        box = {"facecolor": "white", "linewidth": 0, "pad": 6}
        return Text(side, 0.985, words, fontsize=_TITLE_PX, bbox=box, transform=self._axes.transAxes, **style)

    def _draw_legend(self, colors: dict[str, Rgb]) -> None:
        others = self._scene.obstacles
        if others is not None and others.present.any():
            colors["pedestrians and cyclists"] = OTHER_RGB
        handles = [Patch(facecolor=_shares(rgb), label=name) for name, rgb in colors.items()]
        if self._scene.future is not None:
            handles.append(Patch(facecolor="none", edgecolor=_INK, label="recorded"))
        style: dict[str, Any] = {"framealpha": 1.0, "edgecolor": "none", "fancybox": False, "handleheight": 1}
        self._axes.legend(handles=handles, loc="lower left", fontsize=_ID_PX, borderaxespad=0, **style)


def _draw_lines(axes: Axes, lines: list[RoadLine], scale: float) -> None:
    areas = [line.points for line in lines if line.kind == AREA]
    axes.add_collection(PolyCollection(areas, facecolors=_ASPHALT), autolim=False)
    for color, kinds in ((_ASPHALT, {SURFACE}), (_PAINT, None), (_CURB, {BORDER})):
        chosen = [x for x in lines if (x.kind in kinds if kinds else x.kind not in (SURFACE, AREA, BORDER))]
        widths = [x.width_m if x.kind == SURFACE else 0.4 if x.kind == STOP else 0.15 for x in chosen]
        pixels = [max(width * scale, 1.0) for width in widths]
        drawn = LineCollection([x.points for x in chosen], colors=color, linewidths=pixels, capstyle="round")
        axes.add_collection(drawn, autolim=False)


def _shares(rgb: Rgb) -> tuple[float, float, float]:
    red, green, blue = (value / 255 for value in rgb)
    return red, green, blue


def _between(states: States, frame: float) -> States:
    low = min(int(frame), states.shape[1] - 1)
    a, b = states[:, low], states[:, min(low + 1, states.shape[1] - 1)]
    share = frame - low
    x, y, speed = ((1 - share) * u + share * v for u, v in ((a.x, b.x), (a.y, b.y), (a.speed, b.speed)))
    turn = np.angle(np.exp(1j * (b.heading - a.heading)))
    return States(x=x, y=y, heading=a.heading + share * turn, speed=speed)


def _apart(states: States) -> FloatArray:
    places = np.stack([states.x, states.y], axis=1)
    away = places - places.sum(axis=0) / max(len(places), 1)
    length = np.linalg.norm(away, axis=1, keepdims=True)
    sign = np.where(np.arange(len(places)) % 2, -1.0, 1.0)
    ahead = np.stack([np.cos(states.heading), np.sin(states.heading)], axis=1) * sign[:, None]
    return np.where(length > 0.1, away / np.maximum(length, 0.1), ahead)
