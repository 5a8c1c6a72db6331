"""``scex-sumo compare``: distances of seed scenes, their groups, and their differences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.commands.console import warn
from scex_sumo.commands.options import complete_results
from scex_sumo.commands.tables import write_table

if TYPE_CHECKING:
    from scex_sumo.results.run import Run
    from scex_sumo.studies.compare.compare import Comparison, Grouping


EXAMPLE = "out/k733 out/k729 out/merge -o out/compared"


def compare_command(
    folders: Annotated[
        list[Path],
        Argument(
            metavar="OUT...",
            help="Result folders, at least two.",
            show_default=False,
            autocompletion=complete_results,
        ),
    ],
    nearest: Annotated[
        Path | None, Option(metavar="OUT", help="List the other runs by their distance to this run.")
    ] = None,
    distance: Annotated[
        str, Option(metavar="w1|jsd", help="Distance of densities: Wasserstein, or Jensen-Shannon.")
    ] = "w1",
    groups: Annotated[
        int | None, Option(metavar="N", help="Number of groups; default: the clearest grouping.")
    ] = None,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="FOLDER", help="Folder for tables and a page.")
    ] = None,
) -> None:
    """Compare seed scenes by the densities of their metrics."""
    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.run_table import print_line
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run
    from scex_sumo.studies.compare.compare import KINDS, comparable, compare, group_runs
    from scex_sumo.studies.compare.page import comparison_lines

    if distance not in KINDS:
        raise UsageError(f"--distance: unknown distance {distance!r}; known: {', '.join(KINDS)}")
    wanted = _folders(folders, nearest)
    if len(wanted) < 2:
        raise UsageError(f"compare: needs at least two result folders, got {len(wanted)}")
    if out is not None and any((out / name).exists() for name in ("run.json", "incomplete.json")):
        raise UsageError(f"-o {out}: is the result folder of a run; give a folder of its own")
    # By name, so that the same folders in another order give the same bytes.
    labels, wanted = map(list, zip(*sorted(zip(short_names(wanted), wanted, strict=True)), strict=True))
    with as_written(*wanted):
        runs = [open_run(folder) for folder in wanted]
        warn([*comparable(runs, labels), *_copies(runs, labels)])
        comparison = compare(runs, labels, distance=distance)
    grouping = group_runs(comparison.total, labels, groups=groups)
    centre = None if nearest is None else [p.resolve() for p in wanted].index(nearest.resolve())
    console = output_console()
    for line in comparison_lines(runs, comparison, grouping, centre):
        print_line(line, console)
    if out is not None:
        _write(runs, comparison, grouping, out)


def _folders(folders: Sequence[Path], nearest: Path | None) -> list[Path]:
    seen: dict[Path, Path] = {}
    for folder in folders:
        known = seen.setdefault(folder.resolve(), folder)
        if known is not folder:
            raise UsageError(f"compare: {folder} is named twice (first as {known}); name every run once")
    if nearest is not None:
        seen.setdefault(nearest.resolve(), nearest)
    return list(seen.values())


def short_names(folders: Sequence[Path]) -> list[str]:
    """Return the last parts of paths, as many as make the names different."""
    parts = [folder.resolve().parts for folder in folders]
    for depth in range(1, max((len(p) for p in parts), default=1) + 1):
        names = ["/".join(p[-depth:]) for p in parts]
        if len(set(names)) == len(names):
            return names
    return [str(folder) for folder in folders]


def _copies(runs: Sequence[Run], labels: Sequence[str]) -> Iterable[str]:
    first: dict[str, str] = {}
    for label, run in zip(labels, runs, strict=True):
        known = first.setdefault(str(run.info.get("identity", label)), label)
        if known != label:
            yield f"{label} holds the same run as {known}"


def _write(runs: Sequence[Run], comparison: Comparison, grouping: Grouping, out: Path) -> None:
    from scex_sumo.studies.compare.compare import distances_table
    from scex_sumo.studies.compare.page import HTML, write_comparison

    table = distances_table(comparison).replace_schema_metadata({"distance": comparison.kind})
    for name in ("distances.parquet", "distances.csv"):
        write_table(table, out / name)
    try:
        page = write_comparison(runs, comparison, grouping, out / HTML)
    except OSError as error:
        raise ResultError(f"{out}: cannot write: {error.strerror or error}") from None
    print(f"result: {out}/distances.parquet, distances.csv")
    print(f"report: {page}")
