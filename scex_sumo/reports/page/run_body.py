"""Body of a run's report: the words that stand in it before any script has run."""

from __future__ import annotations

from collections.abc import Mapping
from string import Template
from typing import Any

from scex_sumo.reports.page.html import Html, element, joined
from scex_sumo.reports.page.shell import asset
from scex_sumo.reports.tables.runs import counted

_WORST = 3
_SECONDS_A_STEP = 0.1


def run_body(info: Mapping[str, Any]) -> str:
    """HTML of the body, from what `report_contents` says."""
    place = info["location"] if info["location"] != info["name"] else ""
    about = [
        counted(len(info["track_ids"]), "vehicle"),
        counted(info["children"], "child scenario"),
        f"{info['steps'] * _SECONDS_A_STEP:.1f} s ahead",
        place,
    ]
    return Template(asset("report.html")).substitute(
        name=element("span", info["name"]),
        about=joined(" · ".join(part for part in about if part)),
        verdict=joined(_collision_card(info), _share_card(), _encounter_card(info)),
        legend=_legend(info),
        recorded="" if info["has_recorded"] else " hidden",
        focus=_focus_options(info),
        notes=_notes(info["notes"]),
        foot=joined(f"scex-sumo {info['version']} · {info['command']}"),
    )


def percent(share: float) -> str:
    """A share in percent, with a digit after the point where it is small."""
    return f"{100 * share:.{1 if 0 < share < 0.0995 else 0}f} %"


def _collision_card(info: Mapping[str, Any]) -> Html:
    found, likely = info["collision"], info["likely_collisions"]
    if found is None:
        words = element("p.soft", "not in this result; run it again")
        return element("div.card", element("h2", "P(collision)"), element("div.big", "–"), words)
    of = f"{found['count']} of {counted(info['children'], 'child scenario')}; 95 %: "
    parts = [
        element("h2", "P(collision)"),
        element("div.big.hot" if found["count"] else "div.big", percent(found["value"])),
        element("p.soft", of + f"{percent(found['low'])} – {percent(found['high'])}"),
    ]
    if likely is not None:
        parts.append(element("p", f"likely: {percent(likely)}"))
    return element("div.card", *parts)


def _share_card() -> Html:
    return element("div.card", element("h2", "P(critical)"), element("div", id="shares"))


def _encounter_card(info: Mapping[str, Any]) -> Html:
    rows = info["encounters"]["rows"][:_WORST]
    buttons = [
        element("li", element("button", row["words"], data_encounter=number))
        for number, row in enumerate(rows)
    ]
    shown = element("ol", *buttons) if rows else element("p", "Nobody meets anybody.")
    return element("div.card", element("h2", "Worst encounters"), shown)


def _legend(info: Mapping[str, Any]) -> Html:
    models = [
        element("div", element("i", data_model=number), model) for number, model in enumerate(info["models"])
    ]
    recorded = [element("div", element("i.outline"), "recorded")] if info["has_recorded"] else []
    return joined(*models, *recorded)


def _focus_options(info: Mapping[str, Any]) -> Html:
    """What the children can be judged by: collisions and metrics that have an event at all."""
    names = ["collision", *(m["name"] + (" (mean)" if m["mean"] else "") for m in info["metrics"])]
    known = {row["metric"] for row in info["events"]["rows"]}
    options = [element("option", name, value=m) for m, name in enumerate(names, -1) if m in known]
    return joined(*options)


def _notes(notes: list[str]) -> Html:
    if not notes:
        return Html()
    lines = element("ul", *(element("li", note) for note in notes), id="notes")
    return element("section.card", element("h2", "Notes"), lines)
