"""A wrong origin is told from the tracks of another map."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.converters.cleaning.align import evidence
from scex_sumo.converters.cleaning.fit import Alignment
from scex_sumo.converters.cleaning.place import doubt_place, explain_mismatch
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.tracks.reader import read_tracks
from scex_sumo.converters.tracks.rows import FLOAT_COLUMNS, TrackRows
from scex_sumo.road import Road
from tests.converters.sumo_roads import arc, lane, road


@pytest.fixture
def bend() -> Road:
    """Three quarters of a circle of radius 30 m, and a straight lane away from its end."""
    return road([lane(1, arc((0, 0), 30.0, 0.0, 270.0), to=(2,)), lane(2, [(0, -30), (120, -30)])])


def driven(a_road: Road, tracks: int = 5) -> TrackRows:
    """Poses a few metres apart along the road's lanes."""
    lines = [one.centreline for one in a_road.lanes.values()]
    points = np.concatenate([line[:-1] for line in lines])
    headings = np.concatenate([np.arctan2(*np.diff(line, axis=0).T[::-1]) for line in lines])
    whole, some = np.zeros(len(points), np.int64), np.ones(len(points))
    columns = dict.fromkeys(FLOAT_COLUMNS, some) | {"x": points[:, 0], "y": points[:, 1], "psi_rad": headings}
    columns |= {"case": whole, "segment": whole, "frame_id": whole, "track": np.arange(len(points)) % tracks}
    return TrackRows(labels=tuple(map(str, range(tracks))), types=("car",) * tracks, **columns)


def test_tracks_that_a_shift_brings_onto_lanes_have_a_wrong_origin(bend: Road) -> None:
    away = driven(bend)
    away = replace(away, x=away.x + 200.0, y=away.y - 80.0)
    moved = "moved by -200 m, +80 m, 100% of its driving is on lanes"
    assert f"{moved}; give --origin LAT,LON" in explain_mismatch(away, bend)
    # Coordinates of a SUMO net have no origin to choose.
    assert f"{moved}; give the map of these tracks" in explain_mismatch(
        away, replace(bend, net=Path("a.net.xml"))
    )


def test_tracks_a_few_metres_off_are_doubted_with_the_shift_and_an_origin_that_fits(bend: Road) -> None:
    there, bend = driven(bend), replace(bend, origin=(49.0, 8.4))
    assert doubt_place(there, bend) is None
    assert doubt_place(replace(there, x=there.x + 2.0), bend) is None  # within what the tracks are aligned by
    assert "moved by -4 m, " in (doubt_place(replace(there, x=there.x + 4.0), bend) or "")
    doubt = doubt_place(replace(there, x=there.x + 12.0), bend)
    assert doubt is not None and doubt.startswith("warning: only ")
    assert "moved by -12 m, +0 m it is 100%" in doubt or "moved by -12 m, -0 m it is 100%" in doubt
    assert "one near 49.00000,8.39984 fits better" in doubt  # 12 m west, at 73.0 km per degree


def test_tracks_that_no_shift_brings_onto_lanes_are_of_another_map(bend: Road) -> None:
    star = [lane(k, [(0, 0), (90 * np.cos(k), 90 * np.sin(k))]) for k in range(1, 7)]
    dense = [replace(one, centreline=np.linspace(*one.centreline, 46)) for one in star]
    assert "the tracks belong to another map" in explain_mismatch(driven(road(dense)), bend)


def test_a_turn_of_a_few_degrees_hides_no_wrong_origin() -> None:
    example = scex.example_path("roundabout")
    there = evidence(read_tracks(example.with_suffix(".csv")).vehicles)
    away = Alignment(centre=(0.0, 0.0), turn=math.radians(5.0)).moved(there)
    assert "of its driving is on lanes; give --origin LAT,LON" in explain_mismatch(away, read_road(example))
