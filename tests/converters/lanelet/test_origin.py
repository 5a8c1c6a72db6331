"""Where a map's coordinates begin."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.file import read_map_file
from scex_sumo.converters.lanelet.origin import recorded_origin
from scex_sumo.converters.lanelet.projection import to_local
from scex_sumo.converters.lanelet.reader import map_origin, read_road
from tests.converters.maps import draw_map, straight

KARLSRUHE = (49.01, 8.43)


def find_origin(
    path: Path,
    *,
    tracks_path: Path | None = None,
    origin: tuple[float, float] | None = None,
    own_corner: bool = False,
) -> tuple[float, float]:
    """As maps are read: by the user, by files beside it, by its coordinates."""
    origin = origin or recorded_origin(path, tracks_path=tracks_path)
    return origin or map_origin(read_map_file(path), own_corner=own_corner)


def map_at(path: Path, place: tuple[float, float]) -> Path:
    """A lanelet of about 111 m by 4 m whose south-west corner is at a place."""
    (lat, lon), (north, east) = place, (4e-5, 1e-3)
    corners = [(lat + north, lon), (lat + north, lon + east), (lat, lon), (lat, lon + east)]
    nodes = "".join(f"<node id='{i}' lat='{a!r}' lon='{b!r}'/>" for i, (a, b) in enumerate(corners, 1))
    ways = "<way id='5'><nd ref='1'/><nd ref='2'/></way><way id='6'><nd ref='3'/><nd ref='4'/></way>"
    members = "<member type='way' ref='5' role='left'/><member type='way' ref='6' role='right'/>"
    lanelet = f"<relation id='7'>{members}<tag k='type' v='lanelet'/></relation>"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"<osm version='0.6'>{nodes}{ways}{lanelet}</osm>")
    return path


def meta_data(folder: Path, lat: str = "49.5", lon: str = "8.5") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "meta_data.csv"
    path.write_text(f"id,originLat,originLon,duration\n000,{lat},{lon},60\n")
    return path


def test_the_recordings_meta_data_give_the_origin(tmp_path: Path) -> None:
    meta_data(tmp_path / "tracks")
    tracks = tmp_path / "tracks" / "vehicle_tracks_000.csv"
    assert find_origin(map_at(tmp_path / "a.osm", KARLSRUHE), tracks_path=tracks) == (49.5, 8.5)


def test_an_unknown_origin_is_an_error_that_says_how(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"the origin .* not known: no meta_data.csv[^0-9]* --origin LAT,LON"):
        find_origin(map_at(tmp_path / "a.osm", KARLSRUHE))


def test_a_map_by_itself_begins_at_its_own_corner_and_says_so(tmp_path: Path) -> None:
    path = map_at(tmp_path / "a.osm", KARLSRUHE)
    assert find_origin(path, own_corner=True) == KARLSRUHE
    road = read_road(path)
    assert road.origin == KARLSRUHE
    assert road.notes == ("origin unknown: coordinates begin at the map's corner 49.0100000,8.4300000",)
    np.testing.assert_allclose(road.lanes[7].right_bound[0], (0.0, 0.0), atol=1e-6)


def test_the_real_maps_origins(data: Path) -> None:
    assert find_origin(data / "interaction/maps/DR_DEU_Merging_MT.osm") == (0.0, 0.0)
    assert find_origin(data / "taf_bw/maps/k733_2020-09-15.osm") == (49.005306, 8.4374089)
    tracks = data / "taf_bw/recorded_trackfiles/k729_2022-03-16/vehicle_tracks_000.csv"
    found = find_origin(data / "taf_bw/maps/k729_2022-03-16.osm", tracks_path=tracks)
    assert found == (49.01160993928274, 8.43856470258739)


def with_local(text: str, east: float, north: float, *, degrees: str | None = None, every: int = 1) -> str:
    """A drawn map with local coordinates as in Autoware, shifted; ``degrees`` replaces lat and lon."""
    number = itertools.count()

    def tagged(match: re.Match[str]) -> str:
        [[x, y]] = to_local(np.array([[float(match[2]), float(match[3])]]), (0.0, 0.0))
        lat, lon = (match[2], match[3]) if degrees is None else (degrees, degrees)
        tags = f"<tag k='local_x' v='{x + east}'/><tag k='local_y' v='{y + north}'/>"
        marked = next(number) % every == 0
        return f"<node id='{match[1]}' lat='{lat}' lon='{lon}'>{tags if marked else ''}</node>"

    return re.sub(r"<node id='(\d+)' lat='([^']*)' lon='([^']*)'></node>", tagged, text)


@pytest.mark.parametrize("degrees", ["", "35.2", "nan", "1e9"])
@pytest.mark.parametrize("corner", [(0.0, 0.0), (89571.0, 42301.0), (412_000.0, 5_430_000.0)])
def test_local_coordinates_count_where_the_nodes_have_them(
    degrees: str, corner: tuple[float, float], tmp_path: Path
) -> None:
    path = tmp_path / "autoware.osm"
    path.write_text(with_local(draw_map([straight(1, 0, 50), straight(2, 50, 90)]), *corner, degrees=degrees))
    for origin in (None, (49.0, 8.4)):
        road = read_road(path, origin=origin)
        expected = np.add(corner, [(0, 1.75), (50, 1.75)])
        np.testing.assert_allclose(road.lanes[1].centreline[[0, -1]], expected, atol=1e-5)
        assert road.lanes[1].successors == (2,)
        assert (road.origin, road.georeference) == ((0.0, 0.0), None)
        unused = ("origin 49,8.4 not used: the map's coordinates are local",) if origin else ()
        assert road.notes == ("coordinates are those of the tags local_x and local_y", *unused)
    assert find_origin(path) == (0.0, 0.0)
