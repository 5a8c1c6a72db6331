"""Rare collisions of human-like drivers, read from ``rare.json``."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import write_atomic
from scex_sumo.statistics.density import Interval

RARE: Final = "rare.json"
FUTURES: Final = Path("rare", "futures.parquet")
"""Futures with a collision, the heaviest first."""

STATES: Final = ("x", "y", "heading", "speed")
FUTURES_SCHEMA: Final = pa.schema(
    [
        ("future", pa.int64()),
        ("weight", pa.float64()),
        ("chosen", pa.list_(pa.int64())),
        ("draw", pa.list_(pa.float64())),
        ("time_s", pa.float64()),
        ("track_id", pa.int64()),
        ("other_id", pa.int64()),
        ("injuries", pa.float64()),
        *((name, pa.list_(pa.float64())) for name in STATES),
    ]
)
"""``time_s`` and the tracks are those of the first collision; ``injuries`` the expected severe ones of all.
States are those after each step, vehicle by vehicle."""

_PLAIN_NUMBER = 1e-3  # smaller shares are written as 7e-5


@dataclass(frozen=True, kw_only=True)
class RarePair:
    """Two vehicles that collide in some future.

    Attributes:
        share: of the probability of any collision.
        causes: what their drivers draw more often in these futures, e.g. ``8 inattentive``.
    """

    track_id: int
    other_id: int
    value: float
    low: float
    high: float
    share: float
    hits: int
    causes: tuple[str, ...] = ()

    def words(self) -> str:
        """Return the pair in words, e.g. ``7 and 8, 8 inattentive``."""
        return ", ".join([f"{self.track_id} and {self.other_id}", *self.causes])


@dataclass(frozen=True, kw_only=True)
class Rare(Interval):
    """Probability of a collision by importance sampling; ``count`` futures estimate it.

    Attributes:
        hits: futures with a collision among these.
        chosen: futures among these that were chosen as likely to collide.
        simulated: simulations of pairs that chose them.
        expected_mais3: expected severe injuries (MAIS 3+) in a future.
        pairs: that collide, the most probable first.
    """

    hits: int
    chosen: int
    simulated: int
    expected_mais3: float
    pairs: tuple[RarePair, ...] = ()

    def pair(self, one: int, other: int) -> RarePair | None:
        """Return the estimate of two vehicles; None if they collide in no future."""
        ids = (min(one, other), max(one, other))
        return next((p for p in self.pairs if (p.track_id, p.other_id) == ids), None)

    def of(self, one: int, other: int) -> float:
        """Return the probability that two vehicles collide; 0 if they do so in no future."""
        pair = self.pair(one, other)
        return 0.0 if pair is None else pair.value

    @property
    def short(self) -> str:
        """In words, without the interval, e.g. ``7e-5`` or ``< 1.3 %``."""
        return probability_words(self.value) if self.hits else f"< {probability_words(self.high)}"

    @property
    def percent(self) -> str:
        """In words, e.g. ``7e-5 (3e-5 – 1.5e-4)``, or ``less than 1.3 %`` without any collision."""
        if not self.hits:
            return f"less than {probability_words(self.high)}"
        return " ".join([
            probability_words(self.value),
            f"({probability_words(self.low)} – {probability_words(self.high)})",
        ])  # fmt: skip

    def mostly(self) -> str:
        """Return the most probable pair in words, or how many simulations looked for one in vain."""
        if not self.pairs:
            return f"none in {self.simulated} simulations of pairs that come near" if self.simulated else ""
        first = self.pairs[0]
        return f"mostly {first.words()}" if len(self.pairs) > 1 else first.words()

    def words(self) -> str:
        """Return the interval, the most probable pair, and where the estimate comes from."""
        limits = f"95 %: {probability_words(self.low)} – {probability_words(self.high)}" if self.hits else ""
        hurt = f"{probability_words(self.expected_mais3)} severe injuries a future" if self.hits else ""
        futures = f"importance sampling, {self.hits} collisions in {self.count} futures"
        return "; ".join(part for part in (limits, self.mostly(), hurt, futures) if part)


def probability_words(value: float) -> str:
    """Return a probability as percent, or as a power of ten below 0.1 %."""
    if value >= _PLAIN_NUMBER or value == 0:
        return f"{100 * value:.2g} %" if value < 0.995 else "100 %"
    digits, power = f"{value:.1e}".split("e")
    return f"{digits.removesuffix('.0')}e{int(power)}"


def write_rare(found: Rare, file: Path) -> None:
    """Write ``rare.json``."""
    write_atomic(file, json.dumps(dataclasses.asdict(found)).encode())


def read_rare(folder: Path) -> Rare | None:
    """Read the rare collisions of a result folder; None if it has none.

    Raises:
        ResultError: ``rare.json`` is damaged.
    """
    file = folder / RARE
    if not file.is_file():
        return None
    try:
        content = json.loads(file.read_bytes())
        pairs = tuple(RarePair(**{**pair, "causes": tuple(pair["causes"])}) for pair in content["pairs"])
        return Rare(**{**content, "pairs": pairs})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultError(f"{file}: cannot be read ({str(error)[:80]}); run again") from None
