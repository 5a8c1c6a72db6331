"""Figures of a converted net beside its map: one table of names, measures, bounds and words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.lanelet2sumo.judge.matching import Shapes, match_lanelets
from scex_sumo.lanelet2sumo.judge.priority import RightOfWay
from scex_sumo.lanelet2sumo.reader import read_net
from scex_sumo.road import Road
from scex_sumo.roads.conflicts import conflicts

NAMED = 6  # ids named in one problem; the rest are counted
DEVIATION_P95_M = 0.01
DEVIATION_MAX_M = 0.10

Figures: TypeAlias = dict[str, Any]


@dataclass(frozen=True)
class Figure:
    """One figure of a net.

    Attributes:
        name: ends in its unit, if it has one.
        measure: takes the evidence of its table; sets become sorted lists.
        problem: what to say of a figure out of bounds: words for its entries, or a text of all figures.
        bound: whether all figures are within the bound; by default this one is 0 or empty.
    """

    name: str
    measure: Callable[[Any], Any]
    problem: str | Callable[[Figures], str] = ""
    bound: Callable[[Figures], bool] | None = None

    def complaint(self, figures: Figures) -> str:
        """Return the problem in words, or nothing."""
        value, say = figures[self.name], self.problem
        if not say or (self.bound(figures) if self.bound else not value):
            return ""
        if callable(say):
            return say(figures)
        return f"{value} {say}" if isinstance(value, int) else _list(say, value)


def _list(what: str, entries: tuple[Any, ...]) -> str:
    named = ", ".join(map(_entry, entries[:NAMED]))
    return f"{len(entries)} {what}: {named}{', ...' if len(entries) > NAMED else ''}"


def _entry(entry: Any) -> str:
    if isinstance(entry, tuple):
        return f"({', '.join(map(_entry, entry))})"
    return f"{entry:.2f}" if isinstance(entry, float) else str(entry)


def _deviates(f: Figures) -> str:
    worst = f"; {_list('above 0.1 m (lanelet, m)', far)}" if (far := f["worst_deviations"]) else ""
    return f"deviation p95 {f['deviation_p95_m']:.3f} m, max {f['deviation_max_m']:.3f} m{worst}"


SHAPES = (
    Figure("lanelets", lambda s: len(s.lanelets)),
    Figure("lanes_present", lambda s: len(s.covered)),
    Figure("missing_lanes", lambda s: s.lanelets.keys() - {*s.covered}, "lanelets without a SUMO lane"),
    Figure("wrong_speeds", lambda s: s.wrong_speeds, "wrong speed limits (lanelet, map, net in m/s)"),
    Figure("deviation_p50_m", lambda s: float(np.percentile(s.deviations, 50))),
    Figure("deviation_p95_m", lambda s: float(np.percentile(s.deviations, 95))),
    Figure(
        "deviation_max_m",
        lambda s: float(s.deviations.max()),
        _deviates,
        # A net without any lane has no deviation: nan.
        lambda f: f["deviation_p95_m"] <= DEVIATION_P95_M and f["deviation_max_m"] <= DEVIATION_MAX_M,
    ),
    Figure("worst_deviations", lambda s: s.worst),
    Figure("successors", lambda s: len(s.successors)),
    Figure("missing_successors", lambda s: s.successors - s.joined, "successors without a connection"),
    Figure("invented_successors", lambda s: s.joined - s.successors, "connections that the map has not"),
)
RIGHTS = (
    Figure("regulated_pairs", lambda r: r.regulated),
    Figure("wrong_priority", lambda r: r.wrong, "against the map's right of way (should yield, should go)"),
    Figure("signalled", lambda r: len(r.signalled)),
    Figure("missing_signals", lambda r: r.missing_signals(), "lanelets whose traffic light nothing controls"),
)


@dataclass(frozen=True, kw_only=True)
class FidelityReport:
    """Figures of one net, by name, and the rows that measured them."""

    figures: Figures
    table: tuple[Figure, ...]

    def __getitem__(self, name: str) -> Any:
        return self.figures[name]

    def problems(self) -> list[str]:
        """Return what the net misses, one line each, with ids; empty for a faithful net."""
        return [words for figure in self.table if (words := figure.complaint(self.figures))]


def check_net(net_path: Path, road: Road, lanes: LaneTable) -> FidelityReport:
    """Judge a converted net against its road; what the road itself lost of the map counts as missing."""
    matching = match_lanelets(read_net(net_path).in_map(road), road, lanes)
    meeting = {c.lanes for c in conflicts(matching.road.vehicle_lanes) if c.kind != "diverge"}
    figures: Figures = {"net": net_path.name, "map": road.name}
    figures |= measured(SHAPES, Shapes(matching)) | measured(RIGHTS, RightOfWay(matching, meeting))
    for kind in ("lanelets", "lights"):
        figures[f"lost_{kind}"] = tuple(i for loss in road.losses if loss.kind == kind for i in loss.elements)
    return FidelityReport(figures=figures, table=(*SHAPES, *RIGHTS))


def measured(table: tuple[Figure, ...], evidence: object) -> Figures:
    """Return the figures of a table by name, measured from its evidence."""
    values = {figure.name: figure.measure(evidence) for figure in table}
    values |= {name: sorted(value) for name, value in values.items() if isinstance(value, set)}
    return {n: tuple(value) if isinstance(value, list) else value for n, value in values.items()}
