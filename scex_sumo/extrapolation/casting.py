"""Who may drive: the models of a run, and the vehicles that have a fixed one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from scex_sumo.arrays import IntArray
from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.guard.guarded import Guarded
from scex_sumo.behaviors.plug_in.fallback import Fallible
from scex_sumo.behaviors.plug_in.usable import source_file
from scex_sumo.behaviors.registry import ModelSpec, build, is_own, may_fail, parse_models
from scex_sumo.errors import UsageError
from scex_sumo.extrapolation.assignments import assignments, child_generator, listing, route_draws
from scex_sumo.extrapolation.rollout import history_at
from scex_sumo.scene import SeedScene, Who

Models = str | Sequence[str | ModelSpec]


@dataclass(frozen=True, kw_only=True)
class Casting:
    """The models of a run.

    Attributes:
        drawn: models to draw from.
        specs: all models, those of fixed vehicles included; assignments are indices into it.
        fixed: index of the model by track id, for vehicles that are not drawn.
        tested: model by track id for vehicles under test; None where one is driven as drawn.
    """

    drawn: tuple[ModelSpec, ...]
    specs: tuple[ModelSpec, ...]
    fixed: Mapping[int, int]
    tested: Mapping[int, str | None] = field(default_factory=dict)

    @property
    def weights(self) -> list[float]:
        """Relative frequency of the models to draw from."""
        return [spec.weight for spec in self.drawn]

    @property
    def names(self) -> tuple[str, ...]:
        """All models as on the command line, without weights."""
        return tuple(str(spec) for spec in self.specs)


def cast_models(
    models: Models, assign: Mapping[int, str], under_test: Mapping[int, str | None] | None = None
) -> Casting:
    """Read the models to draw from and those of single vehicles.

    Args:
        models: ``name[:parameter=value]...[@weight]``, comma-separated or a list.
        assign: model by track id.
        under_test: model by track id for vehicles under test; None leaves one to what is drawn.

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
    tested = dict(under_test or {})
    for track, text in [*assign.items(), *tested.items()]:
        if text is None:
            continue
        wanted = parse_models(text)
        if len(wanted) != 1:
            option = "--under-test" if track in tested else "--assign"
            raise UsageError(f"{option} {track}={text}: names {len(wanted)} models; give one")
        if str(wanted[0]) not in names:
            specs.append(wanted[0])
            names.append(str(wanted[0]))
        fixed[int(track)] = names.index(str(wanted[0]))
    return Casting(drawn=tuple(drawn), specs=tuple(specs), fixed=fixed, tested=tested)


def put_under_test(
    assign: Mapping[int, str], under_test: Mapping[int, str | None], *, own: bool
) -> tuple[dict[int, str], dict[int, str | None]]:
    """Who has a fixed model in any case, and who is under test.

    Args:
        assign: model by track id.
        under_test: model by track id; None for as drawn.
        own: a vehicle whose assigned model is one of the user's own is under test, too.

    Returns:
        Both mappings, without and with those vehicles.

    Raises:
        UsageError: a vehicle is in both.
    """
    twice = sorted(set(under_test) & set(assign))
    if twice:
        raise UsageError(f"--under-test {twice[0]}: --assign names this vehicle too; give one of them")
    more = {t: text for t, text in assign.items() if own and any(map(is_own, parse_models(text)))}
    return {t: text for t, text in assign.items() if t not in more}, {**under_test, **more}


def draw_assignments(
    casting: Casting, track_ids: IntArray, *, children: int | None, seed: int, design: str
) -> IntArray:
    """(C, V) model of every vehicle in every child, as `assignments`.

    A vehicle under test takes part in the draw and then gets its model, so that all others have the models
    that they have without it.

    Raises:
        UsageError: a track id that the seed scene has not, and what `assignments` raises.
    """
    ids = [int(track) for track in track_ids]
    unknown = sorted(set(casting.tested) - set(ids))
    if unknown:
        # A model of the user's own is under test by --assign as well.
        raise UsageError(
            f"--assign or --under-test: no vehicle {unknown[0]} in the seed scene; "
            f"its vehicles: {listing(ids)}"
        )
    always = {track: model for track, model in casting.fixed.items() if track not in casting.tested}
    drawn = assignments(casting.weights, track_ids, children=children, seed=seed, fixed=always, design=design)
    for track, model in casting.tested.items():
        if model is not None:
            drawn[:, ids.index(track)] = casting.fixed[track]
    return drawn


def drivers(casting: Casting) -> tuple[Behavior, ...]:
    """The models of a run, by index; those that may fail with the path-following driver to stand in.

    Raises:
        UsageError: a model cannot be made.
    """
    return tuple(
        _standing_in(build(spec), name) if may_fail(spec) else build(spec)
        for spec, name in zip(casting.specs, casting.names, strict=True)
    )


def _standing_in(model: Behavior, name: str) -> Behavior:
    """A model that cannot fail; the guard also slows down whoever stands in for it."""
    if isinstance(model, Guarded):
        return Guarded(Fallible(model.model, name), model.profile)
    return Fallible(model, name)


def weights_of(casting: Casting, models: Sequence[Behavior]) -> dict[str, str]:
    """SHA-256 of the weights of each learned model, by its name."""
    found = {}
    for name, model in zip(casting.names, models, strict=True):
        while isinstance(model, Guarded | Fallible):
            model = model.model
        sha256 = getattr(model, "weights_sha256", None)
        if isinstance(sha256, str):
            found[name] = sha256
    return found


def sources_of(casting: Casting, models: Sequence[Behavior]) -> dict[str, str]:
    """SHA-256 of the file that each of the user's own models comes from, by its name, where there is one."""
    found = {}
    for spec, name, model in zip(casting.specs, casting.names, models, strict=True):
        while isinstance(model, Guarded | Fallible):
            model = model.model
        file = source_file(model) if is_own(spec) else None
        if file is not None and file.is_file():
            found[name] = hashlib.sha256(file.read_bytes()).hexdigest()
    return found


def try_drivers(casting: Casting, models: Sequence[Behavior], scene: SeedScene, *, seed: int) -> None:
    """Let every model that may fail plan once for the vehicles of the seed scene that it may get.

    Raises:
        ScexError: one has no usable plan for any of them.
    """
    assert scene.road is not None
    children = np.zeros(1, dtype=np.int64)
    draw = route_draws(children, scene.vehicles, seed=seed)
    history = history_at(scene, scene.history.repeat(1), children, draw, step=0)
    for index, driver in enumerate(models):
        model = driver.model if isinstance(driver, Guarded) else driver
        if not isinstance(model, Fallible):
            continue
        tracks = scene.track_ids.tolist()
        mine = [casting.fixed.get(t, index if index < len(casting.drawn) else -1) == index for t in tracks]
        vehicle = np.flatnonzero(np.array(mine, dtype=np.bool_))
        who = Who(child=np.zeros_like(vehicle), vehicle=vehicle)
        model.try_on(history, scene.road, who, [child_generator(seed, 0)])


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
