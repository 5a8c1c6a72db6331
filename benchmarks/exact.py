"""Exact probabilities on recorded scenes: how many pairs have them, how often they are wrong, what they cost.

Ten scenes of 5 to 83 vehicles on which the search was developed, and ten others; the rule-based models, 385
drawn futures. The tables predict the collisions of 2000 futures that were drawn independently, with another
seed. The cost is the processor time of the run with exact probabilities less that without, over the run's
with human-like reference and report.

    python benchmarks/exact.py [DATA] [--set developed|others] [--fresh 2000]
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import scex_sumo
from scex_sumo.base.arrays import BoolArray
from scex_sumo.certainty.tables import InfluenceTable
from scex_sumo.results.run import Run
from scex_sumo.results.tables.outcomes import first_contacts
from scex_sumo.scene import SeedScene

SCENES = {
    "developed": (
        ("ngsim", "Peach-2_1", 0.25),
        ("ngsim", "Peach-3_1", 0.5),
        ("ngsim", "Peach-3_2", 0.5),
        ("ngsim", "Lanker-2_16", 0.5),
        ("ngsim", "Lanker-2_4", 0.5),
        ("ngsim", "Lanker-2_24", 0.25),
        ("taf_bw", "k733_2020", 0.5),
        ("mona", "MONAEast", 0.5),
        ("mona", "MONAMerge", 0.25),
        ("mona", "MONAWest", 0.5),
    ),
    "others": (
        ("ngsim", "Lanker-2_10", 0.5),
        ("ngsim", "Lanker-2_12", 0.25),
        ("ngsim", "Lanker-2_15", 0.5),
        ("ngsim", "Lanker-2_20", 0.75),
        ("taf_bw", "k729_2022-03-16_004", 0.5),
        ("taf_bw", "k729_2022-03-16_013", 0.5),
        ("taf_bw", "k733_2020", 0.25),
        ("mona", "MONAEast", 0.2),
        ("mona", "MONAMerge", 0.75),
        ("mona", "MONAWest", 0.2),
    ),
}
"""Data set, part of a recording's name, share of its time."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")
    parser.add_argument("data", type=Path, nargs="?", default=default)
    parser.add_argument("--fresh", type=int, default=2000)
    parser.add_argument("--set", choices=SCENES, default="developed")
    options = parser.parse_args()
    print("|scene|vehicles|colliding pairs|exact|vehicles that decide|extra futures", end="")
    print("|P(any) sampled|exact|fresh|wrong pairs, worst share|remainder|cost|")
    print("|---" * 12 + "|")
    total = np.zeros(5)
    for name, scene in scenes(options.data, options.set):
        row, counts = measured(name, scene, options.fresh)
        total += counts
        print(row, flush=True)
    pairs, exact, wrong = total[:3].astype(int).tolist()
    print(f"\n{exact} of {pairs} colliding pairs are exact ({exact / pairs:.0%}); ", end="")
    print(f"{wrong} of the exact ones are wrong in a larger share of the fresh futures than the remainder;")
    share = total[3] / total[4]
    print(f"extra futures: {total[3]:.1f} s of processor time, the runs: {total[4]:.1f} s ({share:.2f})")


def scenes(data: Path, chosen: str) -> Iterator[tuple[str, SeedScene]]:
    """The recorded scenes."""
    for folder, part, share in SCENES[chosen]:
        recording = next(r for r in scex_sumo.find_recordings([data / folder]) if part in r.name)
        loaded = scex_sumo.load_recording(recording)
        times = [moment.time_s for moment in scex_sumo.recording_moments(loaded, every_s=1.0)]
        yield part, scex_sumo.seed_at(loaded, times[int(share * len(times))])


def measured(name: str, scene: SeedScene, count: int) -> tuple[str, tuple[float, ...]]:
    """A row of the table; numbers of pairs that collide, are exact, are wrong too often; seconds."""
    with tempfile.TemporaryDirectory() as folder:
        scex_sumo.extrapolate(scene, futures=2, out=Path(folder) / "warm")
        spent = {}
        for exact in (False, True):
            begin = time.process_time()
            run = scex_sumo.extrapolate(
                scene, out=Path(folder) / f"exact_{exact}", exact=exact, reference=None, report=False
            )
            spent[exact] = time.process_time() - begin
        begin = time.process_time()
        scex_sumo.extrapolate(scene, out=Path(folder) / "whole", exact=False)
        rest = time.process_time() - begin - spent[False]
        fresh = scex_sumo.extrapolate(
            scene,
            futures=count,
            design="random",
            seed=4711,
            world="plain",
            metrics=["gap"],
            exact=False,
            reference=None,
            report=False,
            out=Path(folder) / "fresh",
        )
        found = scex_sumo.exact_of(run)
        assert found is not None
        tables = {key: table for key, table in found.tables.items() if key[2] == "collision"}
        sampled = [key for key in found.sampled if key[2] == "collision"]
        shares = [
            float(np.mean(predicted(table, fresh) != collided(fresh, *key[:2])))
            for key, table in tables.items()
        ]
        sizes = np.bincount([len(table.track_ids) for table in tables.values()], minlength=9)[1:]
        limit = max((table.remainder for table in tables.values()), default=3 / found.checked)
        any_exact = found.probability()
        extra, whole = spent[True] - spent[False], spent[False] + rest
        cells = (
            name,
            scene.vehicles,
            len(tables) + len(sampled),
            len(tables),
            " ".join(f"{k}:{n}" for k, n in enumerate(sizes.tolist(), 1) if n) or "–",
            found.extra,
            f"{run.collision.sampled.value:.2%}",
            "sampled" if any_exact is None else f"{any_exact:.2%}",
            f"{fresh.collision.sampled.value:.2%}",
            f"{sum(share > 0 for share in shares)}, {max(shares, default=0):.2%}",
            f"{limit:.2%}",
            f"{extra / whole:.2f}",
        )
        too_often = sum(share > limit for share in shares)
    row = f"|{'|'.join(str(cell) for cell in cells)}|"
    return row, (len(tables) + len(sampled), len(tables), too_often, extra, whole)


def collided(run: Run, one: int, other: int) -> BoolArray:
    """(C,) whether two vehicles collide in each future, neither of which had collided before."""
    table = first_contacts(run.collisions)
    ids = np.sort([np.asarray(table["track_id"]), np.asarray(table["other_id"])], axis=0)
    rows = (ids[0] == one) & (ids[1] == other)
    return np.isin(np.arange(run.futures), np.asarray(table["future"])[rows])


def predicted(table: InfluenceTable, run: Run) -> BoolArray:
    """(C,) whether a table says that its event happens in each future."""
    tracks = run.info["seed_scene"]["track_ids"]
    models = np.array(run.assignments["model"].to_pylist()).reshape(-1, len(tracks))
    at = tuple(
        np.array([table.draws.models.index(model) for model in models[:, tracks.index(track)]])
        for track in table.track_ids
    )
    return np.broadcast_to(table.outcomes[at], (run.futures,))


if __name__ == "__main__":
    main()
