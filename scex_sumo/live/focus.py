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
    """Vehicles of a moment whose pairs count. One of the three is given.

    Attributes:
        around: SUMO's name of a vehicle: within 30 m of it.
        region: circle, x, y and radius in SUMO's coordinates, m; also the text ``X,Y,R``.
        busiest: number of vehicles, those around the one that has most others near it.

    Raises:
        UsageError: several are given, or one makes no sense.
    """

    around: str | None = None
    region: tuple[float, float, float] | str | None = None
    busiest: int | None = None

    def __post_init__(self) -> None:
        if sum(one is not None for one in (self.around, self.region, self.busiest)) > 1:
            raise UsageError("--around, --region and --busiest exclude one another; give one of them")
        if self.busiest is not None and self.busiest < 2:
            raise UsageError(f"--busiest: got {self.busiest}, needs at least 2 vehicles")
        if self.region is not None:
            circle = self.region if isinstance(self.region, str) else Region(circle=self.region)
            object.__setattr__(self, "region", region_of(circle, None).circle)

    def of(self, names: list[str], xy: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the indices of the vehicles that are extrapolated, and of those whose pairs count.

        Args:
            xy: (N, 2) of the named vehicles, m.
        """
        circle = self._circle(names, xy)
        if circle is None:
            most = self.busiest or BUSIEST
            if len(names) <= most:
                return np.arange(len(names)), np.arange(len(names))
            nearest = np.argsort(_apart(xy, xy[_middle(xy)]), kind="stable")[:most]
            return np.sort(nearest), np.sort(nearest)
        x, y, radius = circle
        apart = _apart(xy, np.array([x, y]))
        order = np.argsort(apart, kind="stable")
        kept = order[apart[order] <= radius + MARGIN_M][:_MAX_INSIDE]
        return np.sort(kept), np.sort(kept[apart[kept] <= radius])

    def _circle(self, names: list[str], xy: FloatArray) -> tuple[float, float, float] | None:
        if self.around is None:
            assert not isinstance(self.region, str)
            return self.region
        if self.around not in names:
            return 0.0, 0.0, -np.inf  # it is not there, so nobody is
        x, y = xy[names.index(self.around)].tolist()
        return x, y, AROUND_M


def _apart(xy: FloatArray, point: FloatArray) -> FloatArray:
    apart: FloatArray = np.hypot(*(xy - point).T)
    return apart


def _middle(xy: FloatArray) -> int:
    """Return the index of the vehicle that has most others within 30 m."""
    from scipy.spatial import cKDTree

    near = cKDTree(xy).query_ball_point(xy, AROUND_M, return_length=True)
    return int(np.argmax(near))
