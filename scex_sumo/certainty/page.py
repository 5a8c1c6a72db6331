"""Card of the exact probabilities on a run's page, with a slider for each model's weight."""

from __future__ import annotations

from typing import Any

from scex_sumo.certainty.results import exact_of, people_of
from scex_sumo.page.html import Html, element
from scex_sumo.page.parts import PagePart
from scex_sumo.results.run import Run
from scex_sumo.results.tables.encounters import ENCOUNTERS


def exact_part(run: Run) -> PagePart:
    """Return the card of a run with exact tables; none where no pair collides."""
    contents = exact_contents(run)
    return PagePart(cards=exact_card(run), info={"exact": contents}, scripts=("exact.js",))


def exact_contents(run: Run) -> dict[str, Any] | None:
    """Return models, shares and the cut sets of the pairs that collide; None without exact tables.

    ``pairs`` have their ``cubes``, lists of track id and model's index; None if sampled.
    """
    exact = exact_of(run)
    if exact is None or not (run.folder / ENCOUNTERS).is_file():
        return None
    pairs = []
    for row in run.encounters.to_pylist():
        table = exact.table(row["track_id"], row["other_id"])
        if row["collision"] == 0 and (table is None or table.probability() == 0):
            continue
        cubes = None if table is None else [sorted(cube) for cube in table.cut_sets]
        name, words = f"{row['track_id']} → {row['other_id']}", [] if table is None else table.in_words()
        pairs.append(
            {
                "name": name,
                "cubes": cubes,
                "words": "; or ".join(words)
                or f"sampled: {exact.why_sampled(row['track_id'], row['other_id'])}",
                "sampled": row["collision"],
                "remainder": exact.remainder if table is None else table.remainder,
            }
        )
    draws = exact.draws
    return {
        "models": list(draws.models),
        "shares": draws.shares.tolist(),
        **people_of(draws),
        "pairs": pairs,
        "remainder": exact.remainder,
    }


def exact_card(run: Run) -> list[Html]:
    """Return the card with the sliders; none where no pair collides or no table is exact."""
    contents = exact_contents(run)
    exact = exact_of(run)
    if contents is None or not contents["pairs"] or exact is None:
        return []
    sliders = [
        element(
            "label.weight",
            element("span", model),
            element("input", type="range", min="0", max="1", step="any", data_model=number),
            element("output"),
        )
        for number, model in enumerate(contents["models"])
    ]
    about = f"{exact.summary().capitalize()}. Drag a weight: P follows without new futures."
    return [
        element(
            "section.card",
            element("h2", "Exact probabilities"),
            element("p.soft", about),
            element("div", *sliders, id="weights"),
            element("div.row", element("button", "the run's weights", id="own-weights")),
            element("p", "Any collision: ", element("b", id="any-collision")),
            element("div.scroll", id="exact-table"),
            id="exact",
        )
    ]
