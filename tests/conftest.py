"""Shared fixtures."""

from __future__ import annotations

import gc
import os
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests.command import forkserver
from tests.workers import forked_workers

# Times of a busy machine say nothing about what is tested.
settings.register_profile("suite", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("suite")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background: futures inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

REPOSITORY = Path(__file__).resolve().parents[1]


def shared_data() -> Path | None:
    """Folder of the real maps and recordings, or None where it is absent."""
    folder = Path(os.environ.get("SCEX_DATA", REPOSITORY.parent / "shared" / "data"))
    return folder if folder.is_dir() else None


gc.disable()  # while tests are collected: half a million objects that stay


def pytest_collection_finish() -> None:
    """Garbage is looked for among what tests make, not each time among all that was imported."""
    gc.freeze()
    gc.enable()


def pytest_xdist_auto_num_workers() -> int:
    """One process more than cores: a third of the time a test waits for a program, a page or a clock."""
    return (os.cpu_count() or 1) + 1


@pytest.fixture(scope="session")
def data() -> Path:
    """The real maps and recordings; skips the test where they are absent."""
    folder = shared_data()
    if folder is None:
        pytest.skip("real maps and recordings are not here; set SCEX_DATA to their folder")
    return folder


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests neither use nor fill the user's cache, but for matplotlib's list of fonts; they share one."""
    fonts = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "matplotlib"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MPLCONFIGDIR", os.environ.get("MPLCONFIGDIR", str(fonts)))
        base = tmp_path_factory.getbasetemp()
        ours = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
        patch.setenv("XDG_CACHE_HOME", str(ours / "cache"))
        patch.setenv("SCEX_WORKERS", "1")  # tests share the cores already
        yield


@pytest.fixture(scope="module", autouse=True)
def _quick_workers(request: pytest.FixtureRequest) -> Iterator[None]:
    """Worker processes start in milliseconds, but for modules that test them: `NEW_PROCESSES`."""
    with nullcontext() if hasattr(request.module, "NEW_PROCESSES") else forked_workers(forkserver()):
        yield


@pytest.fixture
def registered_models(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """The models that a test registers, by name; forgotten after it."""
    models: dict[str, object] = {}
    monkeypatch.setattr("scex_sumo.drivers.registry._registered", models)
    return models


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """One line for each reason that tests were skipped for: what was not tested is not hidden."""
    skipped = terminalreporter.stats.get("skipped", [])
    reasons = Counter(report.longrepr[2].removeprefix("Skipped: ") for report in skipped)
    for reason, count in reasons.most_common():
        terminalreporter.write_line(f"not tested: {count} tests: {reason}")
