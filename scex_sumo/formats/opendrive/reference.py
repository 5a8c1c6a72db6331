"""Reference line of an OpenDRIVE road, and the cubic polynomials along it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray

SAGITTA_M = 0.002  # between a curve and the line through its points
STEP_M = (0.1, 1.0)  # between points
MAX_POINTS = 1_000_000  # of a road
SHORT_M = 1e-6  # a stretch without length
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def number(element: Element, name: str, default: str | None = None) -> float:
    """Return an attribute; `ValueError` if it is not a finite number."""
    text = element.get(name, default)
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{name} of its {element.tag} is {str(text)[:24]!r}")
    return value


def polynomial(records: Sequence[Element], at: str, s: FloatArray) -> FloatArray:
    """Return the values at stations of cubics that each hold from their own station ``at`` on; else 0."""
    table = np.array([[number(record, name, "0") for name in (at, *"abcd")] for record in records])
    if not len(table):
        return np.zeros(len(s))
    table = table[np.argsort(table[:, 0], kind="stable")]
    k = np.searchsorted(table[:, 0], s + SHORT_M, side="right") - 1
    start, a, b, c, d = table[np.maximum(k, 0)].T
    u = s - start
    return np.where(k >= 0, a + u * (b + u * (c + u * d)), 0.0)


class ReferenceLine:
    """Reference line of a road: lines, arcs, spirals and polynomials in a row.

    Attributes:
        s: (S,) m, stations so dense that straight lines between them are within 2 mm.
        places: (S, 2) m; ``headings`` (S,) rad.
    """

    @np.errstate(invalid="ignore", over="ignore")  # of a damaged file; its road is refused
    def __init__(self, road: Element, breaks: Sequence[float]) -> None:
        """``breaks``: stations that are among ``s``."""
        stretches = [(number(x, "s"), abs(number(x, "length")), x) for x in road.findall("planView/geometry")]
        stretches = sorted(stretches, key=lambda entry: entry[0])
        stretches = [entry for entry in stretches if entry[1] > SHORT_M] or stretches[:1]
        if not stretches:
            raise ValueError("it has no geometry")
        parts = [(start, _Stretch(x, length)) for start, length, x in stretches]
        end = float(stretches[-1][0] + stretches[-1][1])
        rows = [np.asarray([x for x in breaks if 0.0 <= x <= end])]
        for start, stretch in parts:
            count = math.ceil(stretch.length / stretch.step_m) + 1
            if count > MAX_POINTS:
                raise ValueError(f"length of its geometry is {stretch.length:.3g} m")
            rows.append(start + np.linspace(0.0, stretch.length, count))
        s = np.unique(np.concatenate(rows))
        self.s = s[np.append(True, np.diff(s) > SHORT_M)]
        starts = np.array([start for start, _ in parts])
        of = np.clip(np.searchsorted(starts, self.s + SHORT_M, side="right") - 1, 0, None)
        self.places, self.headings = np.empty((len(self.s), 2)), np.empty(len(self.s))
        for k, (start, stretch) in enumerate(parts):
            at = of == k
            self.places[at], self.headings[at] = stretch.at(self.s[at] - start)

    def beside(self, t: FloatArray, rows: slice) -> FloatArray:
        """Return the points (n, 2) to the left of stations by ``t`` m."""
        heading = self.headings[rows]
        return np.asarray(
            self.places[rows] + t[:, None] * np.column_stack([-np.sin(heading), np.cos(heading)])
        )


class _Stretch:
    def __init__(self, element: Element, length: float) -> None:
        self.length = length
        self._x, self._y, self._heading = (number(element, name) for name in ("x", "y", "hdg"))
        self._cubic = None
        self._curvatures = 0.0, 0.0
        for shape in element:
            if shape.tag == "arc":
                self._curvatures = (number(shape, "curvature"),) * 2
            elif shape.tag == "spiral":
                self._curvatures = number(shape, "curvStart"), number(shape, "curvEnd")
            elif shape.tag == "paramPoly3":
                u, v = ([number(shape, f"{k}{axis}", "0") for k in "abcd"] for axis in "UV")
                self._cubic = u, v, length if shape.get("pRange") == "arcLength" else 1.0, True
            elif shape.tag == "poly3":
                self._cubic = [0, 1, 0, 0], [number(shape, k, "0") for k in "abcd"], length, False
        ds = np.linspace(0.0, length, 33)
        turned = np.unwrap(self.at(ds)[1])
        sharpest = float(np.abs(np.diff(turned)).max()) / max(length / 32, SHORT_M)
        self.step_m = float(np.clip(math.sqrt(8 * SAGITTA_M / max(sharpest, 1e-9)), *STEP_M))

    def at(self, ds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places and headings at distances from its beginning."""
        u, v, turned = self._by_curvature(ds) if self._cubic is None else self._by_cubic(ds)
        c, s = math.cos(self._heading), math.sin(self._heading)
        return np.column_stack([self._x + c * u - s * v, self._y + s * u + c * v]), self._heading + turned

    def _by_curvature(self, ds: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        first, last = self._curvatures
        rate = (last - first) / max(self.length, SHORT_M)
        half = np.diff(ds, prepend=0.0)[:, None] / 2
        between = ds[:, None] - half + half * _NODES
        angle = between * (first + rate / 2 * between)
        u, v = (np.cumsum((half * _WEIGHTS * wave(angle)).sum(axis=1)) for wave in (np.cos, np.sin))
        return u, v, ds * (first + rate / 2 * ds)

    def _by_cubic(self, ds: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        assert self._cubic is not None
        u, v, last, whole = self._cubic
        p = np.linspace(0.0, last, max(65, min(MAX_POINTS, math.ceil(4 * self.length))))
        arc = np.append(0.0, np.cumsum(np.hypot(np.diff(_cubic(u, p)), np.diff(_cubic(v, p)))))
        scale = arc[-1] / max(self.length, SHORT_M) if whole else 1.0
        at = np.interp(ds * scale, arc, p)
        return _cubic(u, at), _cubic(v, at), np.arctan2(_slope(v, at), _slope(u, at))


def _cubic(abcd: Sequence[float], p: FloatArray) -> FloatArray:
    a, b, c, d = abcd
    return np.asarray(a + p * (b + p * (c + p * d)))


def _slope(abcd: Sequence[float], p: FloatArray) -> FloatArray:
    _, b, c, d = abcd
    return np.asarray(b + p * (2 * c + p * 3 * d))
