"""Terminal tables of the encounters of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.base.errors import UsageError
from scex_sumo.exact.tables import InfluenceTable
from scex_sumo.reports.run_table import counted, encounter_in_words, print_line, print_table
from scex_sumo.results.exact import EVENTS, Encounter, Exact
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
        found = Encounter(row=row, exact=run.exact)
        is_exact = found.table is not None
        models = row["models"][0] if row["models"] else None
        gap = row["gap_p05"]
        table.add_row(
            f"{row['track_id']} → {row['other_id']}",
            row["place"] or "–",
            f"{found.probability():.1%}",
            "exact" if is_exact else f"{100 * low:.0f}–{100 * high:.0f}",
            *(f"{found.probability(name):.0%}" for name in ("ttc", "pet", "drac", "critical")),
            "–" if gap is None else f"{gap:.1f}",
            "–" if models is None else f"{models['model']}, {models['other_model']}",
        )
    print_table(table, console)


def print_pair(run: Run, row: Mapping[str, Any], console: Console) -> None:
    """Print shares, gaps, models and colliding futures of a pair."""
    print_line(encounter_in_words(run, row), console)
    table = Table(title="share of all futures, 95 % confidence interval", title_justify="left")
    table.add_column("question")
    table.add_column("share", justify="right")
    table.add_column("interval", justify="right")
    found = Encounter(row=row, exact=run.exact)
    for name, words in QUESTIONS.items():
        low, high = row[f"{name}_low"], row[f"{name}_high"]
        events = EVENTS if name == "critical" else (name,)
        if all(found.table_of(event) is not None for event in events):
            table.add_row(words, f"{found.probability(name):.1%}", "exact")
        else:
            table.add_row(words, f"{row[name]:.1%}", f"{low:.1%} – {high:.1%}")
    print_table(table, console)
    if run.exact is not None and found.table is not None and found.probability() > 0:
        _print_exact(run.exact, found.table, console)
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


def _print_exact(exact: Exact, table: InfluenceTable, console: Console) -> None:
    """Print the cut sets of a collision, and whose models matter how much."""
    print_line(f"collides exactly if ({exact.told()}):", console)
    for words in table.in_words():
        print_line(f"  {words}", console)
    for track, models in table.leverage().items():
        most = max(models, key=lambda model: abs(models[model]))
        print_line(f"  {track}: P changes by {models[most]:+.3f} per share of {most}", console)


def print_weights(run: Run, weights: Mapping[str, float], console: Console) -> None:
    """Print the exact probabilities of the pairs that collide with other weights of the models.

    Raises:
        UsageError: the run has no exact tables, or a model is unknown.
    """
    exact = run.exact
    if exact is None:
        raise UsageError(
            f"{run.folder}: has no exact tables; run again with --exact and deterministic models"
        )
    table = Table(title="P(collision) with other weights", title_justify="left")
    table.add_column("pair", no_wrap=True)
    for name in ("run's weights", "these weights"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("decided by", overflow="fold")
    for row in run.encounters.to_pylist():
        one = exact.table(row["track_id"], row["other_id"])
        if row["collision"] > 0 or (one is not None and one.probability() > 0):
            values = ("sampled", "–") if one is None else (one.probability(), one.probability(weights))
            table.add_row(
                f"{row['track_id']} → {row['other_id']}",
                *(value if isinstance(value, str) else f"{value:.2%}" for value in values),
                "–" if one is None else ", ".join(str(track) for track in one.track_ids),
            )
    whole = [exact.p_collision(), exact.p_collision(weights)]
    table.add_row("any", *("–" if value is None else f"{value:.2%}" for value in whole), "")
    print_table(table, console)


def _colliding_children(run: Run, row: Mapping[str, Any]) -> list[int]:
    ids = [np.asarray(run.collisions[name]) for name in ("track_id", "other_id")]
    pair = np.sort(np.stack(ids), axis=0) == np.sort([row["track_id"], row["other_id"]])[:, None]
    return [int(child) for child in np.asarray(run.collisions["child"])[pair.all(axis=0)]]
