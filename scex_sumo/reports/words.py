"""Words and rows of a run that its card, its page and the tables share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

from scex_sumo.results.run import Run

MAIN: Final[tuple[str, ...]] = ("gap", "ttc_path", "drac", "thw", "wttc_path")
"""Metrics of the table in its default form."""

Head: TypeAlias = tuple[str, str, str]
"""Title, format and hint of a column in the terminal and on a page.

Formats: text, names and words (left-aligned), real, percent, seconds, metres; in a terminal also ``.2f``.
"""


def participants(scene: Mapping[str, Any]) -> str:
    """Return how many vehicles and people of a seed scene, as ``run.json`` has it, take part, and how."""
    people = len(scene.get("people", ()))
    words = counted(scene["vehicles"] - people, "vehicle")
    words += f" and {people} {'person' if people == 1 else 'people'}" if people else ""
    replayed = [counted(count, kind) for kind, count in (scene.get("replayed") or {}).items()]
    return f"{words} ({', '.join(replayed)} as recorded)" if replayed else words


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, e.g. ``2 vehicles``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def row_cell(value: float | str | None) -> str:
    """Return the value of a row of an extra as it is printed."""
    return value if isinstance(value, str) else "–" if value is None else f"{value:.3g}"


def extra_rows(run: Run) -> dict[str, list[float | str | None]]:
    """Return the rows of the extras by title: the value in the stress test, then in the reference."""
    sets = [run] if run.reference is None else [run, run.reference]
    rows_of = [{row["name"]: row for row in result.info.get("rows", ())} for result in sets]
    titles = {name: f" [{row['unit']}]" if row["unit"] else "" for name, row in rows_of[0].items()}
    return {
        f"{name}{unit}": [rows.get(name, {}).get("value") for rows in rows_of]
        for name, unit in titles.items()
    }
