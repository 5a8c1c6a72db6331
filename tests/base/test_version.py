"""The version in the code is that of the package."""

from __future__ import annotations

from scex_sumo.base.version import __version__, version_of


def test_the_version_is_that_of_the_metadata() -> None:
    assert __version__ == version_of("scex-sumo")
