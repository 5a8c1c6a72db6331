"""The independent judge of a conversion: how faithful a SUMO net is to the Lanelet2 map it should be.

It reads the net's XML afresh and shares nothing with the net writer but the lane table, and even that is
optional, so nets from any other converter are judged by the same figures.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from scex_sumo.converters.fidelity.driving import DrivingReport, drive_net
from scex_sumo.converters.fidelity.geometry import GeometryFigures, judge_geometry
from scex_sumo.converters.fidelity.loading import LoadingFigures, judge_loading
from scex_sumo.converters.fidelity.matching import LaneNames, match
from scex_sumo.converters.fidelity.net import read_net
from scex_sumo.converters.fidelity.priority import PriorityFigures, judge_priority
from scex_sumo.converters.fidelity.topology import TopologyFigures, judge_topology
from scex_sumo.road import Road

__all__ = ["DrivingReport", "FidelityReport", "FidelityTargets", "check_net", "drive_net"]

WIDTH_SLACK_M = 0.2  # above what lanes of one width can reach on a map of tapering lanelets
NAMED = 6  # ids named in one problem; the rest are counted


@dataclass(frozen=True, kw_only=True)
class FidelityTargets:
    """What a faithful net reaches; everything counted must be complete.

    Attributes:
        deviation_p95_m: 95th percentile of the deviation.
        deviation_max_m: greatest deviation.
        width_error_mean_m: SUMO lanes have one width, lanelets any.
        probe_hit_share: share of centreline points where moveToXY finds the mapped lane.
    """

    deviation_p95_m: float = 0.01
    deviation_max_m: float = 0.10
    width_error_mean_m: float = 0.40
    probe_hit_share: float = 0.99


@dataclass(frozen=True, kw_only=True)
class FidelityReport:
    """All figures of one net against one map.

    Attributes:
        net: file name of the net.
        road: name of the map.
        table: whether a lane table was given; without one lanelets were found by geometry.
        geometry: where the lanes lie.
        topology: where they lead.
        priority: who gives way.
        loading: what SUMO says.
        driving: how SUMO's own vehicles fared, where they were asked to drive.
    """

    net: str
    road: str
    table: bool
    geometry: GeometryFigures
    topology: TopologyFigures
    priority: PriorityFigures
    loading: LoadingFigures
    driving: DrivingReport | None = None

    def to_dict(self) -> dict[str, Any]:
        """Every figure by its name, in one flat mapping that JSON takes."""
        figures: dict[str, Any] = {"net": self.net, "map": self.road, "lane_table": self.table}
        figures |= asdict(self.geometry) | asdict(self.topology)
        figures |= asdict(self.priority) | asdict(self.loading)
        figures["lanes_percent"] = _percent(self.geometry.lanes_present, self.geometry.lanelets)
        figures["speeds_percent"] = _percent(self.geometry.speeds_right, self.geometry.lanes_present)
        figures["probe_hit_percent"] = _percent(self.loading.probe_hits, self.loading.probes)
        if self.driving is not None:
            figures["driving"] = self.driving.to_dict()
        return figures

    def with_driving(self, driving: DrivingReport) -> FidelityReport:
        """The same report with how vehicles fared on the net."""
        return replace(self, driving=driving)

    def problems(self, targets: FidelityTargets | None = None) -> list[str]:
        """What the net misses, one line each, with the ids; empty for a faithful net."""
        wanted = targets if targets is not None else FidelityTargets()
        found = [*self._geometry_problems(wanted), *self._topology_problems(), *self._priority_problems()]
        found += self._loading_problems(wanted)
        return found + (self.driving.problems() if self.driving is not None else [])

    def _geometry_problems(self, wanted: FidelityTargets) -> list[str]:
        figures = self.geometry
        found = [
            _list("lanelets without a SUMO lane", figures.missing_lanes),
            _list("wrong speed limits (lanelet, map, net in m/s)", figures.wrong_speeds),
            _list(
                "edges whose length is not their lanes' (edge, length, lanes' mean)", figures.wrong_lengths
            ),
            _list("lanes against their lanelet", figures.reversed_lanes),
            _list("car lanes that stand for no lanelet", figures.invented_lanes),
            _list("lanelets closed to cars that became car lanes", figures.non_vehicle_as_cars),
            _list("lanes that run on beyond their lanelets (lane, m)", figures.overhangs),
        ]
        deviation = (figures.deviation_p95_m, figures.deviation_max_m)
        if not (deviation[0] <= wanted.deviation_p95_m and deviation[1] <= wanted.deviation_max_m):
            worst = _list("worst", figures.worst_deviations)
            found.append(f"deviation p95 {deviation[0]:.3f} m, max {deviation[1]:.3f} m; {worst}")
        least = max(wanted.width_error_mean_m, figures.width_error_floor_m + WIDTH_SLACK_M)
        if figures.width_error_mean_m > least:
            floor = figures.width_error_floor_m
            found.append(f"mean width error {figures.width_error_mean_m:.2f} m, {floor:.2f} m can be reached")
        return [line for line in found if line]

    def _topology_problems(self) -> list[str]:
        figures = self.topology
        found = [
            _list("successors without a connection", figures.missing_successors),
            _list("connections that the map does not have", figures.invented_successors),
            _list("routes that SUMO cannot drive", figures.missing_routes),
            _list("routes that the map forbids", figures.invented_routes),
            _list("permitted lane changes that are not possible", figures.missing_lane_changes),
            _list("forbidden lane changes that are possible", figures.invented_lane_changes),
        ]
        return [line for line in found if line]

    def _priority_problems(self) -> list[str]:
        figures = self.priority
        found = [
            _list("conflicting lanelets that are no foes", figures.missing_foes),
            _list("right of way against the map's rules (should yield, should go)", figures.wrong_priority),
            _list("not right before left (should yield, should go)", figures.wrong_from_the_right),
            _list("lanelets with a traffic light that nothing controls", figures.missing_signals),
            _list("foes that both have green", figures.clashing_greens),
            _list("links that yield to each other", figures.mutual_yields),
            _list("foes of which neither yields", figures.free_foes),
            _list("junctions whose rows contradict themselves", figures.inconsistent_rows),
        ]
        return [line for line in found if line]

    def _loading_problems(self, wanted: FidelityTargets) -> list[str]:
        figures = self.loading
        found = [
            _list("sumo says", figures.sumo_warnings),
            _list("sumolib says", figures.sumolib_warnings),
            _list("netconvert refuses the net", figures.netconvert_errors),
        ]
        if figures.probe_hits < wanted.probe_hit_share * figures.probes:
            lost = _list("lost (lanelet, points)", figures.lost_probes)
            found.append(f"moveToXY finds {figures.probe_hits} of {figures.probes} centreline points; {lost}")
        return [line for line in found if line]


def check_net(net_path: Path, road: Road, lanes: LaneNames | None = None) -> FidelityReport:
    """Judge a net against the map it should be.

    Args:
        net_path: a SUMO net in the map's coordinates (its own netOffset is taken off).
        road: the map.
        lanes: which SUMO lanes stand for which lanelet; None to find out by geometry.

    Raises:
        InputError: the file is no SUMO net.
        SimulationError: SUMO is not installed, or broke off.
    """
    net = read_net(net_path)
    matching = match(net, road, lanes)
    return FidelityReport(
        net=net_path.name,
        road=road.name,
        table=lanes is not None,
        geometry=judge_geometry(net, road, matching),
        topology=judge_topology(net, road, matching),
        priority=judge_priority(net, road, matching),
        loading=judge_loading(net, road, matching),
    )


def _percent(part: int, whole: int) -> float:
    return 100.0 * part / whole if whole else 100.0


def _list(what: str, entries: tuple[Any, ...]) -> str:
    """``2 things: a, b``; an empty text for none."""
    if not entries:
        return ""
    named = ", ".join(_entry(entry) for entry in entries[:NAMED])
    return f"{len(entries)} {what}: {named}{', ...' if len(entries) > NAMED else ''}"


def _entry(entry: Any) -> str:
    if isinstance(entry, tuple):
        return "(" + ", ".join(_entry(value) for value in entry) + ")"
    return f"{entry:.2f}" if isinstance(entry, float) else str(entry)
