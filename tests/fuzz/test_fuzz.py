"""Mutated files end in a result, or in one line and the right exit status; ``make fuzz`` runs 10 000."""

from __future__ import annotations

import os
from pathlib import Path
from random import Random

import pytest

from tests.fuzz.cases import Fuzzer
from tests.fuzz.forked import _verdict
from tests.fuzz.mutations import mutated

KINDS = (
    "tracks",
    "maps",
    "commonroad",
    "folders",
    "options",
    "columns",
    "detectors",
    "opendd",
    "openscenario",
    "scenes",
    "outputs",
)


@pytest.fixture(scope="module")
def fuzzer(tmp_path_factory: pytest.TempPathFactory) -> Fuzzer:
    return Fuzzer(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_a_mutated_input_ends_in_a_result_or_in_one_line(fuzzer: Fuzzer, kind: str) -> None:
    case = fuzzer.case(kind, 0)
    assert case.ended.fine, f"{case.how}: {case.command}: {case.ended}"


def test_the_same_seed_gives_the_same_mutation(tmp_path: Path) -> None:
    written = []
    for name in ("one.csv", "two.csv"):
        file = tmp_path / name
        file.write_text("a,b\n1,2\n3,4\n" * 20)
        said = [mutated(file, rng) for rng in [Random(7)] for _ in range(3) if file.stat().st_size]
        written.append((said, file.read_bytes()))
    assert written[0] == written[1]


@pytest.mark.parametrize(
    ("status", "said", "verdict"),
    [
        (0, "note: one\nnote: two\n", "result"),
        (1, "note: one\nerror: a.csv: empty\n", "one line"),
        (1, "error: one\nerror: two\n", "words"),
        (1, "error: " + "x" * 9000, "words"),
        (1, "Traceback (most recent call last):\nValueError\n", "traceback"),
        (-11, "", "died"),
        (3, "error: one\n", "status"),
    ],
)
def test_a_verdict_is_strict(status: int, said: str, verdict: str) -> None:
    assert _verdict(status, said, 0) == verdict


def test_a_result_that_took_too_much_memory_is_a_finding() -> None:
    assert _verdict(0, "", 3 << 30) == "memory"


def test_no_case_has_changed_the_process(fuzzer: Fuzzer) -> None:
    before = Path.cwd(), os.getpid()
    fuzzer.case("options", 99)
    assert (Path.cwd(), os.getpid()) == before
