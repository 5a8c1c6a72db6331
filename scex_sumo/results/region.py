"""Region of a scene: the vehicles whose pairs count in encounters, P(collision) and metrics."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import number_or_name
from scex_sumo.results.obstacles import replaying
from scex_sumo.scene import STEP_S, SeedScene

NEAR_M: Final = 50.0
"""At constant speed, vehicles that come no nearer to those inside are replayed."""


ALL_SIMULATED: Final = 100
"""Vehicles of a scene that are simulated wherever the region is."""

AROUND_M: Final = 30.0
"""Radius around a vehicle."""


@dataclass(frozen=True, kw_only=True)
class Region:
    """Circle around a place or a vehicle. A pair counts if one of its vehicles is inside at the seed moment.

    Attributes:
        circle: x, y and radius, m.
        around: track id or SUMO's name of a vehicle; the radius is then `AROUND_M`.

    Raises:
        UsageError: both or none are given, or the circle is none.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> part = scex.extrapolate(scene, futures=4, region=scex.Region(around=16))
        >>> len(part.info["region"]["vehicles"]) < scene.vehicles
        True
    """

    circle: tuple[float, float, float] | None = None
    around: int | str | None = None

    def __post_init__(self) -> None:
        if (self.circle is None) == (self.around is None):
            raise UsageError("region: give a circle or a vehicle")
        if self.circle is not None and not (all(map(math.isfinite, self.circle)) and self.circle[2] > 0):
            raise UsageError(f"--region {self.circle}: needs finite numbers and a radius above 0 m")

    def vehicles(self, scene: SeedScene) -> tuple[int, ...]:
        """Return the indices of the vehicles inside.

        Raises:
            UsageError: there is none, or no vehicle of this id.
        """
        now = scene.now
        if self.circle is not None:
            x, y, radius = self.circle
        else:
            assert self.around is not None
            centre = scene.track_ids.tolist().index(scene.track_of(self.around, "--region"))
            x, y, radius = float(now.x[centre]), float(now.y[centre]), AROUND_M
        inside = np.flatnonzero(np.hypot(now.x - x, now.y - y) <= radius)
        if not inside.size:
            raise UsageError(
                f"--region {x:g},{y:g},{radius:g}: no vehicle there at the seed moment; the vehicles are at "
                f"x {now.x.min():.0f} to {now.x.max():.0f}, y {now.y.min():.0f} to {now.y.max():.0f}"
            )
        return tuple(inside.tolist())

    def simulated(self, scene: SeedScene, steps: int, always: Collection[int] = ()) -> SeedScene:
        """Return the scene in which vehicles are replayed that cannot come near those inside.

        A scene of up to `ALL_SIMULATED` vehicles is simulated as a whole.

        Args:
            steps: of 0.1 s.
            always: track ids of vehicles that are simulated wherever they are.
        """
        there = [*self.vehicles(scene)]
        if scene.vehicles <= ALL_SIMULATED:
            return scene
        now, distances_m = scene.now, np.abs(scene.now.speed) * STEP_S * steps
        apart = np.hypot(now.x[:, None] - now.x[there], now.y[:, None] - now.y[there])
        near = (apart - distances_m[:, None] - distances_m[there] <= NEAR_M).any(axis=1)
        near |= np.isin(scene.track_ids, list(always))
        if near.all():
            return scene
        far = f"{int((~near).sum())} of {scene.vehicles} vehicles"
        note = f"{far}, too far from the region to come near it, are replayed"
        return replace(replaying(scene, np.flatnonzero(near).tolist()), notes=(*scene.notes, note))

    def words(self) -> str:
        """Return the circle in words."""
        if self.around is not None:
            return f"within {AROUND_M:g} m of {self.around}"
        assert self.circle is not None
        return "within {2:g} m of {0:g}, {1:g}".format(*self.circle)

    def to_json(self) -> dict[str, Any]:
        """Return the entry ``region`` of ``run.json``."""
        if self.circle is None:
            return {"region": {"around": self.around, "radius": AROUND_M}}
        return {"region": dict(zip(("x", "y", "radius"), self.circle, strict=True))}


def region_of(given: str | int) -> Region:
    """Return the region of a text ``X,Y,R``, or around a vehicle of this id or name.

    Raises:
        UsageError: it is another text.
    """
    if isinstance(given, int) or "," not in given:
        return Region(around=number_or_name(str(given)))
    try:
        x, y, radius = (float(number) for number in given.split(","))
    except ValueError:
        raise UsageError(
            f"--region {given}: needs X,Y,R in m, or a vehicle, e.g. --region 1010,985,40"
        ) from None
    return Region(circle=(x, y, radius))
