"""What is drawn beside the vehicles, and what is in view."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scex_sumo.scene import States
from scex_sumo.world.drawings import (
    FutureView,
    TiledFuture,
    draw_futures,
    draw_legend,
    draw_seams,
    frame_of,
    write_view_settings,
)

RED, BLUE = (214, 64, 58), (54, 124, 196)
MAP = (0.0, 0.0, 300.0, 100.0)


def track(x: float, y: float) -> States:
    """(1, 4): eastwards, a metre a step."""
    along = x + np.arange(4.0)[None]
    return States(
        x=along, y=np.full_like(along, y), heading=np.zeros_like(along), speed=np.full_like(along, 10)
    )


def elements(drawn: str) -> dict[str, ElementTree.Element]:
    return {e.get("id", ""): e for e in ElementTree.fromstring(f"<a>{drawn}</a>")}


def test_vehicles_are_enlarged_only_where_they_would_be_too_small_to_see() -> None:
    assert frame_of(MAP, [(0, 0)], []).exaggeration == 1.0
    assert frame_of((0.0, 0.0, 300.0, 400.0), [(0, 0)], []).exaggeration == 2.0
    assert frame_of((0.0, 0.0, 9000.0, 100.0), [(0, 0)], []).exaggeration == 3.0


def test_ways_begin_at_the_seed_scene_in_the_colour_of_the_model() -> None:
    future = FutureView(
        number=7, states=track(100.0, 40.0), models=("risky",), past=2, title="wttc < 0.3, say"
    )
    shown = TiledFuture(future=future, slot=4, offset=(1000, -500))
    drawn = elements(draw_futures([shown], {"risky": RED}, frame_of(MAP, [(0, 0)], [])))
    way = drawn["t4_way.0"]
    assert way.get("shape") == "1101.00,-460.00 1102.00,-460.00 1103.00,-460.00"
    assert way.get("color") == "214,64,58"
    # SUMO refuses ids with blanks, commas or angle brackets; a title has to be one.
    assert set(drawn) == {"t4_way.0", "future 7 · wttc _ 0.3_ say".replace(" ", "\N{NO-BREAK SPACE}")}


def test_the_legend_says_whose_colour_is_which() -> None:
    drawn = elements(draw_legend(frame_of(MAP, [(0, 0)], [("standard_driver", BLUE), ("risky_driver", RED)])))
    assert [drawn[f"legend.{n}"].get("color") for n in (0, 1)] == ["54,124,196", "214,64,58"]
    assert {"standard_driver", "risky_driver"} < set(drawn)
    for name, square in (("standard_driver", "legend.0"), ("risky_driver", "legend.1")):
        corners = [float(p.split(",")[0]) for p in drawn[square].get("shape", "").split()]
        assert float(drawn[name].get("x", "nan")) > max(corners)  # the text is beside its colour
        assert float(drawn[name].get("y", "nan")) < MAP[1]  # and below the map


def test_view_settings_are_well_formed_and_say_what_was_asked(tmp_path: Path) -> None:
    path = tmp_path / "view.xml"
    frame = frame_of(MAP, [(0, 0)], [])
    zoom, x, y = frame.viewport
    write_view_settings(path, frame, delay_ms=40, pause_s=4.0)
    settings = ElementTree.parse(path).getroot()
    found = {e.tag: e.attrib for e in settings}
    assert found["delay"] == {"value": "40"}
    assert found["viewport"] == {"zoom": f"{zoom:.2f}", "x": f"{x:.2f}", "y": f"{y:.2f}", "angle": "0"}
    assert found["breakpoint"] == {"time": "4.00"}
    vehicles = settings.find("scheme/vehicles")
    assert vehicles is not None and vehicles.get("vehicleName_show") == "0"


def test_junctions_have_an_outline_in_the_colour_of_lanes_that_hides_their_seams(tmp_path: Path) -> None:
    future = FutureView(number=3, states=track(0.0, 0.0), models=("a",), past=1)
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]])
    drawn = elements(draw_seams([square], [TiledFuture(future=future, slot=None, offset=(10.0, 0.0))]))
    (seam,) = drawn.values()
    assert seam.get("shape") == "10.00,0.00 14.00,0.00 14.00,4.00 10.00,0.00"
    assert float(seam.get("layer", "nan")) < 0.0
    write_view_settings(tmp_path / "v.xml", frame_of(MAP, [(0, 0)], []))
    colors = ElementTree.parse(tmp_path / "v.xml").getroot().iter("entry")
    assert {entry.get("color") for entry in colors} == {seam.get("color")}
