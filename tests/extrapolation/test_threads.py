"""Threads that extrapolate at once wait for each other: libsumo and standard error are one in a process."""

from __future__ import annotations

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from tests.runs import extrapolate


def test_two_threads_have_the_results_of_one_after_the_other(tmp_path: Path) -> None:
    scenes = [read_seed(example_path(name)) for name in ("roundabout", "motorway_merge")]
    out, error = sys.stdout, os.fstat(2)

    def run(k: int, out: str) -> bytes:
        mix = "sumo:EIDM,standard_driver"
        extrapolate(scenes[k], futures=2, models=mix, steps=5, workers=1, out=tmp_path / out / str(k))
        return (tmp_path / out / str(k) / "tracks.parquet").read_bytes()

    with ThreadPoolExecutor(2) as threads:
        together = [*threads.map(run, range(2), ["together"] * 2)]
    assert together == [*map(run, range(2), ["alone"] * 2)]
    assert sys.stdout is out and os.path.samestat(os.fstat(2), error)
