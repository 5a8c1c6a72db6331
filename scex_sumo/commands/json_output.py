"""JSON output of a command: its answer on standard output, and nothing else."""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from scex_sumo.base.errors import ScexError


def print_alone(command: Callable[[], Any]) -> None:
    """Run a command and print the answer that it returns, or fails with; drop what it prints meanwhile."""
    with _elsewhere() as stdout:

        def write(answer: Any) -> None:
            stdout.write(json.dumps(plain(answer), indent=2, ensure_ascii=False, allow_nan=False) + "\n")

        try:
            write(command())
        except ScexError as error:
            if error.answer is not None:
                write(error.answer)
            raise


@contextlib.contextmanager
def _elsewhere() -> Iterator[Any]:
    """Yield standard output; meanwhile what Python prints is dropped, and what SUMO prints goes to errors."""
    stdout = sys.stdout
    stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with (
            os.fdopen(os.dup(kept), "w", encoding="utf-8") as file,
            contextlib.redirect_stdout(io.StringIO()),
        ):
            yield file
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def plain(value: Any) -> Any:
    """Return a value as JSON has it: NaN is null, infinity ``"inf"``, arrays and tuples are lists."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else ("inf" if value > 0 else "-inf")
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)
