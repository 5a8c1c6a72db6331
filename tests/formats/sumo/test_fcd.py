from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.formats.sumo.fcd import read_fcd


def fcd(times: list[float], *, angle: float = 90.0, kind: str = "passenger", name: str = "7") -> str:
    """A vehicle at 10 m/s eastwards whose front bumper is at x = 10 t."""
    rows = "".join(
        f'<timestep time="{t}"><vehicle id="{name}" x="{10 * t}" y="5" angle="{angle}" type="{kind}" '
        f'speed="10" pos="0" lane="a_0" slope="0"/></timestep>'
        for t in times
    )
    return f"<fcd-export>{rows}</fcd-export>"


def test_centres_lie_half_a_length_behind_the_front_and_angles_count_from_the_east(tmp_path: Path) -> None:
    file = tmp_path / "a.fcd.xml"
    file.write_text(fcd([0.0, 0.1, 0.2]))
    table, findings = read_fcd(file)
    rows = table.vehicles
    np.testing.assert_allclose(rows.x, [-2.5, -1.5, -0.5])  # SUMO's passenger car is 5 m long
    np.testing.assert_allclose(rows.y, 5.0)
    np.testing.assert_allclose(rows.psi_rad, 0.0, atol=1e-12)
    assert (rows.labels, rows.types, table.step_s) == (("7",), ("car",), pytest.approx(0.1))
    assert findings == (
        "vehicle sizes are not recorded: SUMO's default sizes are used, by the names of the types",
    )


@pytest.mark.parametrize("changes", [[50], [1], [98], [40, 52]], ids=str)
def test_a_lane_change_in_one_step_is_drawn_over_the_steps_around(changes: list[int], tmp_path: Path) -> None:
    lane = np.zeros(101)
    for change in changes:
        lane[change:] += 3.2
    rows = "".join(
        f'<timestep time="{k / 10}"><vehicle id="7" x="{k}" y="{y}" angle="90" speed="10" /></timestep>'
        for k, y in enumerate(lane)
    )
    file = tmp_path / "a.fcd.xml"
    file.write_text(f"<fcd-export>{rows}</fcd-export>")
    table, findings = read_fcd(file)
    assert f"{len(changes)} lane changes in one step: drawn over 3 s" in findings
    drawn = table.vehicles
    aside = drawn.y + drawn.length / 2 * np.sin(drawn.psi_rad)
    assert (aside[0], aside[-1]) == pytest.approx((lane[0], lane[-1]))
    within_s = 3.0 if len(changes) == 1 else 1.2 + 1.5  # each side of the middle between two has its own time
    assert np.diff(aside).min() >= -1e-9 and np.diff(aside).max() < 1.51 * 0.1 * 3.2 * len(changes) / within_s
    along = np.arctan2(drawn.vy, drawn.vx)  # vehicles head where they go
    np.testing.assert_allclose(np.tan(along[1:-1]), (aside[2:] - aside[:-2]) / 2, atol=0.02)
    table, findings = repair_tracks(table)
    assert table.vehicles.segment.max() == 0 and not any("jump" in phrase for phrase in findings)


def test_parquet_is_read_alike(tmp_path: Path) -> None:
    columns = {
        "timestep_time": [0.0, 0.1],
        "vehicle_id": ["3", "3"],
        "vehicle_x": [0.0, 1.0],
        "vehicle_y": [0.0, 0.0],
        "vehicle_angle": [90.0, 90.0],
        "vehicle_speed": [10.0, 10.0],
        "vehicle_type": ["bus", "bus"],
    }
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    rows = read_fcd(tmp_path / "a.parquet")[0].vehicles
    np.testing.assert_allclose(rows.x, [-6.0, -5.0])
    assert rows.types == ("bus",)


def test_what_is_no_fcd_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.fcd.xml"
    file.write_text("<fcd-export></fcd-export>")
    with pytest.raises(TrackError, match="no vehicle in it"):
        read_fcd(file)
    file.write_text("<fcd-export><timestep")
    with pytest.raises(TrackError, match="no fcd-output of SUMO can be read: not XML"):
        read_fcd(file)
    file.write_text('<?xml version="1.0" encoding="UTF-1"?><fcd-export/>')
    with pytest.raises(TrackError, match="unknown encoding"):
        read_fcd(file)
    pq.write_table(pa.table({"time": [0.0]}), tmp_path / "b.parquet")
    with pytest.raises(TrackError, match="no column id"):
        read_fcd(tmp_path / "b.parquet")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('y="5"', 'y="nan"', "y of vehicle 7 at 0 s is missing"),
        ('x="0.0"', 'x="1e300"', r"x of vehicle 7 at 0 s is 1e\+300"),
        ('time="0.1"', 'time="60"', "simulated in steps of 60 s, 0.001 to 2 s are read"),
    ],
)
def test_implausible_data_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    file = tmp_path / "a.fcd.xml"
    file.write_text(fcd([0.0, 0.1]).replace(old, new, 1))
    with pytest.raises(TrackError, match=words):
        read_fcd(file)


def test_positions_in_degrees_are_named(tmp_path: Path) -> None:
    file = tmp_path / "geo.fcd.xml"
    steps = "".join(
        f'<timestep time="{k / 10}"><vehicle id="7" x="{8.4 + k * 1.4e-5}" y="49" angle="90" speed="10"/>'
        "</timestep>"
        for k in range(3)
    )
    file.write_text(f"<fcd-export>{steps}</fcd-export>")
    with pytest.raises(
        TrackError, match=r"positions are in degrees; simulate again without --fcd-output\.geo"
    ):
        read_fcd(file)
