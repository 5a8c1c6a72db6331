"""Process that others' code cannot end."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

end_process = os._exit  # which `staying` replaces


@contextmanager
def staying() -> Iterator[None]:
    """Turn ``os._exit`` of others' code into SystemExit: it would end the process without a line."""
    before, process = os._exit, os.getpid()

    def refuse(status: int) -> NoReturn:
        if os.getpid() != process:  # one that the code has forked
            end_process(status)
        raise SystemExit(f"os._exit({status})")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = before
