"""Errors that reach the user as one line: what, where, got, remedy."""

import difflib
import inspect
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

_PACKAGE = str(Path(__file__).parents[1])

last_words: list[Callable[[str], None]] = []
"""Tells the line of an error that cannot be raised, before the process ends; the last one counts.

Without one the process stays: it is the user's own, and its other threads may go on.
"""


class ScexError(Exception):
    """Any error that is the input's or the environment's fault; the command line prints it as one line.

    Example:
        >>> try:
        ...     scex.read_map("nowhere.osm")
        ... except scex.ScexError as error:
        ...     print(type(error).__name__)
        MapError
    """

    answer: Mapping[str, Any] | None = None
    """What a command prints with ``--json`` although it fails."""


class InputError(ScexError):
    """A file, column or value that cannot be used."""


class OwnCodeError(InputError):
    """An error in code of the user's, with its line."""


class MapError(InputError):
    """A map that cannot be read or converted."""


class TrackError(InputError):
    """Recorded tracks that cannot be read."""


class ScexWarning(UserWarning):
    """A note on the input or the result, as the command line prints it to standard error.

    Example:
        >>> import warnings
        >>> warnings.simplefilter("ignore", scex.ScexWarning)  # no notes
    """


class UsageError(ScexError):
    """An option or argument that makes no sense; exit status 2."""


class SimulationError(ScexError):
    """SUMO refused or lost something that it should simulate."""


class OutOfTimeError(SimulationError):
    """Users' code that did not return in time."""


class ResultError(ScexError):
    """A result folder that cannot be written, read or resumed."""


class MissingExtraError(ScexError):
    """An optional dependency that is needed and not installed."""


def reason_of(error: BaseException) -> str:
    """Return an error's message in one line, with its class unless it is one of ours."""
    message = one_line(error)
    return message if isinstance(error, ScexError) else f"{type(error).__name__}: {message}"


def listed(names: Iterable[object], most: int = 5) -> str:
    """List the first names, and how many more there are."""
    words = [str(name) for name in names]
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more


def nearest(name: str, names: Iterable[str]) -> str:
    """Return the three known names that are nearest to a misspelt one, nearest first."""
    words = {word.lower(): word for word in names}
    return ", ".join(words[w] for w in difflib.get_close_matches(name.lower(), words, n=3, cutoff=0.0))


def one_line(message: object) -> str:
    """Return a message without line breaks; very long words except paths are cut."""
    return (
        " ".join(re.sub(r"([^/]{60})[^/]{200,}", r"\1…", word) for word in str(message).split())
        or "no message"
    )


def warn_notes(notes: Iterable[str]) -> None:
    """Raise notes as warnings, in the user's line that called this package."""
    frame, level = inspect.currentframe(), 1
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    for note in notes:
        warnings.warn(one_line(note.removeprefix("warning: ")), ScexWarning, stacklevel=level)
