"""Extra of a run: work of the user's on its futures, with options of its own and rows of the summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from scex_sumo.base.blame import own_call
from scex_sumo.base.errors import OwnCodeError, UsageError
from scex_sumo.base.importing import Registry
from scex_sumo.base.options import Option, options_of

if TYPE_CHECKING:
    from scex_sumo.extrapolation.job import Job
    from scex_sumo.extrapolation.processes.workers import Workers
    from scex_sumo.results.parts import Part
    from scex_sumo.scene import States

EXTRAS: Final = Registry(group="scex_sumo.extras", kind="extra of a run")


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """A run whose drawn futures are finished, for its extras.

    Attributes:
        part: all futures, with their first step only.
        options: the `RunOptions`.

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
    options: Any

    @property
    def states(self) -> States:
        """States of all futures at all steps, (futures, steps, vehicles), read from the result folder."""
        from scex_sumo.results.parts import Parts

        return Parts(self.job.folder).read(0, len(self.part.futures)).states

    @property
    def is_reference(self) -> bool:
        """Whether these are the human-like futures beside a run."""
        return bool(self.options.is_reference)


@dataclass(frozen=True, kw_only=True)
class Extra:
    """Extra of a run; a frozen dataclass whose fields, made by `option`, are its options.

    A run takes it as ``--extra package.module:Class:option=value``, or by the name of its entry point.

    Example:
        >>> class Vehicles(scex.Extra):
        ...     def after(self, work):
        ...         return [scex.Row(name="vehicles", value=work.job.scene.vehicles)]
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> counted = scex.extrapolate(scene, futures=2, reference=None, report=False, extra=[Vehicles()])
        >>> counted.info["rows"][-1]["value"]
        14
    """

    def after(self, work: Work) -> Sequence[Row]:
        """Do its work when all tables are written, and return rows of the summary."""
        return ()


def work_of(extras: Sequence[Extra], work: Work) -> tuple[list[dict[str, Any]], list[str]]:
    """Let extras work; return their rows for ``run.json``, and notes on those that failed."""
    rows, failed = list[dict[str, Any]](), list[str]()
    for extra in extras:
        name = f"extra {type(extra).__name__}: after"
        try:
            own = own_call(name, extra.after)(work)
            wrong = [row for row in own if not isinstance(row, Row)] if isinstance(own, Sequence) else [own]
            if wrong:
                raise OwnCodeError(f"{name} returned {type(wrong[0]).__name__}, needs rows")
            rows += map(asdict, own)
        except OwnCodeError as error:  # the run's other results stay
            failed.append(f"warning: {error}; its rows are left out")
    return rows, failed


def extra_named(given: str | Extra) -> Extra:
    """Return an extra by its name or import path and options, ``package.module:Class[:option=value]...``.

    Raises:
        UsageError: there is no such extra, it has no such option, or its class raises.
    """
    if not isinstance(given, str):
        return given
    name, *rest = given.split(":")
    while rest and "=" not in rest[0]:
        name = f"{name}:{rest.pop(0)}"
    kind = EXTRAS.load(name)
    if not (isinstance(kind, type) and issubclass(kind, Extra)):
        raise UsageError(f"--extra {name}: is no class derived from scex_sumo.Extra")
    known, values = options_of(kind), {}
    for entry in rest:
        key, equals, text = entry.partition("=")
        if not equals or key not in known:
            raise UsageError(
                f"--extra {given}: {entry!r} is no option of it; it has {', '.join(known) or 'none'}"
            )
        values[key] = _value(known[key], getattr(kind, key, None), text, given)
    extra: Extra = own_call(f"extra {name}", kind, error=UsageError)(**values)
    return extra


def _value(option: Option, default: Any, text: str, given: str) -> Any:
    if option.read is not None:
        return option.read([text] if option.several else text)
    if isinstance(default, bool):
        return text.lower() in ("true", "1")
    try:
        return type(default)(text) if isinstance(default, int | float) else text
    except ValueError:
        raise UsageError(f"--extra {given}: {text!r} is no number") from None
