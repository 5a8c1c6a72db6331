"""One moment of a recording becomes a seed scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.recordings import recorded_scene
from scex_sumo.scene import SeedScene
from tests.converters.track_files import CASE_COLUMNS, Row, in_case, moving, straight, write_rows


def _seed(tmp_path: Path, rows: list[Row], **options: object) -> SeedScene:
    columns = CASE_COLUMNS if "case_id" in rows[0] else CASE_COLUMNS[1:]
    tracks = write_rows(tmp_path / "vehicle_tracks_007.csv", rows, columns)
    return recorded_scene(tmp_path / "town.osm", tracks=tracks, **options)  # type: ignore[arg-type]


def test_a_moment_has_its_last_second_and_its_recorded_future(tmp_path: Path) -> None:
    scene = _seed(tmp_path, straight(5, range(60), start=100.0, y=2.0), time_s=2.0)
    assert scene.track_ids.tolist() == [5]
    assert scene.types == ("car",)
    assert scene.time_s == 2.0
    np.testing.assert_allclose(scene.history.x[0], 110.0 + np.arange(11))
    np.testing.assert_allclose(scene.history.y, 2.0)
    np.testing.assert_allclose(scene.history.speed, 10.0)
    np.testing.assert_allclose(scene.history.heading, 0.0)
    assert scene.recorded_steps.tolist() == [10]
    assert scene.future is not None
    assert scene.future_valid is not None
    assert scene.future_valid.sum() == 39  # frames 21 to 59
    np.testing.assert_allclose(scene.future.x[0], 121.0 + np.arange(80))  # goes on after the recording's end
    assert scene.notes == ()
    assert (scene.length[0], scene.width[0]) == (4.5, 1.8)


def test_a_vehicle_without_a_past_gets_one_at_constant_velocity_and_it_is_said(tmp_path: Path) -> None:
    late = moving(lambda t: (0.0, 6.0 * t), 2, range(17, 60))
    scene = _seed(tmp_path, straight(1, range(60), y=-9.0) + late, time_s=2.0)
    assert scene.recorded_steps.tolist() == [10, 3]
    np.testing.assert_allclose(scene.history.y[1], 0.6 * np.arange(10, 21), atol=1e-9)
    np.testing.assert_allclose(scene.history.x[1], 0.0, atol=1e-9)
    np.testing.assert_allclose(scene.history.heading[1], np.pi / 2)
    assert scene.notes == ("1 of 2 vehicles came within the last second: constant velocity before",)


def _cases() -> list[Row]:
    frames = range(1, 41)
    rows = in_case("1.0", straight(1, frames))
    rows += in_case("2.0", straight(1, frames) + straight(2, frames, y=4.0))
    return rows + in_case("11.0", straight(3, range(20, 41)))


def test_the_moment_of_a_case_is_frame_10(tmp_path: Path) -> None:
    scene = _seed(tmp_path, _cases(), case="1.0")
    assert scene.time_s == 1.0
    assert scene.history.x[0, -1] == 10.0
    assert scene.recorded_steps.tolist() == [9]
    np.testing.assert_allclose(scene.history.x[0], np.arange(11), atol=1e-9)
    assert scene.future_valid is not None
    assert scene.future_valid.sum() == 30
    assert scene.notes == ("9 of 10 previous steps recorded, constant velocity before",)


@pytest.mark.parametrize(
    ("rows", "options", "words"),
    [
        (_cases(), {"case": "7"}, ["no case 7", "3 cases: 1.0, 2.0, 11.0"]),
        (_cases(), {"case": "11"}, ["case 11.0", "no vehicle in frame 10", "--time S"]),
        (_cases(), {"case": "1", "time_s": 9.0}, ["no moment at 9 s", "0.1 to 4.0 s", "--time"]),
        (straight(1), {"case": "1"}, ["no case_id column", "--time S"]),
        (straight(1), {"time_s": 4.2}, ["no moment at 4.2 s", "spans 0.0 to 4.0 s", "--time"]),
        (straight(1), {"time_s": -1.0}, ["no moment at -1 s", "spans 0.0 to 4.0 s"]),
        (straight(1), {"time_s": float("nan")}, ["no moment at nan s"]),
        (straight(1, kind="pedestrian"), {}, ["no motor vehicle", "only pedestrian"]),
        (
            straight(1, range(10)) + straight(2, range(30, 41)),
            {"time_s": 2.0},
            ["no vehicle at 2 s", "nearest moment with one is"],
        ),
    ],
)
def test_a_wrong_case_or_a_moment_without_vehicles_is_an_error_that_helps(
    tmp_path: Path, rows: list[Row], options: dict[str, object], words: list[str]
) -> None:
    with pytest.raises(TrackError) as error:
        _seed(tmp_path, rows, **options)
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


def _marked(tmp_path: Path, marks: tuple[str, str]) -> SeedScene:
    columns = [*CASE_COLUMNS, "track_to_predict", "interesting_agent"]
    rows = in_case("a", straight(1, track_to_predict="0", interesting_agent="0"))
    rows += in_case("a", straight(2, y=4.0, **dict(zip(columns[-2:], marks, strict=True))))
    tracks = write_rows(tmp_path / "marks.csv", rows, columns)
    return recorded_scene(tmp_path / "town.osm", tracks=tracks, time_s=1.0)


def test_vehicles_of_a_case_are_marked_whatever_its_name(tmp_path: Path) -> None:
    source = _marked(tmp_path, ("1.0", "")).source
    assert (source["case"], source["to_predict"], source["interesting"]) == ("a", ["2"], [])


def test_a_mark_that_is_no_number_is_an_error_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(TrackError, match=r"line 43: track_to_predict is 'yes', not a number; repair"):
        _marked(tmp_path, ("yes", "0"))


def _turn(t: float) -> tuple[float, float]:
    """A circle of 20 m at 8 m/s whose heading passes through pi after 2 s."""
    phi = np.pi + 0.4 * (t - 2.0)
    return 20.0 * np.sin(phi), -20.0 * np.cos(phi)


@pytest.mark.parametrize("step_ms", [40.0, 1000.0 / 30.0, 200.0])
def test_other_rates_are_interpolated_to_ten_hertz(tmp_path: Path, step_ms: float) -> None:
    rows = moving(_turn, 1, range(int(6000 / step_ms)), step_ms=step_ms)
    scene = _seed(tmp_path, rows, time_s=2.0)
    t = scene.time_s + 0.1 * np.arange(-10, 1)
    expected = np.array([_turn(value) for value in t]).T
    # The cubic is off by p'''' dt⁴ / 384 < 1e-5 m; stamps are rounded: 8 m/s * 0.5 ms.
    np.testing.assert_allclose(scene.history.x[0], expected[0], atol=0.006)
    np.testing.assert_allclose(scene.history.y[0], expected[1], atol=0.006)
    turned = np.angle(np.exp(1j * (scene.history.heading[0] - 0.4 * (t - 2.0) - np.pi)))
    np.testing.assert_allclose(turned, 0.0, atol=0.002)  # through the step from pi to -pi
    np.testing.assert_allclose(scene.history.speed, 8.0, atol=0.01)  # chord of 0.08 rad: 1 - cos(0.04)
    assert f"recorded at {1000 / step_ms:.3g} Hz: interpolated to 10 Hz" in scene.notes


def test_pedestrians_present_at_the_moment_are_obstacles(tmp_path: Path) -> None:
    rows = straight(1, range(60))
    rows += straight(2, range(15, 31), speed=1.0, kind="Pedestrian", y=5.0)
    rows += straight(3, range(25, 60), speed=1.0, kind="Bike", y=7.0)  # not yet there
    obstacles = _seed(tmp_path, rows, time_s=2.0).obstacles
    assert obstacles is not None
    assert obstacles.ids == ("2",)
    assert obstacles.types == ("pedestrian",)
    assert obstacles.states.shape == (1, 91)
    assert obstacles.present[0, :5].tolist() == [False] * 5
    assert obstacles.present[0, 5:].all()
    np.testing.assert_allclose(obstacles.states.x[0], 1.0 + 0.1 * np.arange(91))  # goes on after frame 30


def test_k733_at_one_minute(data: Path) -> None:
    scene = recorded_scene(data / "taf_bw/maps/k733_2020-09-15.osm", time_s=60.0)
    assert scene.name == "k733_2020-09-15_000_t60.0"
    assert scene.vehicles == 9
    assert scene.obstacles is not None
    assert sum("1.74 x too small" in note for note in scene.notes) == 1
    # What a history says and what it shows agree: the positions move as fast as the speeds.
    step = np.hypot(np.diff(scene.history.x), np.diff(scene.history.y)) / 0.1
    mean = (scene.history.speed[:, 1:] + scene.history.speed[:, :-1]) / 2.0
    recorded = np.arange(10) >= 10 - scene.recorded_steps[:, None]
    assert np.abs(step - mean)[recorded].max() < 0.5


def test_the_cases_of_version_1_2_are_found(data: Path) -> None:
    tracks = data / "interaction/cases/v12_case_format_sample.csv"
    scene = recorded_scene(data / "interaction/maps/DR_DEU_Roundabout_OF.osm", tracks=tracks, case=2)
    assert scene.track_ids.tolist() == [2, 3, 4, 5, 6, 7]
    assert scene.recorded_steps.tolist() == [9] * 6
    assert scene.future_valid is not None
    assert scene.future_valid.sum(axis=1).tolist() == [7] * 6  # 17 frames
    assert scene.obstacles is not None
    assert scene.obstacles.ids == ("1",)
