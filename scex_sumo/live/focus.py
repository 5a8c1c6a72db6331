"""Focus of a watch: the vehicles of a running simulation that are extrapolated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.results.region import AROUND_M, Region, region_of

BUSIEST: Final = 25
"""Vehicles that are extrapolated if nothing is asked for."""
MARGIN_M: Final = 70.0
"""Vehicles this far outside of a circle are extrapolated, too; pairs of them do not count."""
_MAX_INSIDE = 60


@dataclass(frozen=True, kw_only=True)
class Focus:
    """Vehicles of a moment whose pairs count.

    Attributes:
        region: circle, x, y and radius in SUMO's coordinates, m, also as the text ``X,Y,R``; or SUMO's name
            of a vehicle: within 30 m of it. None: as ``busiest``.
        busiest: number of vehicles, those around the one that has most others near it.

    Raises:
        UsageError: one makes no sense.
    """

    region: tuple[float, float, float] | str | None = None
    busiest: int = BUSIEST

    def __post_init__(self) -> None:
        if self.busiest < 2:
            raise UsageError(f"busiest: got {self.busiest}, needs at least 2 vehicles")
        if isinstance(self.region, str) and "," in self.region:
            object.__setattr__(self, "region", region_of(self.region).circle)
        elif isinstance(self.region, tuple):
            Region(circle=self.region)

    def of(self, names: list[str], xy: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the indices of the vehicles that are extrapolated, and of those whose pairs count.

        Args:
            xy: (N, 2) of the named vehicles, m.
        """
        circle = self._circle(names, xy)
        if circle is None:
            if len(names) <= self.busiest:
                return np.arange(len(names)), np.arange(len(names))
            nearest = np.argsort(_apart(xy, xy[_middle(xy)]), kind="stable")[: self.busiest]
            return np.sort(nearest), np.sort(nearest)
        x, y, radius = circle
        apart = _apart(xy, np.array([x, y]))
        order = np.argsort(apart, kind="stable")
        kept = order[apart[order] <= radius + MARGIN_M][:_MAX_INSIDE]
        return np.sort(kept), np.sort(kept[apart[kept] <= radius])

    def _circle(self, names: list[str], xy: FloatArray) -> tuple[float, float, float] | None:
        if not isinstance(self.region, str):
            return self.region
        if self.region not in names:
            return 0.0, 0.0, -np.inf  # it is not there, so no vehicle counts
        x, y = xy[names.index(self.region)].tolist()
        return x, y, AROUND_M


def _apart(xy: FloatArray, point: FloatArray) -> FloatArray:
    apart: FloatArray = np.hypot(*(xy - point).T)
    return apart


def _middle(xy: FloatArray) -> int:
    """Return the index of the vehicle that has most others within 30 m."""
    from scipy.spatial import cKDTree

    near = cKDTree(xy).query_ball_point(xy, AROUND_M, return_length=True)
    return int(np.argmax(near))
