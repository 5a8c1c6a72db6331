"""UTM projection of places on Earth, as Lanelet2 does it: latitude and longitude to metres, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from scex_sumo.arrays import FloatArray


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


def _projector(origin: tuple[float, float], use_offset: bool = True) -> Any:
    from lanelet2.io import Origin
    from lanelet2.projection import UtmProjector

    return UtmProjector(Origin(*map(float, origin)), use_offset, False)
