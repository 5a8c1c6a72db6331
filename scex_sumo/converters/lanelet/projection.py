"""UTM projection of latitude and longitude to metres and back, as Lanelet2 computes it; distances."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.road import Georeference

METRES_PER_DEGREE = 111_195.0  # of latitude, on the sphere of 6371 km
STRAY_M = 50_000.0  # a recorded site spans a few km


def to_local(degrees: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """Project (N, 2) latitudes and longitudes to metres east and north of an origin, in its zone."""
    from lanelet2.core import GPSPoint

    forward = _projector(origin).forward
    points = [forward(GPSPoint(float(lat), float(lon), 0.0)) for lat, lon in degrees]
    return np.array([(p.x, p.y) for p in points]).reshape(-1, 2)


def to_degrees(metres: FloatArray, origin: tuple[float, float], *, absolute: bool = False) -> FloatArray:
    """Return (N, 2) latitudes and longitudes of places in metres east and north of an origin.

    With ``absolute`` they are UTM's easting and northing in its zone. `RuntimeError` for no place on Earth.
    """
    from lanelet2.core import BasicPoint3d

    reverse = _projector(origin, not absolute).reverse
    places = [reverse(BasicPoint3d(float(x), float(y), 0.0)) for x, y in metres]
    return np.array([(p.lat, p.lon) for p in places]).reshape(-1, 2)


def georeference(origin: tuple[float, float]) -> Georeference:
    """Return the UTM projection that `to_local` uses."""
    from lanelet2.core import GPSPoint

    lat, lon = origin
    corner = _projector(origin, use_offset=False).forward(GPSPoint(lat, lon, 0.0))
    south = " +south" if lat < 0 else ""
    projection = f"+proj=utm +zone={utm_zone(lat, lon)}{south} +datum=WGS84 +units=m +no_defs"
    return Georeference(projection=projection, east_m=corner.x, north_m=corner.y)


def utm_zone(lat: float, lon: float) -> int:
    """Return the UTM zone of a place: 6 degrees wide, except in south-west Norway and on Svalbard."""
    lon = (lon + 180.0) % 360.0 - 180.0
    if 56.0 <= lat < 64.0 and 3.0 <= lon < 12.0:
        return 32
    if 72.0 <= lat < 84.0 and 0.0 <= lon < 42.0:
        return 31 + 2 * sum(lon >= edge for edge in (9.0, 21.0, 33.0))
    return int((lon + 180.0) // 6.0) + 1


def _projector(origin: tuple[float, float], use_offset: bool = True) -> Any:
    from lanelet2.io import Origin
    from lanelet2.projection import UtmProjector

    return UtmProjector(Origin(*map(float, origin)), use_offset, False)


def distance_m(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return the rough distance of two places, m; enough to tell near from far."""
    east = (a[1] - b[1]) * math.cos(math.radians((a[0] + b[0]) / 2))
    return math.hypot(a[0] - b[0], east) * METRES_PER_DEGREE
