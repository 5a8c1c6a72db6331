"""Parameters of a command, generated from dataclasses of options."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import MISSING, Field, fields
from typing import Annotated, Any, get_type_hints

import typer

from scex_sumo.base.options import Option


def with_options(kinds: Sequence[type]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorate a command: in place of ``**given`` it takes the options of dataclasses.

    Args:
        kinds: the dataclasses, in the order of the help; keyword-only options of the command follow.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        signature = inspect.signature(command, eval_str=True)
        own = [p for p in signature.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
        more = [parameter for kind in kinds for parameter in parameters_of(kind)]
        last = [p for p in own if p.kind is inspect.Parameter.KEYWORD_ONLY]
        first = [p for p in own if p not in last]
        command.__signature__ = signature.replace(parameters=[*first, *more, *last])  # type: ignore[attr-defined]
        return command

    return decorate


def parameters_of(kind: type) -> list[inspect.Parameter]:
    """Return a keyword parameter for each option of a dataclass, as Typer reads them."""
    hints = get_type_hints(kind)
    return [
        _parameter(one, one.metadata["option"], hints[one.name])
        for one in fields(kind)
        if "option" in one.metadata
    ]


def _parameter(option_field: Field[Any], about: Option, hint: Any) -> inspect.Parameter:
    if about.several:
        hint, default = list[str] | None, None
    elif about.takes is not None:
        hint, default = about.takes | None, None
    else:
        default = None if option_field.default is MISSING else option_field.default
    names = about.names or ((f"--{option_field.name.replace('_', '-')}",) if hint is not bool else ())
    option = typer.Option(
        *names,
        metavar=about.metavar,
        help=about.help,
        autocompletion=about.complete,
        rich_help_panel=about.panel,
    )
    return inspect.Parameter(
        option_field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[hint, option]
    )
