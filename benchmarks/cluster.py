"""What seed scenes cost on a Dask cluster of two workers, and what forty thousand would.

    python benchmarks/cluster.py [DATASET] [--every S]

The scheduler's time has its idle time in it, so more workers than the printed ones may be fed.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import psutil
from distributed import Client

import scex_sumo
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.studies.moments.workers import DaskWorkers
from scex_sumo.studies.rank.folder import RankFolder, run_moment
from scex_sumo.studies.rank.ranking_run import RankingRun
from scex_sumo.studies.rank.settings import RankSettings

DATASET = scex_sumo.example_path("roundabout").parent
MODELS = ("standard_driver", "risky_driver", "constant_velocity", "emergency_brake")
FORTY_THOUSAND = 40_000


@contextmanager
def dask_cluster(workers: int) -> Iterator[str]:
    """A scheduler and workers on loopback, one thread each."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    address = f"tcp://127.0.0.1:{port}"
    with tempfile.TemporaryDirectory() as folder:
        options = ["--nthreads", "1", "--no-nanny", "--local-directory", folder]
        commands = [["scheduler", "--host", "127.0.0.1", "--port", port]]
        commands += [["worker", address, *options]] * workers
        one_thread = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        running = [
            subprocess.Popen(
                [sys.executable, "-m", "dask", *command, "--no-dashboard"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=one_thread,
            )
            for command in commands
        ]
        try:
            yield address
        finally:
            for process in reversed(running):
                process.kill()
                process.wait()


def cluster_workers(address: str, count: int) -> DaskWorkers:
    """Workers that are there, once the scheduler answers."""
    deadline = time.monotonic() + 60
    while True:
        try:
            Client(address, timeout=5, set_as_default=False).close()
            break
        except OSError:
            if time.monotonic() > deadline:
                raise
    workers = DaskWorkers(address, run_moment)
    workers._client.wait_for_workers(count, timeout=60)
    return workers


def resident(pid: int) -> float:
    """Memory of a process, MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1e3


def used(process: psutil.Process) -> float:
    """Processor time, s."""
    return sum(process.cpu_times()[:2])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", nargs="?", type=Path, default=DATASET)
    parser.add_argument("--every", type=float, default=1.0)
    args = parser.parse_args()
    settings = RankSettings(run=RunSettings(models=MODELS, futures=32), every=args.every, top=1)
    with dask_cluster(2) as address, tempfile.TemporaryDirectory() as out:
        workers = cluster_workers(address, 2)
        scheduler, *both = psutil.Process().children()
        owners = [psutil.Process(), scheduler, both[0]]
        begin = [used(process) for process in (owners[0], scheduler, *both)]
        seen: list[list[float]] = []
        with closing(workers), RankFolder(Path(out) / "out", {}) as folder:
            recordings = find_recordings([args.dataset])
            RankingRun(
                recordings,
                settings,
                folder,
                workers,
                lambda *_: seen.append([resident(p.pid) for p in owners]),
            ).run()
        own, handing, *work = (
            used(process) - start for process, start in zip((owners[0], scheduler, *both), begin, strict=True)
        )
        size = sum(f.stat().st_size for f in Path(out).rglob("*") if f.is_file())
    seeds = len(seen) - 1
    each_s, each_kb = sum(work) / seeds, size / seeds / 1e3
    print(f"Dask, 2 workers, pairs of {seeds} seeds: {each_s:.2f} s in a worker, ", end="")
    print(f"{1e3 * own / seeds:.0f} ms in the main process, {1e3 * handing / seeds:.0f} ms in the scheduler")
    print(f"  {FORTY_THOUSAND} seeds: {each_s * FORTY_THOUSAND / 3600:.1f} core-hours, ", end="")
    print(
        f"{each_kb * FORTY_THOUSAND / 1e6:.2f} GB, at least {each_s * seeds / max(own, handing):.0f} workers"
    )
    names = "main process", "scheduler", "worker"
    for name, half, end in zip(names, seen[seeds // 2], seen[-1], strict=True):
        print(f"  {name}: {half:.0f} MB after half of the seeds, {end:.0f} MB at the end")


if __name__ == "__main__":
    main()
