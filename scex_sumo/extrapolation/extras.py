"""Extra of a run: what it does beside its drawn futures, with options of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from scex_sumo.base.errors import OwnCodeError
from scex_sumo.base.progress import Progress
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.extras import ExtraResults, Row, extra_types

if TYPE_CHECKING:
    from scex_sumo.extrapolation.job import Job
    from scex_sumo.extrapolation.models import ModelSet
    from scex_sumo.results.parts import Part
    from scex_sumo.results.run import Run
    from scex_sumo.scene import States


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """A run whose drawn futures are finished, for its extras.

    Attributes:
        part: all futures, with their first step only.
        begun: what `Extra.begin` returned.
        progress: counts the steps of a further run of this size, see `Extra.repeats`.

    Example:
        >>> class Standing(scex.Extra):
        ...     def after(self, work):
        ...         return [scex.Row(name="standing", value=int((work.states.speed[:, -1] < 0.1).sum()))]
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> scex.extrapolate(scene, futures=1, report=False, extra=[Standing()]).info["rows"][-1]["name"]
        'standing'
    """

    job: Job
    part: Part
    workers: Workers
    options: RunOptions
    extras: Sequence[Extra] = ()
    begun: Future[Any] | None = None
    progress: Progress | None = None

    @property
    def states(self) -> States:
        """States of all futures at all steps, (futures, steps, vehicles), read from the result folder."""
        from scex_sumo.results.parts import Parts

        return Parts(self.job.folder).states()

    @property
    def is_reference(self) -> bool:
        """Whether these are the human-like futures beside a run."""
        return self.options.is_reference

    def bar_of_repeat(self, label: str) -> AbstractContextManager[Progress | None]:
        """Open the part of the run's progress bar for a further run."""
        return nullcontext(self.progress)


@dataclass(frozen=True, kw_only=True)
class Extra(ExtraResults):
    """Extra of a run; a frozen dataclass whose fields, made by `option`, are its options.

    Each method may be left out. Registered by an entry point in ``scex_sumo.extras``, its options belong to
    ``scex-sumo run`` and `extrapolate`; else it is given as ``--extra package.module:Class:option=value``.

    Example:
        >>> class Vehicles(scex.Extra):
        ...     def after(self, work):
        ...         return [scex.Row(name="vehicles", value=work.job.scene.vehicles)]
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> counted = scex.extrapolate(scene, futures=2, reference=None, report=False, extra=[Vehicles()])
        >>> counted.info["rows"][-1]["value"]
        14
    """

    nested: ClassVar[bool] = True
    """Whether it works for a run inside of another run's folder, too."""

    def is_on(self, settings: RunSettings) -> bool:
        """Return whether it works in a run with these settings; the other methods are not called if not."""
        return True

    def check(self, settings: RunSettings, models: ModelSet) -> None:
        """Raise a `UsageError` for options that make no sense, before a future is simulated."""

    def repeats(self, settings: RunSettings) -> int:
        """Return how many further runs of the same size it makes in `after`."""
        return 0

    def begin(self, job: Job, workers: Workers, options: RunOptions) -> Future[Any] | None:
        """Start in a worker what needs no futures of the run, see `Workers.submit`; None without a worker."""
        return None

    def after(self, work: Work) -> Sequence[Row]:
        """Do its work when all tables are written, and return rows of the summary."""
        return ()

    def finish(self, run: Run, work: Work) -> Mapping[str, Path]:
        """Do what needs the finished result; return files for the user by what they are."""
        return {}


def run_options() -> tuple[type, ...]:
    """Return the dataclasses whose fields are the options of a run: settings, other options, extras."""
    return RunSettings, RunOptions, *extra_types().values()


def working(extras: Sequence[Extra], settings: RunSettings) -> list[Extra]:
    """Return the extras that are on, with all their methods."""
    return [extra.loaded() for extra in extras if extra.is_on(settings)]


def rows_of(extra: Extra, work: Work) -> list[Row]:
    """Return the rows of an extra.

    Raises:
        OwnCodeError: what its ``after`` returns are no rows.
    """
    rows = extra.after(work)
    wrong = [row for row in rows if not isinstance(row, Row)] if isinstance(rows, Sequence) else [rows]
    if wrong:
        raise OwnCodeError(
            f"extra {type(extra).__name__}: after returned {type(wrong[0]).__name__}, needs rows"
        )
    return list(rows)


def extras_of(given: Sequence[Mapping[str, Any]]) -> list[Extra]:
    """Return the registered extras, with the given options of each in the order of `run_options`."""
    kinds = cast("Sequence[type[Extra]]", run_options()[2:])
    return [kind(**values) for kind, values in zip(kinds, given, strict=True)]
