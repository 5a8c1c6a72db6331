"""Terminal tables of the encounters of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import pyarrow as pa
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.evaluation.outcomes import collided
from scex_sumo.exact.tables import InfluenceTable
from scex_sumo.reports.encounter_rows import Meeting, meetings
from scex_sumo.reports.run_table import counted, print_line, print_table
from scex_sumo.results.exact import EVENTS, Encounter, Exact, TooFewFuturesError
from scex_sumo.results.region import EVERYWHERE, Region
from scex_sumo.results.run import Run

QUESTIONS = {
    "collision": "collision",
    "ttc": "TTC on path < 1.5 s",
    "pet": "PET < 1 s",
    "drac": "DRAC > 3.4 m/s²",
    "critical": "any of these",
}
"""Questions about a pair, by column."""


def print_encounters(run: Run, console: Console, *, most: int, region: Region = EVERYWHERE) -> None:
    """Print at most ``most`` lines of both sets of futures, the most critical pair first."""
    scene, found = run.info["seed_scene"]["name"], meetings(run, region)
    indices = None if region == EVERYWHERE else region.vehicles(run.scene)
    if indices is not None:
        inside = run.scene.track_ids[list(indices)].tolist()
        line = (
            f"{len(inside)} of {run.scene.vehicles} vehicles are {region.words()}; one of them collides in "
        )
        likely = run.reference
        human = "" if likely is None else f", {_share(likely, inside)} of the human-like ones"
        print_line(f"{line}{_share(run, inside)} of the futures{human}", console)
    pairs = counted(len({one.pair for one in found}), "pair")
    human = f" and {run.reference.children} human-like ones" if run.reference is not None else ""
    table = Table(
        title=f"{scene}: {pairs} of vehicles meet in {counted(run.children, 'future')}{human}",
        title_justify="left",
        caption="→: hits or follows; shares: of the line's futures; no human-like line: critical in none\n"
        "gap, after, driven by: of the typical future, as view --encounter shows it",
        caption_justify="left",
    )
    for name in ("pair", "place", "futures"):
        table.add_column(name, no_wrap=True)
    for name in ("collides", "95 %", "TTC", "PET", "DRAC", "any", "gap [m]", "after"):
        table.add_column(Text(name), justify="right", no_wrap=True)
    table.add_column("driven by", overflow="fold")
    for one in found[:most]:
        row, encounter = one.row, Encounter(row=one.row, run=one.run)
        is_exact = encounter.table is not None
        table.add_row(
            f"{row['track_id']} → {row['other_id']}",
            row["place"] or "–",
            one.futures,
            f"{encounter.probability():.1%}",
            "exact" if is_exact else f"{100 * row['collision_low']:.0f}–{100 * row['collision_high']:.0f}",
            *(f"{encounter.probability(name):.0%}" for name in ("ttc", "pet", "drac", "critical")),
            "> 10" if row["gap"] is None else f"{row['gap']:.1f}",
            f"{row['time_s']:.1f} s",
            f"{row['model']}, {row['other_model']}",
        )
    print_table(table, console)


def _share(run: Run, vehicles: Sequence[int]) -> str:
    """Return the share of the futures in which one of these vehicles collides."""
    hits = run.collisions
    own = np.isin([np.asarray(hits["track_id"]), np.asarray(hits["other_id"])], vehicles).any(axis=0)
    return run.intervals.share(collided(hits.filter(pa.array(own)), np.arange(run.children))).percent


def print_pair(one: Meeting, console: Console) -> None:
    """Print shares, gaps, models and colliding futures of a pair in one set of futures."""
    run, row = one.run, one.row
    print_line(one.words(), console)
    table = Table(title=f"share of {run.children} {one.futures} futures, 95 % interval", title_justify="left")
    table.add_column("question")
    table.add_column("share", justify="right")
    table.add_column("interval", justify="right")
    found = Encounter(row=row, run=run)
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
    look = f"look: scex-sumo view {run.folder} --encounter {row['track_id']},{row['other_id']}"
    console.print(look, soft_wrap=True, highlight=False)


def _print_exact(exact: Exact, table: InfluenceTable, console: Console) -> None:
    """Print the cut sets of a collision, and whose models matter how much."""
    print_line(f"collides exactly if ({exact.told()}):", console)
    for words in table.in_words():
        print_line(f"  {words}", console)
    for track, models in table.leverage().items():
        most = max(models, key=lambda model: abs(models[model]))
        print_line(f"  {track}: P changes by {models[most]:+.3f} per share of {most}", console)


def print_weights(run: Run, weights: Mapping[str, float], console: Console, *, most: int = 20) -> None:
    """Print the probabilities of the critical pairs with other weights of the models.

    Raises:
        UsageError: a model is unknown, or a weight is below 0.
    """
    given = ", ".join(f"{model} {weight:g}" for model, weight in weights.items())
    table = Table(title=f"P with {given} instead of the run's weights", title_justify="left")
    table.add_column("pair", no_wrap=True)
    for event in EVENTS:
        table.add_column(QUESTIONS[event], justify="right")
    pairs, sampled = [row for row in run.encounters.to_pylist() if row["critical"] > 0], False
    for row in pairs[:most]:
        found = Encounter(row=row, run=run)
        marks = {event: "" if found.table_of(event) is not None else "~" for event in EVENTS}
        sampled |= "~" in marks.values()
        cells = [
            f"{mark}{found.probability(event):.2%} → {'–' if new is None else f'{new:.2%}'}"
            for (event, new), mark in zip(found.weighted(weights).items(), marks.values(), strict=True)
        ]
        table.add_row(f"{row['track_id']} → {row['other_id']}", *cells)
    new = "–"
    with suppress(TooFewFuturesError):
        new = f"{run.p_collision(weights):.2%}"
    mark = "" if run.p_collision.exact is not None else "~"
    table.add_row("any", f"{mark}{run.p_collision():.2%} → {new}", *[""] * (len(EVENTS) - 1))
    print_table(table, console)
    if sampled or mark:
        print_line("~ from the drawn futures, weighted; – too few of them are driven like this", console)
    if len(pairs) > most:
        print_line(f"{len(pairs) - most} more pairs with --most", console)


def _colliding_children(run: Run, row: Mapping[str, Any]) -> list[int]:
    ids = [np.asarray(run.collisions[name]) for name in ("track_id", "other_id")]
    pair = np.sort(np.stack(ids), axis=0) == np.sort([row["track_id"], row["other_id"]])[:, None]
    return [int(child) for child in np.asarray(run.collisions["child"])[pair.all(axis=0)]]
