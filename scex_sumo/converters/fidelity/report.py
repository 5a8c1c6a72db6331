"""Fidelity judge: how faithful a SUMO net is to the Lanelet2 map it should be, whoever wrote it.

It reads the net's XML afresh and shares nothing with the net writer but the lane table, and even that is
optional, so nets from any other converter are judged by the same figures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from scex_sumo.converters.fidelity.driving import DrivingReport, drive_net
from scex_sumo.converters.fidelity.geometry import judge_geometry
from scex_sumo.converters.fidelity.loading import judge_loading
from scex_sumo.converters.fidelity.matching import LaneNames, match_lanelets
from scex_sumo.converters.fidelity.net import read_net
from scex_sumo.converters.fidelity.priority import judge_priority
from scex_sumo.converters.fidelity.topology import judge_topology
from scex_sumo.road import Road

__all__ = ["DrivingReport", "FidelityReport", "check_net", "drive_net"]

NAMED = 6  # ids named in one problem; the rest are counted

# Figures that list what is wrong, in words; a faithful net has none of it.
FAULTS: Final[Mapping[str, str]] = {
    "missing_lanes": "lanelets without a SUMO lane",
    "wrong_speeds": "wrong speed limits (lanelet, map, net in m/s)",
    "wrong_lengths": "edges whose length is not their lanes' (edge, length, lanes' mean)",
    "reversed_lanes": "lanes against their lanelet",
    "invented_lanes": "car lanes that stand for no lanelet",
    "non_vehicle_as_cars": "lanelets closed to cars that became car lanes",
    "overhangs": "lanes that run on beyond their lanelets (lane, m)",
    "missing_successors": "successors without a connection",
    "invented_successors": "connections that the map does not have",
    "missing_routes": "routes that SUMO cannot drive",
    "invented_routes": "routes that the map forbids",
    "missing_lane_changes": "permitted lane changes that are not possible",
    "invented_lane_changes": "forbidden lane changes that are possible",
    "missing_foes": "conflicting lanelets that are no foes",
    "wrong_priority": "right of way against the map's rules (should yield, should go)",
    "wrong_from_the_right": "not right before left (should yield, should go)",
    "missing_signals": "lanelets with a traffic light that nothing controls",
    "clashing_greens": "foes that both have green",
    "mutual_yields": "links that yield to each other",
    "free_foes": "foes of which neither yields",
    "inconsistent_rows": "junctions whose rows contradict themselves",
    "sumo_warnings": "sumo says",
    "sumolib_warnings": "sumolib says",
    "netconvert_errors": "netconvert refuses the net",
}
# What a faithful net reaches where a figure is a number.
DEVIATION_P95_M = 0.01
DEVIATION_MAX_M = 0.10
WIDTH_ERROR_M = 0.40  # mean; SUMO lanes have one width, lanelets any
WIDTH_SLACK_M = 0.2  # above what lanes of one width can reach on a map of tapering lanelets
PROBE_HIT_SHARE = 0.99


@dataclass(frozen=True, kw_only=True)
class FidelityReport:
    """All figures of one net against one map; ``report["deviation_max_m"]`` is one of them.

    Attributes:
        figures: by name, in the order of the report; those named in `FAULTS` list ids.
        driving: how SUMO's own vehicles fared, where they were asked to drive.
    """

    figures: Mapping[str, Any] = field(repr=False)
    driving: DrivingReport | None = None

    def __getitem__(self, name: str) -> Any:
        return self.figures[name]

    def to_dict(self) -> dict[str, Any]:
        """Every figure by its name, in one flat mapping that JSON takes."""
        return {**self.figures, **({"driving": self.driving.to_dict()} if self.driving else {})}

    def problems(self) -> list[str]:
        """What the net misses, one line each, with the ids; empty for a faithful net."""
        found = [_list(words, self[name]) for name, words in FAULTS.items() if self[name]]
        p95, greatest = self["deviation_p95_m"], self["deviation_max_m"]
        if not (p95 <= DEVIATION_P95_M and greatest <= DEVIATION_MAX_M):  # nor without any lane
            named = self["worst_deviations"]
            worst = f"; {_list('above 0.1 m (lanelet, m)', named)}" if named else ""
            found.append(f"deviation p95 {p95:.3f} m, max {greatest:.3f} m{worst}")
        width, floor = self["width_error_mean_m"], self["width_error_floor_m"]
        if width > max(WIDTH_ERROR_M, floor + WIDTH_SLACK_M):
            found.append(f"mean width error {width:.2f} m, {floor:.2f} m can be reached")
        hits, probes = self["probe_hits"], self["probes"]
        if probes - hits > max(1, (1 - PROBE_HIT_SHARE) * probes):
            lost = _list("lost (lanelet, points)", self["lost_probes"])
            found.append(f"moveToXY finds {hits} of {probes} centreline points; {lost}")
        return found + (self.driving.problems() if self.driving is not None else [])


def check_net(net_path: Path, road: Road, lanes: LaneNames | None = None) -> FidelityReport:
    """Judge a net against the map it should be; what the road itself lost of the map counts as not there.

    Args:
        net_path: a SUMO net in the map's coordinates (its own netOffset is taken off).
        road: the map.
        lanes: which SUMO lanes stand for which lanelet; None to find out by geometry.

    Raises:
        InputError: the file is no SUMO net.
        SimulationError: SUMO is not installed, or broke off.
    """
    matching = match_lanelets(read_net(net_path, road.georeference), road, lanes)
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
    """``2 things: a, b``."""
    named = ", ".join(_entry(entry) for entry in entries[:NAMED])
    return f"{len(entries)} {what}: {named}{', ...' if len(entries) > NAMED else ''}"


def _entry(entry: Any) -> str:
    if isinstance(entry, tuple):
        return "(" + ", ".join(_entry(value) for value in entry) + ")"
    return f"{entry:.2f}" if isinstance(entry, float) else str(entry)
