"""Make a suite: rank what is not ranked yet, choose cases, write them with weights, exposure and page."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scex_sumo.base.arguments import checked
from scex_sumo.base.files import own_folder, remove, write_atomic
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.base.version import __version__
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.decision.typology import CONFLICTS
from scex_sumo.exporters.request import EXPORTERS
from scex_sumo.results.folder import OutputFolder
from scex_sumo.results.info import versions
from scex_sumo.studies.moments.folder import plain
from scex_sumo.studies.rank.rank import rank
from scex_sumo.suites.case import FORMATS, shown, write_case
from scex_sumo.suites.choice import Chosen, check_count, choose
from scex_sumo.suites.cut import Cutter, recordings_of
from scex_sumo.suites.drive import drive
from scex_sumo.suites.page import CaseCard, catalogue_card, write_catalogue_page
from scex_sumo.suites.population import RISK_WORDS, Population, is_ranking, read_population
from scex_sumo.suites.suite import CASES, FORMAT, MAPS, SUITE, Suite, open_suite

RANKING = "ranking"
FUTURES = 64
PAGE = "catalogue.html"
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
        "min_vehicles": min_vehicles,
    }
    with SuiteFolder(out, identity, overwrite=overwrite) as folder:
        if others:
            own: dict[str, Any] = {"every": every, "min_vehicles": min_vehicles, "workers": workers}
            own |= {"overwrite": overwrite, "progress": progress, "command": command}
            rank(others, out=out / RANKING, top=1, futures=1, **own)  # a suite needs no stress test
            rankings.append(out / RANKING)
        population = read_population(rankings)
        chosen = choose(population, count, seed=seed)
        cases, notes = [], list[str]()
        with progress_of(progress, "cases") as tick:
            for one in _cases(population, chosen, out, tuple(formats), seed, notes):
                cases.append(one)
                if tick is not None:
                    tick(len(cases), len(chosen))
        cases.sort(key=lambda one: str(one.about["name"]))
        info = _info(population, cases) | {"seed": seed, "futures": FUTURES, "notes": notes}
        info |= {"versions": versions(), "command": list(command) if command else None}
        info |= {"scex_sumo": __version__, "seconds": round(time.perf_counter() - started, 1)}
        names = ", ".join(sorted({str(one.about["site"]) for one in cases}))
        text = _LICENCE_TEXT.format(names=names, given=licence, version=__version__)
        write_atomic(out / LICENCE, text.encode())
        write_catalogue_page(out / PAGE, info, [one.card for one in cases])
        folder.finish(info, allow_nan=False)
    return open_suite(out)


def _cases(
    population: Population, chosen: Chosen, out: Path, formats: Sequence[str], seed: int, notes: list[str]
) -> Iterator[_WrittenCase]:
    """Write the cases, one recording after the other."""
    recordings, cut = recordings_of(population), None
    rows = [population.rows[k] for k in chosen.index.tolist()]
    for number in sorted(range(len(rows)), key=lambda number: (rows[number]["recording"], number)):
        row, index = rows[number], chosen.index[number]
        kind, chance = row["conflict"], float(chosen.chance[number])
        row = row | {
            "name": f"{number + 1:03d}-{plain(kind.replace(',', ''))}",
            "kind": kind,
            "risk": RISK_WORDS[population.risk[index]],
            "site": row["location"],
            "weight": row["share"] / chance,
            "chance": chance,
            "stratum": CONFLICTS.index(kind),
        }
        if cut is None or cut.name != row["recording"]:
            cut = Cutter(recordings, row["recording"])
        driven = drive(cut.scene(row), row["track_id"], None, FUTURES, seed=seed)
        about, missing = write_case(
            out / CASES / row["name"], driven, row, maps=out / MAPS, formats=formats, seed=seed
        )
        notes += missing
        told = driven.row_of(row["other_id"])
        yield _WrittenCase(about=about, card=catalogue_card(row, told["how"], shown(driven, told)))


def _info(population: Population, cases: Sequence[_WrittenCase]) -> dict[str, Any]:
    """Return the exposure of a population, and its cases."""
    picked = [(one.about["kind"], one.about["risk"]) for one in cases]
    exposure = population.exposure()
    for row in exposure:
        row["cases"] = [picked.count((row["kind"], word)) for word in RISK_WORDS]
    return {
        "format": FORMAT,
        "hours": population.hours,
        "moments": population.moments,
        "encounters": population.encounters,
        "candidates": len(population),
        "rare": population.rare,
        "doubtful": population.doubtful,
        "people": {"collisions_per_hour": sum(row["people_collide_per_hour"] for row in exposure)},
        "risks": RISK_WORDS,
        "exposure": exposure,
        "cases": [dict(one.about) for one in cases],
    }
