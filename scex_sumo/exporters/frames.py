"""Pictures of a child from above: road, vehicles in the colours of their models, ids, what was recorded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from scex_sumo.arrays import FloatArray
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, SeedScene, States
from scex_sumo.views.road_lines import AREA, BORDER, STOP, SURFACE, road_lines
from scex_sumo.world.gui.colors import Rgb
from scex_sumo.world.gui.drawings import OTHER_RGB
from scex_sumo.world.gui.names import readable

_FINE = 2  # drawn this much larger, to be smooth
_MARGIN_M, _PAIR_MARGIN_M, _LEAST_HEIGHT_M = 12.0, 25.0, 50.0
_RING_M = 4.5
_ID = 13  # size of letters
_GRASS, _ASPHALT, _PAINT, _CURB = (226, 230, 224), (178, 184, 191), (250, 250, 250), (140, 148, 156)
_INK, _PAPER, _RING = (24, 30, 38), (255, 255, 255), (208, 40, 40)
_BODY = np.array([[0.36, 0.5], [0.5, 0.3], [0.5, -0.3], [0.36, -0.5], [-0.5, -0.5], [-0.5, 0.5]])
_WINDSCREEN = np.array([[0.24, 0.4], [0.12, 0.36], [0.12, -0.36], [0.24, -0.4]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Film:
    """A child to be drawn at any time.

    Attributes:
        scene: the seed scene.
        states: (V, 10 + T) of the child; the tenth is the moment of the seed scene.
        models: (V,) who drives.
        colors: of the models.
        title: what is written above.
        pair: vehicles that are ringed and kept in view; none shows everybody.
        net: NET.net.xml, with NET.add.xml beside it.
        size: width and height in pixels.
    """

    scene: SeedScene
    states: States
    models: Sequence[str]
    colors: Mapping[str, Rgb]
    title: str
    pair: Sequence[int]
    net: Path
    size: tuple[int, int]

    def picture(self, frame: float) -> Image.Image:
        """The child at one of its frames, or between two of them."""
        image = self._ground.copy()
        pen = ImageDraw.Draw(image)
        poses = _between(self.states, frame)
        self._draw_recorded(pen, frame)
        self._draw_others(pen, frame)
        for pose, model, size in zip(poses, self.models, self._sizes, strict=True):
            body = self._body(pose, size)
            pen.polygon(body, fill=self.colors[model])
            pen.line([*body, body[0]], _INK, _FINE)  # polygon's own outline is ten times as slow
            pen.polygon(self._body(pose, size, _WINDSCREEN), fill=_INK)
        self._draw_names(pen, poses)
        time_s = (frame - LOGGED_HISTORY + 1) * STEP_S
        words = f"{time_s:+.1f} s" if time_s <= -0.05 else f"{abs(time_s):.1f} s"
        self._panel(pen, [words.replace("-", "\N{MINUS SIGN}")], right=True)
        return image.reduce(_FINE)

    @cached_property
    def _sizes(self) -> FloatArray:
        return np.stack([self.scene.length, self.scene.width], axis=1)

    @cached_property
    def _view(self) -> tuple[FloatArray, float]:
        """Centre in m, and pixels of the large picture per m."""
        shown = self.states[list(self.pair)] if self.pair else self.states
        low, high = (
            np.array([end(shown.x[:, LOGGED_HISTORY - 1 :]), end(shown.y[:, LOGGED_HISTORY - 1 :])])
            for end in (np.min, np.max)
        )
        span = np.maximum(high - low + 2 * (_PAIR_MARGIN_M if self.pair else _MARGIN_M), _LEAST_HEIGHT_M)
        return (low + high) / 2, float(min(_FINE * np.array(self.size) / span))

    def _pixels(self, points: FloatArray) -> list[tuple[float, float]]:
        """Places (..., 2) in the large picture."""
        centre, scale = self._view
        middle = _FINE * np.array(self.size) / 2
        placed = middle + (points - centre) * np.array([scale, -scale])
        return [(x, y) for x, y in placed.reshape(-1, 2).tolist()]

    def _body(
        self, pose: FloatArray, size: FloatArray, outline: FloatArray = _BODY
    ) -> list[tuple[float, float]]:
        x, y, heading = pose
        along, across = (outline * size).T
        cos, sin = math.cos(heading), math.sin(heading)
        return self._pixels(np.stack([x + along * cos - across * sin, y + along * sin + across * cos], -1))

    @cached_property
    def _ground(self) -> Image.Image:
        """What does not move: the road, the title, whose colour is which."""
        image = Image.new("RGB", (_FINE * self.size[0], _FINE * self.size[1]), _GRASS)
        pen = ImageDraw.Draw(image)
        centre, scale = self._view
        half = _FINE * np.array(self.size) / 2 / scale
        box = (centre[0] - half[0], centre[0] + half[0], centre[1] - half[1], centre[1] + half[1])
        lines = road_lines(self.net, box)
        for kind, width_m, points in sorted(lines, key=lambda line: line.kind not in (SURFACE, AREA)):
            where = self._pixels(points)
            if kind == AREA:
                pen.polygon(where, fill=_ASPHALT)
                continue
            fill = _ASPHALT if kind == SURFACE else _CURB if kind == BORDER else _PAINT
            wide = width_m if kind == SURFACE else 0.4 if kind == STOP else 0.15
            pen.line(where, fill=fill, width=max(round(wide * scale), _FINE), joint="curve")
        self._panel(pen, [self.title])
        self._legend(pen)
        return image

    def _draw_recorded(self, pen: ImageDraw.ImageDraw, frame: float) -> None:
        """Outlines of where the vehicles really went."""
        future, at = self.scene.future, round(frame) - LOGGED_HISTORY
        if future is None or not 0 <= at < future.shape[1]:
            return
        for vehicle, pose in enumerate(_between(future, min(frame - LOGGED_HISTORY, future.shape[1] - 1.0))):
            if self.scene.future_valid is None or self.scene.future_valid[vehicle, at]:
                body = self._body(pose, self._sizes[vehicle])
                pen.line([*body, body[0]], _INK, _FINE)

    def _draw_others(self, pen: ImageDraw.ImageDraw, frame: float) -> None:
        """Pedestrians and cyclists as dots."""
        others, at = self.scene.obstacles, round(frame) + 1
        if others is None or at >= others.present.shape[1]:
            return
        here = others.present[:, at]
        for x, y in self._pixels(np.stack([others.states.x[here, at], others.states.y[here, at]], axis=-1)):
            pen.circle((x, y), 4 * _FINE, fill=OTHER_RGB, outline=_PAPER)

    def _draw_names(self, pen: ImageDraw.ImageDraw, poses: FloatArray) -> None:
        """Ids in the middle of vehicles where they overprint no other; a pair's beside their rings."""
        scale = self._view[1]
        names = [str(track) for track in self.scene.track_ids]
        rest = [v for v in range(len(names)) if v not in self.pair]
        wide = np.array([_font(_ID).getlength(names[v]) / scale for v in rest])
        long = self._sizes[rest, 0]
        x = poses[rest, 0] + np.where(
            long < 1.3 * wide, (long + wide) / 2, 0.0
        )  # beside cars that are too small
        for k in readable([names[v] for v in rest], x, poses[rest, 1], _ID * _FINE / scale):
            _write(pen, self._pixels(np.array([x[k], poses[rest[k], 1]]))[0], names[rest[k]], _INK, _ID)
        for vehicle, away in zip(self.pair, _apart(poses[list(self.pair)]), strict=True):
            place, radius = poses[vehicle, :2], max(_RING_M, 14 * _FINE / scale)
            pen.circle(self._pixels(place)[0], radius * scale, outline=_RING, width=3 * _FINE)
            at = self._pixels(place + away * (radius + 14 * _FINE / scale))[0]
            _write(pen, at, names[vehicle], _RING, 17)

    def _legend(self, pen: ImageDraw.ImageDraw) -> None:
        entries = [(model, self.colors[model]) for model in sorted(set(self.models))]
        if self.scene.obstacles is not None and self.scene.obstacles.present.any():
            entries.append(("pedestrians and cyclists", OTHER_RGB))
        line, font = 20 * _FINE, _font(_ID)
        count = len(entries) + (self.scene.future is not None)
        top = _FINE * self.size[1] - line * count - 8 * _FINE
        wide = max((font.getlength(name) for name, _ in entries), default=0) + 44 * _FINE
        pen.rectangle((0, top - 8 * _FINE, wide, _FINE * self.size[1]), fill=_PAPER)
        for n in range(count):
            y = top + (n + 0.4) * line
            name, color = entries[n] if n < len(entries) else ("recorded", None)
            box = (10 * _FINE, y - 6 * _FINE, 28 * _FINE, y + 6 * _FINE)
            pen.rectangle(box, fill=color, outline=_INK if color is None else None, width=_FINE)
            pen.text((36 * _FINE, y), name, _INK, font, anchor="lm")

    def _panel(self, pen: ImageDraw.ImageDraw, lines: Sequence[str], *, right: bool = False) -> None:
        """Words in an upper corner."""
        text, font, pad = "\n".join(lines), _font(17), 8 * _FINE
        wide = font.getlength(text) + 2 * pad
        left = _FINE * self.size[0] - wide if right else 0
        pen.rectangle((left, 0, left + wide, 22 * _FINE + pad), fill=_PAPER)
        pen.text((left + pad, 15 * _FINE), text, _INK, font, anchor="lm")


def _write(pen: ImageDraw.ImageDraw, at: tuple[float, float], words: str, color: Rgb, size: int) -> None:
    """Words around a place, on any ground."""
    pen.text(at, words, color, _font(size), anchor="mm", stroke_width=2 * _FINE, stroke_fill=_PAPER)


@lru_cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size * _FINE)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font


def _between(states: States, frame: float) -> FloatArray:
    """(V, 3) x, y and heading between two of the (V, T) states."""
    low = min(int(frame), states.shape[1] - 1)
    high = min(low + 1, states.shape[1] - 1)
    part = frame - low
    turn = np.angle(np.exp(1j * (states.heading[:, high] - states.heading[:, low])))
    x, y = ((1 - part) * v[:, low] + part * v[:, high] for v in (states.x, states.y))
    return np.stack([x, y, states.heading[:, low] + part * turn], axis=1)


def _apart(poses: FloatArray) -> FloatArray:
    """(N, 2) directions of vehicles away from their middle; along their headings where in one place."""
    away = poses[:, :2] - poses[:, :2].sum(axis=0) / max(len(poses), 1)
    length = np.linalg.norm(away, axis=1, keepdims=True)
    sign = np.where(np.arange(len(poses)) % 2, -1.0, 1.0)
    ahead = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1) * sign[:, None]
    return np.where(length > 0.1, away / np.maximum(length, 0.1), ahead)
