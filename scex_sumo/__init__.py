"""Hundreds of futures of one moment of traffic, and how critical it can become.

The public names are loaded when they are first used, so that the import costs nothing.
"""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING, Any

from scex_sumo.base.version import __version__

if TYPE_CHECKING:
    from scex_sumo.base.errors import ScexError as ScexError
    from scex_sumo.base.errors import ScexWarning as ScexWarning
    from scex_sumo.base.options import option as option
    from scex_sumo.behaviors.base import Behavior as Behavior
    from scex_sumo.behaviors.registry import behavior as behavior
    from scex_sumo.behaviors.registry import parse_models as parse_models
    from scex_sumo.behaviors.spec import ModelSpec as ModelSpec
    from scex_sumo.certainty.results import Exact as Exact
    from scex_sumo.certainty.results import exact_of as exact_of
    from scex_sumo.certainty.results import weighted_probability as weighted_probability
    from scex_sumo.converters.datasets.find import find_recordings as find_recordings
    from scex_sumo.converters.datasets.recordings import LoadedRecording as LoadedRecording
    from scex_sumo.converters.datasets.recordings import load_recording as load_recording
    from scex_sumo.converters.datasets.recordings import recording_moments as recording_moments
    from scex_sumo.converters.datasets.recordings import seed_at as seed_at
    from scex_sumo.converters.lanelet.reader import read_road as read_road
    from scex_sumo.converters.maps import read_map as read_map
    from scex_sumo.converters.net.convert import convert as convert
    from scex_sumo.converters.net.sumo_net import SumoNet as SumoNet
    from scex_sumo.converters.registries import Recording as Recording
    from scex_sumo.converters.tracks.rows import TrackTable as TrackTable
    from scex_sumo.converters.tracks.rows import track_rows as track_rows
    from scex_sumo.exporters.scene_graph import plot_scene_graph as plot_scene_graph
    from scex_sumo.exporters.scene_graph import to_hetero_data as to_hetero_data
    from scex_sumo.exporters.scene_graph import to_networkx as to_networkx
    from scex_sumo.extrapolation.extrapolate import extrapolate as extrapolate
    from scex_sumo.extrapolation.extras import Extra as Extra
    from scex_sumo.extrapolation.extras import Work as Work
    from scex_sumo.extrapolation.settings import RunSettings as RunSettings
    from scex_sumo.formats.sumo.watch import Watch as Watch
    from scex_sumo.formats.sumo.watch import watch as watch
    from scex_sumo.learned.scene_graph.graph import SceneGraph as SceneGraph
    from scex_sumo.learned.scene_graph.graph import scene_graph as scene_graph
    from scex_sumo.learned.training.attention import plot_attention as plot_attention
    from scex_sumo.metrics.pairs.scenes import Samples as Samples
    from scex_sumo.metrics.pairs.scenes import Scenes as Scenes
    from scex_sumo.metrics.registry import metric as metric
    from scex_sumo.plug_in.inputs import Surroundings as Surroundings
    from scex_sumo.plug_in.predictor import Predictor as Predictor
    from scex_sumo.plug_in.user_model import predictor as predictor
    from scex_sumo.results.extras import ExactProbability as ExactProbability
    from scex_sumo.results.extras import Row as Row
    from scex_sumo.results.probability import Probability as Probability
    from scex_sumo.results.region import Region as Region
    from scex_sumo.results.run import Run as Run
    from scex_sumo.results.run import open_run as open_run
    from scex_sumo.road import Lane as Lane
    from scex_sumo.road import Road as Road
    from scex_sumo.scenarios import example_path as example_path
    from scex_sumo.scenarios.seeds import read_seed as read_seed
    from scex_sumo.scenarios.seeds import synthetic_seed as synthetic_seed
    from scex_sumo.scene import Plan as Plan
    from scex_sumo.scene import SceneHistory as SceneHistory
    from scex_sumo.scene import SeedScene as SeedScene
    from scex_sumo.scene import States as States
    from scex_sumo.scene import VehicleIndex as VehicleIndex
    from scex_sumo.studies.dataset_report import dataset_report as dataset_report
    from scex_sumo.studies.rank.rank import Ranking as Ranking
    from scex_sumo.studies.rank.rank import rank as rank
    from scex_sumo.studies.under_test.results import UnderTest as UnderTest
    from scex_sumo.studies.validate.validate import Validation as Validation
    from scex_sumo.studies.validate.validate import validate as validate

_HOMES = {
    "Behavior": "scex_sumo.behaviors.base",
    "Exact": "scex_sumo.certainty.results",
    "ExactProbability": "scex_sumo.results.extras",
    "Extra": "scex_sumo.extrapolation.extras",
    "Lane": "scex_sumo.road",
    "LoadedRecording": "scex_sumo.converters.datasets.recordings",
    "ModelSpec": "scex_sumo.behaviors.spec",
    "Plan": "scex_sumo.scene",
    "Predictor": "scex_sumo.plug_in.predictor",
    "Probability": "scex_sumo.results.probability",
    "Ranking": "scex_sumo.studies.rank.rank",
    "Recording": "scex_sumo.converters.registries",
    "Region": "scex_sumo.results.region",
    "Road": "scex_sumo.road",
    "Row": "scex_sumo.results.extras",
    "Run": "scex_sumo.results.run",
    "RunSettings": "scex_sumo.extrapolation.settings",
    "Samples": "scex_sumo.metrics.pairs.scenes",
    "SceneGraph": "scex_sumo.learned.scene_graph.graph",
    "SceneHistory": "scex_sumo.scene",
    "Scenes": "scex_sumo.metrics.pairs.scenes",
    "ScexError": "scex_sumo.base.errors",
    "ScexWarning": "scex_sumo.base.errors",
    "SeedScene": "scex_sumo.scene",
    "States": "scex_sumo.scene",
    "Surroundings": "scex_sumo.plug_in.inputs",
    "SumoNet": "scex_sumo.converters.net.sumo_net",
    "TrackTable": "scex_sumo.converters.tracks.rows",
    "UnderTest": "scex_sumo.studies.under_test.results",
    "Validation": "scex_sumo.studies.validate.validate",
    "VehicleIndex": "scex_sumo.scene",
    "Work": "scex_sumo.extrapolation.extras",
    "Watch": "scex_sumo.formats.sumo.watch",
    "behavior": "scex_sumo.behaviors.registry",
    "convert": "scex_sumo.converters.net.convert",
    "dataset_report": "scex_sumo.studies.dataset_report",
    "exact_of": "scex_sumo.certainty.results",
    "example_path": "scex_sumo.scenarios",
    "extrapolate": "scex_sumo.extrapolation.extrapolate",
    "find_recordings": "scex_sumo.converters.datasets.find",
    "load_recording": "scex_sumo.converters.datasets.recordings",
    "metric": "scex_sumo.metrics.registry",
    "open_run": "scex_sumo.results.run",
    "option": "scex_sumo.base.options",
    "parse_models": "scex_sumo.behaviors.registry",
    "plot_attention": "scex_sumo.learned.training.attention",
    "plot_scene_graph": "scex_sumo.exporters.scene_graph",
    "predictor": "scex_sumo.plug_in.user_model",
    "rank": "scex_sumo.studies.rank.rank",
    "read_map": "scex_sumo.converters.maps",
    "read_road": "scex_sumo.converters.lanelet.reader",
    "read_seed": "scex_sumo.scenarios.seeds",
    "recording_moments": "scex_sumo.converters.datasets.recordings",
    "scene_graph": "scex_sumo.learned.scene_graph.graph",
    "seed_at": "scex_sumo.converters.datasets.recordings",
    "synthetic_seed": "scex_sumo.scenarios.seeds",
    "to_hetero_data": "scex_sumo.exporters.scene_graph",
    "to_networkx": "scex_sumo.exporters.scene_graph",
    "track_rows": "scex_sumo.converters.tracks.rows",
    "validate": "scex_sumo.studies.validate.validate",
    "weighted_probability": "scex_sumo.certainty.results",
    "watch": "scex_sumo.formats.sumo.watch",
}

if "IPython" in sys.modules:  # runs and seed scenes are shown as HTML in a notebook
    importlib.import_module("scex_sumo.page.notebook").register()

__all__ = [*sorted(_HOMES), "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'scex_sumo' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
