"""Obedience of human-like drivers: lights, priority and crosswalks, with rare violations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.draws import normal_quantiles, uniforms
from scex_sumo.humans.observed.observations import View
from scex_sumo.road_rules import Rules
from scex_sumo.rules.holds import Manner, Obeyed, lights, obeyed
from scex_sumo.rules.passages import Lit, traffic_on

GIVES_WAY, LIGHTS, CHANGES, STOPS = 80_000, 80_001, 80_002, 80_003  # salts of draws
RELEASE = 81_000  # the same; each plan has its own


@dataclass(frozen=True, kw_only=True)
class RuleParameters:
    """Parameters of obedience. Comments: unit | meaning | source."""

    yellow_s: float = 4.0  # s | time to the line at which half of the drivers stop at yellow | 10 % stop at
    yellow_scale_s: float = 0.68  # s | scale of that logistic | 2.5 s, 90 % at 5.5 s: Zegeer and Deen 1978
    latest_s: float = 3.2  # s | nobody else hopes to enter later after yellow begins, of 3 s | chosen
    red_mps2: float = 4.5  # m/s² | hardest braking for red of a driver that does not brake yet | chosen
    runs_red: float = 0.004  # 1 | share that enters in early red | Bonneson and Zimmerman 2004
    early_red_s: float = 2.0  # s | the same: time of early red | the same: 95 % of 541 violations
    ignores: float = 0.001  # 1 | share that does not give way | chosen
    gap_factor: float = 0.35  # 1 | median factor on critical headways | chosen: INTERACTION, training parts
    gap_spread: float = 0.2  # 1 | standard deviation of its logarithm | chosen
    priority_mps2: float = 3.0  # m/s² | hardest braking to give way | chosen
    rolls_mps: float = 2.5  # m/s | speed at which drivers roll over the line of a stop sign | chosen
    start_s: float = 1.0  # s | mean time from green, or a gap, to the start | HCM 7: start-up lost time 2 s
    change_s: float = 20.0  # s | mean time to an unknown light's green | chosen: half a red of 40 s
    held_m: float = 5.0  # m | a vehicle that stands nearer before its place to stop waits for it | chosen


RULE_PARAMETERS = RuleParameters()


def _logit(share: FloatArray) -> FloatArray:
    share = np.clip(share, 1e-6, 1 - 1e-6)
    return np.asarray(np.log(share / (1 - share)))


def manner_of(draw: FloatArray, spread: float) -> Manner:
    """Draw how drivers obey, by (n,) draws; with ``spread`` 0 the median driver, which violates nothing."""
    given, (yellow, red) = RULE_PARAMETERS, uniforms(draw, 2, STOPS).T
    _, _, priority, gap = uniforms(draw, 4, GIVES_WAY).T  # the first two are those of late responses
    runs = (red < given.runs_red) & (spread > 0)
    waits_s = given.yellow_s + min(spread, 1.0) * given.yellow_scale_s * _logit(yellow)
    return Manner(
        priority=(priority >= given.ignores) | (spread == 0),
        yellow_mps2=np.inf,
        yellow_s=np.where(runs, np.inf, np.minimum(waits_s, given.latest_s)),
        red_mps2=given.red_mps2,
        red_delay_s=np.where(runs, given.early_red_s, 0.0),
        gaps=given.gap_factor * np.exp(min(spread, 1.0) * given.gap_spread * normal_quantiles(gap)),
        priority_mps2=given.priority_mps2,
        stands_mps=given.rolls_mps,
        ready=True,
    )


def obedience(view: View, rows: IntArray, spread: float) -> Obeyed:
    """Return where drivers have to stop, and where lights are green; ``rows`` (C, V): paths of all."""
    history, vehicles, human = view.history, view.vehicles, view.human
    rules = history.scene.rules
    assert rules is not None
    manner = manner_of(history.route_draw[vehicles.future, vehicles.vehicle], spread)
    if np.isfinite(human.yellow_mps2):
        yellow_s = np.where(np.isinf(manner.yellow_s), np.inf, 0.0)
        manner = replace(manner, yellow_mps2=human.yellow_mps2, yellow_s=yellow_s)
    traffic = traffic_on(history, view.paths, rows)
    return obeyed(view.on_path, traffic, manner, _lights(view, rules, spread))


def _lights(view: View, rules: Rules, spread: float) -> Lit:
    """Return the lights now; unknown ones are drawn, the same for all vehicles of a future."""
    history, given = view.history, RULE_PARAMETERS
    if not spread or all(signal.letters for signal in rules.signals):
        return lights(history, view.paths)
    from scex_sumo.rules.inferred import drawn_lights

    draw, count = history.route_draw[:, 0], len(rules.signals)
    noise = _logit(uniforms(draw, count, LIGHTS))
    change_s = -given.change_s * np.log(uniforms(draw, count, CHANGES))
    return drawn_lights(history, view.paths, rules, noise, change_s)


def waits_for(rules: Obeyed, view: View, waits_s: FloatArray, free: BoolArray) -> FloatArray:
    """Return (n,) times for which vehicles stand, s: at a place to stop until it is free, then not for long.

    ``waits_s``: (n,) without rules; ``free``: (n,) whether the passage of the first in a queue, or the way of
    the others, is free.
    """
    draw = view.history.route_draw[view.vehicles.future, view.vehicles.vehicle]
    soon = -RULE_PARAMETERS.start_s * np.log(uniforms(draw, 1, RELEASE + view.history.step)[:, 0])
    waits_s = np.where((waits_s > 0) & free, np.minimum(waits_s, soon), waits_s)
    return np.where((waits_s > 0) & (rules.hold < RULE_PARAMETERS.held_m), np.inf, waits_s)
