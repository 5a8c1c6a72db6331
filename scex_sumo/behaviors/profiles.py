"""Defaults of every model, in one table.

``standard_driver`` and ``risky_driver`` are the two profiles of the scene extrapolation paper (Zipfl,
Schütt, Zöllner 2024); it does not state a_max, ours is 1.5 m/s² for the standard and 3.0 m/s² for the risky
driver. ``calibrated_driver`` follows its own lane only and slows down for curves, as people do; its numbers
are what ``benchmarks/calibrate.py`` fits to the training part of TAF-BW and MONA, but for the clearance and
the memory, which three seconds of driving do not tell.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from scex_sumo.behaviors.guard.profile import GuardProfile
from scex_sumo.behaviors.learned.profiles import GraphImagePredictorProfile, GraphPredictorProfile
from scex_sumo.behaviors.models.constant_velocity import ConstantVelocityProfile
from scex_sumo.behaviors.models.emergency_brake import EmergencyBrakeProfile
from scex_sumo.behaviors.models.idm_profile import CALIBRATED, IdmProfile
from scex_sumo.behaviors.models.likely_driver import LikelyProfile
from scex_sumo.behaviors.models.replay import ReplayProfile

DEFAULTS: Mapping[str, Any] = MappingProxyType(
    {
        "standard_driver": IdmProfile(
            comfort_deceleration=3.0,
            time_headway=3.1,
            minimum_gap=9.0,
            max_acceleration=1.5,
            clearance=5.0,
        ),
        "risky_driver": IdmProfile(
            comfort_deceleration=8.0,
            time_headway=2.1,
            minimum_gap=5.0,
            max_acceleration=3.0,
            clearance=5.0,
        ),
        "calibrated_driver": CALIBRATED,
        "likely_driver": LikelyProfile(),
        "constant_velocity": ConstantVelocityProfile(),
        "emergency_brake": EmergencyBrakeProfile(deceleration=5.0),
        "graph_predictor": GraphPredictorProfile(),
        "graph_image_predictor": GraphImagePredictorProfile(),
        "replay": ReplayProfile(),
    }
)

GUARDS: Mapping[str, GuardProfile] = MappingProxyType(
    {
        "likely_driver": GuardProfile(
            comfort_deceleration=6.5,
            reaction_time=0.2,
            minimum_gap=0.3,
            margin=0.15,
            alongside_margin=0.05,
            time_margin=0.3,
            touching=0.3,
        )
    }
)
"""Guards that are not the default one: people drive nearer to each other than that one lets them."""
