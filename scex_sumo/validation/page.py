"""Page of a validation: one self-contained file with the scores, the reliability diagrams and the ranks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from scex_sumo.files import write_atomic

HTML = "validation.html"
_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:1em 0}td,th{padding:.2em .7em;text-align:right}
td,th{border-bottom:1px solid #ddd}
td:first-child,th:first-child{text-align:left}figure{display:inline-block;margin:.5em}figcaption{font-size:85%}
p.note{color:#555}"""
_EVENT_COLUMNS = (
    ("event", "event"),
    ("happened", "happened"),
    ("forecast", "forecast"),
    ("brier", "Brier"),
    ("brier_low", "2.5 %"),
    ("brier_high", "97.5 %"),
    ("reliability", "reliability"),
    ("resolution", "resolution"),
    ("uncertainty", "uncertainty"),
    ("skill_base_rate", "skill, base rate"),
    ("skill_seed_moment", "seed moment"),
    ("skill_constant_velocity", "const. velocity"),
    ("calibration_error", "ECE"),
    ("roc_area", "ROC area"),
    ("precision_area", "PR area"),
)
_VALUE_COLUMNS = (
    ("column", "value"),
    ("count", "cases"),
    ("crps", "CRPS"),
    ("crps_skill", "skill, const. velocity"),
    ("coverage", "within 5-95 %"),
    ("coverage_low", "2.5 %"),
    ("coverage_high", "97.5 %"),
)
_POSITION_COLUMNS = (
    ("second", "after s"),
    ("moving", "moving"),
    ("vehicles", "vehicles"),
    ("error_of_mean_m", "of the mean, m"),
    ("mean_error_m", "mean, m"),
    ("least_error_m", "least, m"),
    ("constant_velocity_error_m", "const. velocity, m"),
    ("along_coverage", "within 5-95 %, along"),
    ("across_coverage", "across"),
)


def write_validation_page(
    folder: Path, info: Mapping[str, Any], rows: Mapping[str, Sequence[Mapping[str, Any]]]
) -> None:
    """Write ``validation.html``.

    Args:
        folder: where to.
        info: what ``validate.json`` says.
        rows: events, values and positions, as `scex_sumo.validation.scoring` gives them.
    """
    events, values = rows["events"], rows["values"]
    usual = [row for row in events if 0.0 < row["happened"] < 1.0]
    parts = [
        f"<h1>Validation of {escape(', '.join(info['models']))}</h1>",
        f"<p>{info['seeds']} seed scenes of {info['recordings']} recordings, {info['children']} children "
        f"each, part of the recordings: {escape(info['part'])}. Mean Brier score over the paper's thresholds "
        f"<b>{info['mean_brier']:.3f}</b> (base rate {info['mean_brier_base_rate']:.3f}); P(collision) "
        f"{info['p_collision']:.2%}, overlaps in the recordings {info['recorded_overlaps']:.2%}; realism "
        f"{_shown(info['realism'])}.</p>",
        '<p class="note">Realism is after that of the Waymo Sim Agents Challenge, of 3 s and '
        "without lights: compare mixes with it, not with that leaderboard. Intervals: recordings drawn with "
        "replacement.</p>",
        "<h2>Events</h2>",
        _table(_EVENT_COLUMNS, events),
        "<h2>Reliability</h2>",
        '<p class="note">Where a forecast of 30 % came true 30 % of the time, the dot is on the line; its '
        "area is the number of seed scenes.</p>",
        *(_diagram(row) for row in usual),
        "<h2>Values</h2>",
        _table(_VALUE_COLUMNS, values),
        '<p class="note">Ranks of the recorded value among the children: flat where the children are like '
        "it, high at both ends where they spread too little.</p>",
        *(_ranks(row["column"], row["ranks"]) for row in values),
        "<h2>Positions</h2>",
        _table(_POSITION_COLUMNS, rows["positions"]),
        *_failures(info["failed"]),
    ]
    head = f"<!doctype html><meta charset=utf-8><title>Validation</title><style>{_STYLE}</style>"
    write_atomic(folder / HTML, (head + "\n".join(parts)).encode())


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return "–" if math.isnan(value) else f"{value:.3f}"
    return "–" if value is None else escape(str(value))


def _table(columns: Sequence[tuple[str, str]], rows: Sequence[Mapping[str, Any]]) -> str:
    head = "".join(f"<th>{escape(label)}" for _, label in columns)
    body = "".join("<tr>" + "".join(f"<td>{_shown(row[key])}" for key, _ in columns) for row in rows)
    return f"<table><tr>{head}{body}</table>"


def _diagram(row: Mapping[str, Any]) -> str:
    """Reliability diagram of an event, as SVG."""
    total = sum(row["diagram_count"])
    dots = "".join(
        f'<circle cx="{10 + 160 * p:.1f}" cy="{170 - 160 * o:.1f}" r="{3 + 14 * math.sqrt(n / total):.1f}" '
        'fill="#1f77b4" fill-opacity=".6"/>'
        for p, o, n in zip(
            row["diagram_forecast"], row["diagram_observed"], row["diagram_count"], strict=True
        )
    )
    frame = '<rect x="10" y="10" width="160" height="160" fill="none" stroke="#999"/>'
    line = '<line x1="10" y1="170" x2="170" y2="10" stroke="#999" stroke-dasharray="4"/>'
    svg = f'<svg width="180" height="180" role="img" aria-label="reliability">{frame}{line}{dots}</svg>'
    return f"<figure>{svg}<figcaption>{escape(row['event'])}</figcaption></figure>"


def _ranks(name: str, counts: Sequence[int]) -> str:
    """Rank histogram, as SVG; the line is what equal ranks would give."""
    most, total = max(*counts, 1), sum(counts)
    bars = "".join(
        f'<rect x="{5 + 14 * k}" y="{65 - 60 * n / most:.1f}" width="12" height="{60 * n / most:.1f}" '
        'fill="#1f77b4"/>'
        for k, n in enumerate(counts)
    )
    level = 65 - 60 * total / len(counts) / most
    line = f'<line x1="5" x2="145" y1="{level:.1f}" y2="{level:.1f}" stroke="#d62728"/>'
    svg = f'<svg width="150" height="70">{bars}{line}</svg>'
    return f"<figure>{svg}<figcaption>{escape(name)}</figcaption></figure>"


def _failures(failed: Mapping[str, str]) -> list[str]:
    if not failed:
        return []
    items = "".join(f"<li>{escape(name)}: {escape(reason)}" for name, reason in list(failed.items())[:50])
    return [f"<h2>{len(failed)} moments that could not be judged</h2><ul>{items}</ul>"]
