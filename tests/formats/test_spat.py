"""Recorded signal phases as a SUMO traffic light, on a crossing drawn by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.projection import to_local
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from tests.converters.sumo_roads import NetFile, lane, load, road

ORIGIN = (49.0, 8.4)
CONNECTION = """<Placemark><name>Lane {source}</name>
<LineString><coordinates>{line}</coordinates></LineString><ExtendedData>
<Data name="Source"><value>{source}</value></Data><Data name="Sink"><value>{sink}</value></Data>
<Data name="SignalGroup"><value>{group}</value></Data></ExtendedData></Placemark>"""


def crossing() -> Road:
    """Lanes 1-2-3 run east, 4-5-6 north; 2 and 5 cross at the origin."""
    drawn = road(
        [
            lane(1, [(-80, 0), (-15, 0)], to=(2,)),
            lane(2, [(-15, 0), (15, 0)], to=(3,)),
            lane(3, [(15, 0), (80, 0)]),
            lane(4, [(0, -80), (0, -15)], to=(5,)),
            lane(5, [(0, -15), (0, 15)], to=(6,)),
            lane(6, [(0, 15), (0, 80)]),
        ]
    )
    return Road(name="signals", lanes=drawn.lanes, origin=ORIGIN)


def degrees(points: list[tuple[float, float]]) -> str:
    """Local metres as KML coordinates, by inverting the projection a few times."""
    target = np.array(points, dtype=float)
    guess = np.tile(np.array(ORIGIN), (len(points), 1))
    for _ in range(5):
        miss = target - to_local(guess, ORIGIN)
        guess += miss[:, ::-1] / (111_200.0, 111_200.0 * np.cos(np.radians(ORIGIN[0])))
    return " ".join(f"{lon:.9f},{lat:.9f},0" for lat, lon in guess)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """East is green for the first 10 s, then yellow for 3 s; north from 15 s to 25 s; 30 s recorded."""
    marks = [
        CONNECTION.format(source=1, sink=3, group=1, line=degrees([(-15, 0.5), (-60, 0.5)])),
        CONNECTION.format(source=3, sink="", group="", line=degrees([(15, 0), (60, 0)])),
        CONNECTION.format(source=4, sink=6, group=2, line=degrees([(0.5, -14), (0.5, -60)])),
        CONNECTION.format(source=6, sink="", group="", line=degrees([(0, 15), (0, 60)])),
    ]
    kml = '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'
    (tmp_path / "crossing.kml").write_text(kml.format("".join(marks)))
    rows = ["signal_group_id,timestamp_ms,movement_state"]
    for t in range(0, 30_001, 1000):
        east = "PERMISSIVE_MOVEMENT_ALLOWED" if t < 10_000 else "PERMISSIVE_CLEARANCE" if t < 13_000 else ""
        north = "PROTECTED_MOVEMENT_ALLOWED" if 15_000 <= t < 25_000 else ""
        north = north or ("PERMISSIVE_CLEARANCE" if 25_000 <= t < 28_000 else "")
        rows += [f"{g},{t},{state or 'STOP_AND_REMAIN'}" for g, state in ((1, east), (2, north))]
    path = tmp_path / "signal_phases.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_the_recording_is_replayed(recording: Path, tmp_path: Path) -> None:
    net = convert(crossing(), tmp_path / "net.net.xml", signals=recording)
    assert load(net.path) == ""
    file = NetFile(net.path)
    east, north = (next(c for c in file.connections.values() if c.get("from") == e) for e in ("l1", "l4"))
    assert east.get("tl") == north.get("tl") == "tl_recorded"
    [light] = list(file.root.iter("tlLogic"))
    assert light.get("offset") == "0"
    played = [
        (
            float(p.get("duration", "")),
            *(p.get("state", "")[int(c.get("linkIndex", ""))] for c in (east, north)),
        )
        for p in light.iter("phase")
    ]
    assert [(s, a.upper(), b.upper()) for s, a, b in played] == [
        (10, "G", "R"),
        (3, "Y", "R"),
        (2, "R", "R"),
        (10, "R", "G"),
        (3, "R", "Y"),
        (2, "R", "R"),
    ]


def test_lights_that_belong_to_no_lane_are_said(recording: Path, tmp_path: Path) -> None:
    far = road([lane(1, [(500, 500), (600, 500)], to=(2,)), lane(2, [(600, 500), (700, 500)])])
    drawn = Road(name="far", lanes=far.lanes, origin=ORIGIN)
    net = convert(drawn, tmp_path / "net.net.xml", signals=recording)
    assert net.notes == ("no connection of the net belongs to a movement of signal_phases.csv: no lights",)


def test_a_recording_without_its_intersection_is_refused(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "crossing.kml").unlink()
    with pytest.raises(MapError, match="no KML of the intersection"):
        convert(crossing(), tmp_path / "net.net.xml", signals=recording)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("timestamp_ms", "time", "no timestamp_ms in it"),
        ("STOP_AND_REMAIN", "HALT", "no signal phases can be read: movement_state is 'HALT'"),
        (",STOP_AND_REMAIN", "", "no signal phases can be read: movement_state is ''"),
    ],
)
def test_other_columns_and_unknown_states_are_refused(
    old: str, new: str, said: str, recording: Path, tmp_path: Path
) -> None:
    text = recording.read_text()
    assert old in text
    recording.write_text(text.replace(old, new))
    with pytest.raises(MapError, match=said):
        convert(crossing(), tmp_path / "net.net.xml", signals=recording)


@pytest.mark.parametrize("wrong", ["east,north,0", "8.4", "nan,nan,0", "8.4,1000,0"])
def test_a_word_as_a_coordinate_is_refused(wrong: str, recording: Path, tmp_path: Path) -> None:
    file = tmp_path / "crossing.kml"
    place = degrees([(-15, 0.5)])
    file.write_text(file.read_text().replace(place, wrong, 1))
    with pytest.raises(MapError, match=r"crossing\.kml: lane 1: .*; needs degrees"):
        convert(crossing(), tmp_path / "net.net.xml", signals=recording)


def test_utm_agrees_with_lengths_on_the_ellipsoid() -> None:
    """On the zone's central meridian UTM is 0.9996 times the length of the meridian."""
    a, e2 = 6378137.0, 0.00669437999014
    lat = np.radians(np.linspace(48.0, 49.0, 20001))
    radius = a * (1 - e2) / (1 - e2 * np.sin(lat) ** 2) ** 1.5
    meridian = float(np.sum((radius[1:] + radius[:-1]) / 2 * np.diff(lat)))
    [[east, north]] = to_local(np.array([[49.0, 9.0]]), (48.0, 9.0))
    assert east == pytest.approx(0.0, abs=1e-6)
    assert north == pytest.approx(0.9996 * meridian, abs=1e-3)
    # East of it, a minute of longitude is a cos(lat) / sqrt(1 - e2 sin2 lat) wide.
    [[east, _]] = to_local(np.array([[49.0, 9.0 + 1 / 60]]), (49.0, 9.0))
    width = (
        a / np.sqrt(1 - e2 * np.sin(np.radians(49.0)) ** 2) * np.cos(np.radians(49.0)) * np.radians(1 / 60)
    )
    assert east == pytest.approx(0.9996 * width, abs=1e-3)
