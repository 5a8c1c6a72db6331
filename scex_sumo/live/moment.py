"""Moment of a running simulation, which any process can make a seed scene of."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.recordings import repaired
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Recording
from scex_sumo.converters.tracks.road_users import PEOPLE
from scex_sumo.evaluation.recordings import LoadedRecording, seed_at
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.formats.sumo.recorder import Recorded
from scex_sumo.formats.sumo.scenario import SCENARIO
from scex_sumo.live.focus import Focus
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """Last second of a simulation.

    Attributes:
        recorded: its steps; the last one is the moment.
        net: file.
        counted: SUMO's names of the vehicles of which a pair needs one to count; None: all.
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
        some = {name for _, here, _ in frames for name in here}
        recorded = replace(
            recorded,
            frames=frames,
            absent=deque(recorded.absent),
            users={name: user for name, user in recorded.users.items() if name in some},
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
        name = map_name(self.net)
        here = Recording(name=name, site=name, dataset="sumo", map_path=self.net, track_paths=(self.net,))
        loaded = LoadedRecording(recording=here, road=road_of(self.net), table=table, findings=findings)
        return seed_at(loaded, float(table.vehicles.stamps_ms[-1]) / 1000.0)


def _without(left_out: set[str], names: list[str], states: array[float]) -> tuple[list[str], array[float]]:
    kept = [k for k, name in enumerate(names) if name not in left_out]
    rows = np.frombuffer(states).reshape(-1, 4)[kept]
    return [names[k] for k in kept], array("d", rows.tobytes())


def road_of(net: Path) -> Road:
    """Read a net; a process keeps those that it read last."""
    return _road(net, net.stat().st_mtime_ns if net.exists() else 0)


@lru_cache(maxsize=4)
def _road(net: Path, _stamp: int) -> Road:
    return read_sumo_road(net)
