"""Terminal tables of the encounters of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.evaluation.encounters import in_words
from scex_sumo.reports.run_table import counted, print_line, print_table
from scex_sumo.results.run import Run

QUESTIONS = {
    "collision": "collision",
    "ttc": "TTC on path < 1.5 s",
    "pet": "PET < 1 s",
    "drac": "DRAC > 3.4 m/s²",
    "critical": "any of these",
}
"""Questions about a pair, by column."""


def print_encounters(run: Run, console: Console, *, most: int) -> None:
    """Print at most ``most`` pairs, the most critical first."""
    scene = run.info["seed_scene"]["name"]
    pairs, children = counted(run.encounters.num_rows, "pair"), counted(run.children, "future")
    table = Table(
        title=f"{scene}: {pairs} of vehicles meet in {children}",
        title_justify="left",
        caption="→: hits or follows; shares of all futures; gap: least distance in the nearest 5 % of them",
        caption_justify="left",
    )
    for name in ("pair", "place"):
        table.add_column(name, no_wrap=True)
    for name in ("collides", "95 %", "TTC", "PET", "DRAC", "any", "gap [m]"):
        table.add_column(Text(name), justify="right", no_wrap=True)
    table.add_column("mostly driven by", overflow="fold")
    for row in run.encounters.slice(0, most).to_pylist():
        low, high = row["collision_low"], row["collision_high"]
        models = row["models"][0] if row["models"] else None
        gap = row["gap_p05"]
        table.add_row(
            f"{row['track_id']} → {row['other_id']}",
            row["place"] or "–",
            f"{row['collision']:.1%}",
            f"{100 * low:.0f}–{100 * high:.0f}",
            *(f"{row[name]:.0%}" for name in ("ttc", "pet", "drac", "critical")),
            "–" if gap is None else f"{gap:.1f}",
            "–" if models is None else f"{models['model']}, {models['other_model']}",
        )
    print_table(table, console)


def print_pair(run: Run, row: Mapping[str, Any], console: Console) -> None:
    """Print shares, gaps, models and colliding futures of a pair."""
    print_line(in_words(row), console)
    table = Table(title="share of all futures, 95 % confidence interval", title_justify="left")
    table.add_column("question")
    table.add_column("share", justify="right")
    table.add_column("interval", justify="right")
    for name, words in QUESTIONS.items():
        low, high = row[f"{name}_low"], row[f"{name}_high"]
        table.add_row(words, f"{row[name]:.1%}", f"{low:.1%} – {high:.1%}")
    print_table(table, console)
    gaps = ["> 10" if row[f"gap_p{p}"] is None else f"{row[f'gap_p{p}']:.1f}" for p in ("05", "50", "95")]
    print_line(
        f"least gap in m: {gaps[0]} in 5 %, {gaps[1]} in 50 %, {gaps[2]} in 95 % of the futures", console
    )
    models = Table(title="by their models", title_justify="left")
    for name in (str(row["track_id"]), str(row["other_id"])):
        models.add_column(name)
    for name in ("futures", "critical", "P", "of all", "lift"):
        models.add_column(name, justify="right")
    for entry in row["models"]:
        models.add_row(
            entry["model"],
            entry["other_model"],
            str(entry["children"]),
            str(entry["critical"]),
            f"{entry['probability']:.0%}",
            f"{entry['share']:.0%}",
            f"{entry['lift']:.1f}",
        )
    if row["models"]:
        print_table(models, console)
    if hits := _colliding_children(run, row):
        shown = ", ".join(str(child) for child in hits[:12]) + (", ..." if len(hits) > 12 else "")
        print_line(f"collides in futures {shown}", console)
        console.print(f"look: scex-sumo view {run.folder} --child {hits[0]}", soft_wrap=True, highlight=False)


def _colliding_children(run: Run, row: Mapping[str, Any]) -> list[int]:
    ids = [np.asarray(run.collisions[name]) for name in ("track_id", "other_id")]
    pair = np.sort(np.stack(ids), axis=0) == np.sort([row["track_id"], row["other_id"]])[:, None]
    return [int(child) for child in np.asarray(run.collisions["child"])[pair.all(axis=0)]]
