"""Parameters of the human-like driver: value, unit, meaning and source of each, in one frozen set.

*fitted* parameters have their values in ``parameters.json``, which ``benchmarks/calibrate_likely.py`` writes
from the training parts of INTERACTION, TAF-BW, MONA and NGSIM. The file may set any other number, too.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.models.idm import CALIBRATED, IdmProfile

SUMO_ACCELERATION_MPS2, SUMO_BRAKING_MPS2 = 2.6, 4.5  # of SUMO's default type
SHIPPED = Path(__file__).with_name("parameters.json")
IDM = replace(CALIBRATED, habit_memory=6.0)
MEAN_RANGES = ((-4, 4), (-4, 1.6), (-8, 8), (-2, 2), (-5, 10), (0, 4), (-6, 6))


@dataclass(frozen=True, kw_only=True, eq=False)
class HumanParameters:
    """Parameters of all drivers; what differs between drivers is drawn. Comments: unit | meaning | source."""

    # Variation: a drawn acceleration beyond the demanded one, by class of speed (2) and time (2)
    variation_mean: FloatArray  # m/s² | (2, 2, F) weights of ``mean_features`` | fitted
    variation_root: FloatArray  # m/s² | (2, 2, 2) lower triangular root of the scale matrix | fitted
    variation_skew: FloatArray  # 1 | (2,) log factor on accelerating draws, minus for braking | fitted
    variation_noise: FloatArray  # 1/(m/s²) | (2,) growth with the scatter, see `spread_factor` | fitted
    variation_growth: FloatArray  # 1 | (2,) growth with the other ``spread_features`` | fitted
    variation_times_s: tuple[float, ...] = (0.0, 3.0)  # s | times of the draws; linear between | chosen
    fast_mps: float = 7.0  # m/s | speed between the classes | chosen by CRPS
    max_variation_mps2: float = 5.0  # m/s² | limit of each draw | chosen
    relief_mps2: float = 3.0  # m/s² | demanded braking at which no driver adds an acceleration | chosen
    mean_ranges: tuple[tuple[float, float], ...] = MEAN_RANGES  # m/s², m/s | of ``mean_features`` | chosen
    max_size_mps2: float = 4.0  # m/s² | limit of the size of the acceleration in ``spread_features`` | chosen
    # Free road, leader, curve
    idm: IdmProfile = IDM  # see there | Intelligent Driver Model | calibrate.py; memory chosen by CRPS
    headway_log: FloatArray  # log s | mean and standard deviation | fitted
    most_headway_s: float = 4.0  # s | limit of the draws | chosen
    following_mps2: float = 3.3  # m/s² | comfortable braking behind a leader | chosen by CRPS
    headway_kept: float = 0.9  # 1 | largest share of the shown headway that a driver keeps | chosen
    extra_braking_mps2: float = 0.8  # m/s² | beyond the necessary, for a leader | chosen by CRPS
    min_room_m: float = 0.1  # m | least gap beyond the minimum gap in the necessary braking | chosen
    max_acceleration_mps2: float = 4.0  # m/s² | limit | chosen
    max_braking_mps2: float = 4.0  # m/s² | limit without a conflict | chosen
    far_leader_m: float = 50.0  # m | a leader beyond this does not influence the variation | chosen
    rest_m: float = 2.2  # m | gap to a leader at rest, or the shown one | fitted: rules.py rest
    # Shown motion: what the last second says
    habit_s: float = 2.0  # s | time constant of the shown acceleration | chosen by CRPS
    sudden_s: float = 0.7  # s | time constant of its sudden part | chosen by error
    half_trust_mps2: float = 0.7  # m/s² | scatter at which an acceleration counts by half | chosen
    max_scatter_mps2: float = 0.7  # m/s² | more scatter makes no difference | chosen
    lasting_mps2: float = 0.5  # m/s² | least scatter in the limit large² / hypot(scatter, lasting) | chosen
    large_mps2: float = 1.0  # m/s² | scale of that limit of shown accelerations | chosen
    noisy_mps2: float = 0.1  # m/s² | noise of single steps at which the last one counts by half | chosen
    limit_ahead_m: float = 10.0  # m | place ahead of the speed limit in ``mean_features`` | chosen
    easy_mps2: float = 2.0  # m/s² | comfortable lateral acceleration in ``mean_features`` | chosen
    curve_ahead_s: float = 2.0  # s | place ahead of the curve in ``mean_features`` | chosen
    free_exponent: float = 4.0  # 1 | of v/v0 on the free road | Treiber, Hennecke, Helbing 2000
    # Leaders
    clearance_m: float = 1.2  # m | of another vehicle's centre from the line that a driver keeps | chosen
    corridor_margin_m: float = -0.2  # m | measured boxes of vehicles side by side may touch | chosen
    along_cos: float = 0.5  # 1 | cosine of heading against path below which a vehicle crosses | chosen
    clear_s: float = 1.0  # s | by which a crossing vehicle leaves before the driver arrives | chosen
    # Standing and starting
    standing_mps: float = 0.5  # m/s | a slower vehicle stands | chosen
    starting_mps: float = 0.02  # m/s | a vehicle that gained this in the last step has started | chosen
    start_weights: FloatArray  # log 1/s | (5,) of `start_features` | fitted
    start_within_s: float = 4.0  # s | time for which the fitted rate counts | chosen
    start_wave_s: float = 1.0  # s | mean time from the leader's start to the own one | chosen
    pull_spread: float = 0.35  # 1 | deviation of the log of starting accelerations | chosen: INTERACTION
    queue_m: float = 15.0  # m | a leader nearer than this holds a standing vehicle | chosen
    queue_start_mps2: float = 2.4  # m/s² | largest acceleration of one that leaves a queue | chosen
    queue_start_mps: float = 3.0  # m/s | largest speed of one that leaves a queue | chosen
    crawl_s: float = 0.5  # s | time constant towards the crawling speed | chosen
    yellow_mps2: float = np.inf  # m/s² | braking that is enough to stop at yellow; inf: by time | chosen
    line_gap_m: float = 0.5  # m | to a place where rules make it stop | chosen
    # Place in the lane
    lateral_s: float = 3.0  # s | time after which the wanted offset is reached | chosen
    keep_weights: FloatArray  # 1, s, s², m², m² | (5,) of ``lateral``, ``bends`` for the offset then | fitted
    keep_scale_m: float  # m | scale of its deviation | fitted
    keep_growth: FloatArray  # 1 | (3,) growth with `keep_features` | fitted
    max_bend: float = 0.15  # 1/m | sharper bends make no difference | chosen
    max_offset_m: float = 1.75  # m | from the path, for a vehicle that keeps a lane of usual width | chosen
    max_spare_m: float = 6.0  # m | more room beyond that makes no difference | chosen
    max_turning_m: float = 6.0  # m | the same off the mapped lanes | chosen
    max_lateral: float = 1.5  # m/s, m/s² | across a path; larger values are errors of measurement | chosen
    max_speed_mps: float = 20.0  # m/s | a higher speed makes no difference | chosen
    # Lane change
    change_weights: FloatArray  # log odds | (7,) of `change_features` | fitted
    change_target: FloatArray  # 1, 1, s | (3,) of lane distance, offset, lateral speed | fitted
    change_scale_m: float  # m | scale of its deviation | fitted
    max_change_m: float = 5.0  # m | from the path | chosen
    change_speed_mps: float = 3.0  # m/s | slower vehicles do not change | chosen
    lane_width_m: float = 3.2  # m | way of a change if no lane is mapped | chosen
    lane_ahead_s: tuple[float, float] = (0.5, 3.0)  # s | a lane counts if it is beside there | chosen
    lane_beside_m: tuple[float, float] = (1.5, 5.0)  # m | distance of its centreline from the path | chosen
    occupied_s: float = 2.0  # s | a vehicle that will be beside by then occupies the lane | chosen
    occupied_along_m: float = 1.0  # m | least distance between bodies, along the way | chosen
    occupied_across_m: float = 2.5  # m | beside a vehicle; one further away is on a third lane | chosen
    occupied_headway_s: float = 0.3  # s | smaller headways, ahead or behind, are no gap | chosen
    occupied_min_share: float = 0.2  # 1 | least probability of a change to an occupied lane | chosen
    lateral_doubt: float = 8.0  # 1/(m/s²) | lateral motion counts by 0.7 at a scatter of 1 / this | chosen
    # Path
    path_costs: FloatArray  # 1 | (5,) of `path_features` | fitted
    turn_goes_on_s: float = 1.5  # s | for which the shown turn goes on in them | chosen by likelihood
    max_turn_rad_s: float = 1.0  # rad/s | limit of that turn | chosen
    turn_mps2: float = 3.0  # m/s² | lateral acceleration in turns | chosen
    turn_range_m: tuple[float, float] = (2.0, 50.0)  # m | way to them: least that counts, most | chosen
    missing_range_mps2: tuple[float, float] = (-3.0, 2.0)  # m/s² | of the shown acceleration there | chosen
    max_missing_mps2: float = 2.0  # m/s² | more missing braking excludes a path no further | chosen
    # Attention: 20 % of the time are glances; 3 % of them last longer than 1.7 s, as those before crashes do
    glance_every_s: float = 3.9  # s | one glance begins in each | share of time: Morando, Victor, Dozza 2020
    glance_s: float = 0.7  # s | median duration | tail: Liang, Lee, Horrey 2014; value chosen
    glance_spread: float = 0.48  # 1 | deviation of its logarithm | shape: Taoka 1990; value chosen
    reaction_s: float = 0.9  # s | time from seeing to acting | 0.7 (expected) to 1.25 s (not): Green 2000
    watching_mps2: float = 0.3  # m/s² | braking that forbids a glance | Tijerina et al. 2004; value chosen
    watching_gap_m: float = 0.5  # m | least gap in it | chosen
    # Yielding: braking for conflicts
    conflict_margin_m: float = 0.15  # m | of a planned way beyond the width, on each side | chosen
    alongside_margin_m: float = 0.05  # m | the same for vehicles alongside or oncoming | chosen
    conflict_margin_s: float = 0.3  # s | between two at a crossing | chosen
    contact_s: float = 2.4  # s | time for which planned boxes must not touch expected ones | chosen
    touching_m: float = 1e-3  # m | nearer in the seed scene: trailers, overlapping tracks; ignored | chosen
    order_margin_m: float = 1.0  # m | at a crossing; closer cases go by number | chosen
    order_margin_mps2: float = 0.3  # m/s² | of needed braking: the one that needs less gives way | chosen
    yielding_mps2: float = 5.5  # m/s² | limit of braking for vehicles that are not there yet | chosen
    leader_braking_mps2: float = 4.0  # m/s² | limit of the braking of leaders that goes on | chosen
    ahead_s: float = 0.5  # s | with that braking: length of the way beyond the plan | chosen
    release_mps2: float = 2.0  # m/s² | acceleration back to a planned speed | chosen
    onset_mps2: float = 0.8  # m/s² | needed braking for a response | chosen by error and coverage
    safe_onset: float = 3.0  # 1 | factor if both miss each other with constant velocity | chosen
    looming_mps2: float = 2.0  # m/s² | onset if looking away | Lamble et al. 1999; value chosen
    conflict_braking_mps2: float = 8.0  # m/s² | limit | chosen
    entry_gap_m: float = 1.0  # m | to a vehicle that merges in front | chosen
    stop_gap_m: float = 0.6  # m | to a conflict, beyond that of the guard | chosen
    fall_back_m: float = 3.0  # m | overlap up to which a driver falls back behind one that closes in | chosen
    crossing_s: float = 1.0  # s | before one that crosses: a driver stays out of its way | chosen
    creep_s: float = 1.0  # s | time constant of closing a smaller gap | chosen
    creep_gap_m: float = 0.0  # m | gap that creeping ends at | chosen
    beside_gap_m: float = 0.3  # m | between boxes beside each other | chosen
    passing_gap_m: float = 1.0  # m | to people beside, if 0.5 m aside is enough | chosen
    max_slope: float = 0.3  # 1 | of the way across over the way along | chosen

    @classmethod
    def read(cls, path: Path) -> HumanParameters:
        """Read fitted and changed values from a JSON file."""
        given = json.loads(path.read_text(encoding="utf-8"))
        values: dict[str, Any] = {
            name: np.array(value) if isinstance(value, list) else value for name, value in given.items()
        }
        return cls(**values)


@cache
def simulated(human: HumanParameters) -> HumanParameters:
    """Return the parameters for traffic of SUMO, which has no habits: it drives as its default type may.

    It gains speed evenly up to its limit, with ``accel`` (chosen: `rules.py simulated` at 5 s), keeps to
    the middle of its lane, stops at yellow if ``decel`` is enough, and leaves people no room.

    Source: SUMO's documentation: accel, decel, sigma of passenger cars; junctions.limit-turn-speed.
    """
    idm = replace(
        human.idm,
        max_acceleration=SUMO_ACCELERATION_MPS2,
        curve_acceleration=5.5,
        curve_deceleration=SUMO_BRAKING_MPS2,
        habit_memory=0.0,
    )
    return replace(
        human,
        idm=idm,
        free_exponent=20.0,
        yellow_mps2=SUMO_BRAKING_MPS2,
        following_mps2=SUMO_BRAKING_MPS2,
        habit_s=0.5,
        sudden_s=0.3,
        # Both ends of its vehicles are on the lane: a heading across it in a bend is no motion across it.
        max_lateral=0.0,
        keep_scale_m=0.02,
        passing_gap_m=human.beside_gap_m,
    )


@cache
def human_parameters() -> HumanParameters:
    """Return the shipped parameters."""
    return HumanParameters.read(SHIPPED)
