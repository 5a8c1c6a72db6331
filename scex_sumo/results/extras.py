"""Registry of extras of a run, and what an extra reads from a result folder.

An extra is what a run does beside its drawn futures, such as a human-like reference or a page.
`scex_sumo.extrapolation.extras.Extra` adds what it does while the run is made.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeVar

from scex_sumo.base.errors import UsageError
from scex_sumo.base.importing import Registry, import_object

if TYPE_CHECKING:
    from rich.console import Console

E = TypeVar("E", bound="ExtraResults")

EXTRAS: Final = Registry(group="scex_sumo.extras", kind="extra of a run")

REFERENCE: Final = "reference"
BASELINE: Final = "baseline"
"""Folders in that of a run, with results of their own."""


TEST: Final = "test"
NOTHING: Final = "nothing"
DISAGREE: Final = "disagree"
DOUBTFUL: Final = "doubtful"
VERDICTS: Final[Mapping[str, str]] = {
    TEST: "Test",
    NOTHING: "Nothing to test",
    DISAGREE: "The models disagree",
    DOUBTFUL: "Doubtful data",
}
"""Word of a verdict by its kind: a sentence begins with it."""


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Verdict on a moment of traffic.

    Attributes:
        kind: ``test``, ``nothing``, ``disagree`` or ``doubtful``.
        sentence: the answer in words.
        pair: track ids of the pair that decides: a vehicle hits or follows another one; None without a pair.
        what: kind of the conflict, e.g. ``rear-end``; ``how`` it comes to it, in words.
        place: of the conflict, one of `scex_sumo.roads.places.PLACES`; None off the lanes.
        time_s: of the conflict, after the moment.
        future: human-like future that shows it.
        probability: of a contact of the pair within 3 s, between people.
        least: the same with contacts a tenth as frequent as published; ``most``: ten times.
        doubt: why the data of the pair are doubtful; None if they are not.

    Example:
        >>> run.decision is None or run.decision.kind in ("test", "nothing", "disagree", "doubtful")
        True
    """

    kind: str
    sentence: str
    pair: tuple[int, int] | None = None
    what: str | None = None
    how: str | None = None
    place: str | None = None
    time_s: float | None = None
    future: int | None = None
    probability: float = 0.0
    least: float = 0.0
    most: float = 0.0
    doubt: str | None = None

    def __post_init__(self) -> None:
        assert self.least <= self.probability <= self.most, "P lies within its range"


@dataclass(frozen=True, kw_only=True)
class Row:
    """Row of the summary, for a set of futures: in the terminal, on the page and in JSON.

    Attributes:
        value: NaN or None where undefined; a text is printed as it is.
        unit: printed in brackets behind the name.

    Example:
        >>> scex.Row(name="fast vehicles", value=12.5, unit="%").value
        12.5
    """

    name: str
    value: float | str | None
    unit: str = ""


class ExtraResults:
    """What an extra reads from the folder of a finished `Run`; each method may be left out."""

    order: ClassVar[int] = 0
    """Extras with a lower number come first."""
    files: ClassVar[tuple[str, ...]] = ()
    """Names of the files and folders that it writes into a result folder; removed if it is off."""

    def __init_subclass__(cls) -> None:
        """Make errors of another package's methods one line with its line."""
        if cls.__module__.partition(".")[0] != __package__.partition(".")[0]:
            from scex_sumo.base.blame import own_call

            for name, value in list(vars(cls).items()):
                if callable(value) and not name.startswith("_") and hasattr(super(cls, cls), name):
                    setattr(cls, name, own_call(f"extra {cls.__name__}: {name}", value))

    methods: ClassVar[str] = ""
    """Import path of a class derived from it that has all methods, ``package.module:Class``; or none."""

    def loaded(self: E) -> E:
        """Return the extra with all methods."""
        loaded: E = import_object(self.methods)(**vars(self)) if self.methods else self
        return loaded

    def decision(self, run: Any) -> Decision | None:
        """Return what to test in the moment of the run; None if it does not tell."""
        return None

    def print_above(self, run: Any, console: Console, every: bool) -> None:
        """Print a table of its own above the summary; ``every``: with all metrics."""

    def lines(self, run: Any) -> Sequence[str]:
        """Return sentences of the summary."""
        return ()

    def answer(self, run: Any) -> Mapping[str, Any]:
        """Return keys of the answer of ``run --json``."""
        return {}

    def page(self, run: Any) -> Any:
        """Return its part of the page, a `scex_sumo.page.parts.PagePart`; None for none."""
        return None


@cache
def extra_types() -> Mapping[str, type[ExtraResults]]:
    """Return the registered extras by name, in their order; a broken one of another package is left out."""
    types: dict[str, type[ExtraResults]] = {}
    for name in EXTRAS.paths:
        try:
            types[name] = EXTRAS.load(name)
        except UsageError as error:
            print(f"warning: extra {name} is left out: {error}", file=sys.stderr)
    return dict(sorted(types.items(), key=lambda item: (item[1].order, item[0])))


def extras_results(folder: Path) -> tuple[ExtraResults, ...]:
    """Return the registered extras, to read what they wrote into a folder; those without are not loaded."""
    return tuple(
        _reader(name) if not kind.files or any((folder / file).exists() for file in kind.files) else kind()
        for name, kind in extra_types().items()
    )


@cache
def _reader(name: str) -> ExtraResults:
    return extra_types()[name]().loaded()
