"""Completion of values in a shell: names of models, metrics and formats, result folders.

What knows the names is imported when Tab is pressed, not when the program starts.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

_RESULT = "run.json"


def complete_models(incomplete: str) -> list[str]:
    """Models and sets of models, after the last comma of a list."""
    from scex_sumo.behaviors.registry import SETS, known_models

    return _last_of_list(incomplete, [*SETS, *(model.name for model in known_models())])


def complete_metrics(incomplete: str) -> list[str]:
    """Metrics, after the last comma of a list."""
    from scex_sumo.metrics.registry import known_metrics

    return _last_of_list(incomplete, known_metrics())


def complete_formats(incomplete: str) -> list[str]:
    """Formats that children are exported to."""
    from scex_sumo.exporters.registry import EXPORTERS

    return _last_of_list(incomplete, EXPORTERS)


def complete_results(incomplete: str) -> list[str]:
    """Result folders that begin as typed, or lie in folders that do."""
    typed, slash, begin = incomplete.rpartition("/")
    within = Path(typed + slash)
    found = [file for depth in ("*", "*/*") for file in within.glob(f"{depth}/{_RESULT}")]
    names = (file.parent.relative_to(within).as_posix() for file in found)
    return sorted(f"{typed}{slash}{name}" for name in names if name.startswith(begin))


def _last_of_list(incomplete: str, names: Iterable[str]) -> list[str]:
    typed, comma, last = incomplete.rpartition(",")
    return [f"{typed}{comma}{name}" for name in names if name.startswith(last)]
