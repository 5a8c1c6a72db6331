"""Optional libraries that learned drivers need."""

from __future__ import annotations

from importlib.util import find_spec

from scex_sumo.errors import MissingExtraError

LIBRARIES = ("torch", "torch_geometric")


def check_libraries(name: str) -> None:
    """Raise a `MissingExtraError` where a library for learned drivers is not installed; loads none."""
    missing = [library for library in LIBRARIES if find_spec(library) is None]
    if missing:
        raise MissingExtraError(
            f"{name}: needs {' and '.join(missing)}; install with: pip install 'scex-sumo[learned]'"
        )
