"""ScenarioNet data set of futures, which MetaDrive replays: a pickle each, and the summary of the folder."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.version import __version__
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.exporters.request import Participant, Request
from scex_sumo.road import Lane, Road
from scex_sumo.scene import LOGGED_HISTORY, STEP_S

_LANES = {"vehicle": "LANE_SURFACE_STREET", "bicycle": "LANE_BIKE_LANE", "bus": "LANE_BUS_LANE"}
_USERS = {"pedestrian": "PEDESTRIAN", "bicycle": "CYCLIST"}
_EDGES = {"road_border", "curbstone", "guard_rail", "wall", "fence"}
_SOLID, _BROKEN = "ROAD_LINE_SOLID_SINGLE_WHITE", "ROAD_LINE_BROKEN_SINGLE_WHITE"


def write_scenarionet(request: Request) -> list[Path]:
    """Write each future from its first logged frame on; the ego, else the first vehicle, is the ``sdc``.

    Lights are not written, because a run does not record them.
    """
    road, files, summary = _features(request.road), [], {}
    for future in request.futures:
        name = request.file_stem(future)
        file = request.folder / f"sd_scex_{__version__}_{name}.pkl"
        scenario = _scenario(request, future, name)
        scenario["map_features"] = road
        request.write(file, pickle.dumps(scenario, protocol=4))
        summary[file.name] = scenario["metadata"]
        files.append(file)
    contents = {"dataset_summary.pkl": summary, "dataset_mapping.pkl": dict.fromkeys(summary, "")}
    for name, content in contents.items():
        request.write(request.folder / name, pickle.dumps(content, protocol=4))
        files.append(request.folder / name)
    return files


def _scenario(request: Request, future: int, name: str) -> dict[str, Any]:
    tracks: dict[str, dict[str, Any]] = {}
    for participant in request.participants(future):
        key, track = str(participant.label), _track(participant)
        if key in tracks:
            key = track["metadata"]["object_id"] = f"obstacle_{key}"
        tracks[key] = track
    steps, ego = request.states(future).shape[1], request.ego_index() or 0
    metadata = {"ts": STEP_S * np.arange(steps), "sample_rate": STEP_S, "metadrive_processed": False}
    metadata |= {"coordinate": "right-handed", "dataset": "scex-sumo", "id": name, "scenario_id": name}
    metadata |= {"map": request.road.name, "sdc_id": str(request.scene.track_ids[ego])}
    metadata["current_time_index"] = LOGGED_HISTORY - 1
    scenario = {"id": name, "version": f"scex-sumo {__version__}", "length": steps, "metadata": metadata}
    return {**scenario, "tracks": tracks, "dynamic_map_states": {}}


def _track(participant: Participant) -> dict[str, Any]:
    s, valid = participant.states, participant.present
    columns = {
        "position": np.stack([s.x, s.y, np.zeros(len(valid))], axis=1),
        "heading": s.heading,
        "velocity": np.stack([s.speed * np.cos(s.heading), s.speed * np.sin(s.heading)], axis=1),
    }
    columns |= {key: np.full(len(valid), getattr(participant, key)) for key in ("length", "width", "height")}
    state = {key: np.where(valid[(..., *[None] * (x.ndim - 1))], x, 0.0) for key, x in columns.items()}
    metadata: dict[str, Any] = {"type": participant.kind, "object_id": str(participant.label)}
    metadata |= {"track_length": len(valid), "dataset": "scex-sumo"}
    word = _USERS.get(road_user(participant.kind), "VEHICLE")
    return {"type": word, "state": {**state, "valid": valid.copy()}, "metadata": metadata}


def _features(road: Road) -> dict[str, Any]:
    features = {str(i): _lane(lane, road) for i, lane in road.lanes.items() if lane.kind in _LANES}
    for k, (kind, subtype, points) in enumerate((m.kind, m.subtype, m.points) for m in road.markings):
        word = "ROAD_EDGE_BOUNDARY" if kind in _EDGES else _BROKEN if subtype == "dashed" else _SOLID
        features[f"line_{k}"] = {"type": word, "polyline": points}
    walks = [area.outline for area in road.areas if area.kind == "crosswalk"]
    walks += [lane.outline for lane in road.lanes.values() if lane.subtype == "crosswalk"]
    for k, outline in enumerate(walks):
        features[f"crosswalk_{k}"] = {"type": "CROSSWALK", "polygon": outline}
    return features


def _lane(lane: Lane, road: Road) -> dict[str, Any]:
    sides = {"left": (lane.adjacent_left, lane.left), "right": (lane.adjacent_right, lane.right)}
    last = len(lane.centreline) - 1
    feature: dict[str, Any] = {
        "type": "LANE_FREEWAY" if lane.subtype == "highway" else _LANES[lane.kind],
        "polyline": np.column_stack([lane.centreline, np.zeros(last + 1)]),
        "polygon": lane.outline,
        "speed_limit_kmh": 3.6 * lane.speed_limit_mps,
        "entry_lanes": [str(i) for i in lane.predecessors],
        "exit_lanes": [str(i) for i in lane.successors],
    }
    for side, (beside, allowed) in sides.items():
        feature[f"{side}_neighbor"], feature[f"{side}_boundaries"] = [], []
        if beside is not None:
            whole = {"self_start_index": 0, "self_end_index": last, "neighbor_start_index": 0}
            end = len(road.lanes[beside].centreline) - 1
            feature[f"{side}_neighbor"] = [{"feature_id": str(beside), **whole, "neighbor_end_index": end}]
            kind = _SOLID if allowed is None else _BROKEN
            border = {"lane_start_index": 0, "lane_end_index": last, "boundary_type": kind}
            feature[f"{side}_boundaries"] = [border]
    return feature
