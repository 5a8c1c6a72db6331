"""Whole recordings with their map: loaded, cleaned, and their moments."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.cleaning.align import evidence, on_lanes, thinned
from scex_sumo.converters.cleaning.place import MIN_SHARE_ON_LANES, explain_mismatch, on_closed_lanes
from scex_sumo.converters.cleaning.plausibility import Check, doubts, refuse_implausible
from scex_sumo.converters.datasets.moment import Moment, find_moments
from scex_sumo.converters.datasets.recordings import (
    doubts_of_place,
    read_clean,
    window_with_history,
    with_warnings,
)
from scex_sumo.converters.datasets.scene import take_scene
from scex_sumo.converters.lanelet.origin import recorded_origin
from scex_sumo.converters.maps import LANELET2, read_map
from scex_sumo.converters.registries import Recording, map_format, place_name
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.road import Road
from scex_sumo.roads.matching import off_road
from scex_sumo.scene import SeedScene


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadedRecording:
    """A recording with its map, cleaned.

    Attributes:
        road: the map; recordings of one site loaded one after the other share it.
        table: the tracks at 10 Hz; cases of INTERACTION v1.2 are only aligned.
        findings: one phrase for each kind of defect that was repaired.
        notes: warnings that all its seed scenes have: an implausible recording, a wrong place of the map.
        checks: plausibility of the recording before repairs.

    Example:
        >>> (recording,) = scex.find_recordings([scex.example_path("roundabout")])
        >>> scex.load_recording(recording).table.step_s
        0.1
    """

    recording: Recording
    road: Road
    table: TrackTable
    findings: tuple[str, ...]
    notes: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()

    @property
    def vehicles(self) -> int:
        """Number of track ids of vehicles."""
        return len(set(self.table.vehicles.track_id.tolist()))

    @property
    def seconds(self) -> float:
        """Time from the first to the last sample, s."""
        stamps = self.table.vehicles.timestamp_ms
        return (int(stamps.max()) - int(stamps.min())) / 1000


@checked
def load_recording(
    recording: Recording, origin: tuple[float, float] | None = None, *, force: bool = False
) -> LoadedRecording:
    """Read a recording and its map, repair it and align it to the map.

    Args:
        origin: latitude and longitude of the map's coordinates; None looks beside the tracks.
        force: accept sizes that no vehicle has, and vehicles that would drive backwards.

    Raises:
        MapError: the map is missing or cannot be read, or its origin is not known.
        TrackError: the tracks cannot be read, hold no vehicle, are impossible, or do not lie on the map.

    Example:
        >>> loaded = scex.load_recording(scex.find_recordings([scex.example_path("roundabout")])[0])
        >>> len(loaded.road.lanes) > 0
        True
    """
    map_path, track_path = recording.map_path, recording.track_paths[0]
    stamp = map_path.stat().st_mtime_ns if map_path.exists() else 0
    if origin is None and map_format(map_path).read is LANELET2.read:
        origin = recorded_origin(map_path, tracks_path=track_path)
    road = _read_road(map_path, stamp, origin)
    window = window_with_history(recording.window)
    table, findings, checks = read_clean(recording.track_paths, road, window=window)
    if not force:
        refuse_implausible(track_path, checks, "repair the recording")
    if not len(table.vehicles):
        raise TrackError(f"{table.path}: no motor vehicle among the tracks; leave it out")
    samples = evidence(table.vehicles)
    share = on_lanes(samples, road)
    if share < MIN_SHARE_ON_LANES:
        few = thinned(samples, most=400)
        closed = on_closed_lanes(few.x, few.y, few.psi_rad, road)
        raise TrackError(
            f"{table.path}: only {share:.0%} of where its vehicles drive is on lanes of {map_path}; "
            f"{closed or explain_mismatch(samples, road)}"
        )
    notes = (*doubts(checks), *doubts_of_place(samples, road, track_path))
    return LoadedRecording(
        recording=recording, road=road, table=table, findings=findings, notes=notes, checks=checks
    )


@checked
def seed_at(loaded: LoadedRecording, time_s: float, *, case: str | None = None) -> SeedScene:
    """Cut out the seed scene of one moment, the same as `scex_sumo.read_seed` gives for that file and time.

    Args:
        time_s: the moment in the recording's clock.
        case: id of a case, if the file holds cases; None takes the first one.

    Raises:
        TrackError: no vehicle at that moment, or an unknown case.

    Example:
        >>> loaded = scex.load_recording(scex.find_recordings([scex.example_path("roundabout")])[0])
        >>> scex.seed_at(loaded, 4.0).time_s
        4.0
    """
    scene = take_scene(
        loaded.table,
        loaded.findings,
        name=loaded.recording.name,
        location=place_name(loaded.recording.map_path),
        case=case,
        time_s=time_s,
    )
    twice = [note for note in doubts(loaded.checks, scene.track_ids) if note not in loaded.notes]
    scene = with_warnings(scene, off_road(loaded.road, scene), (*twice, *loaded.notes))
    return loaded.table.complete(dataclasses.replace(scene, road=loaded.road))


@checked
def recording_moments(loaded: LoadedRecording, *, every_s: float) -> list[Moment]:
    """List all moments that can be seed scenes, at least ``every_s`` apart; one for each case.

    Only those in the recording's window count.

    Example:
        >>> loaded = scex.load_recording(scex.find_recordings([scex.example_path("roundabout")])[0])
        >>> len(scex.recording_moments(loaded, every_s=1.0))
        19
    """
    return find_moments(loaded.table, every_s=every_s, window=loaded.recording.window)


@lru_cache(maxsize=4)
def _read_road(map_path: Path, _changed_ns: int, origin: tuple[float, float] | None) -> Road:
    """One object for all recordings of a site, so that everything remembered by road is shared."""
    return read_map(map_path, origin=origin, own_corner=False)
