"""Fidelity judge: how faithful a SUMO net is to the map, whichever converter wrote it.

The judge shares no code with the net writer except the reader of SUMO nets and, if there is one, the lane
table.
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
WIDTH_SLACK_M = 0.2  # above what lanes of one width can reach on a map of tapering lanelets
PROBE_HIT_SHARE = 0.99

Figures: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True)
class Check:
    """What a faithful net reaches.

    Attributes:
        words: name of a list of faults, or what a number misses.
        reached: whether the figures are within the bound; by default the list of faults is empty.
    """

    figure: str
    words: str | Callable[[Figures], str]
    reached: Callable[[Figures], bool] | None = None

    def problem(self, figures: Figures) -> str:
        """Return the problem in one line, with ids; empty if the net is faithful here."""
        value = figures[self.figure]
        if self.reached(figures) if self.reached else not value:
            return ""
        return _list(self.words, value) if isinstance(self.words, str) else self.words(figures)


def _deviates(figures: Figures) -> str:
    named = figures["worst_deviations"]
    worst = f"; {_list('above 0.1 m (lanelet, m)', named)}" if named else ""
    return f"deviation p95 {figures['deviation_p95_m']:.3f} m, max {figures['deviation_max_m']:.3f} m{worst}"


CHECKS: Final = (
    Check("missing_lanes", "lanelets without a SUMO lane"),
    Check("wrong_speeds", "wrong speed limits (lanelet, map, net in m/s)"),
    Check("wrong_lengths", "edges whose length is not their lanes' (edge, length, lanes' mean)"),
    Check("reversed_lanes", "lanes against their lanelet"),
    Check("invented_lanes", "car lanes that stand for no lanelet"),
    Check("non_vehicle_as_cars", "lanelets closed to cars that became car lanes"),
    Check("overhangs", "lanes that run on beyond their lanelets (lane, m)"),
    Check("missing_successors", "successors without a connection"),
    Check("invented_successors", "connections that the map does not have"),
    Check("missing_routes", "routes that SUMO cannot drive"),
    Check("invented_routes", "routes that the map forbids"),
    Check("missing_lane_changes", "permitted lane changes that are not possible"),
    Check("invented_lane_changes", "forbidden lane changes that are possible"),
    Check("missing_foes", "conflicting lanelets that are no foes"),
    Check("wrong_priority", "right of way against the map's rules (should yield, should go)"),
    Check("wrong_from_the_right", "not right before left (should yield, should go)"),
    Check("missing_signals", "lanelets with a traffic light that nothing controls"),
    Check("clashing_greens", "foes that both have green"),
    Check("mutual_yields", "links that yield to each other"),
    Check("free_foes", "foes of which neither yields"),
    Check("inconsistent_rows", "junctions whose rows contradict themselves"),
    Check("sumo_warnings", "sumo says"),
    Check("sumolib_warnings", "sumolib says"),
    Check("netconvert_errors", "netconvert refuses the net"),
    Check(
        "deviation_max_m",
        _deviates,
        # A net without any lane has no deviation: nan.
        lambda f: f["deviation_p95_m"] <= DEVIATION_P95_M and f["deviation_max_m"] <= DEVIATION_MAX_M,
    ),
    Check(
        "width_error_mean_m",
        lambda f: (
            f"mean width error {f['width_error_mean_m']:.2f} m, "
            f"{f['width_error_floor_m']:.2f} m can be reached"
        ),
        lambda f: f["width_error_mean_m"] <= max(WIDTH_ERROR_M, f["width_error_floor_m"] + WIDTH_SLACK_M),
    ),
    Check(
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

    Raises:
        InputError: the file is no SUMO net.
        SimulationError: SUMO is not installed, or stopped with an error.
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
