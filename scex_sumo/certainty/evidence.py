"""Evidence sheet of a run: ``evidence.html``, one page that prints to one A4 sheet.

It has the fields that ISO 21448 clauses 6.4 (risk evaluation) and 6.5 (acceptance criteria) ask for, and
claims no conformity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.errors import ScexError, listed
from scex_sumo.base.files import write_atomic
from scex_sumo.certainty.response.extra import HEAD, ResponseExtra
from scex_sumo.certainty.results import exact_of
from scex_sumo.certainty.tables import InfluenceTable
from scex_sumo.converters.datasets.moment import find_moments
from scex_sumo.converters.datasets.reader import read_clean
from scex_sumo.page.html import BASE, Html, element, page_html, plain_table
from scex_sumo.reports.run_table import counted, expected_injuries
from scex_sumo.results.run import Run
from scex_sumo.results.tables.outcomes import first_contacts
from scex_sumo.scene import STEP_S

EVIDENCE = "evidence.html"
BRAKES = "emergency_brake"
_WORST = 3
_TOLD = 2  # lines of what it takes


def write_evidence(run: Run) -> Path:
    """Write the evidence sheet of a finished run into its folder and return its path."""
    path = run.folder / EVIDENCE
    scene = run.info["seed_scene"]
    body = element(
        "main.evidence",
        element("h1", f"Evidence sheet: {scene['name']}"),
        element(
            "p.soft",
            f"scex-sumo {run.info['scex_sumo']}. Clauses are those of ISO 21448, named for "
            "orientation; this sheet claims no conformity.",
        ),
        element("p", "" if run.decision is None else run.decision.sentence, id="decision"),
        _rows("Moment", _moment(run)),
        _rows("Probability of a collision", _probability(run)),
        _encounters(run),
        _rows("Risk", _risk(run)),
        _rows("Provenance", _provenance(run)),
    )
    write_atomic(path, page_html(f"Evidence {scene['name']}", body, BASE, {}, {}).encode())
    return path


def _rows(title: str, rows: Mapping[str, str]) -> Html:
    lines = [element("tr", element("th", name), element("td.words", text)) for name, text in rows.items()]
    return element("section", element("h2", title), element("table", element("tbody", *lines)))


def _moment(run: Run) -> dict[str, str]:
    scene, source = run.info["seed_scene"], run.info["seed_scene"].get("source") or {}
    time = "" if scene.get("time_s") is None else f", {scene['time_s']:g} s"
    return {
        "scenario (6.4)": f"{scene['location']}{time}: {counted(scene['vehicles'], 'vehicle')}, "
        f"{counted(run.futures, 'future')} of {run.info['steps'] * STEP_S:g} s",
        "recording": ", ".join(str(source[key]) for key in ("tracks", "simulation") if source.get(key))
        or "none: a synthetic or stored scene",
        "exposure (6.4)": _exposure(run),
    }


def _exposure(run: Run) -> str:
    """Return how often the recording has a moment with as many complete vehicles, in words."""
    scene, source = run.info["seed_scene"], run.info["seed_scene"].get("source") or {}
    unknown = "not known: the recording cannot be read here"
    tracks, when = source.get("tracks"), scene.get("time_s")
    if not tracks or when is None:
        return unknown
    try:
        moments = find_moments(read_clean([Path(tracks)], None).table, every_s=1.0)
    except (ScexError, OSError):
        return unknown
    if not moments:
        return unknown
    own = min(moments, key=lambda moment: abs(moment.time_s - when)).complete
    dense = sum(moment.complete >= own for moment in moments)
    return (
        f"{dense} of {len(moments)} moments of the recording, 1 s apart, have {own} or more vehicles that "
        "move and are recorded to the end; scex-sumo rank says how critical those are"
    )


def _probability(run: Run) -> dict[str, str]:
    share, human = run.collision, run.reference
    models = ", ".join(f"{entry['model']} {entry['weight']:g}" for entry in run.info["models"])
    takes = [line.strip() for line in ResponseExtra().lines(run)][:_TOLD]
    scored = "forecasts of this mix were scored on recordings of other sites, see docs/validity.md"
    futures = "not run"
    if human is not None:
        often = f"{human.collision.percent} of {counted(human.futures, 'future')}"
        futures = f"{often}, 95 % interval; {scored}"
    people = {"people": " ".join(takes).removeprefix(f"{HEAD}: ")} if takes else {}
    return {**people, "human-like futures": futures, "stress test": f"{share.words}; drawn as {models}"}


def _encounters(run: Run) -> Html:
    heads = ("pair", "P", "collides", "Δv [m/s]", "P(MAIS 3+)", "class", "avoidable by braking")
    collided = [row for row in run.encounters.to_pylist() if row["collision"] > 0]
    rows = [row for row in collided if run.keeps_doubtful or not row.get("doubt")]
    more = len(rows) - _WORST
    about = (
        f"and {counted(more, 'more pair')}" if more > 0 else "" if rows else "No pair collides in any future."
    )
    doubts = dict.fromkeys(row["doubt"] for row in collided if row not in rows)
    about += f" Left out as doubtful: {listed(doubts)}." if doubts else ""
    return element(
        "section",
        element("h2", "Worst encounters of the stress test (hazardous events, 6.4)"),
        plain_table(heads, (_encounter(run, row) for row in rows[:_WORST]), words=(2, 5)),
        element("p.soft", about),
    )


def _encounter(run: Run, row: Mapping[str, Any]) -> tuple[str, ...]:
    one, other = row["track_id"], row["other_id"]
    encounter = run.encounter(one, other)
    hits = [
        hit
        for hit in first_contacts(run.collisions).to_pylist()
        if {hit["track_id"], hit["other_id"]} == {one, other}
    ]
    changes, risks = (
        [_median(hits, name, track) for track in (one, other)] for name in ("delta_v", "p_mais3")
    )
    known, tables = encounter.collision.known, exact_of(run)
    table = None if tables is None else tables.table(one, other)
    faults = [_fault(hit) for hit in hits]
    often = max(sorted(set(faults)), key=faults.count) if faults else "undecided"
    braked = None if table is None else avoidable(table, (one, other))
    return (
        f"{one} → {other}",
        encounter.collision.percent + ("" if known is not None else " (sampled)"),
        "sampled" if known is None else known.summary or "sampled",
        " / ".join("–" if change is None else f"{change:.1f}" for change in changes),
        " / ".join("–" if risk is None else f"{risk:.1%}" for risk in risks),
        f"{row['kind']}, {often}",
        "–" if braked is None else f"{braked:.0%}",
    )


def _median(hits: Sequence[Mapping[str, Any]], name: str, track: int) -> float | None:
    """Return the median of a column of a vehicle's collisions; None where it is undefined."""
    values = [hit[name if hit["track_id"] == track else f"{name}_other"] for hit in hits]
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _fault(hit: Mapping[str, Any]) -> str:
    """Return the class of a collision with the vehicle that it is about."""
    if hit["fault"] is None:
        return "undecided"
    is_other = hit["fault"].startswith("other ")
    return f"{hit['other_id' if is_other else 'track_id']} {hit['fault'].removeprefix('other ')}"


def avoidable(table: InfluenceTable, pair: tuple[int, int]) -> float | None:
    """Return the share of an event that does not happen if one of two vehicles brakes from the start.

    None without such a model, or if the event never happens.
    """
    models = table.draws.models
    if BRAKES not in models or not table.outcomes.any():
        return None
    still = table.outcomes.copy()
    for axis, track in enumerate(table.track_ids):
        if track in pair and track not in table.draws.people:
            still &= np.take(table.outcomes, [models.index(BRAKES)], axis=axis)
    return 1.0 - replace(table, outcomes=still).probability() / table.probability()


def _risk(run: Run) -> dict[str, str]:
    injuries = expected_injuries(run)
    exact, weighted, total = exact_of(run), 0.0, 0.0
    for row in run.encounters.to_pylist() if exact is not None else ():
        table = exact.table(row["track_id"], row["other_id"]) if exact is not None else None
        share = None if table is None else avoidable(table, (row["track_id"], row["other_id"]))
        if table is not None and share is not None:
            weighted += share * table.probability()
            total += table.probability()
    return {
        "severity (6.4)": "not in this result"
        if injuries is None
        else f"{1000 * injuries:.2f} severe injuries (MAIS 3+, occupants of cars and vans) expected in 1000 "
        "futures of the stress test",
        "controllability (6.4)": f"{weighted / total:.0%} of the collisions with exact tables do not happen "
        "if one of the two brakes hard from the moment on"
        if total
        else "not known: no collision has an exact table",
        "acceptance criterion (6.5)": "to be set by the reader; this sheet sets none",
        "residual risk (6.5)": "probability and severity above, per such moment; exposure as above",
    }


def _provenance(run: Run) -> dict[str, str]:
    info = run.info
    return {
        "command": " ".join(str(word) for word in info.get("command") or ()) or "Python",
        "scene, SHA-256": str(info["seed_scene"].get("fingerprint", "")),
        "run, SHA-256": str(info.get("identity", "")),
        "seed, design": f"{info.get('seed')}, {info.get('design')}",
        "versions": ", ".join(f"{name} {version}" for name, version in info.get("versions", {}).items()),
    }
