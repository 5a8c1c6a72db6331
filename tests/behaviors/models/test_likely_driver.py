"""Likely driver: drawn from a population, the same in every plan, as the last second shows."""

import dataclasses

import numpy as np
import pytest

from scex_sumo.behaviors.models.likely_driver import LikelyDriver, LikelyProfile
from scex_sumo.behaviors.models.likely_seen import shown_by
from scex_sumo.behaviors.models.population import normals, population, students, uniforms
from scex_sumo.behaviors.registry import SETS, parse_models
from scex_sumo.errors import UsageError
from scex_sumo.scene import Plan, SceneHistory, Who
