"""Page of a validation: scores and reliability diagrams."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.metrics.registry import metric_of
from scex_sumo.page.columns import Column, failure_card, page_table
from scex_sumo.page.document import Document, card, plots
from scex_sumo.page.figures.charts import Plane, metric_title
from scex_sumo.page.html import Html, element
from scex_sumo.reports.words import counted

HTML = "validation.html"
_BRIER = "95 % interval of the Brier score, recordings drawn with replacement"
_BASE_RATE = "Brier score of the share that happened; no forecast changes it"
_CRPS = "Distance of the futures' distribution from the recorded value, in its unit"
_MOVING = "Whether only vehicles that move count"
_OF_MEAN = "Distance of the futures' mean from the recorded place"
_WITHIN = "Share of the recorded ones within those of the futures"
EVENT_COLUMNS = (
    Column("event", "event"),
    Column("happened", "happened", "percent", "Share of the moments with the event"),
    Column("forecast", "forecast", "percent", "Mean probability that the futures gave it"),
    Column("brier", "Brier", "real", "Mean squared error of the probabilities; 0 is perfect"),
    Column("brier_constant_velocity", "constant velocity", "real", "Brier score if all go on as they do"),
    Column("uncertainty", "base rate", "real", _BASE_RATE),
    Column("brier_low", "Brier from", "real", _BRIER),
    Column("brier_high", "to", "real", _BRIER),
    Column("skill_base_rate", "better than the base rate", "real", "1: perfect, 0: no better, below: worse"),
    Column("skill_constant_velocity", "than constant velocity", "real", "Forecast: all go on as they do"),
)
_VALUE_COLUMNS = (
    Column(lambda row: metric_title(row["column"], metric_of(row["column"])), "value"),
    Column("count", "cases"),
    Column("crps", "CRPS", "real", _CRPS),
    Column("crps_skill", "better than constant velocity", "real", "1: perfect, 0: no better, below: worse"),
    Column("coverage", "within 5 – 95 %", "percent", _WITHIN),
    Column("coverage_low", "from", "percent", "95 % interval of that share"),
    Column("coverage_high", "to", "percent", "95 % interval of that share"),
)
POSITION_COLUMNS = (
    Column("second", "after [s]"),
    Column(lambda row: "yes" if row["moving"] else "no", "moving", "text", _MOVING),
    Column("vehicles", "vehicles"),
    Column("error_of_mean_m", "of the mean", "metres", _OF_MEAN),
    Column("mean_error_m", "mean", "metres", "Mean distance of a future from the recorded place"),
    Column("least_error_m", "least", "metres", "Distance of the nearest future"),
    Column("constant_velocity_error_m", "constant velocity", "metres", "Distance where all go on as they do"),
    Column("along_coverage", "along, within 5 – 95 %", "percent", _WITHIN),
    Column("across_coverage", "across, within 5 – 95 %", "percent", _WITHIN),
)
_PAIR_COLUMNS = (Column("event", "event of a pair"), Column("pairs", "pairs"), *EVENT_COLUMNS[1:])


def write_validation_page(
    folder: Path, info: Mapping[str, Any], rows: Mapping[str, Sequence[Mapping[str, Any]]]
) -> None:
    """Write ``validation.html``.

    Args:
        info: content of ``validate.json``.
        rows: events, pairs, values and positions, see `scex_sumo.studies.validate.scoring`.
    """
    events = rows["events"]
    usual = [event for event in events if 0.0 < event["happened"] < 1.0]
    page = Document(f"Validation of {', '.join(info['models'])}")
    sections = [
        _summary(info),
        card(
            "Events",
            "Probability that the futures gave to recorded events.",
            page.table("events", page_table(EVENT_COLUMNS, events)),
        ),
        card(
            "Pairs",
            "Pairs of vehicles within 10 m of each other in some future; a collision counts as each event. "
            "Pairs whose recorded boxes touch are left out.",
            page.table("pairs", page_table(_PAIR_COLUMNS, rows["pairs"])),
        ),
        card(
            "Do probabilities hold?",
            "Where a forecast of 30 % came true 30 % of the time, the dot is on the line; its area is the "
            "number of seed scenes.",
            plots(*(_diagram(event) for event in usual)) if usual else "No event both happened and did not.",
        ),
        card(
            "Values",
            "Times count up to 10 s, 1/TTC up to 10 1/s, DRAC up to 20 m/s².",
            page.table("values", page_table(_VALUE_COLUMNS, rows["values"])),
        ),
        card(
            "Positions",
            "Distance of the futures from the recorded places.",
            page.table("positions", page_table(POSITION_COLUMNS, rows["positions"])),
        ),
        *failure_card(f"{len(info['failed'])} moments that could not be judged", info["failed"]),
    ]
    about = (
        f"{counted(info['seeds'], 'seed scene')} of {counted(info['recordings'], 'recording')}, "
        f"{info['futures']} futures each, part of the recordings: {info['part']}"
    )
    page.write(folder / HTML, about, *sections)


def _summary(info: Mapping[str, Any]) -> Html:
    lines = (
        *(note.removeprefix("warning: ") for note in info["notes"]),
        f"Mean Brier score over the paper's thresholds {info['mean_brier']:.3f}; constant velocity has "
        f"{info['mean_brier_constant_velocity']:.3f}, the base rate {info['mean_brier_base_rate']:.3f}.",
        f"P(collision) {collisions_in(info)}.",
    )
    return card("In short", *(element("p", line) for line in lines))


def collisions_in(info: Mapping[str, Any]) -> str:
    """Return P(collision) of all seed scenes, and of those without a recorded overlap, in words."""
    without = info["p_collision_without_overlap"]
    where = "" if without is None else f", {without:.2%} where no recorded boxes overlap"
    return f"{info['p_collision']:.2%}{where} (they do in {info['recorded_overlaps']:.2%} of the seed scenes)"


def _diagram(event: Mapping[str, Any]) -> Html:
    total = sum(event["diagram_count"])
    plane = Plane(x=(-0.1, 1.1), y=(-0.1, 1.1), width=180, height=180)  # the largest dots in the corners, too
    whole = np.array([0.0, 1.0])
    kinds = zip(event["diagram_forecast"], event["diagram_observed"], event["diagram_count"], strict=True)
    dots = [
        plane.dot(
            p,
            o,
            "drawn",
            radius=3 + 14 * math.sqrt(n / total),
            title=f"{p:.0%} forecast, {o:.0%} came true, {n} scenes",
        )
        for p, o, n in kinds
    ]
    parts = [plane.line(whole, whole, "soft", dashed=True), *dots]
    marks = [(share, f"{share:.0%}") for share in (0.0, 0.5, 1.0)]
    return plane.figure(event["event"], *parts, marks=marks)
