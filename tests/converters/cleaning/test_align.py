"""Tracks that lie beside their lanes are moved onto them, where the evidence is clear."""

from __future__ import annotations

import csv
import gzip
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.cleaning.align import align_tracks, evidence
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, segments_of
from scex_sumo.evaluation.recordings import load_recording
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Lane, Road
from tests.seeds import lane_along

EAST, NORTH, WEST, SOUTH = 0.0, math.pi / 2, math.pi, -math.pi / 2


def lane(lane_id: int, heading: float, side_m: float) -> Lane:
    """A straight lane of 160 m and 3.5 m width through the crossing at 0, 0, to the right of the middle."""
    along = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-along[1], along[0]])
    return lane_along(lane_id, np.linspace(-80.0, 80.0, 17)[:, None] * along - side_m * left)


CROSSING = Road(
    name="crossing", lanes={k: lane(k, h, 1.75) for k, h in enumerate((EAST, NORTH, WEST, SOUTH), start=1)}
)


def tracks(
    headings: tuple[float, ...],
    *,
    each: int = 10,
    habit_m: float = 0.0,
    seconds: float = 10.0,
    path: str = "recording.csv",
) -> TrackTable:
    """Vehicles at 10 m/s along lanes of the crossing, every one up to 0.3 m left or right of the middle."""
    draw = np.random.default_rng(7)
    steps = int(10 * seconds) + 1
    time_s = 0.1 * np.arange(steps)
    x, y, psi = [], [], []
    for heading in headings:
        for _ in range(each):
            along, beside = 10.0 * time_s - 60.0, -1.75 + habit_m + draw.uniform(-0.3, 0.3)
            x.append(along * math.cos(heading) - beside * math.sin(heading))
            y.append(along * math.sin(heading) + beside * math.cos(heading))
            psi.append(np.full(steps, heading))
    count = len(x)
    number = np.repeat(np.arange(count), steps)
    stamps = np.tile(1000.0 * time_s, count)
    heading_rad = np.concatenate(psi)
    rows = TrackRows(
        case=np.zeros(count * steps, np.int64),
        track=number,
        segment=segments_of(number, stamps),
        labels=tuple(str(k) for k in range(count)),
        types=("car",) * count,
        frame_id=np.tile(np.arange(steps), count),
        timestamp_ms=stamps,
        x=np.concatenate(x),
        y=np.concatenate(y),
        vx=10.0 * np.cos(heading_rad),
        vy=10.0 * np.sin(heading_rad),
        psi_rad=heading_rad,
        length=np.full(count * steps, 4.5),
        width=np.full(count * steps, 1.8),
    )
    nobody = rows.take(np.zeros(len(rows), bool))
    return TrackTable(path=Path(path), cases=("",), vehicles=rows, others=nobody, step_s=0.1)


def displaced(table: TrackTable, dx: float, dy: float, degrees: float) -> TrackTable:
    """The recording turned about 0, 0, then shifted."""
    turn = math.radians(degrees)
    c, s = math.cos(turn), math.sin(turn)

    def moved(rows: TrackRows) -> TrackRows:
        return rows.with_columns(
            x=c * rows.x - s * rows.y + dx,
            y=s * rows.x + c * rows.y + dy,
            vx=c * rows.vx - s * rows.vy,
            vy=s * rows.vx + c * rows.vy,
            psi_rad=rows.psi_rad + turn,
        )

    return replace(table, vehicles=moved(table.vehicles), others=moved(table.others))


def apart(one: TrackTable, other: TrackTable) -> FloatArray:
    return np.asarray(np.hypot(one.vehicles.x - other.vehicles.x, one.vehicles.y - other.vehicles.y))


ALL = (EAST, NORTH, WEST, SOUTH)


@pytest.mark.parametrize("offset", [(0.7, 0.5, 1.1), (-0.8, 0.6, -1.7), (0.0, 0.9, 0.0)])
def test_a_known_offset_is_undone(offset: tuple[float, float, float]) -> None:
    right = tracks(ALL)
    aligned, finding = align_tracks(displaced(right, *offset), CROSSING)
    assert finding
    # What drivers differ by leaves a standard error of 0.3 / sqrt(3) / sqrt(20 tracks) = 0.04 m per axis.
    assert apart(aligned, right).max() < 0.15
    turned = wrap(aligned.vehicles.psi_rad - right.vehicles.psi_rad)
    assert np.degrees(np.abs(turned)).max() < 0.1
    assert_allclose(np.hypot(aligned.vehicles.vx, aligned.vehicles.vy), 10.0)
    course = np.arctan2(aligned.vehicles.vy, aligned.vehicles.vx)
    assert_allclose(wrap(course - aligned.vehicles.psi_rad), 0.0, atol=1e-9)


def test_a_habit_of_driving_right_of_the_middle_is_no_offset() -> None:
    keeping_right = tracks(ALL, habit_m=-0.6)
    assert align_tracks(keeping_right, CROSSING) == (keeping_right, ())
    aligned, finding = align_tracks(displaced(keeping_right, 0.8, -0.6, 0.0), CROSSING)
    assert finding
    assert apart(aligned, keeping_right).max() < 0.25  # 0.6 m are more than the weights take for usual


def test_other_recordings_of_the_site_help_where_evidence_is_thin() -> None:
    few = displaced(tracks(ALL, each=1, path="002.csv"), 0.7, 0.5, 1.1)
    rest = displaced(tracks(ALL, each=10, path="001.csv"), 0.7, 0.5, 1.1)
    aligned, finding = align_tracks(few, CROSSING, siblings=[("001.csv", evidence(rest.vehicles))])
    assert apart(aligned, tracks(ALL, each=1)).max() < 0.15
    assert "estimated from 2 recordings of the site" in "".join(finding)


def test_every_recording_of_a_site_is_moved_alike_to_the_last_bit() -> None:
    parts = [displaced(tracks(ALL, each=n, path=f"{n}.csv"), 0.7, 0.5, 1.1) for n in (3, 4, 5)]
    shift = []
    for part in parts:
        others = [(p.path.name, evidence(p.vehicles)) for p in parts if p is not part]
        shift.append(align_tracks(part, CROSSING, siblings=others)[1])
    assert shift[0] and len(set(shift)) == 1
    twice = [align_tracks(parts[0], CROSSING, siblings=[("4.csv", evidence(parts[1].vehicles))] * 2)[0]
             for _ in range(2)]  # fmt: skip
    assert_array_equal(twice[0].vehicles.x, twice[1].vehicles.x)


@pytest.mark.parametrize(
    "name", ["DR_USA_Roundabout_SR/vehicle_tracks_007", "DR_DEU_Roundabout_OF/vehicle_tracks_000"]
)
def test_clean_tracks_keep_every_position_to_the_last_bit(data: Path, name: str) -> None:
    file = data / "interaction" / "recorded_trackfiles" / f"{name}.csv.gz"
    (recording,) = (r for r in find_recordings([file.parent]) if r.name.endswith(name[-3:]))
    with gzip.open(file, "rt") as rows:
        recorded = {(r["track_id"], int(r["timestamp_ms"])): r for r in csv.DictReader(rows)}
    read = load_recording(recording).table.vehicles
    keys = zip(map(read.labels.__getitem__, read.track), read.timestamp_ms.astype(int).tolist(), strict=True)
    xy = [(float(row["x"]), float(row["y"])) for row in map(recorded.__getitem__, keys)]
    assert len(xy) == len(recorded)
    assert_array_equal(np.array(xy), np.stack([read.x, read.y], axis=1))
