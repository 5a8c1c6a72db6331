"""Defects of recordings are found by data, repaired where that is unambiguous, and counted."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.converters.tracks.reader import read_tracks
from scex_sumo.converters.tracks.rows import TrackTable
from tests.converters.track_files import COLUMNS, Row, moving, straight, write_rows


def _table(tmp_path: Path, rows: list[Row], columns: list[str] = COLUMNS) -> TrackTable:
    return read_tracks(write_rows(tmp_path / "t.csv", rows, columns))


def _repaired(tmp_path: Path, rows: list[Row]) -> tuple[TrackTable, str]:
    """Repair the rows; what is said of defects, without the first phrase about rows left out."""
    table, findings = repair_tracks(_table(tmp_path, rows))
    return table, "; ".join(phrase for phrase in findings if not phrase.endswith("rows left out"))


def _turn(t: float) -> tuple[float, float]:
    """A circle of 20 m at 8 m/s: the heading turns by 0.4 rad/s."""
    return 20.0 * np.sin(0.4 * t), 20.0 * (1.0 - np.cos(0.4 * t))


def test_a_sound_recording_is_left_alone_to_the_last_bit(tmp_path: Path) -> None:
    rows = straight(1) + moving(_turn, 2) + straight(3, speed=0.0) + straight(4, speed=45.0)
    before = _table(tmp_path, rows)
    after, findings = repair_tracks(before)
    assert findings == ()
    for name in ("segment", "x", "y", "vx", "vy", "psi_rad"):
        np.testing.assert_array_equal(getattr(after.vehicles, name), getattr(before.vehicles, name))


def test_velocities_too_small_are_recomputed_and_the_factor_is_named(tmp_path: Path) -> None:
    rows = [row | {"vx": row["vx"] / 1.75, "vy": row["vy"] / 1.75} for row in moving(_turn, 1)]
    table, said = _repaired(tmp_path, rows)
    assert "velocities of 1 of 1 moving tracks contradict the motion (1.75 x too small)" in said
    # Derivatives of second order: a''' dt² / 6 inside, twice that at the ends, of 8 m/s * 0.4² = 1.3 m/s³.
    np.testing.assert_allclose(table.vehicles.speed, 8.0, atol=0.01)


@pytest.mark.parametrize(
    ("vx", "how"), [(-10.0, "wrong direction"), (15.0, "1.50 x too large"), (0.0, "wrong direction")]
)
def test_only_the_tracks_that_contradict_are_changed(tmp_path: Path, vx: float, how: str) -> None:
    rows = straight(1, vx=vx) + straight(2, y=4.0, vy=0.3) + straight(3, y=8.0)
    table, said = _repaired(tmp_path, rows)
    assert f"velocities of 1 of 3 moving tracks contradict the motion ({how})" in said
    vehicles = table.vehicles
    np.testing.assert_allclose(vehicles.vx[vehicles.track_id == 1], 10.0, atol=1e-6)
    assert (vehicles.vy[vehicles.track_id == 2] == 0.3).all()


def test_jittering_positions_are_smoothed(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    rows = moving(_turn, 1, range(200))
    noisy = [row | {"x": row["x"] + 0.15 * a, "y": row["y"] + 0.15 * b} for row, a, b in _noise(rows, rng)]
    table, said = _repaired(tmp_path, noisy)
    assert re.search(r"positions jitter by 0\.1[2-7] m: smoothed", said)
    low, high = np.percentile(_accelerations(table), [1, 99])
    assert -4.0 < low < high < 4.0  # the vehicle itself keeps its speed
    vehicles = table.vehicles
    t = vehicles.timestamp_ms / 1000.0
    off = np.hypot(vehicles.x - 20 * np.sin(0.4 * t), vehicles.y - 20 * (1 - np.cos(0.4 * t)))
    assert np.sqrt(np.mean(off**2)) < 0.5 * 0.15 * np.sqrt(2.0)
    assert np.std(vehicles.speed - 8.0) < 0.25  # raw differences: 0.15 / 0.1 s = 1.5 m/s
    assert np.abs(np.diff(vehicles.speed) / 0.1).max() < 4.0  # raw: above 15 m/s²


def _noise(rows: list[Row], rng: np.random.Generator) -> list[tuple[Row, float, float]]:
    values = rng.standard_normal((len(rows), 2))
    return [(row, float(a), float(b)) for row, (a, b) in zip(rows, values, strict=True)]


def test_a_sample_that_jumps_there_and_back_is_dropped(tmp_path: Path) -> None:
    rows = straight(1)
    rows[20] |= {"x": rows[20]["x"] + 5.0}
    table, said = _repaired(tmp_path, rows)
    assert said == "1 samples at jumps over 3 m dropped"
    assert 2000.0 not in table.vehicles.timestamp_ms
    assert len(set(table.vehicles.segment)) == 1


def test_a_track_that_goes_on_elsewhere_is_cut(tmp_path: Path) -> None:
    rows = straight(1, range(20)) + straight(1, range(20, 41), y=6.0)
    table, said = _repaired(tmp_path, rows)
    assert said == "1 tracks cut at jumps over 3 m"
    assert table.vehicles.tracks == 1
    np.testing.assert_array_equal(table.vehicles.segment, [0] * 20 + [1] * 21)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"length": 1000.0}, "longer than 60 m"),
        ({"width": 40.0}, "wider than 8 m"),
        ({"width": 0.001}, "under 0.1 m"),
        ({"speed": 980.0}, "faster than 100 m/s"),
    ],
)
def test_tracks_of_implausible_size_or_speed_are_left_out(
    tmp_path: Path, changes: dict[str, float], words: str
) -> None:
    table, said = _repaired(tmp_path, straight(1) + straight(2, y=8.0, **changes))
    assert table.vehicles.labels == ("1",)
    assert words in said
    assert said.endswith("left out: 2")


def _stop(psi_standing: list[float]) -> list[Row]:
    """Brakes from 10 m/s to a stop in 2 s, stands for the given headings."""
    rows = moving(lambda t: (10.0 * t - 2.5 * t * t, 0.0), 1, range(20))
    for k, psi in enumerate(psi_standing):
        stand = straight(1, [20 + k], speed=0.0, start=10.0, vx=0.001)[0]
        rows.append(stand | {"psi_rad": psi})
    return rows


@pytest.mark.parametrize("standing", [[0.0, np.pi, 0.0, np.pi], [0.3, -0.3, 0.2, 0.0], [np.pi] * 4])
def test_a_vehicle_that_stands_keeps_the_heading_it_had(tmp_path: Path, standing: list[float]) -> None:
    table, said = _repaired(tmp_path, _stop(standing))
    assert said == "headings of 1 tracks flip or jitter while standing: held"
    np.testing.assert_allclose(table.vehicles.psi_rad, 0.0, atol=1e-6)


def _warm_up() -> list[Row]:
    """A filter meets a vehicle that drives 10 m/s: frozen for 0.4 s, then it catches up within a second."""
    rows = straight(1)
    for k, (x, speed) in enumerate([(0.0, 0.4), (0.0, 0.9), (0.0, 1.6), (0.0, 2.6), (0.2, 3.8)]):
        rows[k] |= {"x": x, "vx": speed}
    for k in range(5, 15):
        rows[k] |= {"x": 0.2 + 1.48 * (k - 4), "vx": min(10.0, 3.8 + 0.8 * (k - 4))}
    return rows


def test_the_warm_up_of_a_tracker_is_dropped(tmp_path: Path) -> None:
    table, said = _repaired(tmp_path, _warm_up() + straight(2, y=4.0))
    assert said == "tracker warm-up: first 2 s of 1 of 2 tracks dropped"
    vehicles = table.vehicles
    assert vehicles.timestamp_ms[vehicles.track_id == 1].min() == 2000.0
    assert vehicles.timestamp_ms[vehicles.track_id == 2].min() == 0.0


def test_pedestrians_are_repaired_like_vehicles_and_said_shortly(tmp_path: Path) -> None:
    rows = straight(1, vx=5.0) + straight(2, kind="bike", y=4.0, speed=5.0, vx=2.5)
    table, said = _repaired(tmp_path, rows)
    assert said.endswith("; pedestrians and cyclists: repaired in the same way")
    np.testing.assert_allclose(table.others.vx, 5.0, atol=1e-6)


def _accelerations(table: TrackTable) -> np.ndarray:
    rows = table.vehicles
    same = np.diff(rows.segment) == 0
    return 1000.0 * np.diff(rows.speed)[same] / np.diff(rows.timestamp_ms)[same]


def test_k733_has_too_small_velocities_and_noise(data: Path) -> None:
    raw = read_tracks(data / "taf_bw/recorded_trackfiles/k733_2020-09-15/vehicle_tracks_000.csv")
    table, findings = repair_tracks(raw)
    said = "; ".join(findings)
    factor = re.search(r"velocities of 58 of 58 moving tracks .*\((\d\.\d\d) x too small\)", said)
    assert factor
    assert float(factor[1]) == pytest.approx(1.75, abs=0.03)
    low, high = np.percentile(_accelerations(table), [1, 99])
    assert low > -4.6  # the recording's own velocities: -7.7 and 8.5, its positions: -19 and 19 m/s²
    assert high < 4.0
    assert table.vehicles.speed.max() < 20.0
    assert repair_tracks(table)[1] == ()


@pytest.mark.parametrize("number", range(0, 16, 4))
def test_k729_starts_warm_after_two_seconds_are_dropped(data: Path, number: int) -> None:
    folder = data / "taf_bw/recorded_trackfiles/k729_2022-03-16"
    table, findings = repair_tracks(read_tracks(folder / f"vehicle_tracks_{number:03}.csv"))
    said = "; ".join(findings)
    assert "tracker warm-up" in said
    assert "velocities" not in said
    assert "positions" not in said
    assert np.percentile(_accelerations(table), 99) < 3.5  # before: up to 10.5 m/s²


@pytest.mark.parametrize(
    ("site", "number", "turned"),
    [
        ("DEU_Roundabout_OF", 0, 0),
        ("USA_Roundabout_FT", 0, 0),
        ("USA_Roundabout_SR", 2, 1),
        ("USA_Intersection_EP0", 4, 1),
        ("USA_Intersection_GL", 4, 2),
    ],
)
def test_tracks_of_interaction_are_left_alone_but_for_headings_that_a_note_names(
    data: Path, site: str, number: int, turned: int
) -> None:
    folder = data / "interaction" / "recorded_trackfiles" / f"DR_{site}"
    raw = read_tracks(folder / f"vehicle_tracks_{number:03}.csv.gz")
    table, findings = repair_tracks(raw)
    for name in ("track", "timestamp_ms", "x", "y", "vx", "vy"):
        np.testing.assert_array_equal(getattr(table.vehicles, name), getattr(raw.vehicles, name))
    change = np.abs(np.angle(np.exp(1j * (table.vehicles.psi_rad - raw.vehicles.psi_rad))))
    assert len(np.unique(raw.vehicles.track[change > 1e-3])) == turned
    assert (
        sum(int(tracks) for tracks in re.findall(r"headings of (\d+) tracks", "; ".join(findings))) == turned
    )
