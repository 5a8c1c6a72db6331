"""Page of a ranking: the moments most worth testing, with pictures, in one file."""

from __future__ import annotations

import base64
import dataclasses
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.files import write_atomic
from scex_sumo.metrics.registry import metric_of
from scex_sumo.ranking.moments import MomentRef
from scex_sumo.ranking.places import distinct_moments, nearby
from scex_sumo.ranking.ranking_run import RankingRun
from scex_sumo.ranking.run_moment import MomentPart, MomentTask, unpack_road
from scex_sumo.ranking.settings import written
from scex_sumo.reports.tables.runs import counted
from scex_sumo.scene import LOGGED_HISTORY

HTML = "ranking.html"
_DRAWN_CHILDREN = 32
_ROWS = 200
_REASONS = 20


@dataclass(frozen=True, kw_only=True)
class _Top:
    """A moment on the page: its row of the table, its picture, and the moments beside it."""

    row: Mapping[str, Any]
    picture: bytes | None
    beside: int
    command: str


def write_ranking_page(run: RankingRun, folder: Path, table: pa.Table) -> list[str]:
    """Draw the best distinct moments and write the page.

    Args:
        run: the ranking; runs the children that are drawn.
        folder: where to write.
        table: the moments, the best first, then what failed.

    Returns:
        The moments on the page, best first.
    """
    settings = run.settings
    by_name = {ref.moment: ref for ref in run.refs}
    refs = [by_name[name] for name in table["seed"].to_pylist()[: len(by_name)]]
    chosen = distinct_moments(refs, range(len(refs)), settings.top)
    rerun = run.rerun([refs[i] for i in chosen], min(_DRAWN_CHILDREN, settings.first))
    pictures = {task.ref.moment: draw(task, part) for task, part in rerun}
    tops = [
        _Top(
            row=table.slice(i, 1).to_pylist()[0],
            picture=pictures.get(refs[i].moment),
            beside=sum(nearby(refs[i], other) for other in refs) - 1,
            command=_command(run, refs[i]),
        )
        for i in chosen
    ]
    limits = settings.thresholds
    content = Template(files("scex_sumo.ranking").joinpath("page.html").read_text("utf-8")).substitute(
        title="Moments worth testing",
        summary=_summary(run, table),
        cards="\n".join(_card(top, limits) for top in tops),
        strips=_strips(table, [top.row for top in tops]),
        head=_head(limits),
        rows="\n".join(_row(row, limits) for row in table.slice(0, _ROWS).to_pylist()),
        more=_more(len(refs)),
        failures=_failures(table),
    )
    write_atomic(folder / HTML, content.encode())
    return [refs[i].moment for i in chosen]


def draw(task: MomentTask, part: MomentPart) -> bytes:
    """The picture of a moment whose children have run with all their tracks."""
    from scex_sumo.reports.pictures.ranking import scene_png

    assert task.road is not None and part.tracks is not None
    shape = (len(part.children), len(part.track_ids), -1)
    x, y = (np.asarray(part.tracks[name]).reshape(shape)[:, :, LOGGED_HISTORY - 1 :] for name in ("x", "y"))
    return scene_png(dataclasses.replace(task.scene, road=unpack_road(task.road)), x, y)


def _command(run: RankingRun, ref: MomentRef) -> str:
    """The command that looks at a moment more closely."""
    recording = next(r for r in run.recordings if r.name == ref.recording)
    paths, models = recording.track_paths, run.settings.models
    words = ["scex-sumo", "run", str(recording.map_path)]
    words += ["--tracks", str(paths[0] if len(paths) == 1 else paths[0].parent)]
    words += ["--case", ref.case] if ref.case else []
    words += ["--time", f"{ref.time_s:g}", "--seed", str(run.settings.seed)]
    words += ["--models", ",".join(models)] if models != written(DEFAULT_MODELS) else []
    return shlex.join([*words, "-o", f"out/{ref.moment}"])


def _summary(run: RankingRun, table: pa.Table) -> str:
    ran = sum(tally.children for tallies in run.tallies.values() for tally in tallies)
    failed = len(table) - len(run.refs)
    return (
        f"{counted(len(run.refs), 'seed scene')} of {counted(len(run.recordings), 'recording')} at "
        f"{counted(len({ref.location for ref in run.refs}), 'site')}, {counted(ran, 'child scenario')}"
        + (f"; {failed} failed" if failed else "")
        + "."
    )


def _card(top: _Top, thresholds: Mapping[str, float]) -> str:
    row = top.row
    picture = ""
    if top.picture is not None:
        data = base64.b64encode(top.picture).decode()
        picture = f'<img alt="{escape(row["seed"])}" src="data:image/png;base64,{data}">'
    where = f"case {escape(row['case'])}, " if row["case"] else ""
    beside = f" {counted(top.beside, 'more moment')} within 3 s." if top.beside else ""
    bars = "".join(_bar(row, column, limit) for column, limit in thresholds.items())
    return f"""<article class="card" id="{escape(row["seed"])}">
<figure>{picture}</figure>
<div><h3><b>{row["rank"]}</b> {escape(row["seed"])}</h3>
<p>{escape(row["location"])}, {where}{row["time_s"]:g} s, {counted(row["vehicles"], "vehicle")}.
Rank {row["rank"]}, 95 % interval {row["rank_low"]} to {row["rank_high"]}, after
{counted(row["children"], "child scenario")}.{beside}</p>
<table class="bars">{bars}</table>
<details><summary>look closer</summary><code>{escape(top.command)}</code></details></div>
</article>"""


def _bar(row: Mapping[str, Any], column: str, limit: float) -> str:
    """The share of critical children as a bar with its interval."""
    metric = metric_of(column)
    sign = "≤" if metric.side == "left" else "≥"
    unit = f" {metric.column_unit}" if metric.column_unit else ""
    mean = ", mean" if column.endswith("_mean") else ""
    label = f"{metric.words}{mean} {sign} {limit:.3g}{unit}"
    median = row[f"median_{column}"]
    if median is None:
        return f'<tr><td>{label}</td><td class="track"></td><td>defined in no child</td></tr>'
    value, low, high = (row[f"p_{column}{end}"] for end in ("", "_low", "_high"))
    bar = (
        f'<i style="width:{100 * value:.1f}%"></i>'
        f'<u style="left:{100 * low:.1f}%;width:{100 * (high - low):.1f}%"></u>'
    )
    return (
        f'<tr><td>{label}</td><td class="track">{bar}</td><td>{value:.0%}</td>'
        f"<td>median {median:.2f}{unit}</td></tr>"
    )


def _head(thresholds: Mapping[str, float]) -> str:
    names = ["rank", "interval", "score", "seed", "location", "time [s]", "vehicles", "children"]
    names += [f"P({metric_of(c).words}{' mean' if c.endswith('_mean') else ''})" for c in thresholds]
    return "".join(f"<th>{escape(name)}</th>" for name in names)


def _row(row: Mapping[str, Any], thresholds: Mapping[str, float]) -> str:
    if row["rank"] is None:
        return ""
    shares = [row[f"p_{column}"] for column in thresholds]
    cells = [
        (row["rank"], str(row["rank"])),
        (row["rank_low"], f"{row['rank_low']}–{row['rank_high']}"),
        (row["score"], f"{row['score']:.3f}"),
        (row["seed"], row["seed"]),
        (row["location"], row["location"]),
        (row["time_s"], f"{row['time_s']:.1f}"),
        (row["vehicles"], str(row["vehicles"])),
        (row["children"], str(row["children"])),
        *((-1 if share is None else share, "–" if share is None else f"{share:.0%}") for share in shares),
    ]
    return "<tr>" + "".join(f'<td data-v="{escape(str(v))}">{escape(t)}</td>' for v, t in cells) + "</tr>"


def _more(seeds: int) -> str:
    rest = f"The first {_ROWS} of {seeds}; all" if seeds > _ROWS else "All"
    return f"{rest} with the medians of the 12 metrics and the intervals: ranking.csv, ranking.parquet."


def _strips(table: pa.Table, tops: Sequence[Mapping[str, Any]]) -> str:
    """Score over time of the recordings that the top moments come from."""
    names = list(dict.fromkeys(row["recording"] for row in tops if not row["case"]))
    strips = []
    for name in names:
        rows = table.filter(pc.equal(table["recording"], name)).select(["time_s", "score"])
        rows = rows.drop_null()
        times = np.asarray(rows["time_s"])
        first, last = float(times.min()), float(times.max())
        span = max(last - first, 1e-9)
        dots = []
        for when, score in zip(times, np.asarray(rows["score"]), strict=True):
            marked = any(row["recording"] == name and row["time_s"] == when for row in tops)
            shape = 'r="5" class="top"' if marked else 'r="2"'
            dots.append(
                f'<circle cx="{8 + 984 * (when - first) / span:.1f}" cy="{62 - 54 * score:.1f}" {shape}/>'
            )
        strips.append(
            f'<div class="strip"><span>{escape(name)}</span><svg viewBox="0 0 1000 70">'
            f'<path d="M8 62H992M8 8H992"/>{"".join(sorted(dots, key=len))}</svg>'
            f"<span>{first:g} to {last:g} s</span></div>"
        )
    return "\n".join(strips)


def _failures(table: pa.Table) -> str:
    failed = table.filter(pc.is_valid(table["failure"])).select(["seed", "failure"]).to_pylist()
    if not failed:
        return ""
    by_reason: dict[str, list[str]] = {}
    for row in failed:
        by_reason.setdefault(row["failure"], []).append(row["seed"])
    most = sorted(by_reason.items(), key=lambda item: -len(item[1]))[:_REASONS]
    items = ""
    for reason, seeds in most:
        examples = ", ".join(seeds[:3]) + (", ..." if seeds[3:] else "")
        items += f"<li>{escape(reason)} ({len(seeds)}: {escape(examples)})</li>"
    return f"<h2>Failed</h2><ul>{items}</ul>"
