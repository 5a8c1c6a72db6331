"""Pairs of a ranking at scale: seeds per minute, costs per seed, memory, sizes on disk.

    python benchmarks/rank.py [DATASET] [--every S] [--repeat 3] [--what PART,...]

Throughput is taken between the first and the last seed that comes back, without start, table and page; one
and two workers take turns, medians. Costs, of the process that hands out the seeds, are processor time.
"""

from __future__ import annotations

import argparse
import os
import pickle
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import scex_sumo
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.studies.moments.cut import list_moments, moment_tasks
from scex_sumo.studies.moments.run import MomentTask
from scex_sumo.studies.moments.workers import DaskWorkers, LocalWorkers, MomentWorkers
from scex_sumo.studies.rank.folder import RankFolder, run_moment
from scex_sumo.studies.rank.ranking_run import RankingRun
from scex_sumo.studies.rank.settings import RankSettings

DATASET = scex_sumo.example_path("roundabout").parent
MODELS = ("standard_driver", "risky_driver", "constant_velocity", "emergency_brake")
TEN_THOUSAND, FORTY_THOUSAND = 10_000, 40_000


def settings_of(args: argparse.Namespace) -> RankSettings:
    return RankSettings(run=RunSettings(models=MODELS, futures=32), every=args.every, top=1)


def run_all(args: argparse.Namespace, workers: MomentWorkers, progress: Callable[[int, int], None]) -> None:
    """Run all moments into a folder that is not kept, with workers that are ended after it."""
    with tempfile.TemporaryDirectory() as out:
        run_into(Path(out) / "out", args, workers, progress)


def run_into(
    out: Path, args: argparse.Namespace, workers: MomentWorkers, progress: Callable[[int, int], None]
) -> None:
    with closing(workers), RankFolder(out, {}) as folder:
        RankingRun(find_recordings([args.dataset]), settings_of(args), folder, workers, progress).run()


def seeds_per_minute(args: argparse.Namespace, workers: MomentWorkers) -> tuple[float, int, float]:
    """Rate of workers that have started, the number of seeds, this process's own seconds for each."""
    times: list[float] = []
    begin = time.process_time()
    run_all(args, workers, lambda done, total: times.append(time.perf_counter()))
    came = times[1:]  # the first is the beginning
    own = (time.process_time() - begin) / len(came)
    return 60 * (len(came) - 1) / (came[-1] - came[0]), len(came), own


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


def cluster_workers(address: str, count: int) -> MomentWorkers:
    from distributed import Client

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


def throughput(args: argparse.Namespace) -> None:
    rates: dict[tuple[str, int], list[float]] = {}
    for _ in range(args.repeat):
        for workers in (1, 2):
            rate, seeds, own = seeds_per_minute(args, LocalWorkers(workers, run_moment))
            rates.setdefault(("processes", workers), []).append(rate)
            with dask_cluster(workers) as address:
                rate, seeds, own_dask = seeds_per_minute(args, cluster_workers(address, workers))
            rates.setdefault(("dask", workers), []).append(rate)
    print(f"throughput, pairs of {seeds} seeds, median of {args.repeat}:")
    for kind in ("processes", "dask"):
        one, two = (statistics.median(rates[kind, n]) for n in (1, 2))
        print(
            f"  {kind:10} 1 worker {one:7.1f} seeds/min, 2 workers {two:7.1f}: {two / (2 * one):.0%} of 2 x 1"
        )
    print(f"  of this process per seed: {1e3 * own:.0f} ms with processes, {1e3 * own_dask:.0f} ms with dask")


def costs(args: argparse.Namespace) -> None:
    """What the process that hands out the seeds spends on each."""
    begin = time.process_time()
    loaded = [load_recording(recording) for recording in find_recordings([args.dataset])]
    loading = time.process_time() - begin
    listings = {
        one.recording.name: list_moments(
            one.recording, recording_moments(one, every_s=args.every), min_vehicles=2
        )
        for one in loaded
    }
    refs = [(ref, one) for one in loaded for ref in listings[one.recording.name].moments]
    begin = time.process_time()
    for ref, one in refs:
        seed_at(one, ref.time_s, case=ref.case or None)
    building = (time.process_time() - begin) / len(refs)
    items = moment_tasks(
        [one.recording for one in loaded],
        listings,
        settings_of(args),
        range(0),
        wanted=lambda listing: listing.moments[:: max(len(listing.moments) // 5, 1)],
    )
    tasks = [task for task in items if isinstance(task, MomentTask)]
    sent = [pickle.dumps(task) for task in tasks]
    parts = [(task.ref, run_moment(task)) for task in tasks]
    begin = time.process_time()
    parts = [(task.ref, run_moment(task)) for task in tasks]
    running = (time.process_time() - begin) / len(tasks)
    back = [pickle.dumps(part) for _, part in parts]
    begin = time.process_time()
    for content in sent:
        pickle.loads(content)
    for task in tasks:
        pickle.dumps(task)
    packing = (time.process_time() - begin) / len(sent)
    with tempfile.TemporaryDirectory() as out, RankFolder(Path(out) / "out", {}) as folder:
        begin = time.process_time()
        for ref, part in parts:
            folder.save(ref, part)
        appending = (time.process_time() - begin) / len(parts)
    print(f"costs per seed, {len(refs)} seeds in {len(loaded)} recordings:")
    print(f"  worker: {1e3 * running:.0f} ms")
    print(f"  main process: load {1e3 * loading / len(refs):.1f} ms, build {1e3 * building:.1f} ms, ", end="")
    print(f"pack and unpack {1e3 * packing:.1f} ms, append {1e3 * appending:.1f} ms")
    print(f"  bytes: {mean(sent):.0f} to the worker, {mean(back):.0f} back")


def mean(contents: Sequence[bytes]) -> float:
    return sum(map(len, contents)) / len(contents)


def echo(content: bytes, size: int) -> bytes:
    """A task that does nothing, with the bytes of one that does."""
    return content[:size]


def scheduler(args: argparse.Namespace, *, to: int = 60_000, back: int = 10_000, tasks: int = 2000) -> None:
    """How many tasks per second Dask hands out and brings back."""
    from distributed import Client, as_completed

    with dask_cluster(2) as address:
        cluster_workers(address, 2).close()
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
            content = os.urandom(to)
            begin = time.perf_counter()
            running = as_completed(
                [client.submit(echo, content, back, pure=False) for _ in range(20)], loop=client.loop
            )
            left = tasks - 20
            for future in running:
                future.result()
                future.release()
                if left:
                    left -= 1
                    running.add(client.submit(echo, content, back, pure=False))
            rate = tasks / (time.perf_counter() - begin)
    print(f"scheduler: {rate:.0f} tasks/s with {to} bytes there and {back} back, 2 workers, 20 in flight")


def resident(pid: int) -> float:
    """Memory of a process, MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1e3


def memory(args: argparse.Namespace) -> None:
    """Resident memory of main process and worker over the seeds."""
    workers = LocalWorkers(1, run_moment)
    worker = workers._workers.pool._workers[0]._process.pid
    seen: list[tuple[float, float]] = []
    run_all(args, workers, lambda *_: seen.append((resident(os.getpid()), resident(worker))))
    print(f"memory over {len(seen) - 1} seeds, MB:")
    for share in (0.1, 0.25, 0.5, 0.75, 1.0):
        index = max(int(share * (len(seen) - 1)), 1)
        print(f"  after {index:5d} seeds: main process {seen[index][0]:.0f}, worker {seen[index][1]:.0f}")


def cluster(args: argparse.Namespace) -> None:
    """What seeds cost on a Dask cluster of two workers, and what forty thousand would.

    The scheduler's time has its idle time in it, so more workers than the printed ones may be fed.
    """
    import psutil

    def used(process: psutil.Process) -> float:
        return sum(process.cpu_times()[:2])

    with dask_cluster(2) as address, tempfile.TemporaryDirectory() as out:
        workers = cluster_workers(address, 2)
        scheduler, *both = psutil.Process().children()
        owners = [psutil.Process(), scheduler, both[0]]
        begin = [used(each) for each in (owners[0], scheduler, *both)]
        seen: list[list[float]] = []
        run_into(Path(out) / "out", args, workers, lambda *_: seen.append([resident(p.pid) for p in owners]))
        own, handing, *work = (
            used(each) - start for each, start in zip((owners[0], scheduler, *both), begin, strict=True)
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


def sizes(args: argparse.Namespace) -> None:
    """Bytes of pairs on disk per seed, and for ten thousand."""
    with tempfile.TemporaryDirectory() as out:
        run_into(Path(out) / "out", args, LocalWorkers(2, run_moment), lambda *_: None)
        files = list(Path(out).glob("out/pairs/*/*/*.parquet"))
        each = sum(file.stat().st_size for file in files) / len(files)
    print(f"sizes: {each / 1e3:.1f} kB per seed; {each * TEN_THOUSAND / 1e9:.2f} GB for {TEN_THOUSAND} seeds")


PARTS = {
    "throughput": throughput,
    "costs": costs,
    "scheduler": scheduler,
    "memory": memory,
    "cluster": cluster,
    "sizes": sizes,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", nargs="?", type=Path, default=DATASET)
    parser.add_argument("--every", type=float, default=1.0)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--what", default=",".join(PARTS), help=f"some of {','.join(PARTS)}")
    args = parser.parse_args()
    for name in args.what.split(","):
        PARTS[name](args)


if __name__ == "__main__":
    main()
