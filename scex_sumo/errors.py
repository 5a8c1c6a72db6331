"""Errors that reach the user as one line: what, where, got, remedy."""

import re
from collections.abc import Iterable


class ScexError(Exception):
    """Any error that is the input's or the environment's fault; the command line prints it as one line."""


class InputError(ScexError):
    """A file, column or value that cannot be used."""


class MapError(InputError):
    """A map that cannot be read or converted."""


class TrackError(InputError):
    """Recorded tracks that cannot be read."""


class UsageError(ScexError):
    """An option or argument that makes no sense; exit status 2."""


class SimulationError(ScexError):
    """SUMO refused or lost something that it should have simulated."""


class ResultError(ScexError):
    """A result folder that cannot be written, read or resumed."""


class MissingExtraError(ScexError):
    """An optional dependency that the request needs and that is not installed."""


def reason_of(error: BaseException) -> str:
    """Reason that an error gives, in one line; with its kind where it is none of ours."""
    said = one_line(error)
    return said if isinstance(error, ScexError) else f"{type(error).__name__}: {said}"


def listed(names: Iterable[object]) -> str:
    """Names for a sentence: the first five, then how many more there are."""
    words = [str(name) for name in names]
    more = f" and {len(words) - 5} more" if len(words) > 5 else ""
    return ", ".join(words[:5]) + more


def one_line(message: object) -> str:
    """Message without line breaks; words longer than any name are cut short, paths are not."""
    return (
        " ".join(re.sub(r"([^/]{60})[^/]{200,}", r"\1…", word) for word in str(message).split())
        or "no message"
    )
