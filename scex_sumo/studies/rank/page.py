"""Page of a ranking: the most critical moments, each with its own report, and the table of all."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.errors import ScexError
from scex_sumo.base.files import TemporaryFolder, write_atomic
from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.certainty.extra import ExactProbabilities
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.settings import RunOptions
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.page.figures.charts import Plane
from scex_sumo.page.html import Html, element
from scex_sumo.page.report.contents import report_contents
from scex_sumo.page.report.report import filled_report
from scex_sumo.page.report.scene import scene_svg
from scex_sumo.page.study import card, failure_card, page_table, table_place, write_study
from scex_sumo.reports.run_table import counted
from scex_sumo.statistics.density import Interval
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.moments.run import MomentTask, unpack_road, written
from scex_sumo.studies.rank.futures import REPORTS
from scex_sumo.studies.rank.places import distinct_moments, nearby
from scex_sumo.studies.rank.ranking_run import RankingRun
from scex_sumo.studies.rank.table import critical_words, page_columns

HTML = "ranking.html"
_ROWS = 1000
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
        pictures = {
            task.ref.moment: _write_report(
                task, _command(run, task.ref), folder / REPORTS / f"{task.ref.moment}.html", pool
            )
            for task in run.tasks([refs[i] for i in chosen])
        }
    limits = run.settings.thresholds
    cards = []
    for i in chosen:
        beside = sum(nearby(refs[i], other) for other in refs) - 1
        name, command = refs[i].moment, shlex.join(_command(run, refs[i]))
        cards.append(_moment(rows[name], pictures.get(name), beside, command, limits))
    strips = _strips(ranking, [rows[refs[i].moment] for i in chosen])
    parts = [element("div.moments", *cards), *([card("When", *strips)] if strips else [])]
    failed = ranking.filter(pc.is_valid(ranking["failure"]))
    reasons = dict(zip(*(failed[name].to_pylist() for name in ("seed", "failure")), strict=True))
    parts += [card("All seed scenes", _more(len(refs)), table_place("all-moments"))]
    parts += failure_card("Failed", reasons)
    columns = page_columns(limits, exact=ranking["remainder"].null_count < len(ranking))
    shown = page_table(columns, ranking.slice(0, min(_ROWS, len(refs))).to_pylist())
    about, tables = _summary(run, ranking), {"all-moments": shown}
    write_study(folder / HTML, "Moments worth testing", about, element("p.soft", _HOW), *parts, tables=tables)
    return [refs[i].moment for i in chosen]


def _write_report(task: MomentTask, command: Sequence[str], path: Path, workers: Workers) -> Html | None:
    """Run the futures of a moment and write their report; return its picture, None if they cannot be run."""
    assert task.road is not None
    scene = dataclasses.replace(task.scene, road=unpack_road(task.road))
    settings = dataclasses.replace(task.settings.run, futures=len(task.futures))
    with TemporaryFolder() as folder:
        try:
            options = RunOptions(compared=False, out=Path(folder) / "run")
            run = run_scene(scene, settings, workers=workers, options=options, extras=[ExactProbabilities()])
        except ScexError:
            return None
        info, arrays = report_contents(run, scene)
        info |= {"folder": command[-1], "command": shlex.join(command)}
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, filled_report(run, info, arrays).encode())
        return scene_svg(info, arrays)


def _command(run: RankingRun, ref: MomentRef) -> list[str]:
    recording = next(r for r in run.recordings if r.name == ref.recording)
    paths, models = recording.track_paths, run.settings.models
    words = ["scex-sumo", "run", str(recording.map_path)]
    words += ["--tracks", str(paths[0] if len(paths) == 1 else paths[0].parent)]
    words += ["--case", ref.case] if ref.case else []
    words += ["--time", f"{ref.time_s:g}", "--seed", str(run.settings.run.seed)]
    words += ["--models", ",".join(map(str, models))] if models != written(DEFAULT_MODELS) else []
    return [*words, "-o", f"out/{ref.moment}"]


def _summary(run: RankingRun, ranking: pa.Table) -> str:
    ran = sum(pc.sum(ranking[name]).as_py() for name in ("futures", "extra"))
    failed = len(ranking) - len(run.refs)
    return (
        f"{counted(len(run.refs), 'seed scene')} of {counted(len(run.recordings), 'recording')} at "
        f"{counted(len({ref.location for ref in run.refs}), 'site')}, {counted(ran, 'future')}"
        + (f"; {failed} failed" if failed else "")
        + "."
    )


def _moment(
    row: Mapping[str, Any], picture: Html | None, beside: int, command: str, limits: Mapping[str, float]
) -> Html:
    name = row["seed"]
    title = element("h2", element("b", str(row["rank"])), f" {name}")
    where = f", case {row['case']}" if row["case"] else ""
    about = (
        f"{row['location']}{where}, {row['time_s']:g} s, {counted(row['vehicles'], 'vehicle')}. Place "
        f"{row['rank_low']} to {row['rank_high']} (95 %) after {counted(row['futures'], 'future')}"
        + (f" and {row['extra']} more for exact P." if row["extra"] else ".")
    ) + (f" {counted(beside, 'more moment')} within 3 s." if beside else "")
    link = element("p", element("a", "Open its report", href=f"{REPORTS}/{name}.html"))
    shares = [_share("collision", row, f"p_{COLLISION}")]
    shares += [_share(critical_words(column, limit), row, f"p_{column}") for column, limit in limits.items()]
    return element(
        "article.card",
        title,
        element("p.soft", about),
        *([] if picture is None else [picture]),
        element("p", _worst(row)),
        *([] if picture is None else [link]),
        *shares,
        element("details", element("summary", "Run it"), element("code", command)),
        id=name,
    )


def _share(words: str, row: Mapping[str, Any], name: str) -> Html:
    value, low, high = (row[f"{name}{end}"] for end in ("", "_low", "_high"))
    interval = Interval(value=value, low=low, high=high, count=row["futures"])
    shown, sure = interval.share, f"95 %: {interval.range} %"
    if name == f"p_{COLLISION}" and row["remainder"] is not None:
        sure = f"exactly {100 * value:.4g} %, remainder {row['remainder']:.1%}"
    plane = Plane(x=(0.0, 1.0), width=200, height=10)
    drawn = [plane.box((0.0, value), (0.2, 0.8), "drawn"), plane.box((0.0, value), (0.2, 0.8), "drawn")]
    drawn.append(plane.line(np.array([low, high]), np.full(2, 0.5), "recorded"))
    bar = element("svg", *drawn, viewBox="0 0 200 10", preserveAspectRatio="none", height="10")
    return element(
        "div.share", element("span", words), bar, element("b", shown), title=f"{words}: {shown}, {sure}"
    )


def _worst(row: Mapping[str, Any]) -> str:
    if row["worst_track_id"] is None:
        return "No encounter is critical."
    pair = f"{row['worst_track_id']} and {row['worst_other_id']}"
    if row["worst_p_collision"] > 0:
        return f"{pair} collide in {_percent(row['worst_p_collision'])} of the futures."
    return f"{pair} meet critically in {_percent(row['worst_p_critical'])} of the futures."


def _percent(share: float) -> str:
    return f"{100 * share:.{1 if 0 < share < 0.0995 else 0}f} %"


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
