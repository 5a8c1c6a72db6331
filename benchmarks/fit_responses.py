"""Fit ``response.json``: what people do, counted in recordings, and how responses depend on the gap.

    python benchmarks/fit_responses.py collect --data ../shared/data
    python benchmarks/fit_responses.py fit --data ../shared/data
    python benchmarks/fit_responses.py people --data ../shared/data

``collect`` keeps what it reads in a folder; ``fit`` writes the file and prints collisions an hour and a
kilometre, and sums of P against counts, on the test parts, too: recordings with an odd number, NGSIM,
MONA-West and TAF-BW. The level of contacts is that of published crashes: no collision was recorded.
``people`` counts who steps out in recordings with cyclists.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from response_samples import (
    HAPPENS,
    NEAR,
    VARIES_MPS2,
    Samples,
    collected,
    dut_samples,
    expected_of,
    samples_of,
)

from scex_sumo import LoadedRecording, find_recordings, load_recording
from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, mean_ranks
from scex_sumo.certainty.response.critical import TYPICAL
from scex_sumo.certainty.response.motion.actions import ACTIONS, BRAKES, LEVELS, STEPS_OUT, pairs_of
from scex_sumo.certainty.response.people import SHIPPED, People, people_of, probabilities
from scex_sumo.converters.tracks.road_users import road_user

app = typer.Typer(add_completion=False)
Data = Annotated[Path, typer.Option(help="Folder of the data sets.")]
Cache = Annotated[Path, typer.Option(help="Folder for samples.")]
EVERY_S = {"interaction": 5.0, "mona": 8.0, "ngsim": 2.0, "taf_bw": 20.0}
PEOPLE_EVERY_S = 2.0
WITH_CYCLISTS = ("interaction/recorded_trackfiles/DR_DEU_Roundabout_OF", "taf_bw", "av2", "scenarionet")
HORIZON_S, WINDOW_S = 3.0, 1.5
SPEED_EDGES = (4.0, 8.0)
LEADER = (8.0, 2.0, 1.5)  # a leader is within 8 m + 2 s, and 1.5 m to the side
MOST_FACTOR = 30.0  # beyond it a frequency is not known at all
# Of a responder's acceleration beside the expected one: the best in training, see `vary`.
MEAN_MPS2, SPREAD_MPS2 = -0.25, 0.5
TAIL = 10  # largest values beyond which the tail is fitted
EXCEEDANCES = 60
FREQUENT = 20  # near misses of training from which their sum counts in the fit
HALF = 0.5  # events where none was counted; three are the bound of 95 % (rule of three)
CONTACTS_A_KM = (
    4.0e-5  # any contact, 64.9 in a million miles of drivers in San Francisco (Flannagan et al. 2023)
)
AT_JUNCTIONS = 5.0  # half of all crashes happen at junctions, on about a tenth of the way
LEVEL_FACTOR = 10.0  # of published rates, either way: sites, and what counts as a crash
MANNER = {"brakes": 0.3, "goes on": 0.25, "cuts in": 0.15, "drifts": 0.03, "steps out": 0.1}
"""Shares of crashes: rear-end, angle, sideswipe, head-on (NHTSA, by first harmful event: 0.32, 0.21, 0.12 and
0.02 in 2014). With pedestrians it is 0.01, and ten times that where people are beside the way (chosen)."""
GRID = {
    "close_response": (0.75, 1.0),
    "close_away": (0.5, 1.0),
    "growth": (7.0, 10.0, 14.0, 20.0, 28.0),
}


def is_test(name: str) -> bool:
    """Whether a recording is kept for the test."""
    number = re.search(r"_(\d+)$", name)
    kept = any(word in name for word in ("Lanker", "Peach", "West", "k729", "k733"))
    return kept or bool(number and int(number[1]) % 2)


@app.command()
def collect(data: Data, cache: Cache = Path("out/responses"), part: int = 0, parts: int = 1) -> None:
    """Collect samples of all recordings, and their braking."""
    dut_samples(data / "dut", cache / "dut", PEOPLE_EVERY_S)
    for name, every_s in EVERY_S.items():
        for recording, found in collected(data / name, cache / name, every_s=every_s, part=part, parts=parts):
            print(recording, len(found.seconds), "moments", len(found.action), "actions", flush=True)
        for recording in find_recordings([data / name])[part::parts]:
            file = cache / "braking" / f"{recording.name}.npy"
            if not file.is_file():
                file.parent.mkdir(parents=True, exist_ok=True)
                np.save(file, braking_of(load_recording(recording)))


def braking_of(loaded: LoadedRecording) -> FloatArray:
    """Return (n, 3) speed, whether it follows, and the strongest braking begun within 3 s, every second."""
    rows, step = loaded.table.vehicles, round(loaded.table.step_s * 1000)
    order = np.lexsort((rows.timestamp_ms, rows.track, rows.case))
    x, y, psi, speed = (values[order] for values in (rows.x, rows.y, rows.psi_rad, rows.speed))
    time, track, segment = rows.timestamp_ms[order], rows.track[order], rows.segment[order]
    steps, window = round(HORIZON_S / loaded.table.step_s), round(WINDOW_S / loaded.table.step_s)
    last = steps + window
    start = np.flatnonzero(np.arange(len(x)) + last < len(x))
    whole = (track[start + last] == track[start]) & (segment[start + last] == segment[start])
    start = start[whole & (time[start + last] - time[start] == last * step) & (time[start] % 1000 == 0)]
    start = start[speed[start] > 0.5]
    later = speed[start[:, None] + np.arange(last + 1)]
    lost = later[:, : steps + 1] - later[:, window : window + steps + 1]
    follows = _follows(x, y, psi, speed, time, start)
    return np.column_stack([speed[start], follows, np.maximum(lost.max(axis=1) / WINDOW_S, 0.0)])


def _follows(
    x: FloatArray, y: FloatArray, psi: FloatArray, speed: FloatArray, time: IntArray, who: IntArray
) -> BoolArray:
    found = np.zeros(len(who), dtype=bool)
    by_time = np.argsort(time, kind="stable")
    first, end = (np.searchsorted(time[by_time], time[who], side=side) for side in ("left", "right"))
    for k, row in enumerate(who):
        others = by_time[first[k] : end[k]]
        dx, dy = x[others] - x[row], y[others] - y[row]
        ahead = np.cos(psi[row]) * dx + np.sin(psi[row]) * dy
        aside = np.abs(np.cos(psi[row]) * dy - np.sin(psi[row]) * dx)
        found[k] = (
            (ahead > 2) & (ahead < 4.5 + LEADER[0] + LEADER[1] * speed[row]) & (aside < LEADER[2])
        ).any()
    return found


def survival(values: FloatArray, at: FloatArray) -> FloatArray:
    """Return the share of at least each value: counted, with a generalised Pareto tail beyond the tenth."""
    ordered = np.sort(values)
    counted = (len(values) - np.searchsorted(ordered, at)) / len(values)
    begin = ordered[-TAIL]
    exceed = ordered[-EXCEEDANCES:] - ordered[-EXCEEDANCES]
    mean, weighted = exceed.mean(), (exceed * np.linspace(1, 0, len(exceed))).mean()
    shape = float(np.clip(2 - mean / (mean - 2 * weighted), 0.0, 0.2))  # no bound below that of tyres
    scale = mean * (1 - shape) + shape * (begin - ordered[-EXCEEDANCES])
    rest = np.maximum(1 + shape * (at - begin) / scale, 1e-9) ** (-1 / shape if abs(shape) > 1e-6 else 0)
    rest = rest if abs(shape) > 1e-6 else np.exp(-(at - begin) / scale)
    tail = np.maximum(TAIL / len(values) * np.minimum(rest, 1.0), 1e-9)
    return np.where(at > begin, tail, counted)


def braking_tables(cache: Path) -> dict[str, Any]:
    """Return the frequencies of braking, with their uncertainty by bootstrap over recordings."""
    files = [file for file in sorted((cache / "braking").glob("*.npy")) if not is_test(file.stem)]
    parts, at = [np.load(file) for file in files], np.array(ACTIONS[BRAKES].values)

    def tables(chosen: list[FloatArray]) -> FloatArray:
        rows = np.concatenate(chosen)
        kind = np.searchsorted(SPEED_EDGES, rows[:, 0]) + np.where(rows[:, 1] > 0, 0, len(SPEED_EDGES) + 1)
        every = [rows[kind == k, 2] for k in range(2 * len(SPEED_EDGES) + 2)]
        return np.array([survival(v if len(v) > 2 * EXCEEDANCES else rows[:, 2], at) for v in every])

    rng = np.random.default_rng(0)
    draws = [tables([parts[k] for k in rng.integers(0, len(parts), len(parts))]) for _ in range(50)]
    spread = np.median(np.log(np.stack(draws).clip(1e-9)).std(axis=0), axis=0)
    found = np.minimum.accumulate(np.clip(tables(parts), 1e-9, 1.0), axis=1).round(9).tolist()
    half = len(found) // 2
    return {
        "following": found[:half],
        "free": found[half:],
        "speed_edges_mps": list(SPEED_EDGES),
        "factor": np.maximum.accumulate(np.exp(1.96 * spread))
        .clip(LEVEL_FACTOR, MOST_FACTOR)
        .round(1)
        .tolist(),
        "counted": int(sum(map(len, parts))),
        "source": "counted by benchmarks/fit_responses.py: strongest mean over 1.5 s that begins within 3 s",
    }


def rates(samples: Samples, people: People, kind: int) -> dict[str, Any]:
    """Return shape and rates of an action by the time that it leaves; see `People.often`."""
    use = (samples.action == kind) & samples.known & ~samples.doubtful
    values, shape = np.array(ACTIONS[kind].values), people.shapes[kind - 1]
    did = samples.did[use & ~np.isnan(samples.did)]
    if len(did) >= 10:
        shape = np.maximum((did[:, None] >= values).mean(axis=0), HALF / len(did) * 0.5 ** np.arange(10))
        shape = np.minimum.accumulate(shape / shape[0])
    entry: dict[str, Any] = {"shape": shape.round(6).tolist()}
    contexts = {"rates": use}
    if kind == STEPS_OUT:
        contexts = {"rates": use & ~samples.follows, "approaching": use & samples.follows}
    counted, exposed = [], []
    for name, rows in contexts.items():
        entry[name], *counts = _rates(samples, people, kind, rows, shape)
        counted += counts[0]
        exposed += counts[1]
    if kind == STEPS_OUT:  # who approaches is not more careful
        entry["approaching"] = np.maximum(entry["approaching"], entry["rates"]).tolist()
    return {
        **entry,
        "factor": LEVEL_FACTOR,
        "counted": counted,
        "exposed": exposed,
        "source": "counted by benchmarks/fit_responses.py; at most as many contacts a kilometre as published",
    }


def _rates(
    samples: Samples, people: People, kind: int, rows: BoolArray, shape: FloatArray
) -> tuple[list[float], list[float], list[float]]:
    """Return the rates of a context by classes of R*, events and exposures."""
    did, values = samples.did[rows], np.array(ACTIONS[kind].values)
    response, done = samples.response[rows][:, :, 0, TYPICAL], ~np.isnan(did)
    share = -np.diff(shape, append=0.0)
    classes = np.searchsorted(people.rate_edges_s, response)
    count = len(people.rate_edges_s) + 1
    exposed = np.array([(share * (classes == k)).sum() for k in range(count)])
    level = np.clip(np.searchsorted(values, did[done], side="right") - 1, 0, LEVELS - 1)
    happened = np.bincount(classes[done, level], minlength=count).astype(float)
    rate = np.minimum(np.maximum(happened, HALF) / np.maximum(exposed, HALF), 1.0)
    late = late_of(samples, people, "contact")[rows]
    horizons = samples.seconds[samples.moment[rows], None] / HORIZON_S
    allowed = contacts_of(kind) * samples.km[np.unique(samples.moment[rows])].sum()
    for k in range(count):
        expected = (share * (classes == k) * late * horizons).sum()
        rate[k] = min(rate[k], allowed / count / max(expected, 1e-9))
    rate = np.minimum.accumulate(rate[::-1])[::-1]
    return [float(f"{value:.3g}") for value in rate], happened.tolist(), exposed.round(1).tolist()


def contacts_of(kind: int) -> float:
    """Return the published contacts a kilometre at junctions through an action."""
    return CONTACTS_A_KM * AT_JUNCTIONS * MANNER[ACTIONS[kind].name]


def late_of(samples: Samples, people: People, event: str) -> FloatArray:
    """Return (n, 10) probability that a response comes too late to avoid an event."""
    k = list(HAPPENS).index(event)
    response, left = samples.response[:, :, k], samples.left[:, :, k]
    late, some = (response == -np.inf).astype(float), np.isfinite(response)
    action, gap = (np.broadcast_to(v[:, None, None], some.shape) for v in (samples.action, samples.gap_s))
    late[some] = people.later(response[some], action[some], gap[some], left[some])
    return np.asarray(late @ people.decelerations)


def chances(samples: Samples, people: People, event: str) -> FloatArray:
    """Return (n,) probabilities of an event through each action."""
    often = people.often(
        action=samples.action,
        speed=samples.speed,
        follows=samples.follows,
        response_s=samples.response[:, :, 0, TYPICAL],
    )
    return probabilities(often, late_of(samples, people, event), samples.action)


def expected_number(samples: Samples, people: People, event: str = "contact") -> FloatArray:
    """Return (5,) expected number through each action in the time that the samples stand for."""
    # A moment stands for the horizon of the frequencies.
    windows = samples.seconds[samples.moment] / HORIZON_S
    sure = np.where(samples.doubtful, 0.0, chances(samples, people, event) * windows)
    return np.bincount(samples.action, weights=sure, minlength=len(ACTIONS))


def predicted(
    samples: Samples, people: People, event: str, mean: float = MEAN_MPS2, spread: float = SPREAD_MPS2
) -> FloatArray:
    """Return (p,) probability of a near miss of each pair: through an action, or as expected.

    Beside its expected motion a responder has an acceleration of its own, normally distributed. One that is
    faster so looks ahead: with the hazard of `People.later` it drives as expected again.
    """
    none = np.zeros(len(samples.pair_moment))
    np.add.at(none, samples.pair, np.log1p(-np.minimum(chances(samples, people, event), 0.999)))
    weight = np.exp(-(((VARIES_MPS2 - mean) / spread) ** 2) / 2)
    left = samples.usual[:, list(NEAR).index(event)]
    goes_on = np.where(VARIES_MPS2 > 0, left**people.growth, left > 0)
    expected = left[:, VARIES_MPS2 == 0] > 0
    usual = np.where((left > 0) & expected, 1.0, goes_on) @ (weight / weight.sum())
    return np.asarray(1 - np.exp(none) * (1 - usual))


def sums(
    samples: Samples, people: People, mean: float = MEAN_MPS2, spread: float = SPREAD_MPS2
) -> list[tuple[str, float, int, float, float]]:
    """Return event, sum of P, count, ROC area of P and of the best surrogate measure; see `predicted`."""
    use = samples.pair_known
    found = []
    for number, event in enumerate(NEAR):
        chance, recorded = predicted(samples, people, event, mean, spread)[use], samples.recorded[use, number]
        areas = [roc_area(chance, recorded)]
        areas.append(max(roc_area(column, recorded) for column in samples.surrogate[use].T))
        found.append((event, float(chance.sum()), int(recorded.sum()), *areas))
    return found


def roc_area(score: FloatArray, happened: BoolArray) -> float:
    """Return the area under the ROC curve; NaN where all or none happened."""
    count = int(happened.sum())
    if count in (0, len(score)):
        return float("nan")
    return float(
        (mean_ranks(score)[happened].sum() - count * (count + 1) / 2) / (count * (len(score) - count))
    )


def _read(cache: Path, *names: str, test: bool | None) -> Samples:
    files = [file for name in names for file in sorted((cache / name).glob("*.npz"))]
    return Samples.joined([Samples.read(file) for file in files if test in (None, is_test(file.stem))])


def _error(found: list[tuple[str, float, int, float, float]]) -> float:
    return float(sum(np.log(p / n) ** 2 for _, p, n, *_ in found if n >= FREQUENT))


@app.command()
def vary(cache: Cache = Path("out/responses")) -> None:
    """Print sums of P and counts of the training parts by mean and spread of the added acceleration."""
    train, people = _read(cache, *EVERY_S, test=False), people_of(SHIPPED)
    for mean, spread in product((-0.5, -0.25, 0.0, 0.25), (0.1, 0.2, 0.3, 0.5, 0.8)):
        found = sums(train, people, mean, spread)
        said = ", ".join(f"{event} {p:.1f} / {n} ({area:.2f})" for event, p, n, area, _ in found)
        print(f"{mean} {spread}: error {_error(found):.3f}; {said}")


@app.command()
def fit(cache: Cache = Path("out/responses"), write: bool = True) -> None:
    """Count and fit on the training parts, then report on the test parts."""
    content = json.loads(SHIPPED.read_text())
    if (cache / "braking").is_dir():
        content["actions"]["brakes"] = braking_tables(cache)
        _write(content)
    train = _read(cache, *EVERY_S, test=False)
    with_people = _read(cache, *EVERY_S, "dut", test=False)
    people = people_of(SHIPPED)
    best, least = people, np.inf
    for values in product(*GRID.values()):
        tried = replace(people, **dict(zip(GRID, values, strict=True)))
        error = _error(sums(train, tried))
        contacts = expected_number(train, tried)[BRAKES] / train.km.sum()
        error += np.log(contacts / contacts_of(BRAKES)) ** 2
        if error < least - 1e-6:
            best, least = tried, error
            print(dict(zip(GRID, values, strict=True)), f"error {error:.3f}, {contacts:.1e} a kilometre")
    for name in GRID:
        content[name]["value"] = getattr(best, name)
        content[name]["source"] = "fitted by benchmarks/fit_responses.py on near misses and published crashes"
    for kind in range(1, len(ACTIONS)):
        content["actions"][ACTIONS[kind].name] = rates(with_people, best, kind)
    if write:
        _write(content)
    report(cache)


def _write(content: dict[str, Any]) -> None:
    """Write the file, each list of numbers on one line."""
    text = json.dumps(content, indent=1, ensure_ascii=False)
    flat = re.sub(r"\[[^\[\]{}]*\]", lambda found: re.sub(r"\s+", " ", found[0]), text)
    SHIPPED.write_text(flat.replace("[ ", "[").replace(" ]", "]") + "\n")


@app.command()
def people(data: Data, every_s: float = 1.0) -> None:
    """Print how often pedestrians and cyclists stepped out within 3 s, beside what the file expects."""
    rows = [row for folder in WITH_CYCLISTS for row in _stepping(data / folder, every_s)]
    for kind, approaches in product(("pedestrian", "bicycle"), (False, True)):
        chosen = [row[2:] for row in rows if row[:2] == (kind, approaches)]
        did, usual = np.array(chosen).reshape(-1, 2).T
        context = "approach" if approaches else "do not"
        print(f"{kind}, {context}: {did.sum():.0f} of {len(did)} pairs, expected {usual.sum():.2f}")


def _stepping(folder: Path, every_s: float) -> Iterator[tuple[str, bool, bool, float]]:
    """Yield kind of person, whether it approaches, whether it steps out, and how often by the file."""
    shipped = people_of(SHIPPED)
    for recording in find_recordings([folder]):
        for expected in expected_of(load_recording(recording), every_s):
            if (
                expected.scene.vehicles == expected.vehicles
                or (found := samples_of(expected, every_s)) is None
            ):
                continue
            use = np.flatnonzero((found.action == STEPS_OUT) & found.known & ~found.doubtful)
            often = shipped.often(
                action=found.action[use],
                speed=found.speed[use],
                follows=found.follows[use],
                response_s=found.response[use][:, :, 0, TYPICAL],
            )[:, 0]
            who = pairs_of(expected).initiator[found.pair[use]]
            for k, share, person in zip(use.tolist(), often.tolist(), who.tolist(), strict=True):
                kind = road_user(expected.scene.types[person])
                yield kind, bool(found.follows[k]), bool(np.isfinite(found.did[k])), share


@app.command()
def report(cache: Cache = Path("out/responses")) -> None:
    """Print contacts an hour and a kilometre, and sums of P against counts."""
    people = people_of(SHIPPED)
    for name, test in product((*EVERY_S, "dut"), (False, True)):
        try:
            samples = _read(cache, name, test=test)
        except ValueError:
            continue
        hours, km = samples.seconds.sum() / 3600, samples.km.sum()
        part = f"{name} {'test' if test else 'train'}"
        print(f"{part}: {len(samples.seconds)} moments of {hours:.2f} h, {km:.0f} km")
        for event in ("contact", "bump", "hard"):
            number = expected_number(samples, people, event)
            each = ", ".join(
                f"{action.name} {n / km:.0e}" for action, n in zip(ACTIONS, number, strict=True) if n
            )
            print(f"  {event}: {number.sum() / hours:.3f} an hour, {number.sum() / km:.1e} a km ({each})")
        for event, chance, count, area, other in sums(samples, people):
            print(f"  {event}: P {chance:.1f}, counted {count}; ROC area {area:.3f}, surrogate {other:.3f}")


if __name__ == "__main__":
    app()
