"""``rank`` over a Dask cluster: a scheduler and two workers on this machine, one of which dies."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import scex_sumo
from scex_sumo.base.errors import UsageError
from scex_sumo.studies.moments.workers import DaskWorkers
from scex_sumo.studies.rank.ranking_run import run_moment
from tests.command import scex, started

distributed = pytest.importorskip("distributed")

OPTIONS = ("--every", "3", "--futures", "4", "--top", "1")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def dask(*arguments: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "dask", *map(str, arguments), "--no-dashboard"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@dataclass
class Cluster:
    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler and two workers; tests that kill one of them come last."""
    address = f"tcp://127.0.0.1:{free_port()}"
    host, port = address.removeprefix("tcp://").split(":")
    scheduler = dask("scheduler", "--host", host, "--port", port)
    options = ("--nthreads", 1, "--no-nanny", "--local-directory", tmp_path_factory.mktemp("dask"))
    workers = [dask("worker", address, *options) for _ in range(2)]
    with distributed.Client(address, timeout=60, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
    yield Cluster(address, scheduler, workers)
    for process in (*workers, scheduler):
        process.kill()
        process.wait()


def result_of(folder: Path) -> dict[str, bytes]:
    files = [f for f in sorted(folder.rglob("*")) if f.is_file() and f.name != "rank.json"]
    return {str(f.relative_to(folder)): f.read_bytes() for f in files}


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    folder = tmp_path / "dataset"
    folder.mkdir()
    for suffix in (".osm", ".csv"):
        shutil.copy(scex_sumo.example_path("roundabout").with_suffix(suffix), folder)
    return folder


def begun(folder: Path) -> None:
    """Wait until the first seed has come back."""
    deadline = time.monotonic() + 60
    while not list(folder.glob("pairs/*/*/*.parquet")) and time.monotonic() < deadline:
        time.sleep(0.01)


def test_a_validation_over_the_cluster_is_that_of_this_machine(
    cluster: Cluster, dataset: Path, tmp_path: Path
) -> None:
    told = {}
    for name, option in (("cluster", ("--workers", cluster.address)), ("alone", ())):
        folder = tmp_path / name
        words = ("--every", "8", "--futures", "2", *option, "-o", folder)
        done = scex("validate", dataset, *words)
        assert done.returncode == 0, done.stderr
        told[name] = {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.parquet")}
    assert told["cluster"] == told["alone"]


def test_a_worker_killed_in_the_middle_changes_no_byte(
    cluster: Cluster, dataset: Path, tmp_path: Path
) -> None:
    ranking = started("rank", dataset, *OPTIONS, "--workers", cluster.address, "-o", tmp_path / "cluster")
    begun(tmp_path / "cluster")
    cluster.workers[0].kill()
    done = ranking.wait()
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "cluster" / "rank.json").exists()

    alone = scex("rank", dataset, *OPTIONS, "-o", tmp_path / "alone")
    assert alone.returncode == 0, alone.stderr
    assert result_of(tmp_path / "cluster") == result_of(tmp_path / "alone")
    table = pq.read_table(tmp_path / "cluster" / "moments.parquet")
    assert table["failure"].null_count == table.num_rows == 5


def test_when_the_scheduler_goes_away_one_line_says_how_to_go_on(
    cluster: Cluster, dataset: Path, tmp_path: Path
) -> None:
    ranking = started("rank", dataset, *OPTIONS, "--workers", cluster.address, "-o", tmp_path / "out")
    begun(tmp_path / "out")
    cluster.scheduler.kill()
    done = ranking.wait()
    assert done.returncode == 1
    kept = "finished seed scenes are kept; run the same command again to go on"
    assert done.stderr == f"error: the Dask scheduler went away; {kept}\n"


@pytest.mark.parametrize(
    ("address", "words"),
    [("nonsense", "needs a number or auto"), (f"tcp://127.0.0.1:{free_port()}", "no Dask scheduler answers")],
    ids=["no address", "a free port"],
)
def test_an_address_where_nobody_answers_is_refused(tmp_path: Path, address: str, words: str) -> None:
    done = scex("rank", scex_sumo.example_path("roundabout"), "--workers", address, "-o", tmp_path / "out")
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: --workers {address}: ")
    assert words in line


def test_tls_without_a_certificate_is_refused_in_one_line() -> None:
    """Dask would try for 40 s, with a traceback."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        address = f"tls://127.0.0.1:{listening.getsockname()[1]}"
        with pytest.raises(UsageError, match="no certificate for TLS; name ca-file, cert and key"):
            DaskWorkers(address, run_moment)


def test_no_scheduler_of_the_docs_is_open_to_everybody() -> None:
    """Whoever reaches a scheduler runs code: each listens on this machine alone, or asks for certificates."""
    text = (Path(__file__).parents[3] / "docs" / "cluster.md").read_text()
    schedulers = [line for line in text.splitlines() if line.startswith("dask scheduler")]
    assert len(schedulers) == 1
    assert all("--host 127.0.0.1" in line or "--protocol tls" in line for line in schedulers)
