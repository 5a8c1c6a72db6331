"""Report of the fidelity judge: figures, bounds and problems.

Only the reader of nets and the lane table are shared with the net writer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeAlias

from scex_sumo.converters.net.reader import read_net
from scex_sumo.judge.driving import DrivingReport, drive_net
from scex_sumo.judge.geometry import judge_geometry
from scex_sumo.judge.loading import judge_loading
from scex_sumo.judge.matching import LaneNames, match_lanelets
from scex_sumo.judge.priority import judge_priority
from scex_sumo.judge.topology import judge_topology
from scex_sumo.road import Road

__all__ = ["DrivingReport", "FidelityReport", "check_net", "drive_net"]

NAMED = 6  # ids named in one problem; the rest are counted
DEVIATION_P95_M = 0.01
DEVIATION_MAX_M = 0.10
WIDTH_ERROR_M = 0.40  # mean; SUMO lanes have one width, lanelets any
WIDTH_SLACK_M = 0.2  # above the floor of lanes of one width
PROBE_HIT_SHARE = 0.99

Figures: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True)
class _Check:
    figure: str
    words: str | Callable[[Figures], str]
    reached: Callable[[Figures], bool] | None = None

    def problem(self, figures: Figures) -> str:
        value = figures[self.figure]
        if self.reached(figures) if self.reached else not value:
            return ""
        return _list(self.words, value) if isinstance(self.words, str) else self.words(figures)


def _deviates(figures: Figures) -> str:
    named = figures["worst_deviations"]
    worst = f"; {_list('above 0.1 m (lanelet, m)', named)}" if named else ""
    return f"deviation p95 {figures['deviation_p95_m']:.3f} m, max {figures['deviation_max_m']:.3f} m{worst}"


CHECKS: Final = (
    _Check("missing_lanes", "lanelets without a SUMO lane"),
    _Check("wrong_speeds", "wrong speed limits (lanelet, map, net in m/s)"),
    _Check("wrong_lengths", "edges whose length is not their lanes' (edge, length, lanes' mean)"),
    _Check("reversed_lanes", "lanes against their lanelet"),
    _Check("invented_lanes", "car lanes that stand for no lanelet"),
    _Check("non_vehicle_as_cars", "lanelets closed to cars that became car lanes"),
    _Check("overhangs", "lanes that run on beyond their lanelets (lane, m)"),
    _Check("missing_successors", "successors without a connection"),
    _Check("invented_successors", "connections that the map does not have"),
    _Check("missing_routes", "routes that SUMO cannot drive"),
    _Check("invented_routes", "routes that the map forbids"),
    _Check("missing_lane_changes", "permitted lane changes that are not possible"),
    _Check("invented_lane_changes", "forbidden lane changes that are possible"),
    _Check("missing_foes", "conflicting lanelets that are no foes"),
    _Check("wrong_priority", "right of way against the map's rules (should yield, should go)"),
    _Check("wrong_from_the_right", "not right before left (should yield, should go)"),
    _Check("missing_signals", "lanelets with a traffic light that nothing controls"),
    _Check("clashing_greens", "foes that both have green"),
    _Check("mutual_yields", "links that yield to each other"),
    _Check("free_foes", "foes of which neither yields"),
    _Check("inconsistent_rows", "junctions whose rows contradict themselves"),
    _Check("sumo_warnings", "sumo says"),
    _Check("sumolib_warnings", "sumolib says"),
    _Check("netconvert_errors", "netconvert refuses the net"),
    _Check(
        "deviation_max_m",
        _deviates,
        # A net without any lane has no deviation: nan.
        lambda f: f["deviation_p95_m"] <= DEVIATION_P95_M and f["deviation_max_m"] <= DEVIATION_MAX_M,
    ),
    _Check(
        "width_error_mean_m",
        lambda f: (
            f"mean width error {f['width_error_mean_m']:.2f} m, "
            f"{f['width_error_floor_m']:.2f} m can be reached"
        ),
        lambda f: f["width_error_mean_m"] <= max(WIDTH_ERROR_M, f["width_error_floor_m"] + WIDTH_SLACK_M),
    ),
    _Check(
        "probe_hits",
        lambda f: (
            f"moveToXY finds {f['probe_hits']} of {f['probes']} centreline points; "
            + _list("lost (lanelet, points)", f["lost_probes"])
        ),
        lambda f: f["probes"] - f["probe_hits"] <= max(1, (1 - PROBE_HIT_SHARE) * f["probes"]),
    ),
)


@dataclass(frozen=True, kw_only=True)
class FidelityReport:
    """All figures of one net against one map, by name; ``driving`` if SUMO's vehicles were asked to drive."""

    figures: Figures = field(repr=False)
    driving: DrivingReport | None = None

    def __getitem__(self, name: str) -> Any:
        return self.figures[name]

    def to_dict(self) -> dict[str, Any]:
        """Return every figure by its name, in one flat mapping for JSON."""
        return {**self.figures, **({"driving": self.driving.to_dict()} if self.driving else {})}

    def problems(self) -> list[str]:
        """Return what the net misses, one line each, with ids; empty for a faithful net."""
        found = [problem for check in CHECKS if (problem := check.problem(self.figures))]
        return found + (self.driving.problems() if self.driving is not None else [])


def check_net(net_path: Path, road: Road, lanes: LaneNames | None = None) -> FidelityReport:
    """Judge a net against its map; what the road itself lost of the map counts as missing.

    Args:
        lanes: SUMO lanes of each lanelet; None to find them by geometry.
    """
    matching = match_lanelets(read_net(net_path).in_map(road.georeference), road, lanes)
    figures: dict[str, Any] = {"net": net_path.name, "map": road.name, "lane_table": lanes is not None}
    for judge in (judge_geometry, judge_topology, judge_priority, judge_loading):
        figures |= judge(matching)
    for kind in ("lanelets", "lights"):
        figures[f"lost_{kind}"] = tuple(i for loss in road.losses if loss.kind == kind for i in loss.elements)
    figures["drawn_lanelets"] = figures["lanelets"] + len(figures["lost_lanelets"])
    shares = {
        "lanes_percent": ("lanes_present", "drawn_lanelets"),
        "speeds_percent": ("speeds_right", "lanes_present"),
        "probe_hit_percent": ("probe_hits", "probes"),
    }
    for name, (part, whole) in shares.items():
        figures[name] = 100.0 * figures[part] / figures[whole] if figures[whole] else 100.0
    return FidelityReport(figures=figures)


def _list(what: str, entries: tuple[Any, ...]) -> str:
    named = ", ".join(_entry(entry) for entry in entries[:NAMED])
    return f"{len(entries)} {what}: {named}{', ...' if len(entries) > NAMED else ''}"


def _entry(entry: Any) -> str:
    if isinstance(entry, tuple):
        return "(" + ", ".join(_entry(value) for value in entry) + ")"
    return f"{entry:.2f}" if isinstance(entry, float) else str(entry)
