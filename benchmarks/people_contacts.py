"""Contacts of human-like drivers with people that are replayed, and with people that decide for themselves.

    python benchmarks/people_contacts.py --data ../shared/data

Thirteen maps: seven of recordings with people; four of INTERACTION and two of ours with synthetic traffic. A
contact is a future in which the boxes of a vehicle and a person overlap that did not in the seed scene.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from fit_people import touching
from people_moments import SETS

import scex_sumo as scex
from scex_sumo.base.errors import ScexError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.results.participants import with_people
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States

EXAMPLES = ("roundabout", "motorway_merge", "urban_intersection")
SITES = ("Roundabout_FT", "Roundabout_SR", "Intersection_EP0", "Intersection_GL")
LEFT_OUT = ("k729_2022-03-16_", 4)  # of the files of one map, that many are read


def scenes(data: Path, most: int) -> Iterator[tuple[str, SeedScene]]:
    """Yield name and seed scenes with people and vehicles, evenly over each recording."""
    for folder in SETS.values():
        for recording in find_recordings([data / folder]):
            prefix, files = LEFT_OUT
            if recording.name.startswith(prefix) and int(recording.name.removeprefix(prefix)) >= files:
                continue
            loaded, found = load_recording(recording), list[SeedScene]()
            for moment in recording_moments(loaded, every_s=2.0):
                try:
                    scene = seed_at(loaded, moment.time_s)
                except ScexError:
                    continue
                if (people := with_people(scene, "model").people) is not None and not people.all():
                    found.append(scene)
            name = recording.name.rpartition("_")[0] if recording.name.startswith(prefix) else recording.name
            yield from ((name, scene) for scene in found[:: max(1, -(-len(found) // most))])
    maps = [scex.example_path(name) for name in EXAMPLES]
    maps += [data / f"interaction/maps/DR_USA_{site}.osm" for site in SITES]
    for path in maps:
        for seed in range(most):
            scene = scex.synthetic_seed(path, vehicles=8, people=8, seed=seed, like="recorded")
            if scene.obstacles is not None:  # motorways have no people
                yield path.stem, scene


def contacts(run: scex.Run) -> tuple[int, int, int]:
    """Return futures with a contact, contacts, and pairs of a vehicle and a person in all futures."""
    scene = run.scene
    many = States.stack([run.states(future)[:, HISTORY_STEPS - 1 :] for future in range(run.futures)], axis=0)
    if tracks := run.info["seed_scene"].get("people"):
        takes = np.isin(scene.track_ids, tracks)
        people, cars = np.flatnonzero(takes), np.flatnonzero(~takes)
        whole, walking = scene, many[:, people]
    else:
        others = scene.obstacles
        assert others is not None
        whole = with_people(scene, "model")
        assert whole.people is not None
        people, cars = np.flatnonzero(whole.people), np.flatnonzero(~whole.people)
        there, now = others.states[:, HISTORY_STEPS], whole.now[people]
        row = np.hypot(now.x[:, None] - there.x, now.y[:, None] - there.y).argmin(axis=1)
        frames = slice(HISTORY_STEPS, HISTORY_STEPS + many.shape[2])
        walking = others.states[row, frames].repeat(run.futures)
    hit = _hits(walking, many[:, cars], whole, people, cars)
    return int(hit.any(axis=(1, 2)).sum()), int(hit.sum()), hit.size


def _hits(
    walking: States, driven: States, scene: SeedScene, people: np.ndarray, cars: np.ndarray
) -> np.ndarray:
    each = [touching(walking[c : c + 1], driven[c], scene, people, cars)[0] for c in range(len(walking.x))]
    first = touching(walking[:1, :, :1], driven[0, :, :1], scene, people, cars)[0]
    return np.asarray(np.stack(each) & ~first)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--futures", type=int, default=12)
    parser.add_argument("--moments", type=int, default=4)
    options = parser.parse_args()
    counts: dict[str, dict[str, np.ndarray]] = {}
    for name, scene in scenes(options.data, options.moments):
        for vru in ("replay", "model"):
            run = scex.extrapolate(
                scene,
                futures=options.futures,
                models="likely",
                vru=vru,
                reference="none",
                response=None,
                report=False,
            )
            row = np.array([options.futures, *contacts(run)])
            mine = counts.setdefault(name, {})
            mine[vru] = mine.get(vru, np.zeros(4, dtype=int)) + row
        print(name, {vru: row.tolist() for vru, row in counts[name].items()}, flush=True)
    total = {vru: np.sum([mine[vru] for mine in counts.values()], axis=0) for vru in ("replay", "model")}
    for name, mine in [*counts.items(), ("all", total)]:
        shares = [
            f"{row[1]} of {row[0]} futures, {100 * row[2] / row[3]:.2f} % of pairs" for row in mine.values()
        ]
        print(f"{name} | {' | '.join(shares)}")


if __name__ == "__main__":
    main()
