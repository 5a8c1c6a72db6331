"""Page of a ranking: the first encounters, playing, with triage by keys; and the table of all."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.files import TemporaryFolder, write_atomic
from scex_sumo.certainty.options import CriticalResponse
from scex_sumo.certainty.response.answer import once_in
from scex_sumo.certainty.response.usual import usual_of
from scex_sumo.certainty.response.words import needs
from scex_sumo.drivers.registry import DEFAULT_MODELS
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.page.html import Html, element
from scex_sumo.page.report.contents import report_contents
from scex_sumo.page.report.report import filled_report
from scex_sumo.page.study import card, failure_card, page_table, table_place, write_study
from scex_sumo.reports.run_table import counted
from scex_sumo.results.probability import Encounter
from scex_sumo.results.tables.fallbacks import fallback_lines
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure, MomentRef
from scex_sumo.studies.moments.run import MomentTask, attempt, unpack_road, written
from scex_sumo.studies.rank.encounters import TRIAGE, leads, with_stress
from scex_sumo.studies.rank.folder import REPORTS
from scex_sumo.studies.rank.ranking_run import RankingRun
from scex_sumo.studies.rank.stage import stage_of
from scex_sumo.studies.rank.table import page_columns, pair_words, stress_words
from scex_sumo.studies.rank.triage import KEY, VERDICTS

HTML = "ranking.html"
SCRIPTS = ("loop.js", "stage.js", "triage.js")
_ROWS = 1000
_EXTRAS = (CriticalResponse(),)  # of the reports of moments
_BY = {"severity": "the severe injuries (MAIS 3+) that are to be expected"}
_HOW = (
    "An encounter is two vehicles in consecutive moments of a recording, shown at its most critical moment. "
    "Encounters are ranked by {by}, of people as they act and respond; the stress test stands beside it. "
    "The filled outlines collide as the words say, dashed ones are what was recorded."
)
_KEYS = (
    "Keys: 1 test, 2 discard, 3 data error, 0 none, J and K next and previous, N note. "
    "This browser keeps the verdicts; save them as a file for others and for 'scex-sumo rank --triage FILE'. "
    "A file dropped on the page is read."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reported:
    """Futures of the moments on the page of a ranking.

    Attributes:
        table: the encounters, with what these futures say.
        moments: names of the moments, that of the first encounter first.
        futures: number of futures that were run.
        notes: why moments have no futures, and whose drivers failed.
    """

    table: pa.Table
    moments: Sequence[str]
    futures: int
    notes: Sequence[str]


def write_ranking_page(run: RankingRun, folder: Path, ranking: pa.Table) -> Reported:
    """Run the futures of the moments of the top encounters; write their reports and the page.

    Args:
        ranking: the encounters in their order.
    """
    lines = leads(ranking)
    top = lines.filter(pc.is_valid(lines["rank"])).slice(0, run.settings.top).to_pylist()
    names = list(dict.fromkeys(row["seed"] for row in top))
    refs = [ref for ref in run.refs if ref.moment in names]
    tasks: dict[str, _ReportTask] = {}
    stress: dict[str, Mapping[tuple[int, int], tuple[float, float]]] = {}
    notes, failures = list[str](), run.unreadable | run.failures
    asked = (_ReportTask.of(task, command=_command(run, task.ref)) for task in run.tasks(refs))
    for task, made in run.run_again(asked, _report):
        assert isinstance(task, _ReportTask)
        tasks[task.ref.moment] = task
        if isinstance(made, Failure):
            failures[task.ref.moment] = made
            notes.append(f"{task.ref.moment}: no futures: {made.reason}")
            continue
        html, stress[task.ref.moment], replaced = made
        notes += [f"{task.ref.moment}: {line}" for line in replaced]
        report = folder / REPORTS / f"{task.ref.moment}.html"
        report.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(report, html)
    ranking = with_stress(ranking, stress)
    lines = leads(ranking)
    cards = {}
    for row in lines.slice(0, len(top)).to_pylist():
        if (ran := tasks.get(row["seed"])) is not None:
            assert ran.road is not None
            scene = dataclasses.replace(ran.scene, road=unpack_road(ran.road))
            cards[row["rank"]] = _card(row, scene, ran.command, row["seed"] in stress)
    lines = leads(ranking)
    shown = list(cards.values())
    rows = lines.slice(0, max(_ROWS, len(top))).to_pylist()
    parts = [
        _bar(),
        element("div.moments", *(html for html, _ in shown)),
        card("All encounters", _more(len(lines)), table_place("all-encounters")),
        *failure_card("Failed", {name: one.reason for name, one in failures.items()}),
    ]
    info = {
        "name": run.identity,
        "verdicts": VERDICTS,
        "cards": [data for _, data in shown],
        "rows": [{name: row[name] for name in (*KEY, *TRIAGE)} for row in rows],
    }
    about, tables = _summary(run, ranking), {"all-encounters": page_table(page_columns(), rows)}
    how = element("p.soft", _HOW.format(by=_BY.get(run.order.by, run.order.by)))
    write_study(
        folder / HTML,
        "Encounters worth testing",
        about,
        how,
        *parts,
        tables=tables,
        scripts=SCRIPTS,
        info=info,
    )
    count = len(stress) * run.settings.futures
    return Reported(table=ranking, moments=names, futures=count, notes=notes)


@dataclass(frozen=True, kw_only=True, eq=False)
class _ReportTask(MomentTask):
    """A moment to be reported, and the command that runs it."""

    command: Sequence[str]


_Made: TypeAlias = tuple[bytes, dict[tuple[int, int], tuple[float, float]], list[str]]


def _report(task: _ReportTask, road: bytes | None = None) -> _Made | Failure:
    """Return a moment's report, the stress test of its pairs, lines on failed drivers; or its failure."""
    return attempt(_reported, task, road)


def _reported(task: _ReportTask, scene: SeedScene, road: bytes) -> _Made:
    with TemporaryFolder() as folder:
        options = RunOptions(compared=False, out=Path(folder) / "run")
        with Workers(1) as alone:
            run = run_scene(scene, task.settings.run, workers=alone, options=options, extras=_EXTRAS)
        info, arrays = report_contents(run, scene)
        info |= {"folder": task.command[-1], "command": shlex.join(task.command)}
        met = [Encounter(row=row, run=run) for row in run.encounters.to_pylist()]
        stress = {one.pair: (one.row["collision"], one.row["critical"]) for one in met}
        return filled_report(run, info, arrays).encode(), stress, fallback_lines(run.info["fallbacks"])


def _command(run: RankingRun, ref: MomentRef) -> list[str]:
    recording = run.recording(ref)
    paths, models = recording.track_paths, run.settings.models
    words = ["scex-sumo", "run", str(recording.map_path)]
    words += ["--tracks", str(paths[0] if len(paths) == 1 else paths[0].parent)]
    words += ["--case", ref.case] if ref.case else []
    words += ["--time", f"{ref.time_s:g}", "--seed", str(run.settings.run.seed)]
    words += ["--models", ",".join(map(str, models))] if models != written(DEFAULT_MODELS) else []
    return [*words, "-o", f"out/{ref.moment}"]


def _summary(run: RankingRun, ranking: pa.Table) -> str:
    doubtful = len(ranking) - ranking["doubt"].null_count
    return (
        f"{counted(len(ranking), 'encounter')} in {counted(len(run.refs), 'seed scene')} of "
        f"{counted(len(run.recordings), 'recording')} at "
        f"{counted(len({ref.location for ref in run.refs}), 'site')}"
        + (f"; {doubtful} with doubtful data" if doubtful else "")
        + "."
    )


def _bar() -> Html:
    save = element("button", "save verdicts (CSV)", id="save")
    read = element("input", type="file", accept=".csv", id="read")
    row = element("div.row", element("b", id="counts"), save, element("label", "read ", read))
    return element("section.card", row, element("p.soft", _KEYS), element("p.soft", id="said", role="status"))


def _card(
    row: Mapping[str, Any], scene: SeedScene, command: Sequence[str], ran: bool
) -> tuple[Html, dict[str, Any]]:
    """Return the card of an encounter, and what its scripts need."""
    stage, name = stage_of(scene, row), row["seed"]
    title = element(
        "h2", element("b", str(row["rank"])), f" {pair_words(row)}, {row['kind'] or 'off the lanes'}"
    )
    buttons = [
        element("button", f"{number} {verdict}", data_verdict=verdict)
        for number, verdict in enumerate(VERDICTS, 1)
    ]
    note = element("input.note", type="search", placeholder="note", aria_label="Note")
    links = [element("a", "Report of the moment", href=f"{REPORTS}/{name}.html")] if ran else []
    html = element(
        "article.card",
        title,
        element("p.soft", _where(row)),
        stage.picture,
        element("p.takes", f"{row['takes']}: {once_in(row['probability'])}."),
        element("ul", *(element("li", words) for words in _facts(row))),
        element("div.row", *buttons, note),
        element("p", *links) if links else "",
        element("details", element("summary", "Run it"), element("code", shlex.join(command))),
        id=f"encounter-{row['rank']}",
        tabindex="0",
    )
    return html, {"outlines": stage.outlines, "contact": stage.contact, "row": row["rank"] - 1}


def _where(row: Mapping[str, Any]) -> str:
    case = f", case {row['case']}" if row["case"] else ""
    long = f" ({row['first_s']:g} to {row['last_s']:g} s)" if row["moments"] > 1 else ""
    return f"{row['location']}, {row['recording']}{case}, {row['time_s']:g} s{long}"


def _facts(row: Mapping[str, Any]) -> list[str]:
    careful = "avoids it" if row["preventable"] else "does not always avoid it"
    tested = "To be tested" if row["to_test"] else "Not to be tested"
    facts = [
        f"{tested}; severe injuries {once_in(row['severity'])}",
        f"a careful and competent driver (UN R157) {careful}",
        needs(row),
        _usual(row),
    ]
    if row["stress_p_collision"] is not None:
        facts.append(f"stress test: collide in {stress_words(row)} of the futures")
    return [fact for fact in facts if fact]


def _usual(row: Mapping[str, Any]) -> str:
    usual = usual_of(row)
    return "" if usual is None else usual.words(row["probability"])


def _more(count: int) -> str:
    rest = f"The first {_ROWS} of {count}; all" if count > _ROWS else "All"
    where = "with more columns are in ranking.csv and ranking.parquet, moments in moments.csv"
    return f"{rest} {where}. A click on a head sorts."
