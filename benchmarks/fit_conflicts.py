"""Law of contact (``decision/law.json``) and scales of late drivers, from training parts of recordings.

    python benchmarks/fit_conflicts.py DATA [--every 6] [--futures 16] [--most N] [--write]

Prints how often people let the needed braking and the time margin come to what, and by speed the mean excess
over limits: the scales of `scex_sumo.humans.attention`. Then it sets the levels of the law, so that contacts
that human-like futures of the same moments give are as frequent as published: 4.0e-5 a vehicle-kilometre
(Flannagan et al. 2023), five times that at junctions; rear-end .3, angle .25, sideswipe .15, head-on .03 of
them (NHTSA 2014).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from near_misses import LIMITS, MARGINS, Sample, moments_of, sample_of
from sklearn.metrics import average_precision_score

from scex_sumo.base.arrays import FloatArray
from scex_sumo.decision.law import FILE, over_futures

CONTACTS_A_KM = 5 * 4.0e-5
SHARES = {"rear-end": 0.3, "angle": 0.25, "sideswipe, head-on": 0.18}
SPEEDS = ((0.0, 3.0), (3.0, 6.0), (6.0, 9.0), (9.0, 40.0))
MARGIN_SCALES_S = (0.3, 0.4, 0.5, 0.6, 0.8)
GAP_SCALE_M = 3.0
LIMIT_MPS2 = 8.0


def joined(samples: Sequence[Sample], name: str) -> FloatArray:
    return np.concatenate([getattr(one, name) for one in samples])


def counted(samples: Sequence[Sample], km: float) -> None:
    """Print what was recorded."""
    braking = np.concatenate([one.recorded.braking for one in samples])
    margin = np.concatenate([one.recorded.margin for one in samples])
    speed = np.concatenate([one.speed for one in samples])
    along = joined(samples, "along")
    for what, rows in (("one follows", along), ("others", ~along)):
        each = (f"> {u:g}: {(braking[rows] > u).sum()}, {_excess(braking[rows], u):.2f}" for u in LIMITS)
        print(f"needed braking, {what}, windows of 3 s, mean excess in m/s²: {'; '.join(each)}")
    for low, high in SPEEDS:
        rows = along & (speed >= low) & (speed < high)
        each = (f"> {u:g}: {(braking[rows] > u).sum()}, {_excess(braking[rows], u):.2f}" for u in LIMITS[:3])
        print(f"  followers at {low:g} to {high:g} m/s: {'; '.join(each)}")
    each = (f"< {u:g}: {(margin < u).sum()}" for u in MARGINS)
    print(f"time margin, s: {'; '.join(each)}; {km:.0f} vehicle-km")


def _excess(values: FloatArray, limit: float) -> float:
    above = values[(values > limit) & (values < LIMIT_MPS2)]
    return float((above - limit).mean()) if len(above) else float("nan")


def power_mean(contact: FloatArray) -> float:
    """Sum over pairs of P over futures."""
    pairs, futures = contact.shape
    pair = np.arange(pairs).repeat(futures)
    return float(over_futures(pair, contact.ravel(), pairs=pairs, futures=futures).sum())


def solved(rate: float, km: float, low: float, high: float, contact_of: object) -> float:
    """Return the parameter at which contacts have a rate, by bisection of its logarithm."""
    assert callable(contact_of)
    for _ in range(40):
        middle = float(np.sqrt(low * high))
        if power_mean(contact_of(middle)) / km > rate:
            high = middle
        else:
            low = middle
    return float(np.sqrt(low * high))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--every", type=float, default=6.0)
    parser.add_argument("--futures", type=int, default=16)
    parser.add_argument("--most", type=int, default=None, help="moments, evenly thinned")
    parser.add_argument("--write", action="store_true", help="write law.json")
    options = parser.parse_args()
    scenes = list(moments_of(options.data, ["train"], options.every))
    if options.most is not None and len(scenes) > options.most:
        scenes = [scenes[k] for k in np.linspace(0, len(scenes) - 1, options.most).astype(int)]
    samples = [one for scene in scenes if (one := sample_of(scene, options.futures)) is not None]
    km = sum(one.km for one in samples)
    counted(samples, km)
    braking, margin, gap = (joined(samples, name) for name in ("braking", "margin", "gap"))
    apart = gap > 0
    truth = joined(samples, "near_miss")
    scale_s = max(
        MARGIN_SCALES_S,
        key=lambda s: average_precision_score(truth, np.cbrt(np.exp(-margin / s)).mean(axis=1)),
    )
    rates = {what: CONTACTS_A_KM * share for what, share in SHARES.items()}

    def by_braking(scale: float) -> FloatArray:
        short = np.maximum(LIMIT_MPS2 - braking, 0.0) / scale
        return np.where(apart & (braking > 0), np.exp(-short), 0.0)

    found = {
        "braking_scale_mps2": solved(rates["rear-end"] + rates["angle"] / 2, km, 0.2, 2.0, by_braking),
        "margin_level": solved(
            rates["angle"] / 2, km, 1e-7, 1.0, lambda level: level * np.exp(-margin / scale_s) * apart
        ),
        "margin_scale_s": scale_s,
        "gap_level": solved(
            rates["sideswipe, head-on"],
            km,
            1e-10,
            1.0,
            lambda level: level * np.exp(-gap / GAP_SCALE_M) * apart,
        ),
        "gap_scale_m": GAP_SCALE_M,
    }
    found = {name: float(f"{value:.2g}") for name, value in found.items()}
    print(json.dumps(found, indent=1))
    if options.write:
        content = json.loads(FILE.read_text())
        for name, value in found.items():
            content[name]["value"] = value
        FILE.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
