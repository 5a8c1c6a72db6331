"""Make a suite: rank what is not ranked yet, choose cases, write them with weights, exposure and page."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import write_atomic
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.base.version import __version__
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.converters.registries import Recording
from scex_sumo.decision.typology import CONFLICTS
from scex_sumo.evaluation.recordings import LoadedRecording, load_recording, seed_at
from scex_sumo.exporters.request import EXPORTERS
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.folder import OutputFolder
from scex_sumo.results.info import versions
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import plain
from scex_sumo.studies.moments.run import net_of, pack_road
from scex_sumo.studies.rank.rank import rank
from scex_sumo.suites.case import FORMATS, shown, write_case
from scex_sumo.suites.drive import drive
from scex_sumo.suites.page import CaseCard, catalogue_card, write_catalogue_page
from scex_sumo.suites.population import Population, read_population
from scex_sumo.suites.suite import CASES, FORMAT, MAPS, SUITE, Suite, open_suite

RANKING = "ranking"
FUTURES = 64
PAGE = "catalogue.html"
LICENCE = "LICENCE.md"
_LICENCE_TEXT = """# Where the cases come from

Each case holds a piece of a recording and a copy of its map: {names}.
What the publishers of these recordings allow holds for this suite, too: look it up before you pass it on.

The driver behaviour, weights and files around them were made by scex-sumo {version}.
"""


class SuiteFolder(OutputFolder):
    """Folder of a suite while it is made; of an interrupted one nothing is kept but its ranking."""

    info, what = SUITE, "suite"
    another = "another suite, of other encounters or with other options"
    evidence = folders = (CASES, MAPS)


WrittenCase: TypeAlias = tuple[Mapping[str, Any], CaseCard]
"""Entry of a case in ``suite.json``, and its card."""


@checked
def catalogue(
    roots: str | Path | Sequence[str | Path],
    *,
    out: str | Path,
    count: int = 50,
    seed: int = 0,
    every: float = 1.0,
    formats: Sequence[str] = FORMATS,
    workers: int = 1,
    overwrite: bool = False,
    command: Sequence[str] | None = None,
    progress: Progress | bool | None = None,
) -> Suite:
    """Make a weighted test suite of the encounters of recordings.

    Args:
        roots: folders of recordings, single files, or finished rankings.
        out: folder of the suite; the ranking that it needs is made in its folder ``ranking``.
        count: of cases.
        seed: of the choice, and of the draws of the cases.
        every: s between two moments.
        formats: export formats of the cases.
        workers: processes that rank.
        overwrite: replace another suite in ``out``.

    Raises:
        UsageError: an argument makes no sense, or there is no encounter without doubt.
        ResultError: the folder cannot be written or holds something else.

    Example:
        >>> suite = scex.catalogue(scex.example_path("roundabout"), out="suite", count=2, every=9, formats=())
        >>> len(suite.cases)
        2
    """
    started, out = time.perf_counter(), Path(out)
    places = [Path(root) for root in ([roots] if isinstance(roots, str | Path) else roots)]
    rankings = [place for place in places if (place / "rank.json").is_file()]
    others = [place for place in places if place not in rankings]
    check_count(count)
    for name in formats:
        EXPORTERS.load(name)
    if others:
        find_recordings(others)  # raises before anything is written
    identity = {
        "format": FORMAT,
        "version": __version__,
        "roots": [str(place.absolute()) for place in places],
        "count": count,
        "seed": seed,
        "formats": list(formats),
        "every_s": every,
    }
    with SuiteFolder(out, identity, overwrite=overwrite) as folder:
        if others:
            options: dict[str, Any] = {"every": every, "workers": workers}
            options |= {"overwrite": overwrite, "progress": progress, "command": command}
            rank(others, out=out / RANKING, top=1, futures=1, **options)  # a suite needs no stress test
            rankings.append(out / RANKING)
        population = read_population(rankings)
        chosen = choose(population, count, seed=seed)
        cases, notes = [], list[str]()
        with progress_of(progress, "cases") as tick:
            for case in _cases(population, chosen, out, tuple(formats), seed, notes):
                cases.append(case)
                if tick is not None:
                    tick(len(cases), len(chosen[0]))
        cases.sort(key=lambda case: str(case[0]["name"]))
        info = _info(population, cases) | {"seed": seed, "futures": FUTURES, "notes": notes}
        info |= {"versions": versions(), "command": list(command) if command else None}
        info |= {"scex_sumo": __version__, "seconds": round(time.perf_counter() - started, 1)}
        names = ", ".join(sorted({str(about["site"]) for about, _ in cases}))
        text = _LICENCE_TEXT.format(names=names, version=__version__)
        write_atomic(out / LICENCE, text.encode())
        write_catalogue_page(out / PAGE, info, [card for _, card in cases])
        folder.finish(info, allow_nan=False)
    return open_suite(out)


def _cases(
    population: Population, chosen: Chosen, out: Path, formats: Sequence[str], seed: int, notes: list[str]
) -> Iterator[WrittenCase]:
    """Write the cases, one recording after the other."""
    recordings = {recording.name: recording for recording in find_recordings(list(population.roots))}
    index, chances_of = chosen
    drawn = zip((population.rows[k] for k in index.tolist()), chances_of.tolist(), strict=True)
    by_recording = sorted(enumerate(drawn, 1), key=lambda numbered: numbered[1][0]["recording"])
    for number, (candidate, chance) in by_recording:
        kind = candidate["conflict"]
        candidate = candidate | {
            "name": f"{number:03d}-{plain(kind.replace(',', ''))}",
            "kind": kind,
            "site": candidate["location"],
            "weight": candidate["share"] / chance,
            "chance": chance,
            "stratum": CONFLICTS.index(kind),
        }
        driven = drive(seed_scene(recordings, candidate), candidate["track_id"], None, FUTURES, seed=seed)
        about, missing = write_case(
            out / CASES / candidate["name"], driven, candidate, maps=out / MAPS, formats=formats, seed=seed
        )
        notes += missing
        pair = driven.row_of(candidate["other_id"])
        yield about, catalogue_card(candidate, pair["how"], shown(driven, pair))


def _info(population: Population, cases: Sequence[WrittenCase]) -> dict[str, Any]:
    """Return the exposure of a population, and its cases."""
    picked = [about["kind"] for about, _ in cases]
    exposure = [of_kind | {"cases": picked.count(of_kind["kind"])} for of_kind in population.exposure()]
    return {
        "format": FORMAT,
        "hours": population.hours,
        "moments": population.moments,
        "encounters": population.encounters,
        "candidates": len(population),
        "rare": population.rare,
        "doubtful": population.doubtful,
        "people": {"collisions_per_hour": sum(of_kind["people_collide_per_hour"] for of_kind in exposure)},
        "exposure": exposure,
        "cases": [dict(about) for about, _ in cases],
    }


def seed_scene(recordings: Mapping[str, Recording], candidate: Mapping[str, Any]) -> SeedScene:
    """Return the seed scene of a candidate with its rules, without the road's own net.

    Raises:
        UsageError: its recording is gone.
    """
    if (name := candidate["recording"]) not in recordings:
        raise UsageError(f"{name}: a recording of the ranking that is not found any more; rank again")
    loaded, net, bare = _loaded(recordings[name])
    scene = seed_at(loaded, candidate["time_s"], case=candidate["case"] or None)
    return replace(ruled(scene, net, RunSettings())[0], road=bare)


@lru_cache(maxsize=1)
def _loaded(recording: Recording) -> tuple[LoadedRecording, SumoNet, Road]:
    loaded = load_recording(recording)
    return loaded, net_of(pack_road(loaded.road)), replace(loaded.road, net=None)


LEAST: Final = 2
"""Least number of cases: one has no variance."""
EVEN: Final = 0.7
"""Part of the draw by number of encounters; the other part is by people's P."""
_HALVINGS = 100
_ROUNDING = 1e-9


Chosen: TypeAlias = tuple[IntArray, FloatArray]
"""Indices (n,) of candidates, kind by kind, the largest P of people first; their chances of being drawn."""


def check_count(count: int) -> None:
    """Raise a `UsageError` for a number of cases of which no variance is known."""
    if count < LEAST:
        raise UsageError(f"--count: got {count}, needs at least {LEAST}")


def choose(population: Population, count: int, *, seed: int = 0) -> Chosen:
    """Draw candidates, at least one of each kind if ``count`` suffices for that; all if there are no more.

    Systematic sampling: the chances of all candidates in a row, ordered by kind and P of people, are cut at
    equal steps. So each kind has its expected number of cases or the next one, and cases of high and low P.
    """
    check_count(count)
    chance = chances(population, count)
    order = np.lexsort((-population.column("probability"), population.kind))
    steps = np.concatenate([[0.0], np.cumsum(chance[order])]) + np.random.default_rng(seed).random()
    index = order[np.diff(np.floor(steps + _ROUNDING)) > 0]
    return index, chance[index]


def chances(population: Population, count: int) -> FloatArray:
    """Return the probability (N,) with which each candidate becomes one of ``count`` cases."""
    share = population.column("share")
    contacts = share * population.column("probability")
    size = EVEN * share / share.sum() + (1 - EVEN) * contacts / contacts.sum()
    _, kind = np.unique(population.kind, return_inverse=True)
    held, sizes = np.bincount(kind), np.bincount(kind, size)
    cases = between(sizes, min(1.0, count / len(held)), held, min(count, len(size)))
    chance = np.empty(len(size))
    for number, expected in enumerate(cases):
        chance[kind == number] = between(size[kind == number], 0.0, 1.0, expected)
    return chance


def between(shares: ArrayLike, least: ArrayLike, most: ArrayLike, total: float) -> FloatArray:
    """Return values (n,) in proportion to positive shares, within bounds, that sum to a total."""
    shares = np.asarray(shares, dtype=np.float64)
    low, high = 0.0, total / float(shares.min())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if np.clip(middle * shares, least, most).sum() < total else (low, middle)
    return np.asarray(np.clip(high * shares, least, most))
