"""Terminal tables of the encounters of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.console import Console

from scex_sumo.metrics.events import EVENTS
from scex_sumo.reports.console_table import console_table, print_line, print_table
from scex_sumo.reports.encounter_rows import HEADS, Meeting, encounter_cells
from scex_sumo.reports.words import Head, counted
from scex_sumo.results.run import Run
from scex_sumo.results.tables.cut_sets import cut_set_words
from scex_sumo.results.tables.encounters import QUESTIONS, event_of
from scex_sumo.results.tables.pairs import ends
from scex_sumo.statistics.density import Interval

MOST_LINES = 20


def print_encounters(run: Run, encounters: Sequence[Meeting], console: Console) -> None:
    """Print at most `MOST_LINES` lines of the meetings of both sets of futures."""
    pairs = counted(len({meeting.pair for meeting in encounters}), "pair")
    human = f" and {run.reference.futures} human-like ones" if run.reference is not None else ""
    scene, futures = run.info["seed_scene"]["name"], counted(run.futures, "future")
    title = f"{scene}: {pairs} of vehicles meet in {futures}{human}"
    caption = (
        "→: hits or follows; shares: of the line's futures, a collision counts as TTC, PET and DRAC\n"
        "no human-like line: critical in none\n"
        "gap (–: over 10 m), after, driven by: of the typical future, as view --encounter shows it\n"
        "doubtful: the recording, not the traffic, see --pair"
    )
    heads = [(name, "text" if form == "percent" else form, hint) for name, form, hint in HEADS]
    cells = (encounter_cells(meeting) for meeting in encounters[:MOST_LINES])
    rows = [[cell.share if isinstance(cell, Interval) else cell for cell in row] for row in cells]
    print_table(console_table(title, heads, rows, caption=caption), console)


def print_pair(meeting: Meeting, console: Console) -> None:
    """Print shares, gaps, models and colliding futures of a pair in one set of futures."""
    run, row = meeting.run, meeting.row
    print_line(meeting.words(), console)
    rows = []
    for name in QUESTIONS:
        share, event = meeting.probability(name), EVENTS.get(name)
        rows.append((event.question if event else "any of these", share.share, f"{share.range} %"))
    heads = [("question", "names", ""), ("share", "text", ""), ("interval", "text", "")]
    title = f"share of {run.futures} {meeting.futures} futures, 95 % interval"
    caption = "a collision counts as TTC, PET and DRAC"
    print_table(console_table(title, heads, rows, caption=caption), console)
    what = event_of(row)[1]
    for words in cut_set_words(row):
        print_line(f"{what} {words}", console)
    gaps = ["> 10" if row[f"gap_p{p}"] is None else f"{row[f'gap_p{p}']:.1f}" for p in ("05", "50", "95")]
    words = "least gap in m: {} in 5 %, {} in 50 %, {} in 95 % of the futures"
    print_line(words.format(*gaps), console)
    if row["lifts"]:
        names: tuple[Head, ...] = (("vehicle", "names", ""), ("model", "names", ""))
        heads = [*names, ("futures", "text", ""), (what, "text", ""), ("lift", "real", "")]
        title, caption = "by the model of one vehicle", "lift: share of these futures over that of all"
        names_of = dict(zip((row["track_id"], row["other_id"]), ends(row), strict=True))
        lifts = [[names_of[track], *values] for track, *values in map(dict.values, row["lifts"])]
        print_table(console_table(title, heads, lifts, caption=caption), console)
    hits = np.flatnonzero(meeting.happens("collision")).tolist()
    if hits:
        shown = ", ".join(map(str, hits[:12])) + (", ..." if len(hits) > 12 else "")
        print_line(f"collides in futures {shown}", console)
    look = f"look: scex-sumo view {run.folder} --encounter {row['track_id']},{row['other_id']}"
    console.print(look, soft_wrap=True, highlight=False)
