"""Training and validation samples of many recordings, kept in a cache."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.cache import cached_object
from scex_sumo.base.errors import MapError, SimulationError, TrackError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.converters.maps import read_map
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import LoadedRecording, load_recording, recording_moments, seed_at
from scex_sumo.evaluation.split import Part, Split, split_moments
from scex_sumo.generators.synthetic import simulated_scenes
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.learned.training.data.perturb import add_obstacles, measured, perturbed
from scex_sumo.learned.training.data.samples import TrainingSamples, learnable, scene_samples
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SeedScene, States

MIN_APART_S = 0.2  # between two moments
SAME_MAP_M = 1.0
SIMULATED_S, SIMULATED_EVERY_S = 240.0, 1.0  # of traffic on each map, and between two moments


@dataclass(frozen=True, kw_only=True)
class SampleOptions:
    """Options of the samples."""

    moments: int = 800  # of a site, evenly spread over its recordings, but `MIN_APART_S` apart
    copies: int = 2  # perturbed copies of each training scene
    stops: int = 3  # further copies with standing vehicles in the way
    split: Split = field(default_factory=Split)  # of the recordings' time


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """Samples for training and validation."""

    sites: tuple[str, ...]  # (S) names; `TrainingSamples.site` counts them
    kinds: tuple[str, ...]  # (S) dataset of each site
    roads: tuple[Road, ...]  # (S) maps
    train: TrainingSamples
    validation: TrainingSamples  # without copies
    digest: str  # of the recordings, maps and options
    recorded: int  # graphs in `train` of recordings; those of simulated traffic follow


def make_dataset(
    recordings: Sequence[Recording],
    options: SampleOptions,
    *,
    maps: Sequence[Path] = (),
    tick: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Make the samples of recordings and of simulated traffic, or take them from the cache.

    Args:
        maps: on which SUMO's drivers drive; each is a site of its own, with training samples only.
        tick: called with the number of recordings done, and of all.
    """
    sites = tuple(sorted({recording.site for recording in recordings}))
    kinds: dict[str, str] = {}
    roads: dict[str, Road] = {}
    parts: dict[Part, list[TrainingSamples]] = {"train": [], "validation": []}
    digest, total = hashlib.sha256(), len(recordings) + len(maps)
    done, report = count(), tick or (lambda done, total: None)
    cached = partial(cached_object, parts=(TrainingSamples,))
    for number, (site, site_recordings, every_s) in enumerate(loaded_sites(recordings, options.moments)):
        for loaded in site_recordings:
            report(next(done), total)
            recording = loaded.recording
            key = f"{_digest((recording.map_path, *recording.track_paths), options)} {every_s:.3f}"
            digest.update(key.encode())
            kinds[site] = recording.dataset
            shift = map_shift(roads.setdefault(site, loaded.road), loaded.road)
            for part, samples_of in parts.items():
                make = partial(_make, loaded, options, part, every_s)
                samples = cached(f"samples/{recording.name}-{part}", key.encode(), make)
                samples_of += [samples.at(number, shift)] if samples else []
    if not parts["train"] or not parts["validation"]:
        short = "training" if not parts["train"] else "validation"
        raise TrackError(
            f"{', '.join(r.name for r in recordings[:3])}: no vehicle for {short} with 1 s of recorded past "
            "and 3 s of recorded future; give longer recordings"
        )
    recorded = sum(map(len, parts["train"]))
    for map_path in maps:
        report(next(done), total)
        road, name = read_map(map_path, own_corner=True), f"{map_path.name}, simulated"
        key = _digest((map_path,), options)
        digest.update(key.encode())
        make = partial(_make_simulated, road, options)
        samples = cached(f"samples/{road.name}-simulated", key.encode(), make)
        if samples is None:
            raise SimulationError(f"{map_path}: no vehicle drives 4 s on it in SUMO; give a larger map")
        parts["train"].append(samples.at(len(sites), np.zeros(2)))
        sites, kinds[name], roads[name] = (*sites, name), "simulated", road
    return Dataset(
        sites=sites,
        kinds=tuple(kinds[site] for site in sites),
        roads=tuple(roads[site] for site in sites),
        train=TrainingSamples.concatenate(parts["train"]),
        validation=TrainingSamples.concatenate(parts["validation"]),
        digest=digest.hexdigest(),
        recorded=recorded,
    )


def map_shift(road: Road, other: Road) -> FloatArray:
    """Return (2,) m from a place on a map to the same place on another of the site.

    NGSIM's maps have different origins.
    """
    common = [(road.lanes[k].centreline, other.lanes[k].centreline) for k in road.lanes.keys() & other.lanes]
    shifts = [theirs - mine for mine, theirs in common if mine.shape == theirs.shape]
    all_shifts = np.concatenate(shifts) if shifts else np.full((1, 2), np.inf)
    shift = np.median(all_shifts, axis=0)
    if not np.isfinite(shift).all() or np.abs(all_shifts - shift).max() > SAME_MAP_M:
        raise MapError(f"{other.name}: another map than that of its site, {road.name}; train them separately")
    return np.asarray(shift)


def loaded_sites(
    recordings: Sequence[Recording], moments: int
) -> Iterator[tuple[str, list[LoadedRecording], float]]:
    """Yield each site, its recordings, and the time in s between two of its moments, if it has so many."""
    for site in sorted({recording.site for recording in recordings}):
        site_recordings = [load_recording(recording) for recording in recordings if recording.site == site]
        moments_of = [recording_moments(loaded, every_s=1.0) for loaded in site_recordings]
        stamps = [[moment.time_s for moment in of if not moment.case] for of in moments_of]
        whole_s = sum(times[-1] - times[0] for times in stamps if times)
        yield site, site_recordings, max(MIN_APART_S, whole_s / moments)


def part_scenes(loaded: LoadedRecording, part: Part, *, split: Split, every_s: float) -> list[SeedScene]:
    """Return the seed scenes of one part of a recording that have a vehicle to learn from."""
    moments = recording_moments(loaded, every_s=STEP_S)
    last, scenes = -np.inf, []
    for moment in split_moments(moments, split, loaded.recording.name)[part]:
        if not moment.case and moment.time_s - last < every_s - 1e-6:
            continue
        last = moment.time_s
        scene = seed_at(loaded, moment.time_s, case=moment.case or None)
        _check_finite(loaded, scene)
        if len(learnable(scene)):
            scenes.append(scene)
    return scenes


def _check_finite(loaded: LoadedRecording, scene: SeedScene) -> None:
    """Refuse what a dataset's own `within` or `complete` may leave: one such value makes all weights nan."""
    for states in (scene.history, scene.future):
        for name, values in vars(states).items() if states is not None else ():
            bad = ~np.isfinite(values).all(axis=1)
            if bad.any():
                raise TrackError(
                    f"{loaded.recording.name}: track {scene.track_ids[np.argmax(bad)]} has no finite {name} "
                    f"around {scene.time_s:g} s; repair the recording or leave it out"
                )


def _make(
    loaded: LoadedRecording, options: SampleOptions, part: Part, every_s: float
) -> TrainingSamples | None:
    scenes = part_scenes(loaded, part, split=options.split, every_s=every_s)
    options = options if part == "train" else replace(options, copies=0, stops=0)
    return _samples(scenes, loaded.road, loaded.recording.name, options)


def _make_simulated(road: Road, options: SampleOptions) -> TrainingSamples | None:
    with TemporaryFolder() as folder:
        net = converted(road, Path(folder) / "map.net.xml")
        scenes = simulated_scenes(road, net.path, seconds=SIMULATED_S, every_s=SIMULATED_EVERY_S)
    scenes = [scene for scene in scenes if len(learnable(scene))]
    return _samples(scenes, road, road.name, replace(options, copies=1, stops=1), noisy=True)


def _samples(
    scenes: Sequence[SeedScene], road: Road, name: str, options: SampleOptions, *, noisy: bool = False
) -> TrainingSamples | None:
    """Make samples of scenes; ``noisy`` ones are seen as if they were measured, in all copies."""
    rng = np.random.default_rng([0, zlib.crc32(name.encode())])
    exact = 0 if noisy else 1  # the first one, which is as recorded
    samples: list[TrainingSamples | None] = []
    for scene in scenes:
        copies = [scene.history, *(perturbed(scene.history, rng) for _ in range(options.copies))]
        seen = [*copies[:exact], *(measured(states, rng) for states in copies[exact:])]
        samples.append(scene_samples(scene, road, States.stack(copies, 0), seen=States.stack(seen, 0)))
        for _ in range(options.stops):
            stop = add_obstacles(scene, road, learnable(scene), rng)
            if stop is None:
                break
            now = stop[0].history
            seen_now = measured(now, rng).repeat(1)
            samples.append(scene_samples(stop[0], road, now.repeat(1), seen=seen_now, blocked=stop[1]))
    known = [graphs for graphs in samples if graphs is not None]
    return TrainingSamples.concatenate(known) if known else None


def _digest(paths: Sequence[Path], options: SampleOptions) -> str:
    digest = hashlib.sha256(repr(sorted(asdict(options).items())).encode())
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()
