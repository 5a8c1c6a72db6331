"""What benchmarks/compare.py prints of its comparisons."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import permutations
from math import comb

import numpy as np

import scex_sumo as scex
from scex_sumo.arrays import FloatArray
from scex_sumo.statistics.grouping import group_runs, silhouette
from scex_sumo.studies.compare import Comparison, compare_samples

DRAWS = 5  # ways to take the seeds of a map together


@dataclass(frozen=True, kw_only=True)
class Seeds:
    """The runs and what is known of their seed scenes, R each."""

    runs: list[scex.Run]
    labels: list[str]
    maps: list[str]
    kinds: list[str]
    speed: FloatArray  # mean of the vehicles, m/s
    separation: FloatArray  # median over the pairs of vehicles, m


def chance(seeds: Seeds, apart: Sequence[str]) -> float:
    """Neighbour accuracy of a distance that knows nothing."""
    shares = []
    for run, kind in enumerate(seeds.kinds):
        others = [k for k, a in zip(seeds.kinds, apart, strict=True) if a != apart[run]]
        shares.append(others.count(kind) / len(others))
    return float(np.mean(shares))


def row(name: str, distance: FloatArray, seeds: Seeds) -> str:
    """How well kinds and maps are told apart by one distance."""
    indices = []
    for method in ("ward", "average"):
        for truth in (seeds.kinds, seeds.maps):
            grouping = group_runs(distance, seeds.labels, groups=len(set(truth)), method=method)
            indices.append(adjusted_rand_index(grouping.group.tolist(), truth))
    cells = [
        *indices,
        float(silhouette(distance, seeds.kinds).mean()),
        float(silhouette(distance, seeds.maps).mean()),
        neighbour_accuracy(distance, seeds.kinds),
        neighbour_accuracy(distance, seeds.maps),
        other_maps(distance, seeds.kinds, seeds.maps),
    ]
    return f"{name:24s}" + "".join(f"{cell:9.2f}" for cell in cells)


HEAD = f"{'':24s}" + "".join(
    f"{cell:>9s}"
    for cell in (
        *("ARI kind", "ARI map", "kind avg", "map avg", "sil kind", "sil map"),
        *("NN kind", "NN map", "NN other"),
    )
)


def report(seeds: Seeds, comparisons: dict[str, Comparison]) -> None:
    """Print everything.

    Args:
        seeds: the runs.
        comparisons: by the name of the distance.
    """
    kind_of = dict(zip(seeds.maps, seeds.kinds, strict=True))
    print(f"{'map':24s}{'kind':14s}{'seeds':>6s}{'vehicles':>9s}{'m/s':>7s}{'apart m':>9s}{'within':>8s}")
    distance = comparisons["w1"].total
    for name in dict.fromkeys(seeds.maps):
        own = [r for r, m in enumerate(seeds.maps) if m == name]
        inside = distance[np.ix_(own, own)][np.triu_indices(len(own), 1)]
        counts = sorted({seeds.runs[r].info["seed_scene"]["vehicles"] for r in own})
        count = "-".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
        print(
            f"{name:24s}{kind_of[name]:14s}{len(own):6d}{count:>9s}"
            f"{seeds.speed[own].mean():7.1f}{seeds.separation[own].mean():9.0f}"
            f"{inside.mean() if inside.size else np.nan:8.2f}"
        )
    print(f"\n{HEAD}")
    for kind, comparison in comparisons.items():
        print(row(kind, comparison.total, seeds))
    speed, separation = np.log(seeds.speed), np.log(seeds.separation)
    print(row("mean speed alone", np.abs(speed[:, None] - speed), seeds))
    print(row("separation alone", np.abs(separation[:, None] - separation), seeds))
    for m, metric in enumerate(comparisons["w1"].metrics):
        print(row(f"  w1 {metric}", comparisons["w1"].per_metric[:, :, m], seeds))
    everyone = [str(r) for r in range(len(seeds.runs))]
    print(f"{'chance':24s}{'':54s}{chance(seeds, everyone):9.2f}{'':9s}{chance(seeds, seeds.maps):9.2f}")
    for kind, comparison in comparisons.items():
        explain(seeds, kind, comparison)
        pooled(seeds, kind)


def explain(seeds: Seeds, kind: str, comparison: Comparison) -> None:
    """What the distances go with: traffic, map, kind; and which maps are in which group."""
    total = comparison.total
    upper = np.triu_indices(len(total), 1)
    speed, separation = np.log(seeds.speed), np.log(seeds.separation)
    traffic = [np.abs(a[:, None] - a)[upper] for a in (speed, separation)]
    predictors = np.stack([np.ones(len(upper[0])), *traffic], axis=1)
    fit = predictors @ np.linalg.lstsq(predictors, total[upper], rcond=None)[0]
    explained = 1 - np.var(total[upper] - fit) / np.var(total[upper])
    print(
        f"\n{kind}: distance by chance alone {np.nanmedian(comparison.noise):.3f}; rank correlation with",
        end="",
    )
    print(f" the difference in speed {correlation(total[upper], traffic[0]):.2f}", end="")
    print(f", separation {correlation(total[upper], traffic[1]):.2f}; both explain {explained:.0%}")
    for name, values in (("distance", total[upper]), ("what is left of it", total[upper] - fit)):
        means, p = kind_effect(values, seeds)
        shares = ", ".join(f"{what} {mean:.3f}" for what, mean in means.items())
        print(f"{kind}: {name}: {shares}" + ("" if np.isnan(p) else f"; p = {p:.2f} for the last two"))
    grouping = group_runs(total, seeds.labels, groups=len(set(seeds.kinds)))
    for number in range(1, grouping.groups + 1):
        inside = Counter(m for m, g in zip(seeds.maps, grouping.group, strict=True) if g == number)
        print(f"  group {number}: " + ", ".join(f"{m} {n}" for m, n in inside.most_common()))


def kind_effect(values: FloatArray, seeds: Seeds) -> tuple[dict[str, float], float]:
    """Means of the pairs' values by what the two seeds share, and how likely chance does as much.

    The chance is exact: the share of all ways to give the kinds to the maps in which seeds of one kind, but
    other maps, are as near to each other, compared to seeds of other kinds, as they are.
    """
    kind_of = dict(zip(seeds.maps, seeds.kinds, strict=True))
    names = list(dict.fromkeys(seeds.maps))
    place = np.array([names.index(m) for m in seeds.maps])
    upper = np.triu_indices(len(place), 1)
    one, two = place[upper[0]], place[upper[1]]

    def difference(kinds: tuple[str, ...]) -> tuple[float, float]:
        array = np.array(kinds)
        same = array[one] == array[two]
        return float(values[same & (one != two)].mean()), float(values[~same].mean())

    actual = tuple(kind_of[name] for name in names)
    if len(set(actual)) == len(actual):
        return {
            "same map": float(values[one == two].mean()),
            "other": float(values[one != two].mean()),
        }, np.nan
    near, far = difference(actual)
    others = [difference(kinds) for kinds in set(permutations(actual))]
    p = np.mean([b - a >= far - near - 1e-12 for a, b in others])
    means = {"same map": float(values[one == two].mean()), "same kind, other map": near, "other kind": far}
    return means, float(p)


def pooled(seeds: Seeds, kind: str) -> None:
    """The same with the children of several seeds of a map taken together: places in place of moments."""
    kind_of = dict(zip(seeds.maps, seeds.kinds, strict=True))
    rng = np.random.default_rng(0)
    count = min(Counter(seeds.maps).values())
    if count < max(Counter(seeds.maps).values()):
        return
    samples = {
        m: [np.asarray(r.metrics[m].to_numpy(zero_copy_only=False), dtype=np.float64) for r in seeds.runs]
        for m in seeds.runs[0].columns
    }
    for size in (size for size in (1, 2, 4) if 2 * size <= count):
        results = []
        for _ in range(1 if size == 1 else DRAWS):
            parts, maps = [], []
            for name in dict.fromkeys(seeds.maps):
                own = rng.permutation([r for r, m in enumerate(seeds.maps) if m == name])
                parts += np.array_split(own, count // size)
                maps += [name] * (count // size)
            joined = {m: [np.concatenate([c[r] for r in part]) for part in parts] for m, c in samples.items()}
            distance = compare_samples(joined, [str(p) for p in range(len(parts))], distance=kind).total
            kinds = [kind_of[m] for m in maps]
            grouping = group_runs(distance, [f"{p:03d}" for p in range(len(parts))], groups=len(set(kinds)))
            results.append(
                (
                    neighbour_accuracy(distance, maps),
                    neighbour_accuracy(distance, kinds),
                    other_maps(distance, kinds, maps),
                    adjusted_rand_index(grouping.group.tolist(), kinds),
                )
            )
        cells = dict(
            zip(("NN map", "NN kind", "NN other", "ARI kind"), np.mean(results, axis=0), strict=True)
        )
        words = ", ".join(f"{name} {cell:.2f}" for name, cell in cells.items())
        print(f"{kind}: {size} seed{'s' * (size > 1)} of a map taken together: {words}")


def other_maps(distance: FloatArray, kinds: Sequence[str], maps: Sequence[str]) -> float:
    """Neighbour accuracy with whole maps left out; NaN where every map is a kind of its own."""
    if len(set(kinds)) == len(set(maps)):
        return float("nan")
    return neighbour_accuracy(distance, kinds, apart=maps)


def correlation(one: FloatArray, two: FloatArray) -> float:
    """Spearman's rank correlation."""
    from scipy.stats import spearmanr

    return float(spearmanr(one, two).statistic)


def adjusted_rand_index(first: Sequence[Hashable], second: Sequence[Hashable]) -> float:
    """Agreement of two groupings: 1 the same, 0 what chance gives, below 0 worse (Hubert and Arabie 1985).

    Args:
        first: (R,) names of the groups in one grouping.
        second: (R,) in the other.
    """
    pairs = _pairs(list(zip(first, second, strict=True)))
    one, two, all_pairs = _pairs(first), _pairs(second), comb(len(first), 2)
    if all_pairs == 0:
        return 1.0
    expected = one * two / all_pairs
    largest = (one + two) / 2
    # Both in one group, or both all apart: the same grouping.
    return 1.0 if largest == expected else (pairs - expected) / (largest - expected)


def _pairs(groups: Sequence[Hashable]) -> int:
    """Pairs of runs in the same group."""
    counts: dict[Hashable, int] = {}
    for name in groups:
        counts[name] = counts.get(name, 0) + 1
    return sum(comb(n, 2) for n in counts.values())


def neighbour_accuracy(
    distance: FloatArray, kinds: Sequence[Hashable], *, apart: Sequence[Hashable] | None = None
) -> float:
    """Share of runs whose nearest neighbour is of their kind (leave one out).

    Args:
        distance: (R, R).
        kinds: (R,) kind of each run.
        apart: (R,) where given, runs with the same entry are no neighbours: leave a whole map out.
    """
    names = list(kinds)
    out = list(range(len(names))) if apart is None else list(apart)
    hits = []
    for run, kind in enumerate(names):
        others = [r for r in range(len(names)) if out[r] != out[run]]
        nearest = min(others, key=lambda r: distance[run, r])
        hits.append(names[nearest] == kind)
    return float(np.mean(hits))
