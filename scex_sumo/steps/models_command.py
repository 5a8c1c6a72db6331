"""``scex-sumo models``: the behaviour models and their parameters."""

from __future__ import annotations


def models_command() -> None:
    """List the behaviour models and their parameters."""
    from rich.table import Table

    from scex_sumo.commands.console import output_console
    from scex_sumo.drivers.listing import known_models
    from scex_sumo.drivers.registry import mixes

    table = Table(show_lines=False, box=None, pad_edge=False)
    for column in ("model", "parameters", "what it does"):
        table.add_column(column, overflow="fold", no_wrap=column == "model")
    for model in known_models():
        table.add_row(model.name, ", ".join(model.parameters), model.summary)
    output_console().print(table)
    for name, models in mixes().items():
        output_console().print(f"{name} stands for {models.replace(',', ', ')}")
