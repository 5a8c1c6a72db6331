"""ScenarioNet scenarios (``sd_*.pkl``): map, tracks and lights of Waymo, nuPlan, nuScenes and others.

The pickles are read by an unpickler that admits NumPy arrays of numbers and text and plain containers only.
"""

from __future__ import annotations

import collections
import io
import math
import pickle
import pickletools
from collections.abc import Hashable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import InputError, MapError, TrackError, reason_of
from scex_sumo.converters.lanelet.tags import KMH, MPH
from scex_sumo.converters.naming import map_name, open_binary
from scex_sumo.converters.registries import Dataset, MapFormat, own_maps, with_notes
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.damage import MAX_ITEMS, refusing_damage
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, DrawnMap, drawn_road, polyline
from scex_sumo.formats.recognition import is_scenarionet
from scex_sumo.formats.samples.boxes import box_table
from scex_sumo.formats.samples.from_car import within_map
from scex_sumo.formats.spat import lane_programme
from scex_sumo.geometry.polylines import samples
from scex_sumo.lanelet2sumo.plan.elements import NetLayout, Programme
from scex_sumo.road import Road

FILLER_KMH = 100.0  # ScenarioNet writes it for lanes without a limit
PLAIN_KINDS = "biufSU"  # of NumPy types
MAX_BYTES = 2**31
_TOO_MANY = f"it holds more than {MAX_ITEMS} items, or a list holds itself"
_RELATIONS = ("exit_lanes", "entry_lanes", "left_neighbor", "right_neighbor")
_USERS = {"PEDESTRIAN": "pedestrian", "CYCLIST": "bicycle"}
_LIGHTS = {"FLASHING": "", "STOP": "r", "RED": "r", "CAUTION": "y", "YELLOW": "y", "GO": "G", "GREEN": "G"}


def unpickle(file: BinaryIO) -> Any:
    """Load a pickle of NumPy arrays and plain containers.

    Raises:
        pickle.UnpicklingError: the pickle names anything else, holds an array of objects, or would fill the
            memory.
    """
    raw, admitted = file.read(), _admitted()
    _check_opcodes(raw)

    class Restricted(pickle.Unpickler):
        def find_class(self, module: str, name: str) -> Any:
            if (module, name) not in admitted:
                raise pickle.UnpicklingError(
                    f"it names {module}.{name}; arrays and plain containers are read"
                )
            return admitted[module, name]

    content = Restricted(io.BytesIO(raw)).load()
    _count(content, {})
    return content


def _check_opcodes(raw: bytes) -> None:
    """Refuse opcodes that reserve memory, or build a key with more parts than can be hashed."""
    mark = pickletools.markobject
    stack: list[int | None] = []  # number of parts of each value; None is a mark
    memo: dict[int, int | None] = {}
    for count, (code, value, _) in enumerate(pickletools.genops(raw)):  # refuses lengths beyond the end
        if code.name.endswith("GET"):
            stack.append(memo[value or 0])
        elif code.name == "MEMOIZE" or code.name.endswith("PUT"):
            place = len(memo) if value is None else value
            if place > count:
                raise pickle.UnpicklingError(f"its memo has a place {place} after {count} opcodes")
            memo[place] = stack[-1]
        elif code.name == "MARK":
            stack.append(None)
        else:
            parts, below = 1, len(code.stack_before)
            if mark in code.stack_before:
                below = code.stack_before.index(mark)
                while (top := stack.pop()) is not None:
                    parts += top
            for _ in range(below):
                parts += stack.pop() or 0
            if parts > MAX_ITEMS:
                raise pickle.UnpicklingError(_TOO_MANY)
            stack += [parts] * len(code.stack_after)


def _count(value: Any, counts: dict[int, int]) -> int:
    """Number of items, letters and numbers in nested containers.

    Lists may share lists, so that few bytes hold more items than anybody can visit: each counts each time.
    """
    if isinstance(value, (str, bytes)):
        return 1 + len(value)
    if isinstance(value, np.ndarray):
        return 1 + value.size
    if not isinstance(value, (dict, list, tuple, set, frozenset)):
        return 1
    if id(value) in counts:
        return counts[id(value)]
    counts[id(value)] = MAX_ITEMS  # of a list that holds itself
    contents = (content for item in value.items() for content in item) if isinstance(value, dict) else value
    counts[id(value)] = total = 1 + sum(_count(content, counts) for content in contents)
    if total > MAX_ITEMS:
        raise pickle.UnpicklingError(_TOO_MANY)
    return total


def _admitted() -> dict[tuple[str, str], Any]:
    """Return what a pickle may name, made anew for each pickle, so that none changes it for another."""

    class Dtype:
        def __init__(self, spec: str, *_: Any) -> None:
            self.dtype = np.dtype(spec) if isinstance(spec, str) else np.dtype(object)
            if self.dtype.kind not in PLAIN_KINDS:
                raise pickle.UnpicklingError(f"it holds an array of {spec!r}; numbers and text are read")

        def __setstate__(self, state: tuple[Any, ...]) -> None:
            # NumPy's own would accept flags by which numbers count as pointers.
            if state[1] in ("<", ">"):
                self.dtype = self.dtype.newbyteorder(state[1])

    class Array(np.ndarray[Any, Any]):
        def __setstate__(self, state: tuple[Any, ...]) -> None:
            *_, shape, dtype, by_column, raw = state
            values = np.frombuffer(raw, dtype.dtype).reshape(shape, order="F" if by_column else "C")
            plain: Any = (1, values.shape, values.dtype, False, values.tobytes())
            super().__setstate__(plain)

    def array(*_: Any) -> Any:
        return np.zeros(0).view(Array)

    def scalar(dtype: Dtype, raw: bytes) -> Any:
        return np.frombuffer(raw, dtype.dtype, 1)[0]

    def from_buffer(raw: Any, dtype: Dtype, shape: tuple[int, ...], order: str) -> Any:
        return np.frombuffer(raw, dtype.dtype).reshape(shape, order="F" if order == "F" else "C")

    admitted: dict[tuple[str, str], Any] = {
        ("collections", "defaultdict"): lambda *_: {},  # without its factory
        ("builtins", "int"): None,
        ("_codecs", "encode"): lambda text, *_: text.encode("latin1"),  # bytes, as protocols 0 to 2 hold them
        ("__builtin__", "bytes"): lambda: b"",
        ("__builtin__", "set"): set,
        # An argument of `array`, not to be called: from raw bytes it would make pointers to objects.
        ("numpy", "ndarray"): None,
        ("numpy", "dtype"): Dtype,
        ("builtins", "set"): set,
        ("builtins", "frozenset"): frozenset,
        ("collections", "OrderedDict"): collections.OrderedDict,
    }
    for core in ("numpy.core", "numpy._core"):
        admitted[f"{core}.multiarray", "_reconstruct"] = array
        admitted[f"{core}.multiarray", "scalar"] = scalar
        admitted[f"{core}.numeric", "_frombuffer"] = from_buffer
    return admitted


def read_scenario(path: Path) -> dict[str, Any]:
    """Read a scenario of at most 2 GB; raises `InputError` if there is none."""
    scenario = _scenario(path, path.stat().st_mtime_ns)
    for key in ("tracks", "map_features", "metadata"):
        if not isinstance(scenario.get(key), dict):
            raise InputError(f"{path}: no scenario of ScenarioNet, it has no {key}; name a file sd_*.pkl")
    return scenario


@lru_cache(maxsize=2)
def _scenario(path: Path, _changed_ns: int) -> dict[str, Any]:
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"{path}: more than 2 GB; split the data set into scenarios")
    try:
        with open_binary(path) as file:
            scenario = unpickle(file)
    except InputError:
        raise
    except Exception as error:  # of any kind: the bytes of a pickle call constructors
        why = reason_of(error)[:200]
        raise InputError(f"{path}: no pickle that can be read ({why}); name a file sd_*.pkl") from None
    return dict(scenario) if isinstance(scenario, Mapping) else {}


def _read_road(path: Path, **_: Any) -> Road:
    with refusing_damage(MapError, path, "map of ScenarioNet"):
        scenario = read_scenario(path)
        # Singapore's limit in towns is Germany's.
        country = "sg" if "singapore" in str(scenario["metadata"].get("map")) else "us"
        return drawn_road(_drawn(path, scenario), name=_name(path), country=country)


def _drawn(path: Path, scenario: Mapping[str, Any]) -> DrawnMap:
    drawn = DrawnMap(path=path)
    features = {str(name): feature for name, feature in scenario["map_features"].items()}
    lanes = {name: lane for name, lane in features.items() if str(lane["type"]).startswith("LANE_")}
    numbered = all(name.isascii() and name.isdigit() for name in lanes)
    names: dict[str, Hashable] = {name: int(name) if numbered else name for name in lanes}
    limits = {name: _limit_mps(lane) for name, lane in lanes.items()}
    given = {limit for limit in limits.values() if limit is not None}
    if len(given) == 1 and abs(given.pop() / KMH - FILLER_KMH) < 0.1:
        drawn.remarks.append(f"{FILLER_KMH:g} km/h at every lane is ScenarioNet's word for no limit")
        limits = dict.fromkeys(limits)
    # nuScenes draws areas of lanes, but not of their connectors in intersections.
    areas = sum("polygon" in lane for lane in lanes.values()) > 0.2 * len(lanes)
    # Some converters write empty lists where they know of no relations.
    used = {key for key in _RELATIONS for lane in lanes.values() if key in lane and np.size(lane[key])}
    for name, lane in lanes.items():
        after, before, *beside = (_names(lane.get(key), names) if key in used else None for key in _RELATIONS)
        kind = str(lane["type"])
        inside = kind == "LANE_SURFACE_UNSTRUCTURE" or bool(lane.get("interpolating"))
        drawn.lanes.append(
            DrawnLane(
                name=names[name],
                centre=_line(lane.get("polyline", ())),
                width_m=_width_m(lane),
                kind="bicycle" if "BIKE" in kind else "bus" if "BUS" in kind else "vehicle",
                subtype="highway" if "FREEWAY" in kind else "road",
                location="" if "FREEWAY" in kind else "urban",
                limit_mps=limits[name],
                inside=inside or (areas and "polygon" not in lane),
                closed=tuple(side for side in ("left", "right") if _is_solid(lane, side)),
                successors=after,
                predecessors=before,
                left_neighbours=beside[0],
                right_neighbours=beside[1],
            )
        )
    for feature in features.values():
        kind = str(feature["type"])
        if kind == "CROSSWALK":
            drawn.crosswalks.append(_line(feature["polygon"]))
        elif kind == "STOP_SIGN":
            drawn.stops |= dict.fromkeys(_names(feature.get("lane"), names) or (), "stop")
        elif "LINE" in kind or "EDGE" in kind or "BOUNDARY" in kind:
            line = "LINE" in kind and "BOUNDARY" not in kind
            subtype = ("dashed" if "BROKEN" in kind else "solid") if line else ""
            points = _line(feature.get("polyline", ()))
            drawn.lines.append(("line_thin" if line else "road_border", subtype, points))
    for name, _, place in _lit(scenario):
        if name in names:
            drawn.lit[names[name]] = place
    return drawn


def _line(points: Any) -> FloatArray:
    """Points (P, 2) of a feature; the third column is a height in some data sets, a heading in others."""
    line = np.asarray(points, np.float64)
    return line.reshape(len(line), -1)[:, :2] if line.size else np.empty((0, 2))


def _names(names: Any, known: Mapping[str, Hashable]) -> list[Hashable] | None:
    """Return the lanes that a feature lists, as ids or dicts; None without a list."""
    if names is None:
        return None
    named = [item.get("feature_id", item.get("id")) if isinstance(item, Mapping) else item for item in names]
    return [known[str(name)] for name in named if str(name) in known]


def _is_solid(lane: Mapping[str, Any], side: str) -> bool:
    lines = [line for line in lane.get(f"{side}_boundaries") or () if isinstance(line, Mapping)]
    return bool(lines) and all("SOLID" in str(line.get("boundary_type")) for line in lines)


def _limit_mps(lane: Mapping[str, Any]) -> float | None:
    limits = ((lane.get("speed_limit_mph"), MPH), (lane.get("speed_limit_kmh"), KMH))
    known = ((float(limit), unit) for limit, unit in limits if limit is not None)
    return next((limit * unit for limit, unit in known if math.isfinite(limit) and limit > 0.0), None)


def _width_m(lane: Mapping[str, Any]) -> float:
    sides = np.asarray(lane.get("width", ()), np.float64)
    if sides.ndim == 2 and len(sides := sides[(sides > 0.1).all(axis=1)]):
        return float(np.median(sides.sum(axis=1)))
    line, ring = (polyline(_line(lane.get(key, ()))) for key in ("polyline", "polygon"))
    if len(ring) < 3 or len(line) < 2:
        return math.nan
    _, points = samples(line, 2.0)
    return 2.0 * float(np.median(shapely.distance(shapely.LinearRing(ring), shapely.points(points))))


def _lit(scenario: Mapping[str, Any]) -> Iterator[tuple[str, list[str], Any]]:
    for name, light in (scenario.get("dynamic_map_states") or {}).items():
        state = light["state"]
        lane, place = light.get("lane", name), light.get("stop_point")
        if "lane" in state:  # older files: for each time
            lane = next((lane_name for lane_name in np.ravel(state["lane"]) if lane_name), name)
        place = state.get("stop_point", [None])[0] if place is None else place
        place = place if len(polyline([place])) else None
        yield str(lane), [str(word) for word in state["object_state"]], place


def _read(path: Path) -> TrackTable:
    with refusing_damage(TrackError, path, "tracks of ScenarioNet"):
        scenario = read_scenario(path)
        names, kinds, values = _boxes(path, scenario)
        values[:, 1:3] -= _drawn(path, scenario).frame
        return box_table(path, names, kinds, values, ego=str(scenario["metadata"].get("sdc_id", "")))


def _boxes(path: Path, scenario: Mapping[str, Any]) -> tuple[list[str], dict[str, str], FloatArray]:
    names: list[str] = []
    kinds: dict[str, str] = {}
    parts: list[FloatArray] = [np.empty((0, 8))]
    for name, track in scenario["tracks"].items():
        state = track["state"]
        count = len(state["position"])
        kinds[str(name)] = kind = _kind(track)
        valid = np.asarray(state["valid"]).reshape(-1).astype(bool)
        if kind.isupper() or not valid.any():
            continue
        time = _times(path, scenario, count)
        unknown = np.full(count, np.nan)
        sizes = [np.asarray(state.get(side, unknown), np.float64) for side in ("length", "width")]
        columns = (
            1000.0 * time,
            *np.asarray(state["position"], np.float64)[:, :2].T,
            *np.asarray(state["velocity"], np.float64)[:, :2].T,
            np.asarray(state["heading"], np.float64).reshape(count),
            *(size.reshape(count) for size in sizes),
        )
        parts.append(np.stack(columns, axis=1)[valid])
        names += [str(name)] * int(valid.sum())
    return names, kinds, np.concatenate(parts)


def _times(path: Path, scenario: Mapping[str, Any], count: int) -> FloatArray:
    times = np.asarray(scenario["metadata"].get("ts", 0.1 * np.arange(count)), np.float64).reshape(-1)
    if len(times) != count:
        raise InputError(f"{path}: {len(times)} times in ts for {count} states; convert the data anew")
    return times


def _kind(track: Mapping[str, Any]) -> str:
    kind = str(track["type"])
    said = str(track.get("metadata", {}).get("type", "")).lower()
    if kind == "CYCLIST" and "motor" in said:
        return "motorcycle"
    if kind == "VEHICLE":
        return {"van": "car", "tram": "TRAM", "pedestrian": "car", "bicycle": "bicycle"}.get(
            user := road_user(said), user
        )
    return _USERS.get(kind, kind)


def _read_signals(layout: NetLayout, road: Road, path: Path) -> tuple[Programme | None, list[str]]:
    with refusing_damage(MapError, path, "lights of ScenarioNet"):
        scenario = read_scenario(path)
        ids = {str(name): number for name, number in _drawn(path, scenario).lane_ids().items()}
        runs = {}
        for name, words, _ in _lit(scenario):
            times = _times(path, scenario, len(words))
            letters = [next((_LIGHTS[state] for state in _LIGHTS if state in word), "") for word in words]
            if name in ids:
                runs[ids[name]] = list(zip((times - times[0]).tolist(), letters, strict=True))
        return lane_programme(layout, road, runs, path.name)


def _name(path: Path) -> str:
    return map_name(path).removeprefix("sd_")


SCENARIONET_MAP = MapFormat(is_mine=is_scenarionet, read=_read_road, tracks=lambda path: path, name=_name)
SCENARIONET = Dataset(
    is_mine=is_scenarionet,
    read=with_notes(_read),
    recordings=own_maps("scenarionet", _name),
    name=lambda path, files: _name(files[0]),
    within=within_map,
    signals=_read_signals,
)
