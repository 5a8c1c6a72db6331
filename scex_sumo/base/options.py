"""Options: fields of a frozen dataclass that the command line, ``--config``, Python and the docs all read.

A field made by `option` carries its help and how the command line writes it. Messages name options as the
command line does; `extrapolate` translates them for callers in Python.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

from scex_sumo.base.errors import UsageError, nearest


@dataclass(frozen=True, kw_only=True)
class Option:
    """How the command line shows and reads a field.

    Attributes:
        help: one line.
        metavar: placeholder of the value.
        names: on the command line; empty for that of the field. ``--on/--off`` for a flag with two names.
        panel: its group in the help; None for the others.
        takes: type that the command line takes, None if the option is not given; None for the field's type.
        several: the option is repeatable; the command line takes a list of texts.
        read: turns the text or texts into the value; None keeps it.
    """

    help: str
    metavar: str | None = None
    names: tuple[str, ...] = ()
    panel: str | None = None
    takes: type | None = None
    several: bool = False
    read: Callable[[Any], Any] | None = None


def option(help: str, default: Any = MISSING, *, factory: Any = MISSING, **how: Any) -> Any:
    """Return a dataclass field with its `Option`; ``how`` are fields of it.

    Example:
        >>> scex.option("Speed above which a vehicle is fast, m/s.", 8.0, metavar="V").default
        8.0
    """
    about = {"option": Option(help=help, **how)}
    if factory is not MISSING:
        return field(default_factory=factory, metadata=about)
    return field(default=default, metadata=about)


def options_of(kind: type) -> dict[str, Option]:
    """Return the options of a dataclass by field."""
    return {entry.name: entry.metadata["option"] for entry in fields(kind) if "option" in entry.metadata}


def from_command_line(kind: type, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of the options of a dataclass that a command line gives."""
    values = {}
    for name, described in options_of(kind).items():
        value = given.get(name)
        if name in given and not ((described.takes or described.several) and value in (None, [])):
            values[name] = value if described.read is None else described.read(value)
    return values


def split_options(given: Mapping[str, Any], kinds: Sequence[type]) -> list[dict[str, Any]]:
    """Return the given options of each dataclass.

    Raises:
        UsageError: an option belongs to none of them.
    """
    known = [[entry.name for entry in fields(kind) if entry.init] for kind in kinds]
    everything = [name for names in known for name in names]
    for name in given:
        if name not in everything:
            raise UsageError(f"unknown option {name!r}; nearest: {nearest(name, everything)}")
    return [{name: given[name] for name in names if name in given} for names in known]


def present_names(arguments: Iterable[str]) -> list[str]:
    """Return arguments with options under their present names, for scripts that use former ones."""
    former = {"--children": "--futures", "--child": "--future", "--plots": "--report"}
    former["--no-plots"] = "--no-report"
    named = [(word, *word.partition("=")) for word in arguments]
    return [former[name] + equals + value if name in former else word for word, name, equals, value in named]


def number_or_name(text: str) -> int | str:
    """Return the track id, or SUMO's name of a vehicle, that an option names."""
    word = text.strip()
    return int(word) if word.removeprefix("-").isdecimal() else word
