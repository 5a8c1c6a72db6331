"""Plausibility of whole recordings: wrong ones are named by their cause, right ones pass."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import ScexWarning, TrackError
from scex_sumo.converters.cleaning.plausibility import Check, doubts, plausibility
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.datasets.recordings import read_recorded
from scex_sumo.converters.tracks.rows import TrackRows

CARS, RADIUS_M, SPEED_MPS = 6, 30.0, 8.0


def ring(kind: str = "car", *, step_s: float = 0.1) -> TrackRows:
    """Cars that drive around a circle for 10 s, in all directions."""
    steps = round(10.0 / step_s)
    track = np.repeat(np.arange(CARS), steps)
    time_s = np.tile(step_s * np.arange(steps), CARS)
    angle = 2 * np.pi * track / CARS + SPEED_MPS / RADIUS_M * time_s
    heading = (angle + np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    return scex.track_rows(
        track,
        [str(k) for k in range(CARS)],
        [kind] * CARS,
        timestamp_ms=1000.0 * time_s,
        x=RADIUS_M * np.cos(angle),
        y=RADIUS_M * np.sin(angle),
        vx=SPEED_MPS * np.cos(heading),
        vy=SPEED_MPS * np.sin(heading),
        psi_rad=heading,
        length=np.full(len(track), 4.6),
        width=np.full(len(track), 1.8),
    )


def wrong(rows: TrackRows) -> Check:
    (found,) = (check for check in plausibility(rows) if check.verdict)
    return found


@pytest.mark.parametrize("step_s", [0.04, 0.1, 0.2, 0.5])
def test_a_right_recording_passes_at_every_rate(step_s: float) -> None:
    checks = plausibility(ring(step_s=step_s))
    assert [check.verdict for check in checks] == [""] * 6
    assert doubts(checks) == ()


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (lambda r: {"length": r.width, "width": r.length}, "length and width are swapped"),
        (lambda r: {"length": 2 * r.length, "width": 2 * r.width}, "2 x the usual size"),
        (lambda r: {"length": r.length / 2, "width": r.width / 2}, r"0\.49 x the usual size"),
        (lambda r: {"length": 3.28 * r.length, "width": 3.28 * r.width}, "give metres, not feet"),
        (lambda r: {"psi_rad": r.psi_rad + np.pi}, "turned by 180 degrees, vehicles would drive backwards"),
        (lambda r: {"psi_rad": np.pi / 2 - r.psi_rad}, "compass headings"),
        (lambda r: {"psi_rad": -r.psi_rad}, "count clockwise"),
        (lambda r: {"psi_rad": np.rad2deg(r.psi_rad)}, "in degrees"),
        (lambda r: {"psi_rad": r.psi_rad + np.pi / 2}, "90 degrees to the left"),
    ],
)
def test_what_a_run_would_not_survive_is_an_error_with_its_cause(
    columns: Callable[[TrackRows], dict[str, Any]], said: str
) -> None:
    rows = ring()
    found = wrong(rows.with_columns(**columns(rows)))
    assert found.verdict == "error"
    with pytest.raises(TrackError, match=said):
        raise TrackError(found.problem)


def test_a_copy_of_a_car_beside_it_is_named_where_it_is_present() -> None:
    rows = ring()
    aside = {"x": rows.x - np.sin(rows.psi_rad), "y": rows.y + np.cos(rows.psi_rad)}
    moved = rows.with_columns(**{k: np.where(rows.track == 0, aside[k], getattr(rows, k)) for k in aside})
    copy = moved.take(moved.track == 0)
    both = scex.track_rows(
        np.concatenate([rows.track, np.full(len(copy), CARS)]),
        [*rows.labels, "99"],
        [*rows.types, "car"],
        **{
            name: np.concatenate([getattr(rows, name), getattr(copy, name)])
            for name in ("timestamp_ms", "x", "y", "vx", "vy", "psi_rad", "length", "width")
        },
    )
    found = wrong(both)
    assert found.pairs == (("0", "99"),)
    assert doubts([found], {"0", "99"}) == (f"warning: {found.problem}",)
    assert doubts([found], {"0", "1"}) == ()


def test_a_queue_bumper_to_bumper_is_not_doubled() -> None:
    rows = ring()
    queue = rows.with_columns(x=4.7 * rows.track, y=0.0 * rows.y, psi_rad=0.0 * rows.psi_rad)
    assert not any(check.pairs for check in plausibility(queue))


MAP = scex.example_path("urban_intersection")


def changed(folder: Path, change: Callable[[dict[str, str]], None]) -> Path:
    """The example's recording with changed rows."""
    with MAP.with_suffix(".csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        change(row)
    path = folder / "tracks.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return path


def test_a_scene_that_would_drive_backwards_is_refused_without_force(tmp_path: Path) -> None:
    path = changed(tmp_path, lambda row: row.update(psi_rad=str(float(row["psi_rad"]) + math.pi)))
    with pytest.raises(
        TrackError, match=r"drive backwards; add pi; read_seed\(..., force=True\) runs it all the same"
    ):
        scex.read_seed(MAP, tracks=path)
    with pytest.warns(ScexWarning, match="drive backwards"):
        assert scex.read_seed(MAP, tracks=path, force=True).vehicles > 5


def test_inspect_shows_the_table_of_a_recording_that_run_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from scex_sumo.studies.inspection.command import inspect_command

    path = changed(tmp_path, lambda row: row.update(length=row["width"], width=row["length"]))
    answer = inspect_command(MAP, tracks=path)()
    (sizes,) = (check for check in answer["checks"] if check["name"].startswith("sizes"))
    assert sizes["verdict"] == "error" and "swapped" in sizes["problem"]
    assert "plausibility of the recording" in capsys.readouterr().out


def test_no_recording_at_hand_is_refused_or_warned_without_reason(data: Path) -> None:
    """MONA's trackers saw some lorries twice; k733 2020's velocities are wrong."""
    for root in ("interaction", "taf_bw", "ngsim", "av2", "scenarionet", "mona"):
        # A part of the large sets.
        step = {"interaction": 96, "taf_bw": 4, "ngsim": 16, "mona": 12, "av2": 3}.get(root, 1)
        for recording in find_recordings([data / root])[::step]:
            rows = read_recorded(recording.track_paths)[0].vehicles
            found = [check for check in plausibility(rows) if check.verdict]
            wanted = ["warning"] if root == "mona" else ["repaired"] if "k733" in recording.name else []
            assert [check.verdict for check in found] == wanted, (recording.name, found)
            assert all(check.pairs for check in found) or "k733" in recording.name
