"""Run that is finished, read from its result folder."""

from __future__ import annotations

import importlib
import importlib.util
import tempfile
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.arrays import FloatArray
from scex_sumo.errors import ResultError, UsageError, one_line
from scex_sumo.metrics.registry import COLLISION, column_named, learn_metrics, metric_of, side_of
from scex_sumo.results.densities import half_widths, metric_density
from scex_sumo.results.design import column_of, intervals_of, is_critical
from scex_sumo.results.info import read_info
from scex_sumo.results.under_test import BASELINE, UNDER_TEST, UnderTest
from scex_sumo.scene import LOGGED_HISTORY, SeedScene, States
from scex_sumo.statistics.density import BANDWIDTH, Density, Interval
from scex_sumo.statistics.intervals import DesignIntervals

if TYPE_CHECKING:
    from scex_sumo.converters.net.sumo_net import SumoNet

TABLES: Final = ("metrics", "assignments", "tracks", "worst", "collisions", "encounters")
REFERENCE: Final = "reference"
"""Folder of the children that tell what is likely, in the folder of a run."""


class Run:
    """Result of a run: tables and statistics, read when asked for.

    Attributes:
        folder: the result folder.
        info: what ``run.json`` says.
    """

    def __init__(self, folder: Path, temporary: tempfile.TemporaryDirectory[str] | None = None) -> None:
        self.folder = folder
        self._temporary = temporary  # keeps a folder that nobody asked for until the run is forgotten
        self.info = read_info(folder)
        learn_metrics(self.info.get("metrics", ()))

    def __repr__(self) -> str:
        name = self.info["seed_scene"]["name"]
        return f"Run({str(self.folder)!r}: {self.info['children']} children of {name})"

    def _repr_html_(self) -> str:
        return str(importlib.import_module("scex_sumo.reports.notebook").run_html(self))

    def plot(self, path: str | Path, *, metric: str | None = None, curve: str = "density") -> Path:
        """Draw densities as in a paper, into an SVG, PNG or PDF file; returns the file.

        Args:
            path: file to write.
            metric: one of the metric columns; None draws all of them.
            curve: ``density`` or ``cumulative``.
        """
        draw = importlib.import_module("scex_sumo.reports.run_figure").draw_figure
        return Path(draw(self, curve, Path(path), metric=metric))

    def to_pandas(self, table: str = "metrics") -> Any:
        """One of the tables as a pandas data frame.

        Args:
            table: ``metrics``, ``assignments``, ``tracks``, ``worst``, ``collisions`` or ``encounters``.

        Raises:
            UsageError: there is no such table, or pandas is not installed.
        """
        if table not in TABLES:
            raise UsageError(f"unknown table {table!r}; known: {', '.join(TABLES)}")
        if importlib.util.find_spec("pandas") is None:
            raise UsageError("to_pandas needs pandas: pip install 'scex-sumo[notebook]'")
        return getattr(self, table).to_pandas()

    @cached_property
    def metrics(self) -> pa.Table:
        """One row per child: ``child``, the metric columns, null where undefined, and ``collision``."""
        table = self.table("metrics.parquet", columns=("child",), rows=self.info.get("children"))
        file = self.folder / "metrics.parquet"
        if table["child"].to_pylist() != list(range(table.num_rows)):
            raise ResultError(f"{file}: its children are not 0 to {table.num_rows - 1}; run again")
        for name in table.column_names[1:]:
            if name == COLLISION:
                continue
            kind = table.schema.field(name).type
            if not (pa.types.is_floating(kind) or pa.types.is_null(kind)):
                raise ResultError(f"{file}: column {name[:40]} holds no numbers; run again")
            metric_of(name)
        return table

    @cached_property
    def recorded(self) -> pa.Table | None:
        """The same metric columns for what really happened, one row; None where nothing was recorded."""
        there = (self.folder / "recorded.parquet").exists()
        return self.table("recorded.parquet", columns=self.columns, rows=1) if there else None

    @cached_property
    def assignments(self) -> pa.Table:
        """``child``, ``track_id``, ``model``: who drove whom."""
        columns, vehicles = ("child", "track_id", "model"), int(self.info["seed_scene"]["vehicles"])
        return self.table("assignments.parquet", columns=columns, rows=self.children * vehicles)

    @cached_property
    def tracks(self) -> pa.Table:
        """States of all children in INTERACTION columns; ``case_id`` is the child."""
        columns = ("case_id", "track_id", "x", "y", "vx", "vy", "psi_rad")
        vehicles, frames = int(self.info["seed_scene"]["vehicles"]), LOGGED_HISTORY + int(self.info["steps"])
        return self.table("tracks.parquet", columns=columns, rows=self.children * vehicles * frames)

    @cached_property
    def worst(self) -> pa.Table:
        """Where each extremum came from: child, metric, timestamp_ms, track_id, other_id, value, and whether
        the two had collided by then, after_collision.
        """
        return self.table("worst.parquet", columns=("child", "metric", "timestamp_ms", "track_id", "value"))

    @cached_property
    def collisions(self) -> pa.Table:
        """Who hits whom, when, where and how hard: one row per child and pair of vehicles that collide."""
        return self.table("collisions.parquet")

    @cached_property
    def encounters(self) -> pa.Table:
        """One row per pair of vehicles that meet in some child, the most critical pair first."""
        return self.table("encounters.parquet")

    @cached_property
    def intervals(self) -> DesignIntervals:
        """Of shares and distributions over the children, as their design leaves them."""
        there = (self.folder / "assignments.parquet").is_file()
        return intervals_of(self.info, self.assignments if there else None, self.children)

    @cached_property
    def p_collision(self) -> Interval:
        """Share of the children in which two vehicles collide, with its 95 % interval."""
        return self.intervals.share(np.asarray(self.metrics[COLLISION]))

    @cached_property
    def baseline(self) -> Run | None:
        """The same children without the models under test; None where there are none, or it was not run."""
        folder = self.folder / BASELINE
        return Run(folder, self._temporary) if (folder / "run.json").is_file() else None

    @cached_property
    def reference(self) -> Run | None:
        """What likely happens, by another mix of models; None where it was not run."""
        folder = self.folder / REFERENCE
        return Run(folder, self._temporary) if (folder / "run.json").is_file() else None

    @cached_property
    def under_test(self) -> UnderTest:
        """The vehicles under test against the baseline.

        Raises:
            ResultError: the run has no vehicle under test, or no baseline.
        """
        known = self.info.get("under_test") or {}
        if not known:
            raise ResultError(
                f"{self.folder}: no vehicle is under test; run with --under-test TRACK=MODEL, "
                "or --assign TRACK=package.module:Class"
            )
        if self.baseline is None:
            raise ResultError(f"{self.folder}: its baseline was not run; run again without --no-baseline")
        tested, without = self._tested(known), self.baseline._tested(known)
        if without["child"] != tested["child"]:
            raise ResultError(f"{self.baseline.folder}: has not the children of {self.folder}; run again")
        vehicles = {int(track): model for track, model in known.items()}
        return UnderTest(vehicles, tested, without, self.thresholds | {COLLISION: 1.0}, self.intervals)

    def _tested(self, vehicles: Iterable[str]) -> pa.Table:
        """Metrics of the pairs that involve a vehicle under test, and whether one of them collides."""
        own = [int(track) for track in vehicles]
        either = [np.isin(np.asarray(self.collisions[name]), own) for name in ("track_id", "other_id")]
        struck = np.asarray(self.collisions["child"])[either[0] | either[1]]
        table = self.table(UNDER_TEST)
        hit = np.isin(np.asarray(table["child"]), struck).astype(np.float64)
        return table.add_column(1, COLLISION, pa.array(hit))

    @cached_property
    def scene(self) -> SeedScene:
        """The seed scene as kept in ``seed.csv``, vehicles in the order of the run; without its road."""
        from scex_sumo.converters.datasets.seed import recorded_scene

        known = self.info["seed_scene"]
        scene = recorded_scene(
            self.folder / known["name"], tracks=self.folder / "seed.csv", case="1.0", repair=False
        )
        where = {int(track): index for index, track in enumerate(scene.track_ids)}
        if sorted(where) != sorted(known["track_ids"]):
            raise ResultError(f"{self.folder}: seed.csv is not that of run.json; run again")
        return scene.reordered([where[track] for track in known["track_ids"]], name=known["name"])

    @cached_property
    def net(self) -> SumoNet:
        """The SUMO net that the run used."""
        from scex_sumo.converters.net.sumo_net import open_net

        return open_net(self.folder / "sumo" / f"{self.info['net']}.net.xml")

    def states(self, child: int) -> States:
        """(V, T) states of a child, frames 1 to 10 the seed's history, 10 the seed scene.

        Raises:
            UsageError: there is no such child.
        """
        if not 0 <= child < self.children:
            raise UsageError(f"no child {child} in {self.folder}; it has 0 to {self.children - 1}")
        vehicles = len(self.info["seed_scene"]["track_ids"])
        frames = LOGGED_HISTORY + int(self.info["steps"])
        rows = self.tracks.slice(child * vehicles * frames, vehicles * frames)
        x, y, vx, vy, psi = (
            np.asarray(rows[name]).reshape(vehicles, frames) for name in ("x", "y", "vx", "vy", "psi_rad")
        )
        return States(x=x, y=y, heading=psi, speed=np.hypot(vx, vy))

    def models_of(self, child: int) -> list[str]:
        """(V,) who drove each vehicle of a child."""
        vehicles = len(self.info["seed_scene"]["track_ids"])
        return [str(m) for m in self.assignments["model"].slice(child * vehicles, vehicles).to_pylist()]

    @property
    def columns(self) -> list[str]:
        """The metric columns."""
        return [name for name in self.metrics.column_names if name not in ("child", COLLISION)]

    @property
    def outcomes(self) -> list[str]:
        """``collision``, where the result tells of them."""
        return [name for name in self.metrics.column_names if name == COLLISION]

    @property
    def children(self) -> int:
        """Number of children."""
        return int(self.metrics.num_rows)

    @property
    def thresholds(self) -> dict[str, float]:
        """Threshold of each metric that has one."""
        return dict(self.info["thresholds"])

    def values(self, column: str) -> FloatArray:
        """(C,) values of a metric in all children, NaN where undefined; of ``collision`` 0 and 1."""
        if column not in (*self.columns, *self.outcomes):
            raise UsageError(f"unknown metric {column!r}; known: {', '.join(self.columns)}")
        return column_of(self.metrics, column)

    def samples(self, column: str) -> FloatArray:
        """(n,) the values of a metric, named as a column or as it is printed, where it is defined."""
        values = self.values(column)
        return values[~np.isnan(values)]

    def density(self, column: str, *, bandwidth: float = BANDWIDTH, reflect: bool | None = None) -> Density:
        """Kernel density and cumulative density of a metric with its 95 % band.

        Args:
            column: one of the metric columns.
            bandwidth: of the kernel, in the metric's unit.
            reflect: tell atoms apart and reflect at 0 what cannot be negative; None does as the run was told.
        """
        folded = bool(self.info.get("reflect", True)) if reflect is None else reflect
        values = self.values(column)
        return metric_density(values, self._half_widths[column], reflect=folded, bandwidth=bandwidth)

    @cached_property
    def _half_widths(self) -> dict[str, float]:
        return half_widths(self.metrics, self.columns, self.intervals)

    def p_critical(self, column: str, *, threshold: float | None = None) -> Interval:
        """Share of all children with a critical value of a metric, with its 95 % interval.

        A child in which the metric is undefined is not critical.

        Args:
            column: one of the metric columns.
            threshold: None takes the run's.

        Raises:
            UsageError: no threshold is given and the run has none for this metric.
        """
        column = column_named(column, self.columns)
        limit = self.thresholds.get(column) if threshold is None else threshold
        if limit is None:
            raise UsageError(
                f"{column}: has no threshold; those that have: {', '.join(self.thresholds)}; "
                "give one as threshold="
            )
        return self.intervals.share(is_critical(self.values(column), column, limit))

    def recorded_value(self, column: str) -> float | None:
        """What a metric was in the recorded future, or None."""
        column = column_named(column, self.columns)
        if self.recorded is None:
            return None
        value = self.recorded[column][0].as_py()
        return None if value is None else float(value)

    def most_critical(self, column: str) -> int:
        """The child with the most critical value of a metric.

        Raises:
            ResultError: the metric is defined in no child.
        """
        values = self.values(column)
        if np.isnan(values).all():
            raise ResultError(f"{self.folder}: {column} is defined in none of {self.children} children")
        index = np.nanargmin(values) if side_of(column) == "left" else np.nanargmax(values)
        return int(self.metrics["child"][int(index)].as_py())

    def table(self, name: str, *, columns: Sequence[str] = (), rows: int | None = None) -> pa.Table:
        """One of the folder's Parquet files.

        Args:
            name: of the file.
            columns: those that it must have.
            rows: how many it must have; None for any number.

        Raises:
            ResultError: it cannot be read, or is not as the run wrote it.
        """
        file = self.folder / name
        try:
            table = pq.ParquetFile(file).read()
        except (OSError, pa.ArrowException, ValueError) as error:
            raise ResultError(f"{file}: cannot be read: {one_line(error)[:160]}") from None
        missing = [column for column in columns if column not in table.column_names]
        if missing:
            raise ResultError(f"{file}: has no column {missing[0]}; it is not as the run wrote it: run again")
        if rows not in (None, table.num_rows):
            raise ResultError(f"{file}: has {table.num_rows} rows, run.json says {rows}; run again")
        return table


def open_run(folder: str | Path) -> Run:
    """Open a result folder.

    Raises:
        ResultError: no finished result is there.
    """
    return Run(Path(folder))
