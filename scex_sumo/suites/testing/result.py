"""Result of a test: verdicts of the cases, the number, and what changed against an older result."""

from __future__ import annotations

import json
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import ResultError, UsageError, one_line
from scex_sumo.studies.under_test.paired import holm
from scex_sumo.suites.estimate import Rate, rate
from scex_sumo.suites.suite import Suite

BETTER, EQUAL, WORSE, FAILED = VERDICTS = ("better", "equal", "worse", "failed")
CHANCE: Final = 0.05
COUNTS: Final = VERDICTS
RATES: Final = ("collisions_per_hour", "severe_per_hour", "difference")
_OPERATORS: Final[dict[str, Callable[[float, float], bool]]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": operator.eq,
    ">": operator.gt,
    "<": operator.lt,
}
_CONDITION = re.compile(r"\s*([a-z_]+)\s*(>=|<=|==|>|<)\s*([-+.\deE]+)\s*")


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Condition by which a test fails, as ``worse > 0``."""

    name: str
    sign: str
    limit: float

    @classmethod
    def of(cls, text: str) -> Condition:
        """Read a condition; raise a `UsageError` for a bad one."""
        match = _CONDITION.fullmatch(text)
        try:
            if match is None or match[1] not in (*COUNTS, *RATES):
                raise ValueError
            return cls(name=match[1], sign=match[2], limit=float(match[3]))
        except ValueError:
            known = ", ".join((*COUNTS, *RATES))
            raise UsageError(
                f"--fail-if {text!r}: needs NAME OPERATOR NUMBER, e.g. 'worse > 0'; names: {known}"
            ) from None

    def holds(self, result: Mapping[str, Any]) -> bool:
        """Whether a result fulfils the condition."""
        return _OPERATORS[self.sign](self.value(result), self.limit)

    def value(self, result: Mapping[str, Any]) -> float:
        """Return the value of a result that the condition asks for; that of no case is infinite."""
        if self.name in COUNTS:
            return float(result["verdicts"][self.name])
        number = result["number"]
        return float("inf") if number is None else float(number[self.name]["value"])


def with_verdicts(records: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return records of cases with verdict and p of more or fewer contacts than people, after Holm."""
    chances = [one.get("chance") for one in records]
    two_sided = [min(1.0, 2 * min(c["more"], c["fewer"])) if c else float("nan") for c in chances]
    judged = []
    for one, corrected in zip(records, holm(two_sided), strict=True):
        if "reason" in one:
            judged.append({**one, "verdict": FAILED})
            continue
        more = one["contacts"] > one["people_contacts"]
        verdict = EQUAL if corrected >= CHANCE else WORSE if more else BETTER
        judged.append({**one, "verdict": verdict, "p": corrected})
    return judged


def verdicts_by_kind(cases: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """Return how many cases of each kind have each verdict."""
    counts: dict[str, dict[str, int]] = {}
    for kind in sorted({one["kind"] for one in cases}):
        own = [one["verdict"] for one in cases if one["kind"] == kind]
        counts[kind] = {name: own.count(name) for name in VERDICTS}
    return counts


def number_of(suite: Suite, records: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the rates of the function and of people, and their difference; None if every case failed.

    What people do is known for all candidates, so that only the function's rate is uncertain. If strata have
    no case that ran, both rates are those of the others.

    The weights of failed cases go to the others of their stratum; a stratum without any other is not seen.
    """
    names = {one["name"]: one for one in records if "reason" not in one}
    ran = np.array([case.name in names for case in suite.cases])
    if not ran.any():
        return None
    rows = [names[case.name] for case, there in zip(suite.cases, ran, strict=True) if there]
    stratum, weight = suite.stratum[ran], _scaled(suite, ran)
    each = {
        name: np.array([row[name] for row in rows]) for name in ("probability", "severity", "people", "most")
    }
    own = [case.about["severity"] for case, there in zip(suite.cases, ran, strict=True) if there]
    each["people_severity"] = np.array(own)
    drawn = np.array([row["variance"] for row in rows])
    given: Any = {"weight": weight, "stratum": stratum, "sizes": suite.sizes, "hours": suite.hours}
    harm = each["most"] * _harm(each)

    def of(values: FloatArray, most: FloatArray, spread: FloatArray | None = None) -> Rate:
        return rate(values, most=most, drawn=spread, **given)

    collisions, severe = of(each["probability"], each["most"], drawn), of(each["severity"], harm)
    people, people_severe = of(each["people"], each["most"]), of(each["people_severity"], harm)
    known = {"collisions_per_hour": people.value, "severe_per_hour": people_severe.value}
    if np.isin(suite.stratum, stratum).all():
        known = suite.info["people"]
    return {
        "collisions_per_hour": collisions.to_json(),
        "severe_per_hour": severe.to_json(),
        "people_collisions_per_hour": people.to_json(),
        "people_severe_per_hour": people_severe.to_json(),
        "people_of_all": suite.info["people"],
        "difference": collisions.less(known["collisions_per_hour"]).to_json(),
        "severe_difference": severe.less(known["severe_per_hour"]).to_json(),
        "cases": len(rows),
        "largest": _largest(rows, weight, each["probability"]),
    }


def _largest(rows: Sequence[Mapping[str, Any]], weight: FloatArray, y: FloatArray) -> dict[str, Any]:
    """Return the case that stands for others with most of the collisions, and its share of all."""
    parts = np.where(weight > 1, weight * y, 0.0)
    k = int(np.argmax(parts))
    return {"name": rows[k]["name"], "share": float(parts[k] / max((weight * y).sum(), 1e-300))}


def _harm(each: Mapping[str, FloatArray]) -> FloatArray:
    """Return the severe injuries of a contact, as of people; at least 1e-4."""
    return np.maximum(each["people_severity"] / np.maximum(each["people"], 1e-12), 1e-4)


def _scaled(suite: Suite, ran: np.ndarray[Any, np.dtype[np.bool_]]) -> FloatArray:
    weight = suite.weight[ran].copy()
    for h in range(len(suite.sizes)):
        inside = suite.stratum[ran] == h
        kept, whole = float(weight[inside].sum()), float(suite.weight[suite.stratum == h].sum())
        if kept > 0:
            weight[inside] *= whole / kept
    return np.asarray(weight)


def unseen(suite: Suite, records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the suite cannot see, one sentence each."""
    ran = {one["name"] for one in records if "reason" not in one}
    words = [f"{kind}: no case" for kind in suite.info["unseen"]]
    for h, stratum in enumerate(suite.info["strata"]):
        cases = [case.name for case in suite.cases if case.about["stratum"] == h]
        if cases and not ran & set(cases):
            words.append(f"{stratum['words']}: no case has run ({stratum['candidates']} candidates)")
    words.append(f"{suite.info['doubtful']} encounters with doubtful data were left out")
    return [
        *words,
        "pairs that the data set does not have; offences at lights; weather, sensors; contacts with third "
        "vehicles (counted apart); what others do after their action",
    ]


def compared(result: Mapping[str, Any], old: Mapping[str, Any]) -> dict[str, Any]:
    """Return which cases became better, worse or failed since an older result of the same suite."""
    rank = {BETTER: 0, EQUAL: 1, WORSE: 2, FAILED: 3}
    before = {one["name"]: one["verdict"] for one in old["cases"]}
    now = {one["name"]: one["verdict"] for one in result["cases"]}
    both = [name for name in now if name in before]
    return {
        "function": old["function"],
        "became_worse": [name for name in both if rank[now[name]] > rank[before[name]]],
        "became_better": [name for name in both if rank[now[name]] < rank[before[name]]],
        "same": sum(rank[now[name]] == rank[before[name]] for name in both),
        "before": old["number"] and old["number"]["collisions_per_hour"],
    }


def read_result(file: Path, suite: str) -> dict[str, Any]:
    """Read an older result.

    Raises:
        ResultError: it cannot be read, or is of another suite.
    """
    try:
        content = json.loads(file.read_bytes())
        cases, digest = content["cases"], content["suite_digest"]
        if not all({"name", "verdict"} <= set(one) for one in cases) or "number" not in content:
            raise KeyError("cases")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultError(f"--against {file}: no result of a test ({one_line(error)[:100]})") from None
    if digest != suite:
        raise ResultError(f"--against {file}: of another suite; test both functions on the same one")
    return dict(content)
