"""Moment of a running simulation, which any process can make a seed scene of; vehicles that count in it."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import TrackError, UsageError
from scex_sumo.converters.datasets.recordings import repaired
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Recording
from scex_sumo.converters.tracks.road_users import PEOPLE
from scex_sumo.evaluation.recordings import LoadedRecording, seed_at
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.formats.sumo.recorder import Recorded
from scex_sumo.formats.sumo.scenario import SCENARIO
from scex_sumo.results.region import AROUND_M, Region, region_of
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

BUSIEST: Final = 25
"""Vehicles that are extrapolated if nothing is asked for."""
MARGIN_M: Final = 70.0
"""Vehicles this far outside of a circle are extrapolated, too; pairs of them do not count."""
_MAX_INSIDE = 60


@dataclass(frozen=True, kw_only=True)
class Focus:
    """Vehicles of a moment whose pairs count.

    The region is a circle, x, y and radius in SUMO's coordinates, m, also as the text ``X,Y,R``; or SUMO's
    name of a vehicle: within 30 m of it. Without one the ``busiest``: so many around the one that has most
    others near it.
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
            apart = np.hypot(*(xy - xy[_middle(xy)]).T)
            nearest = np.argsort(apart, kind="stable")[: self.busiest]
            return np.sort(nearest), np.sort(nearest)
        x, y, radius = circle
        apart = np.hypot(*(xy - (x, y)).T)
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


def _middle(xy: FloatArray) -> int:
    """Return the index of the vehicle that has most others within 30 m."""
    from scipy.spatial import cKDTree

    near = cKDTree(xy).query_ball_point(xy, AROUND_M, return_length=True)
    return int(np.argmax(near))


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """Last second of a simulation on a net; its last step is the moment.

    A pair counts with one of the vehicles ``counted``, by SUMO's names; None: all do.
    """

    recorded: Recorded
    net: Path
    counted: frozenset[str] | None = None

    @property
    def vehicles(self) -> list[str]:
        """SUMO's names of the vehicles of the moment; pedestrians and cyclists are none."""
        users = self.recorded.users
        return [n for n in self.recorded.frames[-1][1] if users[n][0] not in PEOPLE]

    @property
    def motorised(self) -> list[str]:
        """SUMO's names of all vehicles of the moment, with bicycles."""
        users = self.recorded.users
        return [name for name in self.recorded.frames[-1][1] if users[name][0] != "pedestrian"]

    def intending(self, recorded: Recorded) -> Moment:
        """Return the moment with what its vehicles are to do."""
        what = {n: recorded.intentions[n] for n in self.motorised if n in recorded.intentions}
        return replace(self, recorded=replace(self.recorded, intentions=what))

    def counts(self, pair: Sequence[str]) -> bool:
        """Return whether a pair of vehicles counts."""
        return self.counted is None or not self.counted.isdisjoint(pair)

    def within(self, focus: Focus) -> Moment:
        """Return the moment with the vehicles of a focus alone, as it is now."""
        recorded, (_, present, values) = self.recorded, self.recorded.frames[-1]
        place = {name: k for k, name in enumerate(present)}
        names = self.vehicles
        xy = np.frombuffer(values).reshape(-1, 4)[[place[name] for name in names], :2]
        kept, counted = focus.of(names, xy)
        left_out = set(names) - {names[k] for k in kept.tolist()}
        frames = deque(
            (time_s, *_without(left_out, here, states)) for time_s, here, states in recorded.frames
        )
        seen = {name for _, here, _ in frames for name in here}
        recorded = replace(
            recorded,
            frames=frames,
            absent=deque(recorded.absent),
            users={name: user for name, user in recorded.users.items() if name in seen},
        )
        return replace(self, recorded=recorded, counted=frozenset(names[k] for k in counted.tolist()))

    def scene(self) -> SeedScene:
        """Return the seed scene; ``source["vehicles"]`` has SUMO's names.

        Raises:
            TrackError: no vehicle is there.
            MapError: the net cannot be read.
        """
        if not self.motorised:
            time_s = self.recorded.frames[-1][0]
            raise TrackError(f"no vehicle on the road at {time_s:g} s; step the simulation first")
        table, findings = repaired(*self.recorded.tracks(self.net), SCENARIO)
        name, net = map_name(self.net), self.net
        recording = Recording(name=name, site=name, dataset="sumo", map_path=net, track_paths=(net,))
        loaded = LoadedRecording(recording=recording, road=road_of(net), table=table, findings=findings)
        return seed_at(loaded, float(table.vehicles.stamps_ms[-1]) / 1000.0)


def _without(left_out: set[str], names: list[str], states: array[float]) -> tuple[list[str], array[float]]:
    indices = [k for k, name in enumerate(names) if name not in left_out]
    rows = np.frombuffer(states).reshape(-1, 4)[indices]
    return [names[k] for k in indices], array("d", rows.tobytes())


def road_of(net: Path) -> Road:
    """Read a net; a process keeps those that it read last."""
    return _road(net, net.stat().st_mtime_ns if net.exists() else 0)


@lru_cache(maxsize=4)
def _road(net: Path, _stamp: int) -> Road:
    return read_sumo_road(net)
