"""From the map's metres to latitude and longitude, as Lanelet2 reads INTERACTION's maps.

Those maps are written so that a UTM projector with its origin at latitude 0, longitude 0 gives the tracks'
own x and y. This is the inverse, by the series of Krüger (1912) in the third flattening, to fourth order
(less than a micrometre of error here).
"""

from __future__ import annotations

import numpy as np

from scex_sumo.arrays import FloatArray

_FLATTENING = 1 / 298.257223563
_N = _FLATTENING / (2 - _FLATTENING)
_RADIUS = 6378137.0 / (1 + _N) * (1 + _N**2 / 4 + _N**4 / 64)
_SCALE = 0.9996 * _RADIUS
_MERIDIAN = np.radians(3.0)  # of UTM zone 31, which longitude 0 lies in
_ALPHA = (
    _N / 2 - 2 * _N**2 / 3 + 5 * _N**3 / 16 + 41 * _N**4 / 180,
    13 * _N**2 / 48 - 3 * _N**3 / 5 + 557 * _N**4 / 1440,
    61 * _N**3 / 240 - 103 * _N**4 / 140,
    49561 * _N**4 / 161280,
)
_BETA = (
    _N / 2 - 2 * _N**2 / 3 + 37 * _N**3 / 96 - _N**4 / 360,
    _N**2 / 48 + _N**3 / 15 - 437 * _N**4 / 1440,
    17 * _N**3 / 480 - 37 * _N**4 / 840,
    4397 * _N**4 / 161280,
)
_DELTA = (
    2 * _N - 2 * _N**2 / 3 - 2 * _N**3 + 116 * _N**4 / 45,
    7 * _N**2 / 3 - 8 * _N**3 / 5 - 227 * _N**4 / 45,
    56 * _N**3 / 15 - 136 * _N**4 / 35,
    4279 * _N**4 / 630,
)


def to_latitude_longitude(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Latitude and longitude in degrees of points (N, 2) in metres east and north of 0, 0."""
    eta_origin = np.arctanh(np.sin(-_MERIDIAN))
    eta_origin += sum(a * np.sinh(2 * j * eta_origin) for j, a in enumerate(_ALPHA, 1))
    xi, eta = points[:, 1] / _SCALE, points[:, 0] / _SCALE + eta_origin
    xi_sphere = xi - sum(b * np.sin(2 * j * xi) * np.cosh(2 * j * eta) for j, b in enumerate(_BETA, 1))
    eta_sphere = eta - sum(b * np.cos(2 * j * xi) * np.sinh(2 * j * eta) for j, b in enumerate(_BETA, 1))
    chi = np.arcsin(np.sin(xi_sphere) / np.cosh(eta_sphere))
    latitude = chi + sum(d * np.sin(2 * j * chi) for j, d in enumerate(_DELTA, 1))
    longitude = _MERIDIAN + np.arctan2(np.sinh(eta_sphere), np.cos(xi_sphere))
    return np.degrees(latitude), np.degrees(longitude)
