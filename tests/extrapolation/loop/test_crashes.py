"""After a collision: a plastic impact, sliding to rest, and contacts that follow from it counted apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.extrapolation.loop.crashes import CRASH_MPS2, slide
from scex_sumo.metrics.collisions import CONTACT_M2, Contacts, find_collisions
from scex_sumo.scene import States
from tests.metrics.straight import straight
from tests.queues import queues
from tests.runs import extrapolate


def test_a_vehicle_slides_to_rest_with_the_deceleration_of_sliding_tyres() -> None:
    now = States(x=np.zeros(1), y=np.ones(1), heading=np.array([np.pi / 2]), speed=np.full(1, 10.0))
    motion = slide(now, now.speed, 30)
    assert motion.speed[0, 0] == pytest.approx(10 - 0.1 * CRASH_MPS2)
    assert motion.y[0, -1] == pytest.approx(1 + 100 / (2 * CRASH_MPS2))  # v²/2a
    assert motion.speed[0, -1] == 0 and motion.x[0] == pytest.approx(np.zeros(30))


def test_steps_have_the_contacts_of_the_whole_tracks() -> None:
    rng = np.random.default_rng(3)
    vehicles = [
        {"x": x, "y": y, "heading": heading, "speed": speed}
        for x, y, heading, speed in zip(
            *rng.uniform((-20, -20, -3, 0), (20, 20, 3, 14), (24, 4)).T, strict=True
        )
    ]
    tracks = straight(*vehicles)
    found = find_collisions(tracks, limit_m2=CONTACT_M2)
    contacts = Contacts(tracks.states[0, 0], tracks.length, tracks.width)
    seen = set()
    for step in range(1, tracks.states.shape[1]):
        _, one, other = contacts.in_step(tracks.states[:, step - 1], tracks.states[:, step])
        seen |= {(step, *pair) for pair in zip(one.tolist(), other.tolist(), strict=True)}
    pairs = np.sort([found.first, found.second], axis=0)
    assert len(found) > 5 and {pair[1:] for pair in seen} == set(zip(*pairs.tolist(), strict=True))
    assert set(zip(found.step.tolist(), *pairs.tolist(), strict=True)) <= seen


QUEUE = {
    "metrics": ["gap"],
    "world": "plain",
    "futures": "all",
    "models": "constant_velocity,emergency_brake",
}


def test_a_pile_up_is_one_collision_and_its_consequences(tmp_path: Path) -> None:
    """Three in a row, 2 m apart, the first one brakes: 2 hits 1, then 3 hits 2."""
    run = extrapolate(queues(3, gap_m=2.0), out=tmp_path / "run", steps=60, **QUEUE)
    hits = run.collisions.to_pylist()
    piled = [future for future in range(8) if run.models_of(future)[0] == "emergency_brake"]
    piled = [future for future in piled if run.models_of(future)[1:] == ["constant_velocity"] * 2]
    found = [(hit["track_id"], hit["other_id"], hit["consequence"]) for hit in hits if hit["future"] in piled]
    assert found == [(2, 1, False), (3, 2, True)]
    row = next(row for row in run.encounters.to_pylist() if {row["track_id"], row["other_id"]} == {3, 2})
    brakes = sum(run.models_of(f)[1:] == ["emergency_brake", "constant_velocity"] for f in range(8))
    assert (row["collision"], row["consequence"]) == (brakes / 8, 1 / 8)
    states = run.states(piled[0])
    first, second = states.speed[:2]
    after = int(np.flatnonzero(np.abs(np.diff(second)) > 0.1)[0]) + 1
    # equal masses: both have the mean speed after the impact, and stand after v / 0.7 g
    assert second[after] == pytest.approx(first[after], abs=CRASH_MPS2 * 0.1)
    assert (states.speed[:, -1] == 0).all()
