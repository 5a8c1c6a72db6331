"""Errors that reach the user as one line: what, where, got, remedy."""


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
