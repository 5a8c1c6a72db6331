"""The road from above: what is drawn where."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.learned.inputs.surface import CHANNELS, LIMIT_SCALE_MPS, PIXEL_M, raster_of
from scex_sumo.road import Area, Marking
from tests.behaviors import roads


def test_a_lane_is_drawn_with_its_width_direction_and_limit() -> None:
    turn = np.pi / 3
    end = (100 * np.cos(turn), 100 * np.sin(turn))
    raster = raster_of(roads.road(roads.lane(1, [(0.0, 0.0), end], limit=10.0, width=4.0)))
    drivable, _, _, cos, sin, limit, _ = raster.values
    assert drivable.sum() * PIXEL_M**2 == pytest.approx(400.0, rel=0.02)  # its area, m²
    column, row = np.round(np.array([50 * np.cos(turn), 50 * np.sin(turn)]) - raster.corner).astype(int)
    assert drivable[row, column] == 1.0
    assert cos[row, column] == pytest.approx(np.cos(turn), abs=1e-6)
    assert sin[row, column] == pytest.approx(np.sin(turn), abs=1e-6)
    assert limit[row, column] == pytest.approx(10.0 / LIMIT_SCALE_MPS)
    assert drivable[0].sum() == 0  # the margin


def test_where_lanes_overlap_their_directions_are_averaged() -> None:
    crossing = roads.road(
        roads.lane(1, [(-50.0, 0.0), (50.0, 0.0)], width=4.0),
        roads.lane(2, [(0.0, -50.0), (0.0, 50.0)], width=4.0),
    )
    raster = raster_of(crossing)
    column, row = np.round(-raster.corner).astype(int)
    values = dict(zip(CHANNELS, raster.values[:, row, column], strict=True))
    assert (values["cos"], values["sin"]) == pytest.approx((0.5, 0.5), abs=1e-6)
    assert values["drivable"] == 1.0


def test_bounds_markings_and_crosswalks_have_channels_of_their_own() -> None:
    square = np.array([(20.0, -5.0), (24.0, -5.0), (24.0, 5.0), (20.0, 5.0)])
    line = Marking(line_id=1, kind="stop_line", subtype="", points=np.array([(40.0, -2.0), (40.0, 2.0)]))
    island = Area(area_id=3, kind="island", outline=square + 50.0)
    road = replace(
        roads.straight(100.0),
        areas=(Area(area_id=2, kind="crosswalk", outline=square), island),
        markings=(line,),
    )
    raster = raster_of(road)
    _, boundary, marking, _, _, _, crosswalk = raster.values
    assert crosswalk.sum() == pytest.approx(40.0, abs=14.0)  # 4 m by 10 m, and half its outline's pixels
    assert marking.sum() == pytest.approx(5.0, abs=1.0)
    assert boundary.sum() == pytest.approx(101.0, abs=1.0)
