"""Wrong origins: how many recordings get a warning where they lie, and moved by 2 to 12 m in 8 directions.

Each recording is moved before its tracks are aligned. Recordings of too few tracks or directions fit any map
and are counted apart.

    python benchmarks/origins.py [DATA]
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

import scex_sumo
from scex_sumo.converters.datasets.reader import read_clean
from scex_sumo.converters.tracks.evidence import evidence, on_lanes
from scex_sumo.formats.cleaning.align import align_tracks
from scex_sumo.formats.cleaning.mismatch import doubt_place
from scex_sumo.formats.cleaning.shift import find_shift

MOVED_M = (0, 2, 4, 6, 8, 12)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")
    parser.add_argument("data", type=Path, nargs="?", default=default)
    data = parser.parse_args().data
    totals, few = np.zeros((len(MOVED_M), 2), dtype=np.int64), 0
    print("|recording|tracks|on lanes|warned, of 8: " + "|".join(f"{m} m" for m in MOVED_M[1:]) + "|")
    for recording in scex_sumo.find_recordings([data / name for name in ("mona", "ngsim", "taf_bw")]):
        road = scex_sumo.load_recording(recording).road
        table = read_clean(recording.track_paths, road, align=False).table
        right = evidence(align_tracks(table, road)[0].vehicles)
        if find_shift(right, road) is None:
            few += 1
            continue
        warned = []
        for distance in MOVED_M:
            angles = np.arange(8 if distance else 1) * np.pi / 4
            moves = distance * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            doubts = []
            for dx, dy in moves.tolist():
                rows = table.vehicles.with_columns(x=table.vehicles.x + dx, y=table.vehicles.y + dy)
                moved, _ = align_tracks(replace(table, vehicles=rows), road)
                doubts.append(doubt_place(evidence(moved.vehicles), road) is not None)
            warned.append(sum(doubts))
            totals[MOVED_M.index(distance)] += (sum(doubts), len(doubts))
        counts = "|".join(map(str, warned[1:]))
        print(f"|{recording.name}|{right.tracks}|{on_lanes(right, road):.0%}|{counts}|", flush=True)
    shares = [f"{m} m {hit} of {count}" for m, (hit, count) in zip(MOVED_M, totals.tolist(), strict=True)]
    print(f"warned: {', '.join(shares)}; {few} recordings have too few tracks or directions")


if __name__ == "__main__":
    main()
