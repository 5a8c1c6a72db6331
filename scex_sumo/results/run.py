"""Finished run, read from its result folder."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Iterator, Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import FloatArray, numbers_in
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.metrics.registry import COLLISION, Metric, column_named, described_metrics, metric_of
from scex_sumo.results.decision import Decision, read_decision
from scex_sumo.results.design import half_widths, intervals_of, is_critical, metric_density
from scex_sumo.results.folder import HORIZONS, horizons_of
from scex_sumo.results.info import BASELINE, PAGE, REFERENCE, read_info
from scex_sumo.results.road import load_road
from scex_sumo.results.tables.encounters import Encounter
from scex_sumo.results.tables.reading import read_assignments, read_metrics, read_table
from scex_sumo.road import Road
from scex_sumo.scene import LOGGED_HISTORY, SeedScene, States, named
from scex_sumo.statistics.density import Density, Interval
from scex_sumo.statistics.intervals import DesignIntervals

if TYPE_CHECKING:
    from scex_sumo.base.arrow import ArrowTable
    from scex_sumo.converters.net.sumo_net import SumoNet
    from scex_sumo.results.tables.states import StateBlocks

TABLES: Final = ("metrics", "assignments", "tracks", "worst", "collisions", "encounters")
PAIR_OUTCOMES: Final = "pair_outcomes.parquet"
UNDER_TEST: Final = "under_test.parquet"


class Run:
    """Result of a run: tables and statistics, read when they are used.

    Attributes:
        info: contents of ``run.json``.
        own_metrics: metrics by name that ``run.json`` describes; they may be registered nowhere.
        written: files for the user by what they are, e.g. ``report``.

    Example:
        >>> run.futures, run.collision.value
        (4, 0.0)
        >>> run.most_critical("ttc")  # number of the future
        0
    """

    def __init__(self, folder: Path, temporary: tempfile.TemporaryDirectory[str] | None = None) -> None:
        self.folder = folder
        self._temporary = temporary  # lives as long as the run
        self.written: dict[str, Path] = {}
        self.info = read_info(folder)
        self.own_metrics = described_metrics(self.info.get("metrics", ()))

    def __repr__(self) -> str:
        name, decision = self.info["seed_scene"]["name"], self.decision
        said = self.collision.percent + ("" if decision is None else f". {decision.sentence}")
        return f"Run({str(self.folder)!r}: {self.futures} futures of {name}, a collision in {said})"

    def _repr_html_(self) -> str:
        """Return the page in a frame, whose sandbox keeps its script from the notebook."""
        page = self.folder / PAGE
        if not page.is_file():
            return f"<p>{escape(repr(self))}</p>"
        content = escape(page.read_text(encoding="utf-8"))
        return f'<iframe srcdoc="{content}" sandbox="allow-scripts" width="100%" height="900"></iframe>'

    def to_pandas(self, table: str = "metrics") -> Any:
        """Return one of `TABLES` as a pandas data frame."""
        if table not in TABLES:
            raise UsageError(f"unknown table {table!r}; known: {', '.join(TABLES)}")
        if importlib.util.find_spec("pandas") is None:
            raise UsageError("to_pandas needs pandas: pip install '.[notebook]' in the clone")
        return getattr(self, table).to_pandas()

    @cached_property
    def metrics(self) -> ArrowTable:
        """One row per future: ``future``, the metric columns, null where undefined, and ``collision``."""
        return read_metrics(
            self.folder / "metrics.parquet", rows=self.info.get("futures"), own=self.own_metrics
        )

    @cached_property
    def recorded(self) -> ArrowTable | None:
        """The metric columns of the recorded future, one row; None without one."""
        there = (self.folder / "recorded.parquet").exists()
        return self.table("recorded.parquet", columns=self.columns, rows=1) if there else None

    @cached_property
    def assignments(self) -> ArrowTable:
        """``future``, ``track_id``, ``model``: the model of each vehicle."""
        rows = self.futures * int(self.info["seed_scene"]["vehicles"])
        return read_assignments(self.folder / "assignments.parquet", rows=rows)

    @cached_property
    def tracks(self) -> ArrowTable:
        """States of all futures in INTERACTION columns; ``case_id`` is the future."""
        from scex_sumo.results.tables.states import read_states

        vehicles, frames = int(self.info["seed_scene"]["vehicles"]), LOGGED_HISTORY + int(self.info["steps"])
        return read_states(self.folder / "tracks.parquet", rows=self.futures * vehicles * frames)

    @cached_property
    def worst(self) -> ArrowTable:
        """Origin of each extremum: future, metric, time, the two tracks, value."""
        return self.table("worst.parquet", columns=("future", "metric", "timestamp_ms", "track_id", "value"))

    @cached_property
    def collisions(self) -> ArrowTable:
        """Collisions, one row per future and pair of vehicles: time, place, severity."""
        return self.table("collisions.parquet")

    @cached_property
    def encounters(self) -> ArrowTable:
        """Encounters, one row per pair of vehicles that meet in some future; the most critical pair first."""
        return self.table("encounters.parquet")

    @cached_property
    def pair_outcomes(self) -> ArrowTable:
        """Least TTC on the path, largest DRAC, least PET by ``future``, ``track_a`` and ``track_b``."""
        return self.table(PAIR_OUTCOMES, columns=("future", "track_a", "track_b", "min_ttc_path"))

    @cached_property
    def intervals(self) -> DesignIntervals:
        """Intervals of the run's design."""
        there = (self.folder / "assignments.parquet").is_file()
        return intervals_of(self.info, self.assignments if there else None, self.futures)

    @cached_property
    def collision(self) -> Interval:
        """Share of the futures in which two vehicles collide, with its 95 % interval."""
        return self.intervals.share(np.asarray(self.metrics[COLLISION]))

    def p_collision_by(self, seconds: float) -> Interval:
        """Return the share of futures with a collision by a time after the seed moment, with its interval."""
        hits = self.collisions
        early = np.asarray(hits["future"])[np.asarray(hits["time_s"]) <= seconds]
        return self.intervals.share(np.isin(np.arange(self.futures), early))

    @cached_property
    def decision(self) -> Decision | None:
        """Verdict on this moment; None without human-like futures."""
        return read_decision(self.folder)

    def encounter(self, one: int, other: int) -> Encounter:
        """Return the encounter of two vehicles.

        Raises:
            UsageError: these two meet in no future.
        """
        for row in self.encounters.to_pylist():
            if {row["track_id"], row["other_id"]} == {one, other}:
                return Encounter(row=row, run=self)
        raise UsageError(f"{one}, {other}: these two vehicles meet in no future of the run")

    @cached_property
    def baseline(self) -> Run | None:
        """The same futures without the models under test; None if it was not run."""
        return self._part(BASELINE)

    @cached_property
    def reference(self) -> Run | None:
        """The reference with human-like drivers; None if it was not run."""
        return self._part(REFERENCE)

    def _part(self, name: str) -> Run | None:
        folder = self.folder / name
        return Run(folder, self._temporary) if (folder / "run.json").is_file() else None

    @cached_property
    def scene(self) -> SeedScene:
        """The seed scene in ``seed.csv``, without its road."""
        from scex_sumo.results.tables.states import read_scene

        return read_scene(self.folder, self.info["seed_scene"])

    @cached_property
    def road(self) -> Road:
        """The road, as the map was read."""
        return load_road(self.folder)

    @cached_property
    def net(self) -> SumoNet:
        """The SUMO net that the run used."""
        from scex_sumo.converters.net.reading import open_net

        return open_net(self.folder / "sumo" / f"{self.info['net']}.net.xml")

    def name_of(self, track: int) -> int | str:
        """Return SUMO's name of a vehicle of a simulation, else its track id."""
        return named(self.info["seed_scene"].get("source") or {}, track)

    def two_tracks(self, text: str, option: str = "--encounter") -> tuple[int, int]:
        """Return ``A,B`` of an option, SUMO's names or track ids, as track ids; else raise a `UsageError`."""
        known = {str(self.name_of(track)): int(track) for track in self.info["seed_scene"]["track_ids"]}
        words = [word.strip() for word in text.split(",")]
        if len(words) != 2 or not all(w in known or w.removeprefix("-").isdecimal() for w in words):
            vehicles = ", ".join([*known][:20])
            raise UsageError(f"{option} {text}: needs two vehicles, e.g. {option} 11,7; known: {vehicles}")
        first, other = (known[word] if word in known else int(word) for word in words)
        return first, other

    def states(self, future: int) -> States:
        """Return the states (V, T) of a future; frames 1 to 10 are the history, 10 is the seed scene.

        NaN after a vehicle has arrived.
        """
        if not 0 <= future < self.futures:
            raise UsageError(f"no future {future} in {self.folder}; it has 0 to {self.futures - 1}")
        return self._blocks.future(future)

    def state_blocks(self) -> Iterator[States]:
        """Yield the states (C, V, T) of all futures in order, some at a time."""
        return map(self._blocks.read, range(len(self._blocks.ends)))

    @cached_property
    def _blocks(self) -> StateBlocks:
        from scex_sumo.results.tables.states import StateBlocks

        vehicles, frames = len(self.info["seed_scene"]["track_ids"]), LOGGED_HISTORY + int(self.info["steps"])
        file = self.folder / "tracks.parquet"
        return StateBlocks(file, futures=self.futures, vehicles=vehicles, frames=frames)

    def models_of(self, future: int) -> list[str]:
        """Return the model (V,) of each vehicle of a future."""
        if future not in range(self.futures):
            raise UsageError(f"no future {future!r}; there are 0 to {self.futures - 1}")
        vehicles = len(self.info["seed_scene"]["track_ids"])
        return [str(m) for m in self.assignments["model"].slice(future * vehicles, vehicles).to_pylist()]

    @property
    def columns(self) -> list[str]:
        """The metric columns."""
        return [name for name in self.metrics.column_names if name not in ("future", COLLISION)]

    @property
    def futures(self) -> int:
        """Number of futures."""
        return int(self.metrics.num_rows)

    @property
    def thresholds(self) -> dict[str, float]:
        """Threshold of each metric that has one."""
        return dict(self.info["thresholds"])

    def column(self, text: str) -> str:
        """Return the metric column of a printed name; raise a `UsageError` if there is none."""
        if text.strip().lower() == COLLISION:
            return COLLISION
        return column_named(text, self.columns)

    def metric(self, column: str) -> Metric:
        """Return the metric of a column."""
        return metric_of(column, self.own_metrics)

    def values(self, column: str, *, until_s: float | None = None) -> FloatArray:
        """Return the values (C,) of a metric, NaN where undefined; 0 and 1 of ``collision``.

        Args:
            until_s: of the first seconds alone, 1, 2, 3, 5 or 8, in a run of more than 3 s.
        """
        return numbers_in(self._metrics_until(until_s)[self.column(column)])

    def _metrics_until(self, until_s: float | None) -> ArrowTable:
        """Return the metric columns of whole futures, or of their first seconds."""
        if until_s is None:
            return self.metrics
        if until_s not in (known := self.horizons_s):
            there = f"give one of {', '.join(f'{t:g}' for t in known)}" if known else "a run of 3 s has none"
            raise UsageError(f"until_s={until_s!r}: {there}")
        table = self.table(HORIZONS, columns=("future", "until_s", *self.columns))
        return table.filter(np.asarray(table["until_s"]) == until_s)

    @property
    def horizons_s(self) -> tuple[float, ...]:
        """Times by which the metrics of longer futures are known, too; () for 3 s."""
        there = (self.folder / HORIZONS).is_file()
        return horizons_of(int(self.info["steps"])) if there else ()

    def samples(self, column: str) -> FloatArray:
        """Return the values (n,) of a metric in the futures where it is defined."""
        values = self.values(column)
        return values[~np.isnan(values)]

    def density(self, column: str, *, until_s: float | None = None) -> Density:
        """Return density, cumulative density and 95 % band of a metric; ``until_s`` as of `values`."""
        column = self.column(column)
        if column == COLLISION:
            raise UsageError(f"{column}: is 0 or 1 in each future and has no density; see its share instead")
        widths = half_widths(self._metrics_until(until_s), self.columns, self.intervals)
        return metric_density(self.values(column, until_s=until_s), widths[column])

    def p_critical(
        self, column: str, *, threshold: float | None = None, until_s: float | None = None
    ) -> Interval:
        """Return the share of critical futures with its 95 % interval; an undefined metric is not critical.

        ``until_s`` as of `values`; a `UsageError` if there is no ``threshold``, given or of the run.
        """
        column = self.column(column)
        limit = self.thresholds.get(column) if threshold is None else threshold
        if limit is None:
            raise UsageError(
                f"{column}: has no threshold; those that have: {', '.join(self.thresholds)}; "
                "give one as threshold="
            )
        values = self.values(column, until_s=until_s)
        return self.intervals.share(is_critical(values, self.metric(column), limit))

    def recorded_value(self, column: str) -> float | None:
        """Return the value of a metric in the recorded future, or None."""
        column = self.column(column)
        if self.recorded is None:
            return None
        value = self.recorded[column][0].as_py()
        return None if value is None else float(value)

    def most_critical(self, column: str) -> int:
        """Return the future with the most critical value; `ResultError` if the metric is never defined."""
        column = self.column(column)
        values = self.values(column)
        if np.isnan(values).all():
            raise ResultError(f"{self.folder}: {column} is defined in none of {self.futures} futures")
        index = np.nanargmin(values) if self.metric(column).critical == "min" else np.nanargmax(values)
        return int(self.metrics["future"][int(index)].as_py())

    def table(self, name: str, *, columns: Sequence[str] = (), rows: int | None = None) -> ArrowTable:
        """Read one of the folder's Parquet files, checked for columns and number of rows."""
        return read_table(self.folder / name, columns=columns, rows=rows)


@checked
def open_run(folder: str | Path) -> Run:
    """Open a result folder; raise a `ResultError` if it has no finished result.

    Example:
        >>> scex.open_run(run.folder).futures
        4
    """
    return Run(Path(folder))
