"""Result of a test: verdicts of the cases, the number, and what changed against an older result."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.schema import SHARE, TEXT, listed, read_json, record
from scex_sumo.decision.decide import TEST_FROM
from scex_sumo.statistics.paired import holm
from scex_sumo.suites.estimate import Design
from scex_sumo.suites.suite import Suite

BETTER, EQUAL, WORSE, FAILED = VERDICTS = ("better", "equal", "worse", "failed")
CHANCE: Final = 0.05
CHANGES: Final = ("became_better", "became_worse")
RATES: Final = ("collisions_per_hour", "difference")
MATTERS: Final = 2.0
"""Factor by which P has to differ from people's; so small a difference matters to nobody."""
_OPERATORS: Final[dict[str, Callable[[float, float], bool]]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": operator.eq,
    ">": operator.gt,
    "<": operator.lt,
}
_CONDITION = re.compile(r"\s*([a-z_]+)\s*(>=|<=|==|>|<)\s*([-+.\deE]+)\s*")


def read_condition(text: str) -> tuple[str, str, float]:
    """Return name, operator and number of a condition as ``worse > 0``.

    Raises:
        UsageError: it is none, or names something else.
    """
    match = _CONDITION.fullmatch(text)
    try:
        if match is None or match[1] not in (*VERDICTS, *RATES):
            raise ValueError
        return match[1], match[2], float(match[3])
    except ValueError:
        known = ", ".join((*VERDICTS, *RATES))
        raise UsageError(
            f"--fail-if {text!r}: needs NAME OPERATOR NUMBER, e.g. 'worse > 0'; names: {known}"
        ) from None


def holding(condition: tuple[str, str, float], result: Mapping[str, Any]) -> str | None:
    """Return a condition in words if a result fulfils it; the rate of no case is infinite."""
    name, sign, limit = condition
    number = result["number"]
    if name in VERDICTS:
        value = float(result["verdicts"][name])
    else:
        value = float("inf") if number is None else float(number[name]["value"])
    return f"{name} {sign} {limit:g} (it is {value:g})" if _OPERATORS[sign](value, limit) else None


def with_verdicts(records: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return records of cases with verdict and p, after Holm.

    A case is worse, or better, if P differs from people's by a factor of `MATTERS` and not by chance, and one
    of both is large enough to be tested.
    """
    alone = [one.get("p_alone") for one in records]
    corrected = holm([float("nan") if p is None else p for p in alone])
    judged = []
    for one, p in zip(records, corrected, strict=True):
        if "reason" in one:
            judged.append({**one, "verdict": FAILED})
            continue
        less, more = sorted((one["probability"], one["people"]))
        differs = p < CHANCE and more >= TEST_FROM and more >= MATTERS * less
        changed = WORSE if one["probability"] > one["people"] else BETTER
        judged.append({**one, "verdict": changed if differs else EQUAL, "p": None if np.isnan(p) else p})
    return judged


def number_of(suite: Suite, records: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the rates of the function and of people, and their difference; None if every case failed.

    Contacts with the other one of each case count: those with third vehicles belong to other encounters. The
    weights of failed cases go to the others of their kind; a kind without any other is not seen.
    """
    rows, design = _of_suite(suite, records)
    if not rows:
        return None
    names = ("pair", "people_pair", "variance", "people_variance", "difference_variance")
    y, people, drawn, drawn_people, apart = (np.array([row[name] for row in rows]) for name in names)
    return {
        "collisions_per_hour": asdict(design.rate(y, drawn)),
        "people_collisions_per_hour": asdict(design.rate(people, drawn_people)),
        "people_of_all": suite.info["people"],
        "difference": asdict(design.difference(y - people, apart)),
        "cases": len(rows),
    }


def _of_suite(suite: Suite, records: Sequence[Mapping[str, Any]]) -> tuple[list[Mapping[str, Any]], Design]:
    """Return the records of the cases that ran, in the order of the suite, and their design."""
    by_name = {one["name"]: one for one in records if "probability" in one}
    ran = np.array([case.name in by_name for case in suite.cases])
    return [by_name[case.name] for case in suite.cases if case.name in by_name], suite.design.part(ran)


def unseen(suite: Suite, records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the suite cannot see, one sentence each."""
    ran = {one["kind"] for one in records if "reason" not in one}
    exposure = {row["kind"]: row["encounters"] for row in suite.info["exposure"]}
    words = [f"{kind}: no case has run ({n:g} encounters)" for kind, n in exposure.items() if kind not in ran]
    return [
        *words,
        f"{suite.info['rare']} encounters in which people collide less than once in a million moments",
        f"{suite.info['doubtful']} encounters with doubtful data",
        "pairs that the data set does not have; offences at lights; weather, sensors; what comes after 3 s",
    ]


def compared(suite: Suite, result: Mapping[str, Any], old: Mapping[str, Any]) -> dict[str, Any]:
    """Return which cases became better, worse or failed since an older result, and the paired difference."""
    rank = {BETTER: 0, EQUAL: 1, WORSE: 2, FAILED: 3}
    before = {one["name"]: one for one in old["cases"]}
    now = {one["name"]: one for one in result["cases"] if one["name"] in before}
    change = {name: rank[one["verdict"]] - rank[before[name]["verdict"]] for name, one in now.items()}
    rows, design = _of_suite(
        suite, [one for one in now.values() if {"pair", "variance"} <= {*before[one["name"]]}]
    )
    pairs = [(row, before[row["name"]]) for row in rows]
    more = np.array([one["pair"] - other["pair"] for one, other in pairs])
    drawn = np.array([one["variance"] + other["variance"] for one, other in pairs])
    return {
        "function": old["function"],
        CHANGES[0]: [name for name, by in change.items() if by < 0],
        CHANGES[1]: [name for name, by in change.items() if by > 0],
        "difference": asdict(design.difference(more, np.where(more == 0, 0.0, drawn))) if rows else None,
    }


_CASE = record(
    {"name": TEXT, "verdict": {"enum": list(VERDICTS)}},
    {"pair": SHARE, "variance": {"type": "number", "minimum": 0}},
)
_RESULT: Final = record({"function": TEXT, "suite_digest": TEXT, "cases": listed(_CASE)})


def read_result(file: Path, suite: str) -> dict[str, Any]:
    """Read an older result.

    Raises:
        ResultError: it cannot be read, or is of another suite.
    """
    content: dict[str, Any] = read_json(file, _RESULT, "give --against the test.json of a test")
    if content["suite_digest"] != suite:
        raise ResultError(f"--against {file}: of another suite; test both functions on the same one")
    return content
