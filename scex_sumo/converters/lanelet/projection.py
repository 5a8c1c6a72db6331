"""Universal transverse Mercator, forward: what a map's coordinates are projected with."""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray

_A, _F = 6378137.0, 1 / 298.257223563  # WGS 84
_N = _F / (2 - _F)
_RADIUS = _A / (1 + _N) * (1 + _N**2 / 4 + _N**4 / 64)
_ALPHA = (
    _N / 2 - 2 * _N**2 / 3 + 5 * _N**3 / 16,
    13 * _N**2 / 48 - 3 * _N**3 / 5,
    61 * _N**3 / 240,
)
_SCALE, _EASTING = 0.9996, 500_000.0


def to_local(degrees: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """UTM coordinates (N, 2) relative to an origin, in the origin's zone, m.

    Args:
        degrees: (N, 2) latitude, longitude.
        origin: latitude, longitude of the point that becomes (0, 0).

    Source: Krüger 1912, series to third order in n; better than a millimetre within a zone.
    """
    centre = np.floor((origin[1] + 180) / 6) * 6 - 177
    return _utm(degrees, centre) - _utm(np.array([origin]), centre)


def to_degrees(metres: tuple[float, float], near: tuple[float, float]) -> tuple[float, float]:
    """Latitude and longitude of UTM coordinates, in the zone of a place near them.

    Args:
        metres: easting and northing, m.
        near: latitude, longitude.

    Source: the forward projection, inverted by fixed-point steps that end below a micrometre.
    """
    centre = np.floor((near[1] + 180) / 6) * 6 - 177
    place = np.array([near], np.float64)
    for _ in range(50):
        off = np.array([metres]) - _utm(place, centre)
        if np.abs(off).max() < 1e-6:
            break
        place += np.degrees(off[:, ::-1] / _A) / np.array([1.0, np.cos(np.radians(near[0]))])
    return float(place[0, 0]), float(place[0, 1])


def _utm(degrees: FloatArray, centre: float) -> FloatArray:
    lat, lon = np.radians(degrees[:, 0]), np.radians(degrees[:, 1] - centre)
    e = 2 * np.sqrt(_N) / (1 + _N)
    t = np.sinh(np.arctanh(np.sin(lat)) - e * np.arctanh(e * np.sin(lat)))
    xi, eta = np.arctan2(t, np.cos(lon)), np.arctanh(np.sin(lon) / np.sqrt(1 + t**2))
    north, east = xi.copy(), eta.copy()
    for j, a in enumerate(_ALPHA, start=1):
        north += a * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
        east += a * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
    return np.stack([_EASTING + _SCALE * _RADIUS * east, _SCALE * _RADIUS * north], axis=1)
