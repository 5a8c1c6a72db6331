"""Test of a driving function on a suite: cases shared out to workers, resumed, judged and written."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import sha256_of, write_atomic
from scex_sumo.base.outputs import check_output, write_output
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.base.version import __version__
from scex_sumo.behaviors.base import driven_by_sumo, layers
from scex_sumo.decision.decide import RARE
from scex_sumo.drivers.registry import ModelSpec, build, model_specs
from scex_sumo.plug_in.time_limit import time_limit as limited
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure, MomentRef, StudyFolder
from scex_sumo.studies.moments.run import MomentTask, MomentWorkers, StudySettings, pack_road
from scex_sumo.suites.case import shown
from scex_sumo.suites.drive import Driven, drive
from scex_sumo.suites.suite import SUITE, Case, Suite, open_suite
from scex_sumo.suites.testing.result import (
    VERDICTS,
    compared,
    junit_text,
    markdown_text,
    number_of,
    read_result,
    unseen,
    with_verdicts,
    write_test_page,
)

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
    place, records = _RECORDS, ("failed", "parts", _RECORDS)
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
    suite = suite if isinstance(suite, Suite) else open_suite(suite)
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
            "function": str(spec),
            "suite": suite.folder.resolve().name,
            "suite_digest": digest,
            "futures": futures,
            "verdicts": {name: sum(row["verdict"] == name for row in rows) for name in VERDICTS},
            "number": number_of(suite, rows),
            "unseen": unseen(suite, rows),
            "cases": rows,
        }
        result |= {"against": compared(suite, result, older)} if older is not None else {}
        write_test_page(folder.path / PAGE, result, records)
        write_atomic(folder.path / SUMMARY, markdown_text(result).encode())
        if junit is not None:
            write_output(Path(junit), junit_text(result).encode())
        result = folder.finished(result, command)
    return SuiteTest(folder=Path(out), result=result)


test_suite.__test__ = False  # type: ignore[attr-defined]  # pytest


def _spec(given: Any) -> ModelSpec:
    specs = model_specs(given)
    if len(specs) != 1:
        raise UsageError(f"--under-test {given}: names {len(specs)} models; give one")
    if driven_by_sumo(build(specs[0], fallback=True)):
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
    remaining = [task for task in tasks if task.ref.moment not in records]
    if not remaining:
        return records
    began = time.perf_counter()
    with MomentWorkers(workers) as pool:
        for task, outcome in pool.run_each(run_case, remaining):
            now, name = time.perf_counter(), task.ref.moment
            record = {"reason": outcome.reason} if isinstance(outcome, Failure) else dict(outcome)
            records[name], began = record | {"seconds": round(now - began, 2)}, now
            if not (isinstance(outcome, Failure) and outcome.died):  # of the machine, maybe
                folder.keep(name, records[name])
            if tick is not None:
                tick(len(records), len(tasks))
    return records


def _about(case: Case, record: Mapping[str, Any]) -> dict[str, Any]:
    # Sorted as records that were kept are: a test that goes on has the same bytes.
    own = {name: record[name] for name in sorted(record) if name not in _PICTURE}
    return {name: case.about[name] for name in ("name", "kind", "site", "weight")} | own


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseTask(MomentTask):
    """Case to be run with a function.

    Attributes:
        track_id: of the vehicle that the function drives; ``other_id`` of the other one.
        seed: of the draws.
        limit_s: time of the case.
    """

    may_be_late: ClassVar[bool] = True

    track_id: int
    other_id: int
    spec: ModelSpec
    futures: int
    seed: int
    limit_s: float


_packed = lru_cache(maxsize=4)(pack_road)


def task_of(case: Case, spec: ModelSpec, futures: int, *, limit_s: float) -> CaseTask:
    """Return the task of a case; raise a `ResultError` if its files were changed."""
    content, scene = case.content, case.scene()
    name, location = case.name, scene.location
    assert scene.road is not None
    return CaseTask(
        ref=MomentRef(
            moment=name, location=location, recording=name, case="", time_s=0.0, vehicles=scene.vehicles
        ),
        scene=dataclasses.replace(scene, road=None),
        road=_packed(scene.road),
        futures=futures,
        settings=StudySettings(),
        track_id=int(content["function"]["track_id"]),
        other_id=int(content["other"]["track_id"]),
        spec=spec,
        seed=int(content["drivers"]["seed"]),
        limit_s=limit_s,
    )


def run_case(task: CaseTask, scene: SeedScene) -> dict[str, Any]:
    """Return what came of a case."""
    count = task.futures
    with limited(f"a case of {task.spec}", task.limit_s):
        function = drive(scene, task.track_id, task.spec, count, seed=task.seed)
        people = drive(scene, task.track_id, None, count, seed=task.seed)
        return record_of(function, people, task.other_id)


def record_of(function: Driven, people: Driven, other_id: int) -> dict[str, Any]:
    """Return what is kept of the futures of a case with the function, and with people; fit for JSON.

    ``pair`` and ``people_pair`` are P of a contact with the other one of the case alone.
    """
    chosen = function.pairs[0] if function.pairs else function.row_of(other_id)
    pair, people_pair = function.contacts_with(other_id), people.contacts_with(other_id)
    return {
        "probability": function.contacts.probability,
        "people": people.contacts.probability,
        "p_alone": p_alone(function, people),
        "pair": pair.probability,
        "people_pair": people_pair.probability,
        "variance": _variance(pair.effects),
        "people_variance": _variance(people_pair.effects),
        "difference_variance": _variance(pair.effects - people_pair.effects),
        "futures": function.futures,
        "collide": float(function.collides.mean()),
        "people_collide": float(people.collides.mean()),
        **{name: chosen[name] for name in ("how", "future", "needed_braking", "time_margin", "gap_m")},
        **shown(function, chosen),
    }


def _variance(effects: FloatArray) -> float:
    return float(effects.var(ddof=1) / len(effects))


def p_alone(function: Driven, people: Driven) -> float | None:
    """Return the two-sided p of a function that is like people in a case; None if they are the same.

    The more telling of two tests decides: a paired t-test (Student 1908) of the cube roots of P, and a count
    of the collisions against that by people's P, at least `RARE` in each future, after Poisson.
    """
    from scipy.special import pdtrc, stdtr

    differences, count = function.contacts.root - people.contacts.root, function.futures
    spread = float(differences.std(ddof=1))
    if spread == 0:
        return 0.0 if differences.any() else None
    by_roots = float(stdtr(count - 1, -abs(differences.mean()) / spread * np.sqrt(count)))
    hits = int(function.collides.sum())
    by_hits = float(pdtrc(hits - 1, np.maximum(people.contacts.by_future, RARE).sum())) if hits else 1.0
    return min(1.0, 4 * min(by_roots, by_hits))
