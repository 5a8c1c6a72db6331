"""``scex-sumo models``: the behaviour models that can drive."""

from __future__ import annotations


def models_command() -> None:
    """List the behaviour models and their parameters."""
    from rich.console import Console
    from rich.table import Table

    from scex_sumo.behaviors.registry import SETS, known_models

    table = Table(show_lines=False, box=None, pad_edge=False)
    for column in ("model", "parameters", "what it does"):
        table.add_column(column, overflow="fold", no_wrap=column == "model")
    for model in known_models():
        table.add_row(model.name, ", ".join(model.parameters), model.summary)
    Console().print(table)
    for name, models in SETS.items():
        Console().print(f"{name} stands for {models.replace(',', ', ')}")  # words, to break lines between
