"""Figures of the fidelity judge: one table of names, measures, bounds and words.

Only the reader of nets and the lane table are shared with the net writer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.lanelet2sumo.judge.geometry import Shapes
from scex_sumo.lanelet2sumo.judge.matching import match_lanelets
from scex_sumo.lanelet2sumo.judge.priority import RightOfWay
from scex_sumo.lanelet2sumo.judge.topology import Moves
from scex_sumo.lanelet2sumo.reader import read_net
from scex_sumo.road import Road
from scex_sumo.roads.mirror import mirrored_road

NAMED = 6  # ids named in one problem; the rest are counted
DEVIATION_P95_M = 0.01
DEVIATION_MAX_M = 0.10
WIDTH_ERROR_M = 0.40  # mean; SUMO lanes have one width, lanelets any
WIDTH_SLACK_M = 0.2  # above the floor of lanes of one width

Figures: TypeAlias = dict[str, Any]
Rows: TypeAlias = tuple[tuple[Any, ...], ...]  # arguments of `Figure`


@dataclass(frozen=True)
class Figure:
    """One figure of the judge.

    Attributes:
        name: ends in its unit, if it has one.
        measure: takes the evidence under which the figure stands in `TABLE`; sets become sorted lists.
        problem: what to say of a figure out of bounds: words for its entries, or a text of all figures.
        bound: whether all figures are within the bound; by default this one is 0 or empty.
    """

    name: str
    measure: Callable[[Any], Any]
    problem: str | Callable[[Figures], str] = ""
    bound: Callable[[Figures], bool] | None = None

    def complaint(self, figures: Figures) -> str:
        """Return the problem in words, or nothing."""
        value = figures[self.name]
        if not self.problem or (self.bound(figures) if self.bound else not value):
            return ""
        if callable(self.problem):
            return self.problem(figures)
        return f"{value} {self.problem}" if isinstance(value, int) else _list(self.problem, value)


def _list(what: str, entries: tuple[Any, ...]) -> str:
    named = ", ".join(map(_entry, entries[:NAMED]))
    return f"{len(entries)} {what}: {named}{', ...' if len(entries) > NAMED else ''}"


def _entry(entry: Any) -> str:
    if isinstance(entry, tuple):
        return f"({', '.join(map(_entry, entry))})"
    return f"{entry:.2f}" if isinstance(entry, float) else str(entry)


def _count(routes: dict[int, int]) -> int:
    return sum(row.bit_count() for row in routes.values())


def _percent(part: str, whole: str) -> Callable[[Figures], float]:
    return lambda f: 100.0 * f[part] / f[whole] if f[whole] else 100.0


def _deviates(f: Figures) -> str:
    worst = f"; {_list('above 0.1 m (lanelet, m)', far)}" if (far := f["worst_deviations"]) else ""
    return f"deviation p95 {f['deviation_p95_m']:.3f} m, max {f['deviation_max_m']:.3f} m{worst}"


SHAPES: Rows = (
    ("lanelets", lambda s: len(s.lanelets)),
    ("lanes_present", lambda s: len(s.covered)),
    ("missing_lanes", lambda s: s.lanelets.keys() - {*s.covered}, "lanelets without a SUMO lane"),
    ("speeds_right", lambda s: len(s.covered) - len(s.wrong_speeds)),
    ("wrong_speeds", lambda s: s.wrong_speeds, "wrong speed limits (lanelet, map, net in m/s)"),
    ("deviation_p50_m", lambda s: float(np.percentile(s.deviations, 50))),
    ("deviation_p95_m", lambda s: float(np.percentile(s.deviations, 95))),
    (
        "deviation_max_m",
        lambda s: float(s.deviations.max()),
        _deviates,
        # A net without any lane has no deviation: nan.
        lambda f: f["deviation_p95_m"] <= DEVIATION_P95_M and f["deviation_max_m"] <= DEVIATION_MAX_M,
    ),
    ("worst_deviations", lambda s: s.worst),
    ("overhang_max_m", lambda s: s.overhang_max_m),
    ("overhangs", lambda s: s.overhangs, "lanes that run on beyond their lanelets (lane, m)"),
    (
        "wrong_lengths",
        lambda s: s.wrong_lengths,
        "edges whose length is not their lanes' (edge, length, lanes' mean)",
    ),
    ("reversed_lanes", lambda s: s.reversed, "lanes against their lanelet"),
    ("invented_lanes", lambda s: s.invented, "car lanes that stand for no lanelet"),
    ("non_vehicle_as_cars", lambda s: s.opened, "lanelets closed to cars that became car lanes"),
    (
        "width_error_mean_m",
        lambda s: float(s.width_errors.mean()),
        lambda f: (
            f"mean width error {f['width_error_mean_m']:.2f} m, "
            f"{f['width_error_floor_m']:.2f} m can be reached"
        ),
        lambda f: f["width_error_mean_m"] <= max(WIDTH_ERROR_M, f["width_error_floor_m"] + WIDTH_SLACK_M),
    ),
    ("width_error_max_m", lambda s: float(s.width_errors.max())),
    ("width_error_floor_m", lambda s: float(s.width_floor.mean())),
)
MOVES: Rows = (
    ("successors", lambda m: len(m.successors)),
    ("missing_successors", lambda m: m.successors - m.joined, "successors without a connection"),
    ("invented_successors", lambda m: m.joined - m.successors, "connections that the map does not have"),
    ("routes", lambda m: _count(m.routes)),
    ("missing_routes", lambda m: m.pairs(m.missing), "routes that SUMO cannot drive"),
    ("invented_routes", lambda m: m.pairs(m.invented), "routes that the map forbids"),
    ("border_routes", lambda m: _count(m.border(m.routes))),
    ("missing_border_routes", lambda m: m.pairs(m.border(m.missing))),
    ("invented_border_routes", lambda m: m.pairs(m.border(m.invented))),
    ("loose_edge_routes", lambda m: m.pairs(m.loose)),
    ("lane_changes", lambda m: len(m.permitted)),
    ("missing_lane_changes", lambda m: m.missing_changes, "permitted lane changes that are not possible"),
    ("lane_changes_inside", lambda m: m.inside),
    ("lane_change_length_share", lambda m: m.length_share()),
    ("forbidden_lane_changes", lambda m: len(m.adjacent - m.permitted)),
    ("invented_lane_changes", lambda m: m.invented_changes, "forbidden lane changes that are possible"),
)
RIGHTS: Rows = (
    ("conflicts", lambda r: len(r.conflicts)),
    ("crossing", lambda r: sum(conflict.kind == "cross" for conflict in r.conflicts)),
    ("merging", lambda r: sum(conflict.kind == "merge" for conflict in r.conflicts)),
    ("missing_foes", lambda r: r.missing_foes, "conflicting lanelets that are no foes"),
    ("foes_apart", lambda r: r.apart),
    ("regulated_pairs", lambda r: r.regulated),
    ("wrong_priority", lambda r: r.wrong, "right of way against the map's rules (should yield, should go)"),
    ("signalled", lambda r: len(r.signalled)),
    ("missing_signals", lambda r: r.missing_signals(), "lanelets with a traffic light that nothing controls"),
    ("clashing_greens", lambda r: r.clashing_greens(), "foes that both have green"),
    ("from_the_right", lambda r: r.from_the_right),
    ("wrong_from_the_right", lambda r: r.wrong_right, "not right before left (should yield, should go)"),
    ("mutual_yields", lambda r: r.mutual_yields(), "links that yield to each other"),
    ("free_foes", lambda r: r.free_foes(), "foes of which neither yields"),
    ("inconsistent_rows", lambda r: r.inconsistent_rows(), "junctions whose rows contradict themselves"),
)
SHARES: Rows = (
    ("lanes_percent", _percent("lanes_present", "drawn_lanelets")),
    ("speeds_percent", _percent("speeds_right", "lanes_present")),
)
TABLE: Final[Mapping[type, tuple[Figure, ...]]] = {
    part: tuple(Figure(*row) for row in rows)
    for part, rows in ((Shapes, SHAPES), (Moves, MOVES), (RightOfWay, RIGHTS), (dict, SHARES))
}


@dataclass(frozen=True, kw_only=True)
class FidelityReport:
    """Figures of one net, by name, and the rows that measured them."""

    figures: Figures
    table: tuple[Figure, ...]

    def __getitem__(self, name: str) -> Any:
        return self.figures[name]

    def rows(self) -> list[tuple[str, str]]:
        """Return the name and the text of each figure that is one number or word."""
        single = [(n, v) for n, v in self.figures.items() if isinstance(v, (int, float, str))]
        return [(n, f"{round(v, 4):.4g}" if isinstance(v, float) else str(v)) for n, v in single]

    def problems(self) -> list[str]:
        """Return what the net misses, one line each, with ids; empty for a faithful net."""
        return [words for figure in self.table if (words := figure.complaint(self.figures))]


def check_net(net_path: Path, road: Road, lanes: LaneTable | None = None) -> FidelityReport:
    """Judge a net against its map; what the road itself lost of the map counts as missing.

    Args:
        lanes: SUMO lanes of each lanelet; None to find them by geometry.
    """
    net = read_net(net_path).in_map(road)
    if road.left_hand:
        net, road = net.mirrored(), mirrored_road(road)
    matching = match_lanelets(net, road, lanes)
    figures: Figures = {"net": net_path.name, "map": road.name, "lane_table": lanes is not None}
    for part in (Shapes, Moves, RightOfWay):
        figures |= measured(TABLE[part], part(matching))
    for kind in ("lanelets", "lights"):
        figures[f"lost_{kind}"] = tuple(i for loss in road.losses if loss.kind == kind for i in loss.elements)
    figures["drawn_lanelets"] = figures["lanelets"] + len(figures["lost_lanelets"])
    table = tuple(figure for part in TABLE.values() for figure in part)
    return FidelityReport(figures=figures | measured(TABLE[dict], figures), table=table)


def measured(table: tuple[Figure, ...], evidence: object) -> Figures:
    """Return the figures of a table by name, measured from its evidence."""
    values = {figure.name: figure.measure(evidence) for figure in table}
    values |= {name: sorted(value) for name, value in values.items() if isinstance(value, set)}
    return {n: tuple(value) if isinstance(value, list) else value for n, value in values.items()}
