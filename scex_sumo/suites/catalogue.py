"""Make a suite: rank what is not ranked yet, choose cases, write them with weights, exposure and page."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import ScexError, UsageError, reason_of
from scex_sumo.base.files import own_folder, remove, write_atomic
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.base.version import __version__
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.exporters.request import EXPORTERS
from scex_sumo.results.folder import OutputFolder
from scex_sumo.results.info import versions
from scex_sumo.studies.moments.folder import plain
from scex_sumo.studies.rank.rank import rank
from scex_sumo.suites.case import FORMATS, write_case
from scex_sumo.suites.choice import Chosen, check_count, choose
from scex_sumo.suites.cut import cutter_of, recordings_of
from scex_sumo.suites.page import CaseCard, write_catalogue_page
from scex_sumo.suites.population import RISK_WORDS, Population, is_ranking, read_population
from scex_sumo.suites.suite import CASES, FORMAT, MAPS, SUITE, Suite, open_suite

RANKING = "ranking"
FUTURES = 64
PAGE = "catalogue.html"
_PAIRS_ALONE: Any = {"top": 1, "futures": 1}  # a suite needs no stress test
LICENCE = "LICENCE.md"
_LICENCE_TEXT = """# Where the cases come from

Each case holds a piece of a recording and a copy of its map: {names}.
What the publishers of these recordings allow holds for this suite, too: look it up before you pass it on.
{given}
The driver behaviour, weights and files around them were made by scex-sumo {version}.
"""


class SuiteFolder(OutputFolder):
    """Folder of a suite while it is made."""

    info, what = SUITE, "suite"
    another = "another suite, of other encounters or with other options"
    evidence = (CASES, MAPS)

    def _clear(self) -> None:
        for name in (CASES, MAPS):
            remove(self.path / name)

    def _prepare(self) -> None:
        """Nothing is kept of an interrupted suite but its ranking."""
        for name in (CASES, MAPS):
            own_folder(self.path / name)


@dataclass(frozen=True, kw_only=True, eq=False)
class _WrittenCase:
    about: Mapping[str, Any]
    card: CaseCard


@checked
def catalogue(
    roots: str | Path | Sequence[str | Path],
    *,
    out: str | Path,
    count: int = 50,
    seed: int = 0,
    every: float = 1.0,
    min_vehicles: int = 2,
    formats: Sequence[str] = FORMATS,
    licence: str = "",
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
        every: s between two moments; ``min_vehicles`` of a moment as of `rank`.
        formats: export formats of the cases.
        licence: a sentence about the recordings.
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
    rankings = [place for place in places if is_ranking(place)]
    others = [place for place in places if place not in rankings]
    _check(count, formats, others)
    identity = _identity(places, count, seed, formats, every, min_vehicles)
    with SuiteFolder(out, identity, overwrite=overwrite) as folder:
        if others:
            own: dict[str, Any] = {"every": every, "min_vehicles": min_vehicles, "workers": workers}
            own |= {"overwrite": overwrite, "progress": progress, "command": command}
            rank(others, out=out / RANKING, **own, **_PAIRS_ALONE)
            rankings.append(out / RANKING)
        population = read_population(rankings)
        recordings, chosen = recordings_of(population), choose(population, count, seed=seed)
        draws = {"seed": seed, "futures": FUTURES}
        cases, notes = [], list[str]()
        with progress_of(progress, "cases") as tick:
            for one in _cases(population, chosen, recordings, out, tuple(formats), draws, notes):
                cases.append(one)
                if tick is not None:
                    tick(len(cases), len(chosen))
        if not cases:
            raise UsageError(f"{out}: no case can be cut from the recordings; {notes[0]}")
        cases.sort(key=lambda one: str(one.about["name"]))
        info = _info(population, chosen, cases, draws) | {"notes": notes, "versions": versions()}
        info |= {"command": list(command) if command else None, "scex_sumo": __version__}
        info |= {"seconds": round(time.perf_counter() - started, 1)}
        names = ", ".join(sorted({str(one.about["site"]) for one in cases}))
        text = _LICENCE_TEXT.format(names=names, given=licence, version=__version__)
        write_atomic(out / LICENCE, text.encode())
        write_catalogue_page(out / PAGE, info, [one.card for one in cases])
        folder.finish(info, allow_nan=False)
    return open_suite(out)


def _check(count: int, formats: Sequence[str], recordings: Sequence[Path]) -> None:
    """Raise a `UsageError` or `TrackError` for arguments that make no sense, before anything is written."""
    check_count(count)
    for name in formats:
        EXPORTERS.load(name)
    if recordings:
        find_recordings(recordings)


def _identity(
    places: Sequence[Path], count: int, seed: int, formats: Sequence[str], every: float, min_vehicles: int
) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": __version__,
        "roots": [str(place.absolute()) for place in places],
        "count": count,
        "seed": seed,
        "formats": list(formats),
        "every_s": every,
        "min_vehicles": min_vehicles,
    }


def _cases(
    population: Population,
    chosen: Chosen,
    recordings: Mapping[str, Recording],
    out: Path,
    formats: Sequence[str],
    draws: Mapping[str, Any],
    notes: list[str],
) -> Iterator[_WrittenCase]:
    """Write the cases, one recording after the other, without those that cannot be cut."""
    wanted: dict[str, list[int]] = {}
    for number, index in enumerate(chosen.index.tolist()):
        wanted.setdefault(population.rows[index]["recording"], []).append(number)
    for name in sorted(wanted):
        cut = cutter_of(recordings, name)
        for number in wanted[name]:
            row = _row(population, chosen, number)
            try:
                scene, situation = cut.situation(row)
            except ScexError as error:
                stands_for = f"which stands for {row['weight']:.0f} candidates"
                notes.append(f"{row['seed']}: {row['name']}, {stands_for}, is left out: {reason_of(error)}")
                continue
            about, stage, missing = write_case(
                out / CASES / row["name"],
                scene,
                situation,
                row,
                maps=out / MAPS,
                formats=formats,
                draws=draws,
            )
            notes += missing
            card = CaseCard(row=row, stage=stage, words=situation.words(situation.worst()))
            yield _WrittenCase(about=about, card=card)


def _row(population: Population, chosen: Chosen, number: int) -> dict[str, Any]:
    """Return the candidate of a case with the name of the case, its kind, place, weight and stratum."""
    index = int(chosen.index[number])
    row = population.rows[index]
    return {
        **row,
        "kind": row["conflict"],
        "place": row["kind"],
        "name": f"{number + 1:03d}-{plain(row['conflict'].replace(',', ''))}",
        "weight": float(chosen.weight[number]),
        "stratum": int(chosen.stratum[number]),
        "risk": int(population.risk[index]),
    }


def _info(
    population: Population, chosen: Chosen, cases: Sequence[_WrittenCase], draws: Mapping[str, Any]
) -> dict[str, Any]:
    chance, severity = population.column("probability"), population.column("severity")
    kinds, risk = np.array(population.kinds), population.risk
    picked = [{"kind": str(one.about["kind"]), "risk": str(one.about["risk"])} for one in cases]
    coverage = [
        {
            "kind": row["kind"],
            "before": [int(((kinds == row["kind"]) & (risk == k)).sum()) for k in range(len(RISK_WORDS))],
            "after": [picked.count({"kind": row["kind"], "risk": word}) for word in RISK_WORDS],
        }
        for row in population.exposure()
    ]
    return {
        "format": FORMAT,
        **draws,
        "hours": population.hours,
        "moments": population.seeds,
        "encounters": population.encounters,
        "candidates": len(population),
        "doubtful": population.doubtful,
        "exposure": population.exposure(),
        "risks": RISK_WORDS,
        "coverage": coverage,
        "people": {
            "collisions_per_hour": float(chance.sum() / population.hours),
            "severe_per_hour": float(severity.sum() / population.hours),
        },
        "strata": [
            {"words": words, "candidates": int(size)}
            for words, size in zip(chosen.strata, chosen.sizes, strict=True)
        ],
        "unseen": sorted({one["kind"] for one in population.exposure()} - {p["kind"] for p in picked}),
        "cases": [dict(one.about) for one in cases],
    }
