"""Painter of risk in sumo-gui: colours of vehicles, a line between the leading pair, ghosts, legend."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Final

from scex_sumo.base.colors import Rgb
from scex_sumo.live.risk import PairRisk, Risk
from scex_sumo.results.tables.pairs import once_in
from scex_sumo.world.drawings import shown_text

SCALE: Final[tuple[tuple[float, Rgb, str], ...]] = (
    (1e-3, (213, 94, 0), "collides once in 1 000 such moments or more"),
    (1e-4, (230, 159, 0), "once in 10 000"),
    (1e-5, (240, 228, 66), "once in 100 000"),
    (1e-6, (86, 180, 233), "once in a million"),
    (0.0, (222, 226, 230), "less often"),
)
"""Human-like P from which a vehicle has a colour, and its words. Okabe and Ito's, for the colour-blind."""
_OUTSIDE: tuple[Rgb, str] = (128, 132, 138), "not assessed"

_KEY = "scex-watch"
_LINE_M, _GHOST_M = 0.6, 0.2
_LAYER = 200  # above vehicles
_INK: Rgb = (20, 22, 26)
_HALF_HEIGHT_M = 45.0  # of the view that follows
TEXT_PX: Final = 14.0
_VIEW_PX = 714.0  # height of the view in a window of its first size
_LETTER = 0.405  # width by height


def color_of(probability: float) -> Rgb:
    """Return the colour of a vehicle with this P."""
    return next(rgb for least, rgb, _ in SCALE if probability >= least)


class Painter:
    """Paints each `Risk` that it is called with; `close` gives the vehicles their own colours back.

    To ``follow`` is to show the leading pair, with its outlines in a typical critical future.
    """

    def __init__(self, sumo: Any, *, follow: bool = False) -> None:
        self._sumo, self._follow = sumo, follow
        self._own: dict[str, tuple[int, ...]] = {}  # colours before ours
        self._painted: dict[str, Rgb] = {}
        self._drawn: set[str] = set()  # polygons
        self._texts: dict[str, str] = {}  # ids of points of interest, which are their texts
        self._worst: PairRisk | None = None
        self._followed: tuple[str, str] | None = None
        self._legend: tuple[object, PairRisk | None] | None = None  # where it is, and its first line
        self._view = sumo.gui.getIDList()[0]

    def __call__(self, risk: Risk) -> None:
        """Paint a risk."""
        vehicles, assessed = self._sumo.vehicle, set(risk.vehicles)
        present = set(vehicles.getIDList())
        self._own = {name: color for name, color in self._own.items() if name in present}
        self._own |= {name: tuple(vehicles.getColor(name)) for name in present - self._own.keys()}
        colors = {name: color_of(risk.of(name)) if name in assessed else _OUTSIDE[0] for name in present}
        for name, rgb in colors.items():
            if self._painted.get(name) != rgb:
                vehicles.setColor(name, (*rgb, 255))
        self._painted = colors
        self._worst = risk.worst
        self._draw_ghosts(risk)
        if self._follow:
            self._follow_pair(present)
        self.step()

    def step(self) -> None:
        """Move the line with its vehicles, and the legend with the view; call it after each step."""
        self._draw_legend()
        pair = self._worst
        present = self._sumo.vehicle.getIDList() if pair is not None else ()
        if pair is None or not set(pair.names) <= set(present):
            self._erase("line")
            return
        ends = [self._sumo.vehicle.getPosition(name) for name in pair.names]
        self._draw("line", ends, color_of(pair.human_like), _LINE_M)

    def close(self) -> None:
        """Give vehicles their own colours back and remove what was drawn; whatever is gone is gone."""
        with suppress(Exception):  # the window may be closed
            present = set(self._sumo.vehicle.getIDList())
            for name in present & self._own.keys():
                self._sumo.vehicle.setColor(name, self._own[name])
            for key in [*self._drawn]:
                self._erase(key)
            for key in [*self._texts]:
                self._sumo.poi.remove(self._texts.pop(key))
            if self._followed is not None:
                self._sumo.gui.trackVehicle(self._view, "")

    def _follow_pair(self, present: set[str]) -> None:
        pair = self._worst
        if pair is None or pair.names == self._followed or not set(pair.names) <= present:
            return
        (x, y), _ = (self._sumo.vehicle.getPosition(name) for name in pair.names)
        half = _HALF_HEIGHT_M
        self._sumo.gui.setBoundary(self._view, x - half, y - half, x + half, y + half)
        self._sumo.gui.trackVehicle(self._view, pair.hits)
        self._followed = pair.names

    def _draw_ghosts(self, risk: Risk) -> None:
        wanted: dict[str, list[list[float]]] = {}
        if self._follow and risk.worst is not None:
            color = color_of(risk.worst.human_like)
            for number, outlines in enumerate(risk.ghosts.values()):
                wanted |= {f"ghost.{number}.{k}": shape.tolist() for k, shape in enumerate(outlines)}
            for key, shape in wanted.items():
                self._draw(key, [(x, y) for x, y in shape], color, _GHOST_M)
        for key in [key for key in self._drawn if key.startswith("ghost.") and key not in wanted]:
            self._erase(key)

    def _draw_legend(self) -> None:
        place = self._sumo.gui.getBoundary(self._view)
        if self._legend == (place, self._worst):
            return
        self._legend = (place, self._worst)
        (left, low), (_, top) = place
        px = (top - low) / _VIEW_PX
        line_m, x = 1.5 * TEXT_PX * px, left + 12 * px
        y = top - line_m
        pair = self._worst
        head = "no pair leads"
        if pair is not None:
            stress = f"in {pair.stress or 0.0:.0%} of the stress test"
            frequency = once_in(pair.human_like) if pair.human_like else stress
            head = f"{pair.hits} and {pair.other}: {frequency}"
        self._write("head", head, x, y, px)
        for number, (rgb, words) in enumerate([*((rgb, words) for _, rgb, words in SCALE), _OUTSIDE]):
            y -= line_m
            right, lower, upper = x + line_m, y - line_m / 3, y + line_m / 3
            box = [(x, lower), (right, lower), (right, upper), (x, upper)]
            self._draw(f"scale.{number}", [*box, box[0]], rgb, None)
            self._write(f"scale.{number}", words, x + 1.4 * line_m, y, px)

    def _draw(self, key: str, shape: list[tuple[float, float]], rgb: Rgb, width_m: float | None) -> None:
        name, polygon = f"{_KEY}.{key}", self._sumo.polygon
        if key in self._drawn:
            polygon.setShape(name, shape)
            polygon.setColor(name, (*rgb, 255))
            return
        filled = width_m is None
        polygon.add(name, shape, (*rgb, 255), filled, _KEY, _LAYER, width_m or 1.0)
        self._drawn.add(key)

    def _erase(self, key: str) -> None:
        if key in self._drawn:
            self._drawn.remove(key)
            self._sumo.polygon.remove(f"{_KEY}.{key}", _LAYER)

    def _write(self, key: str, text: str, x: float, y: float, px: float) -> None:
        """Write a text that begins at x, y: the id of a point of interest, as sumo-gui shows it."""
        name, middle = shown_text(text), x + 0.5 * _LETTER * TEXT_PX * px * len(text)
        if self._texts.get(key) != name:
            if key in self._texts:
                self._sumo.poi.remove(self._texts.pop(key))
            self._sumo.poi.add(name, middle, y, (*_INK, 0), "", _LAYER, width=0.01, height=0.01)
            self._texts[key] = name
        self._sumo.poi.setPosition(name, middle, y)
