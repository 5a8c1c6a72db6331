"""Order of passing at junctions: human-like futures against recordings and simple rivals.

    python benchmarks/order.py [--data FOLDER] [--sites NAMES] [--part test] [--every 5] [--most 60]
                               [--steps 50]

Only moments with pairs that pass one place, 0.5 s apart or more. Columns: share of the pairs whose order is
forecast right; their number; Brier scores of the order by the futures, by "the nearest goes first", and by
way / speed (``soonest``).
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from recorded_scenes import INTERACTION, INTERACTION_SITES

from scex_sumo.base.errors import ScexError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.evaluation.split import Split, split_moments
from scex_sumo.extrapolation.job import ruled, run_in_memory
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.scene import STEP_S, SeedScene, States

MEET_M, APART_M, LEAST_STEPS, PASSED_M = 1.5, 4.0, 5, 2.5  # of centres of vehicles that pass one place
COLUMNS = ("order", "pairs", "brier", "nearest", "soonest")


def states_of(scene: SeedScene, models: str, futures: int, steps: int, rules: bool) -> States:
    """The futures of a mix of models in a world without SUMO."""
    settings = RunSettings(
        models=models, futures=futures, steps=steps, world="plain", rules=rules, metrics="gap"
    )
    assert scene.road is not None
    with tempfile.TemporaryDirectory() as folder:
        scene, net = ruled(scene, converted(scene.road, Path(folder) / "road.net.xml"), settings)
        return run_in_memory(scene, net, settings, ModelSet.of(settings)).states


def recorded(arguments: argparse.Namespace) -> Iterator[tuple[str, SeedScene]]:
    """Moments of a part of the recordings of each site, evenly spread over them."""
    for site in arguments.sites.split(","):
        folder = INTERACTION / site if site in INTERACTION_SITES else Path("taf_bw")
        chosen: list[tuple[object, float]] = []
        for recording in find_recordings([arguments.data / folder]):
            if site not in recording.name:
                continue
            loaded, last = load_recording(recording), -np.inf
            moments = recording_moments(loaded, every_s=STEP_S)
            if arguments.part != "all":
                moments = split_moments(moments, Split())[arguments.part]
            for moment in moments:
                if moment.complete and moment.vehicles > 1 and moment.time_s >= last + arguments.every - 1e-6:
                    last = moment.time_s
                    chosen.append((loaded, last))
        left = arguments.most
        for k in np.random.default_rng(0).permutation(len(chosen)).tolist():
            try:
                scene = seed_at(*chosen[k])
            except ScexError as error:
                print(error, file=sys.stderr)
                continue
            if left and any(True for _ in passings(scene, arguments.steps)):
                left -= 1
                yield site, scene


def measure_order(scene: SeedScene, states: States, steps: int, into: dict[str, list]) -> None:
    """Add the order of pairs that pass one place to the figures of a site."""
    for a, b, place, first, nearest, soonest in passings(scene, steps):
        times = [_passes(states, v, place) for v in (a, b)]
        p = float(np.where(times[0] == times[1], 0.5, times[0] < times[1]).mean())
        into["order"].append((p > 0.5) == first)
        into["brier"].append((p - first) ** 2)
        into["nearest"].append((nearest - first) ** 2)
        into["soonest"].append((soonest - first) ** 2)


def passings(scene: SeedScene, steps: int) -> Iterator[tuple[int, int, np.ndarray, bool, float, float]]:
    """Pairs that cross or merge in the recorded future: indices, place, whether the first passes first.

    At the end whether it is nearer, and whether it comes sooner by its way and speed.
    """
    whole = np.flatnonzero(scene.future_valid[:, :steps].all(axis=1)).tolist()
    x, y = (np.column_stack([getattr(scene.now, a), getattr(scene.future, a)[:, :steps]]) for a in "xy")
    points = np.stack([x, y], axis=-1)
    for a, b in ((a, b) for a in whole for b in whole if a < b):
        apart = np.hypot(*(points[a][:, None] - points[b]).transpose(2, 0, 1))
        if apart.min() > MEET_M or min(apart[0].min(), apart[:, 0].min()) < APART_M:
            continue
        close = np.argwhere(apart < MEET_M)
        i, j = close[close.sum(axis=1).argmin()]
        if abs(i - j) >= LEAST_STEPS:
            place = (points[a, i] + points[b, j]) / 2
            ways = [np.hypot(*(points[v, 0] - place)) for v in (a, b)]
            soon = [way / max(float(scene.now.speed[v]), 0.1) for v, way in zip((a, b), ways, strict=True)]
            yield a, b, place, bool(i < j), float(ways[0] < ways[1]), float(soon[0] < soon[1])


def _passes(states: States, v: int, place: np.ndarray) -> np.ndarray:
    away = np.hypot(states.x[:, :, v] - place[0], states.y[:, :, v] - place[1])
    k = away.argmin(axis=1)
    return np.where((away.min(axis=1) < PASSED_M) & (k < away.shape[1] - 1), k, np.inf)


def table(rows: dict[str, dict[str, list]]) -> str:
    """The figures of each site."""
    lines = [f"{'site':26}" + "".join(f"{name:>10}" for name in COLUMNS)]
    for site, of in rows.items():
        mean = defaultdict(lambda: np.nan) | {name: np.mean(values) for name, values in of.items()}
        cells = [f"{len(of['order']):10d}" if name == "pairs" else f"{mean[name]:10.3f}" for name in COLUMNS]
        lines.append(f"{site:26}" + "".join(cells))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("--sites", default=",".join(("k733", *INTERACTION_SITES[1:])))
    parser.add_argument("--part", default="test", choices=("train", "validation", "test", "all"))
    parser.add_argument("--every", type=float, default=5.0, help="least time between two moments, s")
    parser.add_argument("--most", type=int, default=60, help="moments of each site")
    parser.add_argument("--models", default="likely_driver")
    parser.add_argument("--futures", type=int, default=16)
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--no-rules", action="store_true")
    arguments = parser.parse_args()
    rows: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    for site, scene in recorded(arguments):
        states = states_of(
            scene, arguments.models, arguments.futures, arguments.steps, not arguments.no_rules
        )
        measure_order(scene, states, arguments.steps, rows[site])
        print(site, scene.name, file=sys.stderr)
    whole: dict[str, list] = defaultdict(list)
    for of in rows.values():
        for name, values in of.items():
            whole[name] += values
    print(table(rows | {"all": whole}))


if __name__ == "__main__":
    main()
