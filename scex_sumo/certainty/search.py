"""Search for the vehicles whose models decide an event, by futures with chosen assignments.

An event is a function of the assignment of models to vehicles. Its decision tree is grown from futures that
are run for it: a leaf is a partial assignment in which all futures seen agree. Futures that were drawn before
only guess what to ask; they build no tree, so that they can check it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray

MAX_VEHICLES: Final = 8
"""Vehicles of an influence set; events that more vehicles decide stay sampled."""

MAX_LATER: Final = 5
"""Vehicles of an event of a later rank that futures are run for."""

MAX_LEAVES: Final = 256
LEAF_ROWS: Final = 2
"""Futures that agree in a leaf before it is believed; one less if `MIN_BACKING` drawn futures agree in it."""

MIN_BACKING: Final = 8

BASE_ROWS: Final = 64
"""Futures drawn first: they show where an event depends on more than was guessed."""

ROUND_ROWS: Final = 32
"""Futures of a round before it takes up later events: few rounds cost less than few futures."""

PATIENCE: Final = 96
"""Futures without a newly settled event after which a search ends: too many vehicles decide the rest."""

MAX_GUESSED: Final = 1000
"""Drawn futures that guess the next vehicle of a search."""

FREE: Final = -1  # a vehicle that a row leaves open
_LIKELY = 0.5  # a likely vehicle is asked first if it tells this part of what the best one tells
_STEPS = (1, 2, 4)  # vehicles changed at once between two futures that differ

Cube: TypeAlias = tuple[tuple[int, int], ...]
"""Partial assignment: vehicles and their levels."""
Simulate: TypeAlias = Callable[[IntArray], BoolArray]
"""Run futures with these assignments (R, V); returns (R, E) whether each event happens."""


@dataclass(eq=False)
class Node:
    """Node of a decision tree.

    Attributes:
        path: vehicle and level of each split above.
        vehicle: that the node splits by; `FREE` in a leaf.
        futures: by level of that vehicle.
        rows: futures seen in a leaf.
        certain: two futures that differ in this vehicle alone have different outcomes.
        is_backed: enough drawn futures agree in it.
        search: open search for the next vehicle: a future without and one with the event, and the vehicles in
            question, most likely first.
    """

    path: Cube
    vehicle: int = FREE
    futures: list[Node] = field(default_factory=list)
    rows: list[int] = field(default_factory=list)
    certain: bool = False
    is_backed: bool = False
    search: tuple[IntArray, IntArray, list[int]] | None = None

    def leaves(self) -> Iterator[Node]:
        """Yield the leaves below."""
        if not self.futures:
            yield self
        for future in self.futures:
            yield from future.leaves()

    def nodes(self) -> Iterator[Node]:
        """Yield the nodes below that split."""
        if self.futures:
            yield self
        for future in self.futures:
            yield from future.nodes()

    def leaf_of(self, row: IntArray) -> Node:
        """Return the leaf of an assignment (V,)."""
        node = self
        while node.futures:
            node = node.futures[int(row[node.vehicle])]
        return node

    def split(self, vehicle: int, levels: int) -> None:
        """Make futures for all levels of a vehicle."""
        self.vehicle = vehicle
        self.futures = [Node((*self.path, (vehicle, level))) for level in range(levels)]


class Search:
    """Decision trees of many events, grown together so that a future serves all of them.

    Attributes:
        rows: (R, V) assignments that were run.
        outcomes: (R, E).
    """

    def __init__(
        self,
        shares: Sequence[FloatArray],
        drawn: IntArray,
        seen: BoolArray,
        first: Sequence[Sequence[int]],
        *,
        rank: Sequence[int],
        rng: np.random.Generator,
    ) -> None:
        """Prepare the trees.

        Args:
            shares: per vehicle, the share of each of its levels.
            drawn: (N, V) level of each vehicle in the drawn futures.
            seen: (N, E) whether each event happens in them.
            first: per event, the vehicles that decide it most likely.
            rank: per event; events of a lower rank are settled first.
            rng: fills what nobody asks for.
        """
        self.shares, self.drawn, self.seen, self.rng = shares, drawn, seen, rng
        self._by_rank = [[e for e, r in enumerate(rank) if r == one] for one in sorted(set(rank))]
        self.levels = [len(share) for share in shares]
        self.rows = np.empty((0, len(shares)), dtype=np.int64)
        self._open = np.empty(0, dtype=np.bool_)  # (R,) rows of which a part was drawn
        self.outcomes = np.empty((0, seen.shape[1]), dtype=np.bool_)
        self.trees = [Node(()) for _ in range(seen.shape[1])]
        self.failed: set[int] = set()
        self._best = self._since = 0  # largest number of settled events, and of the rows when it was reached
        for event, tree in enumerate(self.trees):
            self._guess(event, tree, np.arange(len(drawn)), list(first[event]))

    def run(self, simulate: Simulate, *, most: int) -> None:
        """Run futures until every tree is settled, or none more is, or ``most`` have been run in all."""
        if not len(self.rows):
            events = [e for e in range(len(self.trees)) if len(self.influence(e)) <= MAX_VEHICLES]
            asked = [path for event in events for path in self._rare_cubes(event)]
            rows = self._merged(asked, [])[:most]
            more = self.random(max(min(BASE_ROWS, most) - len(rows), 0))
            self._add([], [*rows, *more], simulate)
        while (left := most - len(self.rows)) > 0:
            if (now := self._settled()) > self._best:
                self._best, self._since = now, len(self.rows)
            whole, drawn = self._wanted()
            if (not whole and not drawn) or len(self.rows) - self._since > PATIENCE:
                break
            self._add(whole[:left], drawn[: max(left - len(whole), 0)], simulate)

    def _settled(self) -> int:
        return sum(map(self.is_settled, range(len(self.trees))))

    def _parts(self) -> Iterator[list[int]]:
        """Yield open events in the order in which they are settled: by rank, those of few vehicles first.

        Events of too many vehicles come last, and only those of the first rank.
        """
        sizes = [min(len(self.influence(event)), MAX_VEHICLES + 1) for event in range(len(self.trees))]
        most = [MAX_VEHICLES, *[MAX_LATER] * len(self._by_rank)]
        few = [(part, size) for part, m in zip(self._by_rank, most, strict=False) for size in range(m + 1)]
        for part, size in [*few, *((part, MAX_VEHICLES + 1) for part in self._by_rank[:1])]:
            yield [event for event in part if sizes[event] == size and event not in self.failed]

    def is_settled(self, event: int) -> bool:
        """Return whether an event's tree is believed: certified, no open leaf, few enough vehicles."""
        tree = self.trees[event]
        if event in self.failed or len(self.influence(event)) > MAX_VEHICLES:
            return False
        return all(self._agrees(event, leaf) and len(leaf.rows) for leaf in tree.leaves())

    def influence(self, event: int) -> list[int]:
        """Return the vehicles that an event's tree splits by, ascending."""
        return sorted({node.vehicle for node in self.trees[event].nodes()})

    def cubes(self, event: int) -> list[Cube]:
        """Return the partial assignments under which a settled event happens; no two overlap."""
        leaves = self.trees[event].leaves()
        return [tuple(sorted(leaf.path)) for leaf in leaves if self.outcomes[leaf.rows[0], event]]

    def predict(self, event: int, rows: IntArray) -> BoolArray:
        """Return (R,) whether a settled event happens in assignments (R, V)."""
        happens = np.zeros(len(rows), dtype=np.bool_)
        for cube in self.cubes(event):
            happens |= np.all([rows[:, v] == level for v, level in cube] or [np.ones(len(rows))], axis=0)
        return happens

    def reopen(self, event: int) -> None:
        """Take a drawn future that a tree gets wrong as one to learn from."""
        wrong = np.flatnonzero(self.predict(event, self.drawn) != self.seen[:, event])
        for index in wrong[:2].tolist():
            row, happens = self.drawn[index], bool(self.seen[index, event])
            leaf = self.trees[event].leaf_of(row)
            other = self.rows[leaf.rows[0]]
            pair = (other, row) if happens else (row, other)
            leaf.search = leaf.search or (*pair, self._suspects(event, leaf, *pair))
        self._best, self._since = self._settled(), len(self.rows)

    def _guess(self, event: int, node: Node, index: IntArray, first: list[int]) -> None:
        """Split a node as long as the drawn futures in it disagree, first by the likely vehicles."""
        happens = self.seen[index, event]
        used = {vehicle for vehicle, _ in node.path}
        if not len(index) or happens.all() or not happens.any() or len(used) >= MAX_VEHICLES:
            node.is_backed = len(index) >= MIN_BACKING and bool(happens.all() or not happens.any())
            return
        gains = _gains(self.drawn[index], happens, self.levels)
        gains[list(used)] = -np.inf
        gains[[v for v, count in enumerate(self.levels) if count < 2]] = -np.inf
        best = int(np.argmax(gains))
        if not np.isfinite(gains[best]) or gains[best] <= 0:
            return
        likely = [v for v in first if gains[v] >= _LIKELY * gains[best]]
        best = likely[int(np.argmax(gains[likely]))] if likely else best
        node.split(best, self.levels[best])
        for level, future in enumerate(node.futures):
            self._guess(event, future, index[self.drawn[index, best] == level], first)

    def random(self, count: int) -> IntArray:
        """Draw assignments (count, V) by the shares."""
        draws = [self.rng.choice(len(share), size=count, p=share) for share in self.shares]
        return np.stack(draws, axis=1).astype(np.int64)

    def _add(self, whole: Sequence[IntArray], drawn: Sequence[IntArray], simulate: Simulate) -> None:
        """Run futures, and enter them into all trees."""
        start = len(self.rows)
        rows = np.array([*whole, *drawn], dtype=np.int64).reshape(-1, len(self.levels))
        self.rows = np.concatenate([self.rows, rows])
        self._open = np.concatenate([self._open, np.arange(len(rows)) >= len(whole)])
        self.outcomes = np.concatenate([self.outcomes, simulate(rows)])
        for event, tree in enumerate(self.trees):
            if event in self.failed:
                continue
            for number in range(start, len(self.rows)):
                tree.leaf_of(self.rows[number]).rows.append(number)
            self._update(event)

    def _agrees(self, event: int, leaf: Node) -> bool:
        happens = self.outcomes[leaf.rows, event]
        return leaf.search is None and bool(happens.all() or not happens.any())

    def _update(self, event: int) -> None:
        """Advance the searches of a tree, and begin one in each leaf that disagrees."""
        tree = self.trees[event]
        for leaf in list(tree.leaves()):
            self._settle(event, leaf)
        certain = {node.vehicle for node in tree.nodes() if node.certain}
        if sum(1 for _ in tree.leaves()) > MAX_LEAVES or len(certain) > MAX_VEHICLES:
            self.failed.add(event)

    def _settle(self, event: int, leaf: Node) -> None:
        """Split a leaf by a vehicle that is certain to matter, as often as its futures allow."""
        if self._agrees(event, leaf):
            return
        if leaf.search is None:
            happens = self.outcomes[leaf.rows, event]
            without, with_it = (
                self.rows[[r for r, h in zip(leaf.rows, happens, strict=True) if h == wanted]]
                for wanted in (False, True)
            )
            apart = (without[:, None] != with_it[None]).sum(axis=2)
            a, b = np.unravel_index(int(np.argmin(apart)), apart.shape)
            pair = without[a], with_it[b]
            leaf.search = (*pair, self._suspects(event, leaf, *pair))
        vehicle = self._narrowed(event, leaf)
        if vehicle is None:
            return
        rows, leaf.rows, leaf.search = leaf.rows, [], None
        leaf.split(vehicle, self.levels[vehicle])
        leaf.certain = True
        for number in rows:
            leaf.futures[int(self.rows[number, vehicle])].rows.append(number)
        for future in leaf.futures:
            self._settle(event, future)

    def _suspects(self, event: int, leaf: Node, without: IntArray, with_it: IntArray) -> list[int]:
        """Return the vehicles in which two futures of a leaf differ, most likely first."""
        drawn, seen = self.drawn[:MAX_GUESSED], self.seen[:MAX_GUESSED, event]
        pool = np.concatenate([drawn, self.rows])
        happens = np.concatenate([seen, self.outcomes[:, event]])
        here = np.ones(len(pool), dtype=np.bool_)
        for vehicle, level in leaf.path:
            here &= pool[:, vehicle] == level
        gains = _gains(pool[here], happens[here], self.levels)
        differ = np.flatnonzero(without != with_it)
        return [int(v) for v in differ[np.argsort(-gains[differ], kind="stable")]]

    def _narrowed(self, event: int, leaf: Node) -> int | None:
        """Narrow a search by the futures that were run for it; returns the vehicle if only one is left."""
        assert leaf.search is not None
        without, with_it, suspects = leaf.search
        while len(suspects) > 1:
            known = [(step, self._outcome(event, row)) for step, row in _between(without, with_it, suspects)]
            if any(happens is None for _, happens in known):
                leaf.search = (without, with_it, suspects)
                return None
            last = 0
            for step, happens in known:
                if happens:
                    with_it = _moved(without, with_it, suspects[:step])
                    break
                last = step
            without = _moved(without, with_it, suspects[:last])
            suspects = [v for v in suspects if without[v] != with_it[v]]
        return suspects[0]

    def _outcome(self, event: int, row: IntArray) -> bool | None:
        same = np.flatnonzero(np.all(self.rows == row, axis=1))
        return bool(self.outcomes[same[0], event]) if same.size else None

    def _wanted(self) -> tuple[list[IntArray], list[IntArray]]:
        """Return the assignments to run next: those of open searches, and of leaves seen too rarely.

        Later events come in if the earlier ones need few futures, or fill what those leave open.
        """
        whole: dict[bytes, IntArray] = {}
        partial: list[Cube] = []
        filling: list[Cube] = []
        first, is_first = {e for part in self._by_rank[:1] for e in part}, False
        for part in self._parts():
            is_full = len(whole) + len(partial) >= ROUND_ROWS
            for event in part:
                # Later ranks do not spend what the first one still needs.
                is_full |= is_first and event not in first and len(whole) + len(partial) >= ROUND_ROWS
                asked = list(self._rare_cubes(event))
                if is_full:
                    filling += asked
                    continue
                rows = self._tests(event)
                if not rows and not asked:
                    self._prune(event, self.trees[event])
                    rows = self._certificates(event)
                whole |= {row.tobytes(): row for row in rows}
                partial += asked
                is_first |= event in first and bool(rows or asked)
        return list(whole.values()), self._merged(partial, filling)

    def _tests(self, event: int) -> list[IntArray]:
        """Return the assignments that the open searches of an event need."""
        searches = [leaf.search for leaf in self.trees[event].leaves() if leaf.search is not None]
        rows = [row for search in searches for _, row in _between(*search)]
        return [row for row in rows if self._outcome(event, row) is None]

    def _rare_cubes(self, event: int) -> Iterator[Cube]:
        """Yield the partial assignments of an event that have been seen too rarely."""
        for leaf in self.trees[event].leaves():
            if leaf.search is None:
                yield from [leaf.path] * (LEAF_ROWS - leaf.is_backed - int(self._open[leaf.rows].sum()))

    def _merged(self, partial: Sequence[Cube], filling: Sequence[Cube]) -> list[IntArray]:
        """Put partial assignments together into few whole ones; what is left open is drawn.

        Those that are ``filling`` make no rows of their own.
        """
        count, every = len(partial), [*partial, *filling]
        asked = np.full((len(every), len(self.levels)), FREE, dtype=np.int64)
        for index, path in enumerate(every):
            for vehicle, level in path:
                asked[index, vehicle] = level
        # The second future of a leaf comes in another row.
        numbers: dict[frozenset[tuple[int, int]], int] = {}
        leaf = np.array([numbers.setdefault(frozenset(path), len(numbers)) for path in every], dtype=np.int64)
        left, rows = np.ones(len(every), dtype=np.bool_), []
        while left[:count].any():
            row, fits = np.full(len(self.levels), FREE, dtype=np.int64), np.ones(len(every), dtype=np.bool_)
            open_ = left.copy()
            while open_.any():
                index = int(np.argmax(open_))
                left[index] = False
                for vehicle, level in every[index]:
                    row[vehicle] = level
                    fits &= (asked[:, vehicle] == FREE) | (asked[:, vehicle] == level)
                open_ = left & fits & (leaf != leaf[index])
            rows.append(np.where(row == FREE, self.random(1)[0], row))
        return rows

    def _prune(self, event: int, node: Node) -> None:
        """Join futures that all agree with each other."""
        for future in node.futures:
            self._prune(event, future)
        if not node.futures or any(c.futures or c.search or not c.rows for c in node.futures):
            return
        rows = [number for future in node.futures for number in future.rows]
        happens = self.outcomes[rows, event]
        if happens.all() or not happens.any():
            node.vehicle, node.futures, node.rows = FREE, [], rows

    def _certificates(self, event: int) -> list[IntArray]:
        """Return assignments that show whether guessed splits matter: a future but for the node's vehicle.

        If its outcome is that of the future, the split's other side disagrees with itself, and is split.
        """
        wanted = []
        for node in self.trees[event].nodes():
            if node.certain:
                continue
            below = [
                (level, leaf, bool(self.outcomes[leaf.rows[0], event]))
                for level, future in enumerate(node.futures)
                for leaf in future.leaves()
            ]
            for level, leaf, happens in below:
                others = [other for other, _, differs in below if other != level and differs != happens]
                if others:
                    row = self.rows[leaf.rows[0]].copy()
                    row[node.vehicle] = others[0]
                    known = self._outcome(event, row)
                    node.certain = known is not None and known != happens
                    if known is None:
                        wanted.append(row)
                    break
        return wanted


def _between(without: IntArray, with_it: IntArray, suspects: Sequence[int]) -> list[tuple[int, IntArray]]:
    """Return (vehicles changed, assignment) between two that differ in the suspects."""
    steps = [step for step in _STEPS if step < len(suspects)]
    return [(step, _moved(without, with_it, suspects[:step])) for step in steps]


def _moved(without: IntArray, with_it: IntArray, vehicles: Sequence[int]) -> IntArray:
    row = without.copy()
    row[list(vehicles)] = with_it[list(vehicles)]
    return row


def _gains(rows: IntArray, happens: BoolArray, levels: Sequence[int]) -> FloatArray:
    """(V,) how much better an event is told if a vehicle's level is known: drop of the Gini impurity."""
    most = max(levels)
    count = np.zeros((2, rows.shape[1], most))
    for level in range(most):
        at = rows == level
        count[0, :, level], count[1, :, level] = at.sum(axis=0), (at & happens[:, None]).sum(axis=0)
    share = happens.mean()
    with np.errstate(invalid="ignore"):
        within = np.where(count[0] > 0, count[1] * (1 - count[1] / count[0]), 0.0).sum(axis=1)
    return np.asarray(share * (1 - share) - within / max(len(rows), 1))
