"""Test of a driving function on a suite: cases shared out to workers, resumed, judged and written."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import check_output, sha256_of, write_atomic, write_output
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.base.version import __version__
from scex_sumo.behaviors.base import layers
from scex_sumo.behaviors.models.simple import SumoDriver
from scex_sumo.drivers.registry import ModelSpec, build, model_specs
from scex_sumo.results.info import versions
from scex_sumo.studies.moments.folder import Failure, StudyFolder
from scex_sumo.studies.moments.run import MomentWorkers
from scex_sumo.suites.suite import SUITE, Case, Suite, open_suite
from scex_sumo.suites.testing.outputs import junit_text, markdown_text, write_test_page
from scex_sumo.suites.testing.result import VERDICTS, compared, number_of, read_result, unseen, with_verdicts
from scex_sumo.suites.testing.tasks import CaseTask, run_case, task_of

RESULT: Final = "test.json"
PAGE: Final = "test.html"
SUMMARY: Final = "summary.md"
LIMIT_S: Final = 60.0
LEAST: Final = 4
"""Least number of futures of a case."""
_RECORDS = "records"
_PICTURE = ("picture", "outlines", "contact")


class TestFolder(StudyFolder):
    """Folder of a test: a record for each case that has run."""

    __test__ = False  # pytest
    info, what = RESULT, "test"
    another = "another test, of another suite or function"
    evidence = (_RECORDS, PAGE)
    trees, records = (), (_RECORDS,)
    kept = (PAGE, SUMMARY)

    def record(self, name: str) -> dict[str, Any] | None:
        """Return the record of a case; None if it has not run."""
        rows = self._load(_RECORDS, name)
        return None if rows is None else rows[0]

    def keep(self, name: str, record: Mapping[str, Any]) -> None:
        """Keep the record of a case."""
        self._save(_RECORDS, name, [dict(record)])


@dataclass(frozen=True, kw_only=True, eq=False)
class SuiteTest:
    """Result of a function on a suite.

    Attributes:
        result: content of ``test.json``.

    Example:
        >>> [name for name in scex.SuiteTest.__dataclass_fields__]
        ['folder', 'result']
    """

    folder: Path
    result: Mapping[str, Any]


@checked
def test_suite(
    suite: str | Path | Suite,
    under_test: Any,
    *,
    out: str | Path,
    futures: int | None = None,
    cases: Sequence[str] | None = None,
    workers: int = 1,
    time_limit: float = LIMIT_S,
    against: str | Path | None = None,
    junit: str | Path | None = None,
    overwrite: bool = False,
    command: Sequence[str] | None = None,
    progress: Progress | bool | None = None,
) -> SuiteTest:
    """Run a driving function in the cases of a suite, and judge it against people.

    Args:
        suite: of `catalogue`, or its folder.
        under_test: a model in any form that ``under_test`` of `extrapolate` takes.
        out: folder of the result; an interrupted test goes on.
        futures: of each case; None: those of the suite.
        cases: names; None: all.
        workers: processes.
        time_limit: of a case, s.
        against: ``test.json`` of another function, or an older one, on the same suite.
        junit: file to write.
        overwrite: replace another test in ``out``.

    Raises:
        UsageError: the function or an argument makes no sense.
        ResultError: the suite is damaged, or the folder cannot be written.

    Example:
        >>> suite = scex.catalogue(scex.example_path("roundabout"), out="suite", count=2, every=9, formats=())
        >>> scex.test_suite(suite, "constant_velocity", out="cv").result["verdicts"]["failed"]
        0
    """
    started, suite = time.perf_counter(), suite if isinstance(suite, Suite) else open_suite(suite)
    spec, futures = _spec(under_test), int(suite.info["futures"]) if futures is None else futures
    if futures < LEAST:
        raise UsageError(f"--futures: got {futures}, needs at least {LEAST}")
    if not time_limit > 0:
        raise UsageError(f"--time-limit: got {time_limit:g}, needs seconds above 0")
    chosen, digest = _chosen(suite, cases), sha256_of(suite.folder / SUITE)
    if junit is not None:
        check_output(Path(junit))
    older = None if against is None else read_result(Path(against), digest)
    identity = {
        "version": __version__,
        "suite": digest,
        "function": f"{spec} {spec.state}",
        "source": _source(spec),
        "futures": futures,
        "time_limit_s": time_limit,
    }
    with (
        TestFolder(Path(out), identity, overwrite=overwrite) as folder,
        progress_of(progress, "cases") as tick,
    ):
        tasks = [task_of(case, spec, futures, limit_s=time_limit) for case in chosen]
        records = _run(tasks, folder, workers, tick)
        rows = with_verdicts([_about(case, records[case.name]) for case in chosen])
        result = {
            "scex_sumo": __version__,
            "command": list(command) if command else None,
            "function": str(spec),
            "suite": suite.folder.resolve().name,
            "suite_digest": digest,
            "futures": futures,
            "verdicts": {name: sum(one["verdict"] == name for one in rows) for name in VERDICTS},
            "number": number_of(suite, rows),
            "unseen": unseen(suite, rows),
            "cases": rows,
            "versions": versions(),
        }
        result |= {"against": compared(suite, result, older)} if older is not None else {}
        write_test_page(folder.path / PAGE, result, records)
        write_atomic(folder.path / SUMMARY, markdown_text(result).encode())
        if junit is not None:
            write_output(Path(junit), junit_text(result).encode())
        folder.finish(result | {"seconds": round(time.perf_counter() - started, 1)})
    return SuiteTest(folder=Path(out), result=result)


test_suite.__test__ = False  # type: ignore[attr-defined]  # pytest


def _spec(given: Any) -> ModelSpec:
    specs = model_specs(given)
    if len(specs) != 1:
        raise UsageError(f"--under-test {given}: names {len(specs)} models; give one")
    if isinstance(build(specs[0], fallback=True), SumoDriver):
        raise UsageError(f"--under-test {given}: SUMO drives it, which a suite does not run; give a function")
    return specs[0]


def _source(spec: ModelSpec) -> str | None:
    """Return the SHA-256 of the file of a function; None without one."""
    files = (layer.source_file for layer in layers(build(spec, fallback=True)))
    return next((sha256_of(file) for file in files if file is not None and file.is_file()), None)


def _chosen(suite: Suite, names: Sequence[str] | None) -> list[Case]:
    known = {case.name: case for case in suite.cases}
    for name in names or ():
        if name not in known:
            raise UsageError(f"--cases: no case {name!r} in {suite.folder}; it has {len(known)}")
    return [case for case in suite.cases if names is None or case.name in names]


def _run(
    tasks: Sequence[CaseTask], folder: TestFolder, workers: int, tick: Progress | None
) -> dict[str, dict[str, Any]]:
    """Return the records by case; those that are kept do not run again."""
    kept = {task.ref.moment: folder.record(task.ref.moment) for task in tasks}
    records = {name: record for name, record in kept.items() if record is not None}
    left = [task for task in tasks if task.ref.moment not in records]
    if not left:
        return records
    began = time.perf_counter()
    with closing(MomentWorkers(workers)) as pool:
        for task, found in pool.run(run_case, left):
            now, name = time.perf_counter(), task.ref.moment
            record = {"reason": found.reason} if isinstance(found, Failure) else dict(found)
            records[name], began = record | {"seconds": round(now - began, 2)}, now
            folder.keep(name, records[name])
            if tick is not None:
                tick(len(records), len(tasks))
    return records


def _about(case: Case, record: Mapping[str, Any]) -> dict[str, Any]:
    own = {name: value for name, value in record.items() if name not in _PICTURE}
    return {name: case.about[name] for name in ("name", "kind", "site", "weight")} | own
