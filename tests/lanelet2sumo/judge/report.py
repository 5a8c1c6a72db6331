"""Whole judge of a net: the figures of `convert`, and those that only prove the converter.

Only the reader of nets and the lane table are shared with the net writer.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.lanelet2sumo.judge import report as judge
from scex_sumo.lanelet2sumo.judge.report import RIGHTS, FidelityReport, Figure, Figures, measured
from scex_sumo.road import Road
from tests.lanelet2sumo.judge.by_geometry import lanes_by_geometry
from tests.lanelet2sumo.judge.mirrored import match_mirrored
from tests.lanelet2sumo.judge.outlines import Outlines
from tests.lanelet2sumo.judge.topology import Moves
from tests.lanelet2sumo.judge.whole_right_of_way import WholeRightOfWay

WIDTH_ERROR_M = 0.40  # mean; SUMO lanes have one width, lanelets any
WIDTH_SLACK_M = 0.2  # above the floor of lanes of one width


def _count(routes: dict[int, int]) -> int:
    return sum(row.bit_count() for row in routes.values())


def _percent(part: str, whole: str) -> Callable[[Figures], float]:
    return lambda f: 100.0 * f[part] / f[whole] if f[whole] else 100.0


OUTLINES = (
    Figure("overhang_max_m", lambda s: s.overhang_max_m),
    Figure("overhangs", lambda s: s.overhangs, "lanes that run on beyond their lanelets (lane, m)"),
    Figure(
        "wrong_lengths",
        lambda s: s.wrong_lengths,
        "edges whose length is not their lanes' (edge, length, lanes' mean)",
    ),
    Figure("reversed_lanes", lambda s: s.reversed, "lanes against their lanelet"),
    Figure("invented_lanes", lambda s: s.invented, "car lanes that stand for no lanelet"),
    Figure("non_vehicle_as_cars", lambda s: s.opened, "lanelets closed to cars that became car lanes"),
    Figure(
        "width_error_mean_m",
        lambda s: float(s.width_errors.mean()),
        lambda f: f"mean width error {f['width_error_mean_m']:.2f} m",
        lambda f: f["width_error_mean_m"] <= max(WIDTH_ERROR_M, f["width_error_floor_m"] + WIDTH_SLACK_M),
    ),
    Figure("width_error_max_m", lambda s: float(s.width_errors.max())),
    Figure("width_error_floor_m", lambda s: float(s.width_floor.mean())),
)
MOVES = (
    Figure("routes", lambda m: _count(m.routes)),
    Figure("missing_routes", lambda m: m.pairs(m.missing), "routes that SUMO cannot drive"),
    Figure("invented_routes", lambda m: m.pairs(m.invented), "routes that the map forbids"),
    Figure("border_routes", lambda m: _count(m.border(m.routes))),
    Figure("missing_border_routes", lambda m: m.pairs(m.border(m.missing))),
    Figure("invented_border_routes", lambda m: m.pairs(m.border(m.invented))),
    Figure("loose_edge_routes", lambda m: m.pairs(m.loose)),
    Figure("lane_changes", lambda m: len(m.permitted)),
    Figure(
        "missing_lane_changes", lambda m: m.missing_changes, "permitted lane changes that are not possible"
    ),
    Figure("lane_changes_inside", lambda m: m.inside),
    Figure("lane_change_length_share", lambda m: m.length_share()),
    Figure("forbidden_lane_changes", lambda m: len(m.adjacent - m.permitted)),
    Figure("invented_lane_changes", lambda m: m.invented_changes, "forbidden lane changes that are possible"),
)
WHOLE_RIGHTS = (
    *RIGHTS,  # again, with other conflicts
    Figure("conflicts", lambda r: len(r.conflicts)),
    Figure("crossing", lambda r: sum(conflict.kind == "cross" for conflict in r.conflicts)),
    Figure("merging", lambda r: sum(conflict.kind == "merge" for conflict in r.conflicts)),
    Figure("missing_foes", lambda r: r.missing_foes, "conflicting lanelets that are no foes"),
    Figure("foes_apart", lambda r: r.apart),
    Figure("clashing_greens", lambda r: r.clashing_greens(), "foes that both have green"),
    Figure("from_the_right", lambda r: r.from_the_right),
    Figure(
        "wrong_from_the_right", lambda r: r.wrong_right, "not right before left (should yield, should go)"
    ),
    Figure("mutual_yields", lambda r: r.mutual_yields(), "links that yield to each other"),
    Figure("free_foes", lambda r: r.free_foes(), "foes of which neither yields"),
    Figure(
        "inconsistent_rows", lambda r: r.inconsistent_rows(), "junctions whose rows contradict themselves"
    ),
)
SHARES = (
    Figure("lanes_percent", _percent("lanes_present", "drawn_lanelets")),
    Figure("speeds_percent", _percent("speeds_right", "lanes_present")),
)


def check_net(net_path: Path, road: Road, lanes: LaneTable | None = None) -> FidelityReport:
    """Judge a net against its map.

    Args:
        lanes: SUMO lanes of each lanelet; None to find them by geometry.
    """
    lanes = lanes_by_geometry(net_path, road) if lanes is None else lanes
    told, matching = judge.check_net(net_path, road, lanes), match_mirrored(net_path, road, lanes)
    rights = measured(WHOLE_RIGHTS, WholeRightOfWay(matching))
    assert rights["wrong_priority"] == told["wrong_priority"]  # whichever way conflicts are found
    figures = told.figures | rights
    figures |= measured(OUTLINES, Outlines(matching)) | measured(MOVES, Moves(matching))
    figures["drawn_lanelets"] = figures["lanelets"] + len(figures["lost_lanelets"])
    figures["speeds_right"] = figures["lanes_present"] - len(figures["wrong_speeds"])
    figures |= measured(SHARES, figures)
    return FidelityReport(
        figures=figures, table=(*told.table, *OUTLINES, *MOVES, *WHOLE_RIGHTS[len(RIGHTS) :])
    )
