"""Colours, line, ghosts and legend in a window that only keeps books."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from scex_sumo.live.painter import SCALE, Painter, color_of
from scex_sumo.live.risk import PairRisk, Risk

OWN = (255, 255, 0, 255)


class Window:
    """sumo-gui's books: colours of vehicles, polygons, points of interest, the view."""

    def __init__(self, *names: str) -> None:
        self.colors = dict.fromkeys(names, OWN)
        self.polygons: dict[str, Any] = {}
        self.texts: dict[str, Any] = {}
        self.tracked = ""
        self.vehicle = SimpleNamespace(
            getIDList=lambda: tuple(self.colors),
            getColor=self.colors.__getitem__,
            setColor=self._color,
            getPosition=lambda name: (float(list(self.colors).index(name)), 0.0),
        )
        self.polygon = SimpleNamespace(
            add=lambda name, shape, color, *rest: self.polygons.update({name: shape}),
            setShape=lambda name, shape: self.polygons.update({name: shape}),
            setColor=lambda name, color: None,
            remove=lambda name, layer=0: self.polygons.pop(name),
        )
        self.poi = SimpleNamespace(
            add=lambda name, x, y, *rest, **more: self.texts.update({name: (x, y)}),
            setPosition=lambda name, x, y: self.texts.update({name: (x, y)}),
            remove=lambda name: self.texts.pop(name),
        )
        self.gui = SimpleNamespace(
            getIDList=lambda: ("View #0",),
            getBoundary=lambda view: ((0.0, 0.0), (100.0, 50.0)),
            setBoundary=lambda view, *corners: None,
            trackVehicle=lambda view, name: setattr(self, "tracked", name),
        )

    def _color(self, name: str, color: tuple[int, ...]) -> None:
        assert name in self.colors  # SUMO raises for a vehicle that has left
        self.colors[name] = color

    def leaves(self, name: str) -> None:
        del self.colors[name]


def risk(*names: str, pair: tuple[str, str] = ("a", "b"), p: float = 2e-4, **more: Any) -> Risk:
    pairs = (PairRisk(hits=pair[0], other=pair[1], kind="rear-end", human_like=p, stress=0.0),)
    return Risk(time_s=1.0, pairs=pairs, vehicles=names, **more)


def test_vehicles_have_the_colour_of_their_probability_and_get_their_own_back() -> None:
    window = Window("a", "b", "c", "d")
    painter = Painter(window)
    painter(risk("a", "b", "c"))
    assert window.colors["a"] == window.colors["b"] == (*color_of(2e-4), 255) != (*color_of(0.0), 255)
    assert window.colors["c"] == (*color_of(0.0), 255)
    outside = window.colors["d"]  # not assessed; SUMO's own yellow is nearly one of the scale
    assert outside not in {OWN, *((*rgb, 255) for _, rgb, _ in SCALE)}
    painter(risk("a", "b"))  # c is no more among those that are assessed
    assert window.colors["c"] == outside
    window.leaves("a")
    painter.close()
    assert set(window.colors.values()) == {OWN} and not window.polygons and not window.texts


def test_a_line_joins_the_leading_pair_until_one_of_it_leaves() -> None:
    window = Window("a", "b")
    painter = Painter(window)
    painter(risk("a", "b"))
    assert window.polygons["scex-watch.line"] == [(0.0, 0.0), (1.0, 0.0)]
    window.leaves("b")
    painter.step()
    assert "scex-watch.line" not in window.polygons


def test_a_window_that_is_closed_stops_nothing() -> None:
    window = Window("a", "b")
    painter = Painter(window)
    painter(risk("a", "b"))

    def closed(*_: Any) -> Any:
        raise OSError("connection closed")

    window.vehicle.getIDList = closed
    painter.close()
