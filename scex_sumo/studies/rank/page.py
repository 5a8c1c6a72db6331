"""Page of a ranking: the most critical moments, each with its own report, and the table of all."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.errors import ScexError
from scex_sumo.base.files import TemporaryFolder, write_atomic
from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.extrapolation.engine import RunOptions, run_scene
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.metrics.registry import COLLISION, metric_of
from scex_sumo.reports.page.body import percent
from scex_sumo.reports.page.charts import Plane
from scex_sumo.reports.page.contents import report_contents
from scex_sumo.reports.page.html import Html, element
from scex_sumo.reports.page.report import filled_report
from scex_sumo.reports.page.scene import scene_svg
from scex_sumo.reports.page.study import Table, card, table, table_place, write_study
from scex_sumo.reports.run_table import counted
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.moments.run import MomentTask, unpack_road
from scex_sumo.studies.moments.settings import written
from scex_sumo.studies.rank.folder import REPORTS
from scex_sumo.studies.rank.places import distinct_moments, nearby
from scex_sumo.studies.rank.ranking_run import RankingRun

HTML = "ranking.html"
_ROWS = 1000
_REASONS = 20
_HOW = (
    "A seed scene is one moment of recorded traffic; its futures are what could come of it with "
    "other drivers. Moments are ranked by how often and how hard vehicles collide in the futures, and by "
    "how many encounters are critical."
)


def write_ranking_page(run: RankingRun, folder: Path, ranking: pa.Table, *, workers: int = 1) -> list[str]:
    """Write the page and a report of each moment on it; return the names of these moments, best first.

    Args:
        ranking: the moments, the best first, then failures.
        workers: processes of this machine that run the moments shown.
    """
    by_name = {ref.moment: ref for ref in run.refs}
    refs = [by_name[name] for name in ranking["seed"].to_pylist()[: len(by_name)]]
    chosen = distinct_moments(refs, range(len(refs)), run.settings.top)
    rows = {refs[i].moment: ranking.slice(i, 1).to_pylist()[0] for i in chosen}
    with Workers(workers) as pool:
        reports = _write_reports(run, [refs[i] for i in chosen], folder, pool)
    limits = run.settings.thresholds
    cards = []
    for i in chosen:
        beside = sum(nearby(refs[i], other) for other in refs) - 1
        name, command = refs[i].moment, shlex.join(_command(run, refs[i]))
        cards.append(_moment(rows[name], reports.get(name), beside, command, limits))
    strips = _strips(ranking, [rows[refs[i].moment] for i in chosen])
    parts = [element("div.moments", *cards), *([card("When", *strips)] if strips else [])]
    parts += [card("All seed scenes", _more(len(refs)), table_place("all-moments")), *_failures(ranking)]
    shown = _table(ranking.slice(0, min(_ROWS, len(refs))).to_pylist(), limits)
    write_study(
        folder / HTML,
        "Moments worth testing",
        _summary(run, ranking),
        element("p.soft", _HOW),
        *parts,
        tables={"all-moments": shown},
    )
    return [refs[i].moment for i in chosen]


@dataclass(frozen=True, kw_only=True)
class _MomentReport:
    path: Path
    picture: Html


def _write_report(
    task: MomentTask, command: Sequence[str], path: Path, workers: Workers
) -> _MomentReport | None:
    """Run the children of a moment and write their report; None if they cannot be run."""
    assert task.road is not None
    scene = dataclasses.replace(task.scene, road=unpack_road(task.road))
    settings = dataclasses.replace(task.settings.run, children=len(task.children))
    folder = TemporaryFolder()
    with folder:
        try:
            out = Path(folder.name) / "run"
            options = RunOptions(compared=False)
            run = run_scene(scene, settings, out=out, workers=workers, options=options)
        except ScexError:
            return None
        info, arrays = report_contents(run, scene)
        info |= {"folder": command[-1], "command": shlex.join(command)}
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, filled_report(run, info, arrays).encode())
        return _MomentReport(path=path, picture=scene_svg(info, arrays))


def _write_reports(
    run: RankingRun, refs: Sequence[MomentRef], folder: Path, workers: Workers
) -> dict[str, _MomentReport]:
    found = {}
    for task in run.tasks(refs):
        path = folder / REPORTS / f"{task.ref.moment}.html"
        report = _write_report(task, _command(run, task.ref), path, workers)
        if report is not None:
            found[task.ref.moment] = report
    return found


def _command(run: RankingRun, ref: MomentRef) -> list[str]:
    recording = next(r for r in run.recordings if r.name == ref.recording)
    paths, models = recording.track_paths, run.settings.models
    words = ["scex-sumo", "run", str(recording.map_path)]
    words += ["--tracks", str(paths[0] if len(paths) == 1 else paths[0].parent)]
    words += ["--case", ref.case] if ref.case else []
    words += ["--time", f"{ref.time_s:g}", "--seed", str(run.settings.run.seed)]
    words += ["--models", ",".join(models)] if models != written(DEFAULT_MODELS) else []
    return [*words, "-o", f"out/{ref.moment}"]


def _summary(run: RankingRun, ranking: pa.Table) -> str:
    ran = sum(pc.sum(ranking[name]).as_py() for name in ("children", "extra"))
    failed = len(ranking) - len(run.refs)
    return (
        f"{counted(len(run.refs), 'seed scene')} of {counted(len(run.recordings), 'recording')} at "
        f"{counted(len({ref.location for ref in run.refs}), 'site')}, {counted(ran, 'future')}"
        + (f"; {failed} failed" if failed else "")
        + "."
    )


def _moment(
    row: Mapping[str, Any],
    report: _MomentReport | None,
    beside: int,
    command: str,
    limits: Mapping[str, float],
) -> Html:
    name = row["seed"]
    title = element("h2", element("b", str(row["rank"])), f" {name}")
    where = f", case {row['case']}" if row["case"] else ""
    about = (
        f"{row['location']}{where}, {row['time_s']:g} s, {counted(row['vehicles'], 'vehicle')}. Place "
        f"{row['rank_low']} to {row['rank_high']} (95 %) after {counted(row['children'], 'future')}."
    ) + (f" {counted(beside, 'more moment')} within 3 s." if beside else "")
    link = []
    if report is not None:
        link = [element("p", element("a", "Open its report", href=f"{REPORTS}/{report.path.name}"))]
    shares = [_share("collision", row, f"p_{COLLISION}")]
    shares += [_share(_critical(column, limit), row, f"p_{column}") for column, limit in limits.items()]
    return element(
        "article.card",
        title,
        element("p.soft", about),
        *([report.picture] if report is not None else []),
        element("p", _worst(row)),
        *link,
        *shares,
        element("details", element("summary", "Run it"), element("code", command)),
        id=name,
    )


def _critical(column: str, limit: float) -> str:
    metric, mean = metric_of(column), ", mean" if column.endswith("_mean") else ""
    sign = "≤" if metric.side == "left" else "≥"
    return f"{metric.words}{mean} {sign} {limit:.3g} {metric.column_unit}".rstrip()


def _share(words: str, row: Mapping[str, Any], name: str) -> Html:
    value, low, high = (row[f"{name}{end}"] for end in ("", "_low", "_high"))
    plane = Plane(x=(0.0, 1.0), width=200, height=10)
    drawn = [plane.box((0.0, value), (0.2, 0.8), "drawn"), plane.box((0.0, value), (0.2, 0.8), "drawn")]
    drawn.append(plane.line(np.array([low, high]), np.full(2, 0.5), "recorded"))
    bar = element("svg", *drawn, viewBox="0 0 200 10", preserveAspectRatio="none", height="10")
    title = f"{words}: {percent(value)}, 95 %: {percent(low)} – {percent(high)}"
    return element("div.share", element("span", words), bar, element("b", percent(value)), title=title)


def _worst(row: Mapping[str, Any]) -> str:
    if row["worst_track_id"] is None:
        return "No encounter is critical."
    pair = f"{row['worst_track_id']} and {row['worst_other_id']}"
    if row["worst_p_collision"] > 0:
        return f"{pair} collide in {percent(row['worst_p_collision'])} of the futures."
    return f"{pair} meet critically in {percent(row['worst_p_critical'])} of the futures."


def _table(rows: Sequence[Mapping[str, Any]], limits: Mapping[str, float]) -> Table:
    heads = [("rank", "place", "text", ""), ("ranks", "95 %", "text", "Place, with 95 % certainty")]
    heads += [("seed", "moment", "words", ""), ("location", "site", "words", "")]
    heads += [("time_s", "time", "seconds", "In the recording"), ("vehicles", "vehicles", "text", "")]
    heads += [
        ("children", "children", "text", "That have been run"),
        ("p_collision", "P(collision)", "percent", ""),
    ]
    heads += [("encounters", "encounters", "real", "Critical ones of a future, on average")]
    heads += [("pair", "worst pair", "text", "")]
    heads += [
        (f"p_{column}", f"P({metric_of(column).words})", "percent", _critical(column, limit))
        for column, limit in limits.items()
    ]
    shown = []
    for row in rows:
        worst = None if row["worst_track_id"] is None else f"{row['worst_track_id']}, {row['worst_other_id']}"
        cells = {**row, "ranks": f"{row['rank_low']} – {row['rank_high']}", "pair": worst}
        shown.append([cells[key] for key, *_ in heads])
    return table([(title, form, hint) for _, title, form, hint in heads], shown)


def _more(seeds: int) -> str:
    rest = f"The first {_ROWS} of {seeds}; all" if seeds > _ROWS else "All"
    return (
        f"{rest} with medians and intervals are in ranking.csv and ranking.parquet. A click on a head sorts."
    )


def _strips(ranking: pa.Table, tops: Sequence[Mapping[str, Any]]) -> list[Html]:
    names = list(dict.fromkeys(row["recording"] for row in tops if not row["case"]))
    strips = []
    for name in names:
        rows = ranking.filter(pc.equal(ranking["recording"], name)).select(["time_s", "score"]).drop_null()
        times, scores = (np.asarray(rows[column]) for column in ("time_s", "score"))
        last = max(float(times.max()), float(times.min()) + 1.0)
        plane = Plane(
            x=(float(times.min()), last), y=(0.0, max(float(scores.max()), 0.1)), width=1000, height=60
        )
        marked = {row["time_s"] for row in tops if row["recording"] == name}
        dots = [
            plane.dot(
                when,
                score,
                "critical" if when in marked else "soft",
                title=f"{when:g} s: {score:.2f}",
                radius=5.0 if when in marked else 2.5,
            )
            for when, score in zip(times.tolist(), scores.tolist(), strict=True)
        ]
        title = f"{name}: score over time in s; large: the moments above"
        strips.append(plane.figure(title, *dots))
    return strips


def _failures(ranking: pa.Table) -> list[Html]:
    failed = ranking.filter(pc.is_valid(ranking["failure"])).select(["seed", "failure"]).to_pylist()
    by_reason: dict[str, list[str]] = {}
    for row in failed:
        by_reason.setdefault(row["failure"], []).append(row["seed"])
    most = sorted(by_reason.items(), key=lambda item: -len(item[1]))[:_REASONS]
    items = [
        element("li", f"{reason} ({len(seeds)}: {', '.join(seeds[:3])}{', ...' if seeds[3:] else ''})")
        for reason, seeds in most
    ]
    return [card("Failed", element("ul", *items))] if items else []
