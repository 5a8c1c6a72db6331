"""Part of a run's page that an extra adds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from scex_sumo.page.html import Html


@dataclass(frozen=True, kw_only=True)
class PagePart:
    """Cards of an extra, and what the page's scripts read of it.

    Attributes:
        cards: below the tables.
        info: names and numbers by key.
        scripts: assets that its cards need, besides those of each page.
        tables: sortable tables by the id of their place, see `table_place`.
        verdict: a sentence below the worst encounters.
    """

    cards: Sequence[Html] = ()
    info: Mapping[str, Any] = field(default_factory=dict)
    scripts: Sequence[str] = ()
    tables: Mapping[str, Any] = field(default_factory=dict)
    verdict: str = ""
