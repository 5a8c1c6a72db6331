"""Do seed scenes of one kind of place group together by their densities?

    nice -n 10 python benchmarks/compare.py [--seeds 8] [--vehicles 10] [--data FOLDER] [--out FOLDER]
    nice -n 10 python benchmarks/compare.py --recorded [--vehicles 5|0] [--data FOLDER] [--out FOLDER]

The first: synthetic seed scenes on all Lanelet2 maps that are there, with the same number of vehicles on
each, held against the kind of place (roundabout, merge, intersection). The second: recorded moments of MONA
and TAF-BW, held against the site; of each the vehicles that have most to do with each other, or all with 0.

``--data`` (else SCEX_DATA, else ../shared/data) has the real maps; without it there are only the three
examples. Finished runs are kept in ``--cache`` and used again as long as the file they came from is the same;
empty it after changing drivers or metrics. ``--out`` gets the figures.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from compare_pictures import draw_compared_densities, draw_dendrogram
from compare_report import Seeds, adjusted_rand_index, report

import scex_sumo as scex
from scex_sumo.errors import SimulationError
from scex_sumo.scenarios.reduction import choose_vehicles, reduced
from scex_sumo.scene import LOGGED_HISTORY
from scex_sumo.statistics.grouping import group_runs
from scex_sumo.studies.compare import compare

KIND_OF = {
    "roundabout": "roundabout",
    "DR_DEU_Roundabout_OF": "roundabout",
    "motorway_merge": "merge",
    "DR_DEU_Merging_MT": "merge",
    "urban_intersection": "intersection",
    "k733_2020-09-15": "intersection",
    "k729_2022-03-16": "intersection",
}
SHORT = {"DR_DEU_Roundabout_OF": "Roundabout_OF", "DR_DEU_Merging_MT": "Merging_MT"}
EXAMPLES = ("roundabout", "motorway_merge", "urban_intersection")
K733_S = np.arange(12.0, 150.0, 17.0)  # moments of its recording of 158 s
FEWEST = 3  # vehicles of a recorded moment


@dataclass(frozen=True, kw_only=True)
class Moment:
    """A seed scene that can be made."""

    place: str
    kind: str
    number: int
    file: Path
    make: Callable[[], scex.SeedScene]


def synthetic(options: argparse.Namespace) -> Iterator[Moment]:
    """Synthetic seeds on the maps that are there."""
    found = {path.stem: path for path in sorted(options.data.rglob("*.osm"))}
    found |= {name: scex.example_path(name) for name in EXAMPLES}
    for name, kind in KIND_OF.items():
        for seed in range(options.seeds if name in found else 0):
            file = found[name]
            yield Moment(
                place=SHORT.get(name, name.split("_20")[0]),
                kind=kind,
                number=seed,
                file=file,
                make=lambda file=file, seed=seed: populated(file, options.vehicles, seed),
            )


def populated(file: Path, vehicles: int, seed: int) -> scex.SeedScene:
    """A synthetic seed, with fewer vehicles where the map does not hold so many."""
    while True:
        try:
            return scex.synthetic_seed(file, vehicles=vehicles, seed=seed)
        except SimulationError:
            if vehicles <= FEWEST:
                raise
            vehicles -= 1


def recorded(options: argparse.Namespace) -> Iterator[Moment]:
    """Moments of real traffic; of MONA one of every third chunk of 16 s."""

    def moment(place: str, number: int, file: Path, make: Callable[[], scex.SeedScene]) -> Moment:
        return Moment(place=place, kind=place, number=number, file=file, make=make)

    for folder in sorted((options.data / "mona").glob("MONA-*")):
        for number, file in enumerate(sorted(folder.glob("*.xml*"))[::3][: options.seeds]):
            yield moment(folder.name, number, file, lambda file=file: scex.read_seed(file))
    taf = options.data / "taf_bw"
    tracks = taf / "recorded_trackfiles" / "k733_2020-09-15" / "vehicle_tracks_000.csv"
    for number, at in enumerate(K733_S[: options.seeds] if tracks.exists() else ()):
        yield moment(
            "k733",
            number,
            tracks,
            lambda at=at: scex.read_seed(taf / "maps" / "k733_2020-09-15.osm", tracks=tracks, time=float(at)),
        )


def run_of(moment: Moment, options: argparse.Namespace) -> scex.Run | None:
    """The run of a moment, from the cache where it is there; None where it has too few vehicles."""
    content = hashlib.sha256(moment.file.read_bytes()).hexdigest()[:8]
    source = "recorded" if options.recorded else "synthetic"
    parts = f"{moment.place}-{content}-{source}-v{options.vehicles}-c{options.children}"
    folder = options.cache / parts / f"s{moment.number}"
    if not (folder / "run.json").exists():
        scene = moment.make()
        if options.recorded and options.vehicles and scene.vehicles >= options.vehicles:
            scene = reduced(scene, choose_vehicles(scene, options.vehicles))
        if scene.vehicles < max(FEWEST, options.vehicles if options.recorded else 0):
            return None
        scex.extrapolate(scene, children=options.children, seed=moment.number, out=folder, overwrite=True)
    return scex.open_run(folder)


def gather(options: argparse.Namespace) -> Seeds:
    """Run all seed scenes that are not in the cache."""
    found = []
    for moment in recorded(options) if options.recorded else synthetic(options):
        run = run_of(moment, options)
        if run is None:
            print(f"{moment.place} {moment.number}: too few vehicles, left out")
        else:
            found.append((moment, run, *speed_and_separation(run)))
    moments, runs, speed, separation = zip(*found, strict=True)
    return Seeds(
        runs=list(runs),
        labels=[f"{m.place} {m.number}" for m in moments],
        maps=[m.place for m in moments],
        kinds=[m.kind for m in moments],
        speed=np.array(speed),
        separation=np.array(separation),
    )


def speed_and_separation(run: scex.Run) -> tuple[float, float]:
    """Mean speed, m/s, and median distance of two vehicles, m, in the seed scene."""
    tracks = run.tracks
    first = (np.asarray(tracks["case_id"]) == 0) & (np.asarray(tracks["frame_id"]) == LOGGED_HISTORY)
    x, y, vx, vy = (np.asarray(tracks[name])[first] for name in ("x", "y", "vx", "vy"))
    i, j = np.triu_indices(len(x), 1)
    return float(np.hypot(vx, vy).mean()), float(np.median(np.hypot(x[i] - x[j], y[i] - y[j])))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", beside)))
    parser.add_argument("--cache", type=Path, default=Path("out") / "compare")
    parser.add_argument("--recorded", action="store_true", help="recorded moments in place of synthetic ones")
    parser.add_argument("--seeds", type=int, default=8, help="per map")
    parser.add_argument("--vehicles", type=int, help="per seed scene; default 10, recorded 5")
    parser.add_argument("--children", type=int, default=96)
    parser.add_argument("--out", type=Path, help="folder for the figures")
    options = parser.parse_args()
    if options.vehicles is None:
        options.vehicles = 5 if options.recorded else 10
    begin = time.perf_counter()
    seeds = gather(options)
    comparisons = {k: compare(seeds.runs, labels=seeds.labels, distance=k) for k in ("w1", "jsd")}
    report(seeds, comparisons)
    for kind, comparison in comparisons.items() if options.out is not None else ():
        grouping = group_runs(comparison.total, seeds.labels, groups=len(set(seeds.kinds)))
        index = adjusted_rand_index(grouping.group.tolist(), seeds.kinds)
        what = "site" if options.recorded else "kind of place"
        title = (
            f"{len(seeds.runs)} seed scenes of {len(set(seeds.maps))} maps by distance {kind}: cut into "
            f"{grouping.groups} groups, adjusted Rand index over the {what} {index:.2f} (1: same, 0: chance)"
        )
        draw_dendrogram(
            comparison, grouping, options.out / f"dendrogram_{kind}", kinds=seeds.kinds, title=title
        )
        draw_compared_densities(
            seeds.runs, comparison, grouping, options.out / f"densities_{kind}", kinds=seeds.kinds
        )
    print(f"\n{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
