"""Command line of the fuzzer: ``python -m tests.fuzz --cases 10000``; prints every finding, then a table."""

from __future__ import annotations

import argparse
import itertools
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

from tests.fuzz.cases import KINDS, OFTEN, Fuzzer


def main() -> int:
    """Run cases of all kinds in turn; status 1 where any ended as it must not."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each kind")
    parser.add_argument("--kind", choices=sorted(KINDS), action="append", help="these only; repeatable")
    given = parser.parse_args()
    kinds = given.kind or list(KINDS)
    ended: Counter[tuple[str, str]] = Counter()
    started, longest, bad = time.monotonic(), 0.0, 0
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    fuzzer = Fuzzer(folder, given.seed)
    numbers = {kind: itertools.count(given.first) for kind in kinds}
    every = itertools.cycle(given.kind or OFTEN)
    with suppress(KeyboardInterrupt):  # the table is of those that ran
        for done, kind in enumerate(itertools.islice(every, given.cases), 1):
            case = fuzzer.case(kind, next(numbers[kind]))
            ended[kind, case.ended.verdict] += 1
            longest = max(longest, case.ended.seconds)
            if not case.ended.fine:
                bad += 1
                how = f"{case.ended.verdict} ({case.ended.status}): {case.how}"
                print(f"{kind} {case.number}: {how}: {case.command[:120]}")
                print("   ", " | ".join(case.ended.said.strip().splitlines()[-3:])[-400:], flush=True)
            if done % 1000 == 0:
                print(f"{done} cases, {bad} findings, {time.monotonic() - started:.0f} s", flush=True)
    verdicts = sorted({verdict for _, verdict in ended}, key=lambda v: (v not in ("result", "one line"), v))
    print(f"| files | {' | '.join(verdicts)} |\n|---|{'---|' * len(verdicts)}")
    for kind in kinds:
        print(f"| {kind} | {' | '.join(str(ended[kind, verdict]) for verdict in verdicts)} |")
    took = f"{time.monotonic() - started:.0f} s, the longest {longest:.1f} s"
    print(f"{sum(ended.values())} cases, {bad} findings, {took}; kept in {folder}")
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
