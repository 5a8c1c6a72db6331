"""Moment of a running simulation, which any process can make a seed scene of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.reader import repaired
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import LoadedRecording, seed_at
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.formats.sumo.recorder import Recorded
from scex_sumo.formats.sumo.scenario import SCENARIO
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """Last second of a simulation.

    Attributes:
        recorded: its steps; the last one is the moment.
        net: file.
    """

    recorded: Recorded
    net: Path

    @property
    def vehicles(self) -> list[str]:
        """SUMO's names of the vehicles of the moment; pedestrians and cyclists are none."""
        users = self.recorded.users
        return [n for n in self.recorded.frames[-1][1] if users[n][0] not in ("pedestrian", "bicycle")]

    def scene(self) -> SeedScene:
        """Return the seed scene; ``source["vehicles"]`` has SUMO's names.

        Raises:
            TrackError: no vehicle is there.
            MapError: the net cannot be read.
        """
        if all(
            kind == "pedestrian" for kind, *_ in map(self.recorded.users.get, self.recorded.frames[-1][1])
        ):
            time_s = self.recorded.frames[-1][0]
            raise TrackError(f"no vehicle on the road at {time_s:g} s; step the simulation first")
        table, findings = repaired(*self.recorded.tracks(self.net), SCENARIO)
        name = map_name(self.net)
        here = Recording(name=name, site=name, dataset="sumo", map_path=self.net, track_paths=(self.net,))
        loaded = LoadedRecording(recording=here, road=road_of(self.net), table=table, findings=findings)
        return seed_at(loaded, float(table.vehicles.stamps_ms[-1]) / 1000.0)


def road_of(net: Path) -> Road:
    """Read a net; a process keeps those that it read last."""
    return _road(net, net.stat().st_mtime_ns if net.exists() else 0)


@lru_cache(maxsize=4)
def _road(net: Path, _stamp: int) -> Road:
    return read_sumo_road(net)
