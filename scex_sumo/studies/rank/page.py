"""Page of a ranking: the first encounters, playing, with triage by keys; and the table of all."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.files import TemporaryFolder, write_atomic
from scex_sumo.decision.decide import disagrees, span
from scex_sumo.decision.moment import FUTURES as HUMAN_FUTURES
from scex_sumo.decision.moment import human_part
from scex_sumo.decision.of_run import write_decision
from scex_sumo.drivers.registry import DEFAULT_MODELS
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.page.columns import Column, Row, failure_card, page_table
from scex_sumo.page.document import Document, card
from scex_sumo.page.html import Html, element
from scex_sumo.page.picture import lane_lines, road_svg
from scex_sumo.page.report.contents import report_contents
from scex_sumo.page.report.report import filled_report
from scex_sumo.page.report.scene import Box
from scex_sumo.page.timeline import Happening, place_map, shapes_legend, timeline, usual_level
from scex_sumo.reports.words import counted
from scex_sumo.results.tables.encounters import Encounter
from scex_sumo.results.tables.fallbacks import fallback_lines
from scex_sumo.results.tables.pairs import TOLD, arrow, once_in, one_in
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.encounters import Pairs
from scex_sumo.studies.moments.folder import Failure, MomentRef
from scex_sumo.studies.moments.run import MomentTask, net_of, unpack_road, written
from scex_sumo.studies.moments.study import MomentRun
from scex_sumo.studies.rank.encounters import KEY, TRIAGE, VERDICTS, with_stress
from scex_sumo.studies.rank.stage import Stage, stage_of_future

_MOST: Final = 12  # recordings
_PLACES: Final = 200  # of a site
_AROUND_M: Final = 30.0
_GLANCE: Final = (
    "Each mark is the most critical pair of a moment: P of a contact between people, on a log scale. The "
    "pointer on a mark names the pair; a click leads to its card, else to its row. A drag selects a "
    "span for the table."
)
REPORTS = "moments"
"""Folder of the reports of the moments that are shown."""
HTML = "ranking.html"
SCRIPTS = ("loop.js", "stage.js", "timeline.js", "triage.js")
_ROWS = 1000
_HOW = (
    "An encounter is two vehicles in consecutive moments of a recording, shown at its most critical one in "
    "the human-like future that decides; dashed: what was recorded. The dark vehicle hits or follows the "
    "light one. "
)
_KEYS = (
    "Keys: 1 test, 2 discard, 3 data error, 0 none, J and K next and previous, N note. "
    "This browser keeps the verdicts; save them as a file for others and for 'scex-sumo rank --triage FILE'. "
    "A file dropped on the page is read."
)


def stress_words(encounter: Row) -> str | None:
    """Return the share of the stress test in which a pair collides; None where no futures were run."""
    share = encounter["stress_p_collision"]
    return None if share is None else f"{share:.0%}"


PAGE_COLUMNS: Final = (
    Column("rank", "place"),
    Column(arrow, "pair", "words", "Hits or follows → the other one"),
    Column("what", "what", "words"),
    Column("how", "how it comes to it", "words"),
    Column("location", "site", "words"),
    Column("recording", "recording", "words"),
    Column("time_s", "time", "seconds", "In the recording, of its most critical moment"),
    Column("probability", "people collide", "often", "P of a contact within 3 s"),
    Column("needed_braking", "needed braking", "tenths", "In the future that decides, m/s²"),
    Column("time_margin", "time margin", "seconds", "In the future that decides"),
    Column("conflict_s", "after", "seconds", "Time of the conflict after the moment"),
    Column("stress_p_collision", "stress test", "percent", "P(collision) with the drawn models"),
    Column("doubt", "doubt", "words"),
    Column(lambda row: "yes" if row["to_test"] else "no", "to test", "words"),
    Column("verdict", "verdict", "words"),
)
"""Columns of encounters on the page."""


PRINTED_COLUMNS: Final = (
    Column("rank", "rank"),
    Column(arrow, "pair", "words"),
    Column("what", "what", "words"),
    Column("how", "how it comes to it", "words"),
    Column(lambda row: f"{row['recording']} {row['case']}".rstrip(), "recording", "words"),
    Column("time_s", "time", "seconds"),
    Column(lambda row: one_in(row["probability"]), "people: 1 in", "text"),
    Column(span, "range", "words"),
    Column(stress_words, "stress", "text"),
)
"""Columns of encounters in the terminal."""


def write_ranking_page(
    run: MomentRun, pairs: Pairs, ranking: pa.Table, shown: int, by: str
) -> tuple[pa.Table, dict[str, Any], list[str]]:
    """Run the futures of the moments of the top encounters; write their reports and the page.

    Return the encounters with the stress test, what ``rank.json`` tells of it, and notes: why moments have no
    futures, and whose drivers failed.

    Args:
        pairs: of all moments.
        ranking: the encounters in their order, ``by`` a column, of which so many are ``shown``.
    """
    top = ranking.filter(pc.is_valid(ranking["rank"])).slice(0, shown).to_pylist()
    names = list(dict.fromkeys(encounter["seed"] for encounter in top))
    refs = {ref.moment: ref for ref in run.refs if ref.moment in names}
    stress: dict[str, Mapping[_Pair, float]] = {}
    notes, failures = list[str](), run.unreadable | run.failures
    own_pairs, stages = {ref.moment: table for ref, table in pairs}, dict[tuple[str, int, int], Stage]()
    places, roads = places_of(ranking), dict[str, Html]()

    def report_tasks() -> Iterator[_ReportTask]:
        for task in run.tasks([*refs.values()]):
            name = task.ref.moment
            own = [encounter for encounter in top if encounter["seed"] == name]
            command = _command(run, task.ref)
            yield _ReportTask(**vars(task), command=command, pairs=own_pairs[name], rows=own)

    for task, reported in run.workers.run_each(_reported, report_tasks()):
        site = task.ref.location
        if site in places and site not in roads:
            roads[site] = road_svg(lane_lines(unpack_road(task.road), box_of(places[site])))
        if isinstance(reported, Failure):
            failures[task.ref.moment] = reported
            notes.append(f"{task.ref.moment}: no futures: {reported.reason}")
            continue
        html, stress[task.ref.moment], replaced, drawn = reported
        stages |= {(task.ref.moment, *pair): stage for pair, stage in drawn.items()}
        notes += [f"{task.ref.moment}: {line}" for line in replaced]
        report = run.folder.path / REPORTS / f"{task.ref.moment}.html"
        report.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(report, html)
    ranking = with_stress(ranking, stress)
    cards = [
        (encounter, *_card(encounter, stages[key], _command(run, refs[encounter["seed"]])))
        for encounter in ranking.slice(0, len(top)).to_pylist()
        if (key := (encounter["seed"], encounter["track_id"], encounter["other_id"])) in stages
    ]
    rows = ranking.slice(0, max(_ROWS, len(top))).to_pylist()
    page = Document("Encounters worth testing", *SCRIPTS)
    rest = f"The first {_ROWS} of {len(ranking)}; all" if len(ranking) > _ROWS else "All"
    addresses = {f"#encounter-{encounter['rank']}": encounter for encounter, _, _ in cards}
    parts = [
        glance(pairs, places, roads, addresses),
        _bar(),
        *_lists(ranking, [(encounter, html) for encounter, html, _ in cards], by),
        card(
            "All encounters",
            f"{rest} with more columns are in ranking.csv and ranking.parquet, moments in moments.csv. "
            "A click on a head sorts.",
            page.table("all-encounters", page_table(PAGE_COLUMNS, rows)),
        ),
        *failure_card("Failed", {name: failure.reason for name, failure in failures.items()}),
    ]
    page.info |= {
        "name": run.folder.identity,
        "verdicts": VERDICTS,
        "cards": [data for _, _, data in cards],
        "rows": [{name: encounter[name] for name in (*KEY, *TRIAGE)} for encounter in rows],
    }
    page.write(run.folder.path / HTML, _summary(run, ranking), *parts)
    return ranking, {"futures_run": len(stress) * run.settings.futures, "shown": names}, notes


@dataclass(frozen=True, kw_only=True, eq=False)
class _ReportTask(MomentTask):
    """A moment to be reported: the command that runs it, all its pairs, and encounters of it on the page."""

    command: Sequence[str]
    pairs: pa.Table
    rows: Sequence[Mapping[str, Any]]


_Pair: TypeAlias = tuple[int, int]
_Made: TypeAlias = tuple[bytes, dict[_Pair, float], list[str], dict[_Pair, Stage]]


def _reported(task: _ReportTask, scene: SeedScene) -> _Made:
    """Return a moment's report, stress test of its pairs, notes, and stages of encounters."""
    with TemporaryFolder() as folder:
        options = RunOptions(out=Path(folder) / "run")
        with Workers(1) as alone:
            run, _ = run_scene(scene, task.settings.run, workers=alone, options=options)
        write_decision(run.folder, task.pairs, futures=HUMAN_FUTURES)
        info, arrays = report_contents(run, scene)
        info |= {"folder": task.command[-1], "command": shlex.join(task.command)}
        met = [Encounter(row=row, run=run) for row in run.encounters.to_pylist()]
        stress = {encounter.pair: encounter.row["collision"] for encounter in met}
        page, notes = filled_report(run, info, arrays), fallback_lines(run.info["fallbacks"])
    scene, net = ruled(scene, net_of(task.road), task.settings.run)
    human = human_part(scene, net, futures=HUMAN_FUTURES, seed=task.settings.run.seed)
    stages = {
        (encounter["track_id"], encounter["other_id"]): stage_of_future(scene, encounter, human)
        for encounter in task.rows
    }
    return page, stress, notes, stages


def _command(run: MomentRun, ref: MomentRef) -> list[str]:
    recording = {recording.name: recording for recording in run.recordings}[ref.recording]
    paths, models = recording.track_paths, run.settings.models
    words = ["scex-sumo", "run", str(recording.map_path)]
    words += ["--tracks", str(paths[0] if len(paths) == 1 else paths[0].parent)]
    words += ["--case", ref.case] if ref.case else []
    words += ["--time", f"{ref.time_s:g}", "--seed", str(run.settings.run.seed)]
    words += ["--models", ",".join(map(str, models))] if models != written(DEFAULT_MODELS) else []
    return [*words, "-o", f"out/{ref.moment}"]


def _summary(run: MomentRun, ranking: pa.Table) -> str:
    doubtful = len(ranking) - ranking["doubt"].null_count
    return (
        f"{counted(len(ranking), 'encounter')} in {counted(len(run.refs), 'seed scene')} of "
        f"{counted(len(run.recordings), 'recording')} at "
        f"{counted(len({ref.location for ref in run.refs}), 'site')}"
        + (f"; {doubtful} with doubtful data" if doubtful else "")
        + "."
    )


def _lists(ranking: pa.Table, shown: Sequence[tuple[Mapping[str, Any], Html]], by: str) -> list[Html]:
    """Return the encounters with cards: those to be tested, then the others."""
    is_sure = pc.is_valid(ranking["rank"])
    parts = []
    for name, is_tested in (("To be tested", True), ("Not to be tested", False)):
        cards = [html for encounter, html in shown if encounter["to_test"] is is_tested]
        total = pc.sum(pc.and_(is_sure, pc.equal(ranking["to_test"], is_tested))).as_py() or 0
        if total:
            head = f"{name}: {total}" + (f", {len(cards)} of them here" if len(cards) < total else "")
            words = "P of a contact between people" if by == "probability" else by
            about = element("p.soft", f"Sorted by {words}.")
            parts.append(
                element(
                    "section",
                    element("h2", head),
                    *([about] if cards else []),
                    element("div.moments", *cards),
                )
            )
    return parts


def _bar() -> Html:
    save = element("button", "save verdicts (CSV)", id="save")
    read = element("input", type="file", accept=".csv", id="read")
    buttons = element("div.row", element("b", id="counts"), save, element("label", "read ", read))
    return element(
        "section.card", buttons, element("p.soft", _HOW + _KEYS), element("p.soft", id="said", role="status")
    )


def _card(encounter: Mapping[str, Any], stage: Stage, command: Sequence[str]) -> tuple[Html, dict[str, Any]]:
    """Return the card of an encounter, and what its scripts need."""
    title = element("h2", element("b", str(encounter["rank"])), f" {arrow(encounter)}, {encounter['what']}")
    buttons = [
        element("button", f"{number} {verdict}", data_verdict=verdict)
        for number, verdict in enumerate(VERDICTS, 1)
    ]
    note = element("input.note", type="search", placeholder="note", aria_label="Note")
    link = element("a", "Report of the moment", href=f"{REPORTS}/{encounter['seed']}.html")
    html = element(
        "article.card",
        title,
        element("p.soft", _where(encounter)),
        stage.picture,
        element("p.takes", f"{encounter['how'] or encounter['what']}: {once_in(encounter['probability'])}."),
        element("ul", *(element("li", words) for words in _facts(encounter))),
        element("div.row", *buttons, note),
        element("p", link),
        element("details", element("summary", "Run it"), element("code", shlex.join(command))),
        id=f"encounter-{encounter['rank']}",
        tabindex="0",
    )
    return html, {"outlines": stage.outlines, "contact": stage.contact, "row": encounter["rank"] - 1}


def _where(encounter: Mapping[str, Any]) -> str:
    case = f", case {encounter['case']}" if encounter["case"] else ""
    long = f" ({encounter['first_s']:g} to {encounter['last_s']:g} s)" if encounter["moments"] > 1 else ""
    return f"{encounter['location']}, {encounter['recording']}{case}, {encounter['time_s']:g} s{long}"


def _facts(encounter: Mapping[str, Any]) -> list[str]:
    facts = [
        f"{span(encounter)} such moments" + ("; the models disagree" if disagrees(encounter) else ""),
        f"as shown in {encounter['futures']} of {HUMAN_FUTURES} human-like futures, "
        f"{encounter['conflict_s']:.1f} s on",
    ]
    if encounter["stress_p_collision"] is not None:
        facts.append(f"stress test: collide in {stress_words(encounter)} of the futures")
    return facts


Cards = Mapping[str, Mapping[str, Any]]
"""Encounters that have cards, by the addresses of these."""


def places_of(ranking: pa.Table) -> dict[str, list[dict[str, Any]]]:
    """Return the encounters that a map shows, by site: the first ones without doubt."""
    is_told = pc.greater_equal(ranking["probability"], TOLD)
    places: dict[str, list[dict[str, Any]]] = {}
    for encounter in ranking.filter(pc.and_(pc.is_valid(ranking["rank"]), is_told)).to_pylist():
        at_site = places.setdefault(encounter["location"], [])
        if len(at_site) < _PLACES:
            at_site.append(encounter)
    return places


def box_of(encounters: Sequence[Mapping[str, Any]]) -> Box:
    """Return the box of a map with these places, m."""
    x, y = [encounter["x"] for encounter in encounters], [encounter["y"] for encounter in encounters]
    return min(x) - _AROUND_M, max(x) + _AROUND_M, min(y) - _AROUND_M, max(y) + _AROUND_M


def glance(
    pairs: Pairs, places: Mapping[str, Sequence[Mapping[str, Any]]], roads: Mapping[str, Html], cards: Cards
) -> Html:
    """Return the time lines of the most critical recordings, and maps of `places_of` that have a road."""
    lines, levels = dict[str, list[Happening]](), dict[str, list[float]]()
    for ref, table in pairs:
        for pair in table.filter(pc.is_null(table["doubt"])).slice(0, 1).to_pylist():
            happening = Happening.of(pair, ref.time_s, _link(pair, ref.recording, ref.time_s, cards))
            lines.setdefault(ref.recording, []).append(happening)
            levels.setdefault(ref.location, []).append(happening.probability)
    usual = {ref.recording: usual_level(levels.get(ref.location, ())) for ref, _ in pairs}
    by_peak = sorted(lines, key=lambda name: -max(mark.probability for mark in lines[name]))
    figures, maps = list[Html](), list[Html]()
    for name, marks in lines.items():
        if name in by_peak[:_MOST]:
            times = [mark.time_s for mark in marks]
            figures.append(timeline(name, marks, (min(times), max(times)), name, usual[name]))
    for site, encounters in places.items():
        if site in roads:
            links = (_link(shown, shown["recording"], shown["time_s"], cards) for shown in encounters)
            linked = zip(encounters, links, strict=True)
            marks = [Happening.of(encounter, encounter["time_s"], link) for encounter, link in linked]
            maps.append(place_map(site, box_of(encounters), roads[site], marks))
    kinds = {mark.what for marks in lines.values() for mark in marks}
    legend = shapes_legend(kinds, usual=any(usual.values()))
    more = f" Shown are the {_MOST} most critical of {len(lines)} recordings." if len(lines) > _MOST else ""
    return card("At a glance", _GLANCE + more, legend, *figures, element("div.maps", *maps))


def _link(pair: Mapping[str, Any], recording: str, time_s: float, cards: Cards) -> str:
    ids = {pair["track_id"], pair["other_id"]}
    for address, shown in cards.items():
        is_pair = shown["recording"] == recording and {shown["track_id"], shown["other_id"]} == ids
        if is_pair and shown["first_s"] <= time_s <= shown["last_s"]:
            return address
    return ""
