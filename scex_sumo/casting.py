"""Who may drive: the models of a run, and the vehicles that have a fixed one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scex_sumo.behaviors.registry import ModelSpec, parse_models
from scex_sumo.errors import UsageError

Models = str | Sequence[str | ModelSpec]


@dataclass(frozen=True, kw_only=True)
class Casting:
    """The models of a run.

    Attributes:
        drawn: models to draw from.
        specs: all models, those of fixed vehicles included; assignments are indices into it.
        fixed: index of the model by track id, for vehicles that are not drawn.
    """

    drawn: tuple[ModelSpec, ...]
    specs: tuple[ModelSpec, ...]
    fixed: Mapping[int, int]

    @property
    def weights(self) -> list[float]:
        """Relative frequency of the models to draw from."""
        return [spec.weight for spec in self.drawn]

    @property
    def names(self) -> tuple[str, ...]:
        """All models as on the command line, without weights."""
        return tuple(str(spec) for spec in self.specs)


def cast_models(models: Models, assign: Mapping[int, str]) -> Casting:
    """Read the models to draw from and those of single vehicles.

    Args:
        models: ``name[:parameter=value]...[@weight]``, comma-separated or a list.
        assign: model by track id.

    Raises:
        UsageError: no model, or one that makes no sense.
    """
    drawn: list[ModelSpec] = []
    for entry in [models] if isinstance(models, str) else models:
        drawn += parse_models(entry) if isinstance(entry, str) else [entry]
    if not drawn:
        raise UsageError("--models: names no model")
    specs = list(drawn)
    names = [str(s) for s in specs]
    fixed = {}
    for track, text in assign.items():
        wanted = parse_models(text)
        if len(wanted) != 1:
            raise UsageError(f"--assign {track}={text}: names {len(wanted)} models; give one")
        if str(wanted[0]) not in names:
            specs.append(wanted[0])
            names.append(str(wanted[0]))
        fixed[int(track)] = names.index(str(wanted[0]))
    return Casting(drawn=tuple(drawn), specs=tuple(specs), fixed=fixed)


def number_of_children(children: int | str) -> int | None:
    """``--children`` as a number, None for ``all``.

    Raises:
        UsageError: neither a number nor ``all``.
    """
    if children == "all":
        return None
    try:
        return int(children)
    except ValueError:
        raise UsageError(f"--children: got {children!r}, needs a number or 'all'") from None
