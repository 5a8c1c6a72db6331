"""``scex-sumo models``: the behaviour models and their parameters."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

from typer import Argument, Option

EXAMPLE = "standard_driver"
_SHOWN = 5  # parameters of a model in the list of all


def models_command(
    name: Annotated[
        str | None, Argument(metavar="NAME", help="One model, with all parameters.", show_default=False)
    ] = None,
    check: Annotated[
        bool,
        Option("--check", help="Let a driver of yours plan: shapes, values, the same in any batch, seconds."),
    ] = False,
) -> None:
    """List the behaviour models, or all parameters of one."""
    from scex_sumo.drivers.listing import model_info

    if check:
        _check(name)
        return
    if name is None:
        _print_all()
        return
    model = model_info(name)
    parameters = [text.partition("=") for text in model.parameters]
    rows = [(key, default or "-", model.meanings.get(key, "")) for key, _, default in parameters]
    _print([(model.name, model.summary)])
    if rows:
        print()
        _print([("parameter", "default", "meaning"), *rows])


def _check(name: str | None) -> None:
    from scex_sumo.base.errors import ScexError, UsageError
    from scex_sumo.extrapolation.model_check import check_model

    if name is None:
        raise UsageError("--check: name a driver, e.g. scex-sumo models mine:Class --check")
    faults, plans, seconds = check_model(name)
    first, second = (f"{1000 * duration_s:.2g} ms" for duration_s in seconds)
    print(f"{name}: {plans} plans, {first} each, {second} the second time")
    if faults:
        raise ScexError(f"{name}: {'; '.join(faults)}")
    print("shapes, values, motion: sound; the same plans when asked again and in another batch")


def _print_all() -> None:
    from scex_sumo.drivers.listing import known_models
    from scex_sumo.drivers.registry import MIXES

    rows: list[tuple[str, str]] = []
    sumo = []
    for model in known_models():
        if model.name.startswith("sumo:"):
            sumo.append(model.name)
            continue
        rows.append((model.name, model.summary))
        more = len(model.parameters) - _SHOWN
        shown = [*model.parameters[:_SHOWN], *([f"and {more} more"] if more > 0 else [])]
        rows += [("", ", ".join(shown))] if shown else []
    rows.append((sumo[0], f"SUMO's own models, also {', '.join(sumo[1:])}"))
    rows.append(("", "parameters: attributes of SUMO's vehicle types, e.g. tau=1.2"))
    _print(rows)
    print("\nMixes")
    _print([(f"  {name}", models.replace(",", ", ")) for name, models in MIXES.items()])
    print("\nAll parameters of a model: scex-sumo models NAME")


def _print(rows: Iterable[tuple[str, ...]]) -> None:
    """Print rows as columns of at most 80 characters; only the first column stays whole."""
    from rich.table import Table

    from scex_sumo.commands.console import output_console

    table = Table.grid(padding=(0, 2, 0, 0))
    rows = list(rows)
    for column in range(len(rows[0])):
        table.add_column(no_wrap=column == 0, overflow="fold")
    for row in rows:
        table.add_row(*row)
    output_console(width=80).print(table, markup=False, highlight=False)
