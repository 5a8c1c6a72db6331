"""Folder of a watched simulation: ``risk.parquet``, and the page ``watch.html``."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import pyarrow as pa

from scex_sumo.base.outputs import write_table
from scex_sumo.live.moment import BUSIEST
from scex_sumo.live.risk import PairRisk, Risk
from scex_sumo.page.document import Document, card
from scex_sumo.page.html import Html, element
from scex_sumo.page.timeline import SHAPES, Happening, shapes_legend, timeline
from scex_sumo.results.tables.columns import schema
from scex_sumo.results.tables.pairs import once_in

RISK: Final = "risk.parquet"
PAGE: Final = "watch.html"
MOMENTS: Final = "moments"
MOST: Final = 10
"""Worst moments on the page."""
APART_S: Final = 3.0
"""Two of them with the same pair are so far apart."""

RISK_SCHEMA: Final = schema("time_s hits other kind human_like stress how needed_braking contact_s x y doubt")
"""One row a moment and pair, the most probable first; moments without a pair have none."""
_REGION_M = 40.0


def write_risks(folder: Path, risks: Iterable[Risk]) -> Path:
    """Write ``risk.parquet`` and return its path."""
    rows = [
        {name: risk.time_s if name == "time_s" else getattr(pair, name) for name in RISK_SCHEMA.names}
        for risk in risks
        for pair in risk.pairs
    ]
    write_table(pa.Table.from_pylist(rows, schema=RISK_SCHEMA), folder / RISK)
    return folder / RISK


def worst_moments(risks: Sequence[Risk]) -> list[tuple[Risk, PairRisk]]:
    """Return the moments with the most probable collisions, each with its pair; see `APART_S`."""
    worst: list[tuple[Risk, PairRisk]] = []
    led = [(risk, pair) for risk in risks if (pair := risk.worst) is not None and pair.human_like > 0]
    for risk, pair in sorted(led, key=lambda moment: -moment[1].human_like):
        near = (
            set(pair.names) == set(other.names) and abs(risk.time_s - then.time_s) < APART_S
            for then, other in worst
        )
        if not any(near):
            worst.append((risk, pair))
        if len(worst) == MOST:
            break
    return worst


def command_of(config: Path, folder: Path, risk: Risk, pair: PairRisk) -> list[str]:
    """Return the words of the command that makes the report of a moment."""
    words = ["run", str(config), "--time", f"{risk.time_s:g}"]
    if len(risk.vehicles) >= BUSIEST:
        words.append(f"--region={pair.x:.0f},{pair.y:.0f},{_REGION_M:g}")
    return [*words, "-o", str(folder / MOMENTS / f"{risk.time_s:g}")]


def write_page(folder: Path, config: Path, risks: Sequence[Risk], about: str) -> Path:
    """Write the page: risk over time, the worst moments; return its path."""
    page = Document(f"{config.stem}: risk while it ran")
    worst = card("Worst moments", *_worst(folder, config, risks))
    return page.write(folder / PAGE, about, card("Risk over time", *_lines(risks)), worst)


def _lines(risks: Sequence[Risk]) -> list[Html]:
    """Return P of the pair that leads over time."""
    if not risks:
        return [element("p.soft", "No moment was assessed.")]
    first, last = risks[0].time_s, max(risks[-1].time_s, risks[0].time_s + 1.0)
    led = [(risk, pair) for risk in risks if (pair := risk.worst) is not None and pair.kind in SHAPES]
    marks = [
        Happening(
            time_s=risk.time_s,
            probability=pair.human_like,
            what=pair.kind,
            words=f"{risk.time_s:g} s, {pair.hits} → {pair.other}: {pair.how}; {once_in(pair.human_like)}",
        )
        for risk, pair in led
    ]
    people = timeline("people: P of the pair that leads", marks, (first, last))
    doubtful = sum(risk.pairs[0].doubt is not None for risk in risks if risk.pairs and risk.worst is None)
    dropped = [element("p.soft", f"{doubtful} moments have doubtful pairs alone.")] if doubtful else []
    return [shapes_legend(mark.what for mark in marks), people, *dropped]


def _worst(folder: Path, config: Path, risks: Sequence[Risk]) -> list[Html]:
    items = []
    for risk, pair in worst_moments(risks):
        time = element("b", f"{risk.time_s:g} s")
        words = shlex.join(["scex-sumo", *command_of(config, Path(os.path.relpath(folder)), risk, pair)])
        says = f": {pair.hits} → {pair.other}, {once_in(pair.human_like)}: {pair.how}"
        items.append(element("li", time, says, element("br"), element("code", words)))
    if not items:
        return [element("p.soft", "No pair of people collides as often as once in a billion such moments.")]
    return [element("p.soft", "The command makes the report of a moment."), element("ol", *items)]
