"""Fits the parameters of likely_driver to recordings and writes ``scex_sumo/humans/parameters.json``.

    python benchmarks/calibrate_likely.py [--data FOLDER] [-o FILE] [--leave-out FOLDER]

From the training part by time of the sites of INTERACTION, of TAF-BW and MONA, and from the NGSIM files that
are not kept for tests (``benchmarks/recorded_scenes.py`` names them). Every vehicle is put on the path that
it took; what it did beyond what `LikelyDriver` asks of it (its leader as it really drove) is written as an
acceleration of its own in each of three seconds, by least squares over the 30 steps. By class of speed these
are regressed on what the seed scene shows (ridge), and what is left gives the scale of a Student distribution
of four degrees: its quartiles' width by direction, so that a few mistracked vehicles do not set it. Headways,
starts from standing, stops of creeping vehicles, offsets from the path, lane changes and the choice of path
are counted from the same vehicles. ``--leave-out`` writes a file for each set, fitted to the others.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from likely_accelerations import BRAKING, HABIT_S, NODES, SPEED_EDGES, accelerations_of, headway_of, settled
from likely_choices import (
    Choice,
    changes_of,
    choices_of,
    comes_to_rest,
    offsets_of,
    paths_of,
    starts_of,
    stops_of,
)
from likely_samples import HUMAN, Manner, Samples, joined, kept, samples_of, weighted
from recorded_scenes import EVERY_S, recorded_parts, smoothed

from scex_sumo.humans.parameters import SHIPPED
from scex_sumo.scene import SeedScene

NOISY_MPS2 = 0.1  # a set whose accelerations scatter by more is noisy


@dataclass(frozen=True, kw_only=True)
class Collected:
    """Vehicles and their choices of path of one data set.

    Accelerations of noisy sets are fitted to their smoothed recordings, too: so does noise show, which the
    same people made neither more nor less.
    """

    whole: Samples  # also those that left their path
    calm: Samples  # of the smoothed recordings, if they are noisy
    choices: Sequence[Choice]
    moments: int

    @classmethod
    def of(cls, scenes: Sequence[SeedScene]) -> Collected:
        found = [(samples_of(scene), list(choices_of(scene))) for scene in scenes]
        whole = Samples.joined([samples for samples, _ in found if samples is not None])
        near = kept(whole)
        scatter = np.median(near.spread_features[near.speed >= HUMAN.standing_mps, 0])
        return cls(
            whole=whole,
            calm=kept(joined(map(smoothed, scenes))) if scatter > NOISY_MPS2 else near,
            choices=[choice for _, each in found for choice in each],
            moments=len(scenes),
        )


def fit(sets: Sequence[Collected]) -> dict[str, object]:
    """The fitted parameters, as in `scex_sumo.humans.parameters.HumanParameters`.

    A data set counts as the square root of its vehicles: the largest shall not decide alone. For changes of
    lane, which are rare, every vehicle counts the same.
    """
    every = Samples.joined([part.whole for part in sets])
    change, change_to, change_m = changes_of(every.part(every.speed >= HUMAN.change_speed_mps))
    found = [kept(part.whole) for part in sets]
    samples, weight = weighted(found)
    print(f"{sum(part.moments for part in sets)} moments, {len(samples.speed)} vehicles")
    log_headway = headway_of(samples)
    moving = samples.speed >= HUMAN.standing_mps
    keeps_side, side = offsets_of(samples.part(moving), weight[moving])
    both, share = weighted([*found, *(part.calm for part in sets)])
    moving = (both.speed >= HUMAN.standing_mps) & ~comes_to_rest(both)
    driving, share = both.part(moving), share[moving]
    begun = dataclasses.replace(
        HUMAN, headway_log=np.array(log_headway), braking_log=np.array(BRAKING), habit_s=HABIT_S
    )
    manner = Manner.of(driving.headway, begun, np.zeros((len(driving.speed), 2)))
    mean, root, grows = accelerations_of(driving, manner, share / share.mean())
    regressed = dataclasses.replace(
        begun,
        speed_edges=np.array(SPEED_EDGES),
        variation_mean=mean,
        variation_root=root,
        variation_noise=grows[:NODES],
        variation_growth=grows[NODES:],
        variation_skew=np.zeros(len(mean)),
    )
    known = settled(regressed, driving, share)
    return {
        "speed_edges": SPEED_EDGES,
        "variation_mean": known.variation_mean.round(4).tolist(),
        "variation_root": known.variation_root.round(4).tolist(),
        "variation_noise": grows[:NODES].round(4).tolist(),
        "variation_growth": grows[NODES:].round(4).tolist(),
        "variation_skew": known.variation_skew.round(4).tolist(),
        "headway_log": [round(v, 4) for v in log_headway],
        "start_weights": starts_of(samples, weight).round(4).tolist(),
        "stop_weights": stops_of(samples, weight).round(4).tolist(),
        "habit_s": HABIT_S,
        "braking_log": [round(v, 4) for v in BRAKING],
        "keep_weights": keeps_side.round(4).tolist(),
        "keep_scale_m": round(side[0], 4),
        "keep_noise": side[1:2].round(4).tolist(),
        "keep_growth": side[2:].round(4).tolist(),
        "change_weights": change.round(4).tolist(),
        "change_target": change_to.round(4).tolist(),
        "change_scale_m": round(change_m, 4),
        "path_costs": paths_of([part.choices for part in sets]).round(4).tolist(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("-o", "--out", type=Path, default=SHIPPED)
    parser.add_argument("--leave-out", type=Path, help="folder for fits without each data set")
    arguments = parser.parse_args()
    sets = {name: Collected.of(list(recorded_parts(arguments.data, name, "train"))) for name in EVERY_S}
    files = {arguments.out: sets}
    if arguments.leave_out is not None:
        files = {arguments.leave_out / f"{left}.json": sets.keys() - {left} for left in sets}
    for file, names in files.items():
        fitted = fit([part for name, part in sets.items() if name in names])
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(fitted, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
