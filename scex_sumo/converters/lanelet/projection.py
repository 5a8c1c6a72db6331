"""UTM projection of places on Earth, as Lanelet2 does it: latitude and longitude to metres, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.road import Georeference


def to_local(degrees: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """Metres (N, 2) east and north of an origin, in the origin's zone.

    Args:
        degrees: (N, 2) latitude, longitude.
        origin: latitude, longitude of the point that becomes (0, 0).
    """
    from lanelet2.core import GPSPoint

    forward = _projector(origin).forward
    points = [forward(GPSPoint(float(lat), float(lon), 0.0)) for lat, lon in degrees]
    return np.array([(p.x, p.y) for p in points]).reshape(-1, 2)


def to_degrees(metres: FloatArray, origin: tuple[float, float], *, absolute: bool = False) -> FloatArray:
    """Latitude and longitude (N, 2) of places in metres.

    Args:
        metres: (N, 2) east and north of the origin.
        origin: latitude, longitude.
        absolute: ``metres`` are UTM's easting and northing in the zone of the origin.

    Raises:
        RuntimeError: they are no place on Earth.
    """
    from lanelet2.core import BasicPoint3d

    reverse = _projector(origin, not absolute).reverse
    places = [reverse(BasicPoint3d(float(x), float(y), 0.0)) for x, y in metres]
    return np.array([(p.lat, p.lon) for p in places]).reshape(-1, 2)


def georeference(origin: tuple[float, float]) -> Georeference | None:
    """The UTM projection that `to_local` uses; None for 0, 0, where maps are drawn that lie nowhere."""
    from lanelet2.core import GPSPoint

    if origin == (0.0, 0.0):
        return None
    lat, lon = origin
    corner = _projector(origin, use_offset=False).forward(GPSPoint(lat, lon, 0.0))
    south = " +south" if lat < 0 else ""
    projection = f"+proj=utm +zone={utm_zone(lat, lon)}{south} +datum=WGS84 +units=m +no_defs"
    return Georeference(projection=projection, east_m=corner.x, north_m=corner.y)


def utm_zone(lat: float, lon: float) -> int:
    """UTM zone of a place; zones are 6 degrees wide but in the south-west of Norway and on Svalbard."""
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
