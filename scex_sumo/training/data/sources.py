"""Source files that a module depends on: itself, and all of this package that it imports, however far."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]


@cache
def sources_digest(module: str) -> str:
    """SHA-256 of all source files that a module depends on; read once in a process."""
    return digest_of(sources(module))


def digest_of(files: Mapping[str, Path]) -> str:
    """SHA-256 of the names and the texts of files."""
    digest = sha256()
    for name, file in sorted(files.items()):
        digest.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def sources(module: str, package: Path = PACKAGE) -> dict[str, Path]:
    """Files of the modules that a module can reach by import statements, inside functions and for types too.

    Args:
        module: its full name, e.g. ``scex_sumo.training.data.dataset``.
        package: folder of the package that the module is in.

    Returns:
        File of each module by its full name, the module itself among them.
    """
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        file = _file_of(name, package)
        if file is not None and name not in found:
            found[name] = file
            waiting += _imported(file)
    return found


def _imported(file: Path) -> Iterator[str]:
    """Names that may be modules: ``from a import b`` may mean the module ``a.b``, or a name in ``a``."""
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _file_of(name: str, package: Path) -> Path | None:
    """File of a module of the package; None for other names."""
    path = package.parent.joinpath(*name.split("."))
    files = (path.with_name(f"{path.name}.py"), path / "__init__.py")
    return next((f for f in files if name.split(".")[0] == package.name and f.is_file()), None)
