"""Fits the parameters of likely_driver to recordings and writes ``scex_sumo/humans/parameters.json``.

    python benchmarks/calibrate_likely.py [--data FOLDER] [-o FILE] [--leave-out FOLDER]

From the training part by time of the sites of INTERACTION, of TAF-BW and MONA, and from the NGSIM files that
are not kept for tests (``benchmarks/recorded_scenes.py`` names them). Every vehicle is put on the path that
it took; what it did beyond what `LikelyDriver` asks of it (its leader as it really drove) is written as an
acceleration of its own at two times, by least squares over the 30 steps. By class of speed these are
regressed on what the seed scene shows (ridge), and what is left gives the scale of a Student distribution of
four degrees. Headways, starts from standing, offsets from the path, lane changes and the choice of path are
counted from the same vehicles. Then all vehicles of some moments drive: mean and scale of the accelerations,
and the scale of the offsets, are changed until the recorded places after 3 s are where the futures say.
``--leave-out`` writes a file for each set, fitted to the others.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from attentive import simulated, with_rules
from likely_accelerations import NODES, accelerations_of, headway_of
from likely_choices import Choice, changes_of, choices_of, offsets_of, paths_of, starts_of
from likely_samples import HUMAN, STEPS, Samples, headways, joined, kept, samples_of, weighted
from recorded_scenes import EVERY_S, recorded_parts, smoothed

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.behaviors.driving.paths import FIRST_HORIZON_S, seed_paths
from scex_sumo.humans import driver
from scex_sumo.humans.lines.driven_line import redrawn
from scex_sumo.humans.observed.observations import observations_of
from scex_sumo.humans.parameters import SHIPPED, HumanParameters
from scex_sumo.scene import SeedScene

NOISY_MPS2 = 0.1  # a set whose accelerations scatter by more is noisy
MOMENTS, VEHICLES = (3, 16), 150  # of each set that settle the scales
FUTURES, TURNS = 19, 8  # of each of these moments
WIDE_M = 3.0  # half the width of a wide lane
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
FITTED = [field.name for field in dataclasses.fields(HumanParameters) if field.default is dataclasses.MISSING]


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
    driven: Sequence[SeedScene]  # some of the moments, with rules

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
            driven=[with_rules(scene) for scene in some_of(scenes)],
        )


def some_of(scenes: Sequence[SeedScene]) -> Sequence[SeedScene]:
    """Some of the moments, evenly, with about `VEHICLES` in all."""
    count = int(np.clip(VEHICLES * len(scenes) / sum(scene.vehicles for scene in scenes), *MOMENTS))
    return scenes[:: -(-len(scenes) // count)]


def fit(sets: Sequence[Collected]) -> HumanParameters:
    """The fitted parameters.

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
    keeps, side = offsets_of(samples.part(moving), weight[moving])
    both, share = weighted([*found, *(part.calm for part in sets)])
    moving = both.speed >= HUMAN.standing_mps
    driving, share = both.part(moving), share[moving]
    known = dataclasses.replace(HUMAN, headway_log=np.array(log_headway))
    headway = headways(driving.headway, known, np.zeros(len(driving.speed)))
    mean, root, grows = accelerations_of(driving, headway, share / share.mean())
    return dataclasses.replace(
        known,
        variation_mean=mean,
        variation_root=root,
        variation_skew=np.zeros(len(root)),
        variation_noise=grows[:NODES],
        variation_growth=grows[NODES:],
        start_weights=starts_of(samples, weight),
        keep_weights=keeps,
        keep_scale_m=side[0],
        keep_growth=side[1:],
        change_weights=change,
        change_target=change_to,
        change_scale_m=change_m,
        path_costs=paths_of([part.choices for part in sets]),
    )


@dataclass(frozen=True, kw_only=True)
class Ends:
    """Recorded places of n moving vehicles after 3 s, m beyond `QUANTILES` of their futures.

    Attributes:
        fast: (n,) in the seed scene.
        wide: (n,) on a wide lane.
        weight: (n,).
        along: (n, 5).
        across: (n, 5).
    """

    fast: BoolArray
    wide: BoolArray
    weight: FloatArray
    along: FloatArray
    across: FloatArray

    def share(self, of: BoolArray, among: BoolArray) -> float:
        """Weighted share of some vehicles (n,) among others (n,)."""
        return float(np.average(of[among], weights=self.weight[among]))

    def outside(self, beyond: FloatArray, among: BoolArray) -> tuple[float, float]:
        """Shares beyond the last quantile, and before the first one."""
        return self.share(beyond[:, -1] > 0, among), self.share(beyond[:, 0] < 0, among)


def ends_of(sets: Sequence[Sequence[SeedScene]]) -> Ends:
    """Drive all vehicles of the moments, and compare their places after 3 s with the recorded ones."""
    parts = [np.concatenate([row for scene in scenes for row in _ends(scene)]) for scenes in sets]
    table = np.concatenate(parts)
    return Ends(
        fast=table[:, 0] >= HUMAN.fast_mps,
        wide=table[:, 1] > WIDE_M,
        weight=np.repeat([1 / np.sqrt(len(part)) for part in parts], [len(part) for part in parts]),
        along=table[:, 2:7],
        across=table[:, 7:],
    )


def _ends(scene: SeedScene) -> Iterator[FloatArray]:
    """Yield (n, 12): speed, m/s, half the width of the lane, m, and places beyond quantiles, m."""
    assert scene.future is not None and scene.future_valid is not None and scene.road is not None
    last, paths = STEPS - 1, seed_paths(scene, scene.road, FIRST_HORIZON_S, redrawn)
    room = observations_of(scene, paths, HUMAN).room[paths.first + paths.straight].mean(axis=2).max(axis=1)
    v = np.flatnonzero(scene.future_valid[:, :STEPS].all(axis=1) & (scene.now.speed > HUMAN.standing_mps))
    states, real = simulated(scene, "likely_driver", range(FUTURES)).states[:, last, v], scene.future[v, last]
    dx, dy, cos, sin = real.x - states.x, real.y - states.y, np.cos(real.heading), np.sin(real.heading)
    ways = (cos * dx + sin * dy, cos * dy - sin * dx)
    # Beyond a quantile of the futures by the opposite quantile of the differences.
    beyond = [np.quantile(way, QUANTILES[::-1], axis=0, method="weibull").T for way in ways]
    yield np.column_stack([scene.now.speed[v], room[v], *beyond])


def settled(known: HumanParameters, sets: Sequence[Sequence[SeedScene]]) -> HumanParameters:
    """Shift and spread the accelerations of each class, and spread the offsets, until they hold the places.

    As often above as below the median, and nearly as often between quartiles and outside 5-95 % as these say:
    others, a limit and a standstill change what a drawn acceleration does.
    """
    for turn in range(TURNS):
        driver.human_parameters = lambda now=known: now  # type: ignore[assignment,misc]
        ends, gain = ends_of(sets), 1.0 / (1 + turn / 3)
        mean, root, skew, growth = (
            getattr(known, name).copy()
            for name in ("variation_mean", "variation_root", "variation_skew", "keep_growth")
        )
        for c, among in enumerate((~ends.fast, ends.fast)):
            ahead, behind = ends.outside(ends.along, among)
            lift = ends.share(ends.along[:, 2] > 0, among) - 0.5
            inner = ends.share((ends.along[:, 1] > 0) & (ends.along[:, 3] < 0), among)
            mean[c, :, 0] += 2 * gain * lift * np.sqrt(np.diag(root[c] @ root[c].T))
            skew[c] = np.clip(skew[c] + 2 * gain * (ahead - behind), -0.7, 0.7)
            root[c] *= np.exp(np.clip(gain * (0.5 * (0.5 - inner) + 2 * (ahead + behind - 0.1)), -0.3, 0.3))
            name = ("slow", "fast")[c]
            print(
                f"{turn} {name}: ahead {ahead:.3f}, behind {behind:.3f}, lift {lift:+.3f}, inner {inner:.2f}"
            )
        narrow, wide = (sum(ends.outside(ends.across, among)) - 0.1 for among in (~ends.wide, ends.wide))
        growth[-1] += 2 * gain * (wide - narrow)
        scale = known.keep_scale_m * np.exp(np.clip(2 * gain * narrow, -0.3, 0.3))
        print(f"{turn} across: outside {narrow + 0.1:.3f}, in wide lanes {wide + 0.1:.3f}", flush=True)
        known = dataclasses.replace(
            known,
            variation_mean=mean,
            variation_root=root,
            variation_skew=skew,
            keep_growth=growth,
            keep_scale_m=float(scale),
        )
    return known


def written(known: HumanParameters) -> str:
    """The fitted parameters as JSON."""
    values = {name: getattr(known, name) for name in FITTED}
    numbers = {name: np.asarray(value).round(4).tolist() for name, value in values.items()}
    return json.dumps(numbers, indent=1) + "\n"


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
        parts = [part for name, part in sets.items() if name in names]
        known = settled(fit(parts), [part.driven for part in parts])
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(written(known), encoding="utf-8")


if __name__ == "__main__":
    main()
