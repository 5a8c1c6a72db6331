"""Seed state: headings and speeds of the seed moment, from the past alone and without jitter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, seed_at
from scex_sumo.geometry.polylines import wrap
from scex_sumo.humans.observed.seed_state import estimated_history, estimated_scene
from scex_sumo.scene import SeedScene, States
from tests.behaviors import roads
from tests.seeds import long_recorded


def turning(speed: float = 10.0, yaw_rate: float = 0.3) -> SeedScene:
    """A vehicle on a circle, whose rear axle does not slip."""
    scene = roads.scene_of((0.0, 0.0, 0.0, speed), (80.0, 0.0, 0.0, 12.0))
    t = 0.1 * np.arange(-10, 1)
    radius, back = speed / yaw_rate, 0.3 * scene.length[0]
    heading = yaw_rate * t
    x, y = radius * np.sin(heading), radius * (1 - np.cos(heading))
    past = scene.history.map(np.copy)
    past.assign(
        0,
        States(
            x=x + back * np.cos(heading), y=y + back * np.sin(heading), heading=heading, speed=past.speed[0]
        ),
    )
    return replace(scene, history=past)


def jittered(scene: SeedScene, seed: int = 0) -> SeedScene:
    """Errors of boxes: 2° and 8° in every tenth sample, 0.1 m, 0.3 m/s."""
    rng, past = np.random.default_rng(seed), scene.history
    shape = past.x.shape
    outlier = np.deg2rad(8.0) * rng.choice([-1, 1], shape) * (rng.random(shape) < 0.1)
    return replace(
        scene,
        history=States(
            x=past.x + rng.normal(0, 0.1, shape),
            y=past.y + rng.normal(0, 0.1, shape),
            heading=past.heading + rng.normal(0, np.deg2rad(2.0), shape) + outlier,
            speed=past.speed + rng.normal(0, 0.3, shape),
        ),
    )


def test_states_without_noise_stay() -> None:
    scene = turning()
    made = estimated_scene(scene, roads.straight())
    assert np.rad2deg(np.abs(wrap(made.history.heading - scene.history.heading))).max() < 0.2
    assert np.abs(made.now.speed - scene.now.speed).max() < 0.01
    assert np.array_equal(made.history.x, scene.history.x)


def test_one_heading_that_jumps_moves_the_estimate_by_a_fraction() -> None:
    scene = turning()
    heading = scene.history.heading.copy()
    heading[0, -1] += np.deg2rad(8.0)
    made = estimated_scene(replace(scene, history=replace(scene.history, heading=heading)), roads.straight())
    assert abs(np.rad2deg(made.now.heading[0])) < 1.5


def test_a_box_askew_to_its_motion_is_turned_towards_it_if_the_positions_are_clean() -> None:
    scene = turning()
    askew = scene.history.heading + np.deg2rad(6.0)
    rng = np.random.default_rng(1)
    made = []
    for noise in (0.0, 0.1):
        past = replace(scene.history, heading=askew, y=scene.history.y + rng.normal(0, noise, askew.shape))
        now = estimated_scene(replace(scene, history=past), roads.straight()).now
        made.append(np.rad2deg(now.heading[0] - scene.now.heading[0]))
    assert abs(made[0]) < 1.0  # the true heading, on a circle, with the slip of the centre
    assert 4.0 < made[1] < 8.0


def test_a_box_that_was_the_wrong_way_round_is_turned() -> None:
    scene = turning()
    heading = scene.history.heading.copy()
    heading[:, :7] += np.pi
    made = estimated_scene(replace(scene, history=replace(scene.history, heading=heading)), roads.straight())
    assert np.rad2deg(np.abs(wrap(made.history.heading - scene.history.heading))).max() < 0.2


def test_a_correction_does_not_make_boxes_touch() -> None:
    # Two long boxes side by side, 0.1 m apart; the course of the first one would turn it into the second.
    scene = roads.scene_of((0.0, 0.0, 0.0, 10.0), (0.0, 1.9, 0.0, 10.0), length=12.0)
    past = scene.history.map(np.copy)
    past.y[0] += 0.1 * (np.arange(-10, 1))
    made = estimated_scene(replace(scene, history=past), roads.straight())
    assert made.now.heading[0] == 0.0


def test_the_estimate_takes_the_place_of_the_recorded_second_as_long_as_models_see_it() -> None:
    scene = jittered(turning())
    history = replace(roads.present(scene), step=4)
    seen = estimated_history(history, roads.straight())
    assert np.array_equal(
        seen.states.heading[0, :, :7], estimated_scene(scene, roads.straight()).history.heading[:, 4:]
    )
    assert np.array_equal(seen.states.heading[0, :, 7:], history.states.heading[0, :, 7:])


def test_jittered_copies_of_clean_recordings_come_back(data: Path) -> None:
    recording = next(r for r in find_recordings([data / "mona"]) if "Merge" in r.name)
    loaded = load_recording(recording)
    errors: dict[str, list[np.ndarray]] = {"before": [], "after": []}
    for number, time_s in enumerate(np.arange(20.0, 220.0, 10.0)):
        scene = long_recorded(seed_at(loaded, float(time_s)))
        noisy = jittered(scene, number)
        for name, one in (("before", noisy), ("after", estimated_scene(noisy, noisy.road))):
            off = np.rad2deg(wrap(one.now.heading - scene.now.heading)), one.now.speed - scene.now.speed
            errors[name].append(np.stack(off)[:, scene.now.speed > 3.0])
    before, after = (
        np.sqrt(np.mean(np.concatenate(e, axis=1) ** 2, axis=1)) for e in (errors["before"], errors["after"])
    )
    assert before[0] > 2.5 and after[0] < 1.4  # degrees
    assert after[1] < 0.75 * before[1]  # m/s
