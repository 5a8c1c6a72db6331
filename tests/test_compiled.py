"""Compiled modules by themselves: there, or not to be had; scipy's package is whole when it is wanted."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from scex_sumo import compiled as module
from scex_sumo.compiled import compiled


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "scipy.special", raising=False)


def test_a_module_is_had_without_its_package() -> None:
    found = compiled("scipy.special", "_ufuncs", "ndtr", "ndtri")
    assert found is not None
    assert found.ndtr(0.0) == 0.5
    assert "scipy.special" not in sys.modules


@pytest.mark.parametrize("missing", [ImportError, None])
def test_what_is_elsewhere_is_none(monkeypatch: pytest.MonkeyPatch, missing: type[Exception] | None) -> None:
    def without(name: str) -> object:
        if missing is not None:
            raise missing(name)
        return sys

    monkeypatch.setattr(module.importlib, "import_module", without)
    assert compiled("scipy.special", "_ufuncs", "ndtr") is None
    assert "scipy.special" not in sys.modules


def test_nothing_stands_in_for_a_package_that_is_there() -> None:
    importlib.import_module("scipy.special")
    assert compiled("scipy.special", "_ufuncs", "ndtr") is None


def test_distances_are_scipys_to_the_bit_without_its_package_which_is_whole_when_it_is_wanted() -> None:
    code = (
        "import sys, numpy as np\n"
        "from scex_sumo.behaviors.learned.seen import surface\n"
        "some = np.random.default_rng(0).random((40, 60)) < 0.9\n"
        "found = surface.cells_to_go(some)\n"
        "assert 'scipy.ndimage' not in sys.modules\n"
        "from scipy.ndimage import distance_transform_edt, gaussian_filter\n"
        "assert np.array_equal(found, distance_transform_edt(some))\n"
        "surface._images = None\n"
        "assert np.array_equal(found, surface.cells_to_go(some))\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
