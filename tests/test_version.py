"""Versions are those that packages say of themselves."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

import pytest

from scex_sumo.version import version_of


@pytest.mark.parametrize(
    "package", ["libsumo", "eclipse-sumo", "numpy", "scipy", "shapely", "pyarrow", "pytest"]
)
def test_a_version_is_that_of_the_metadata(package: str) -> None:
    assert version_of(package) == version(package)


def test_what_is_not_installed_has_none() -> None:
    with pytest.raises(PackageNotFoundError):
        version_of("no-such-package")
