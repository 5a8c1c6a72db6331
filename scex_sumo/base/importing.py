"""Import of objects by path: ``package.module:name``, as users name their own code."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from scex_sumo.base.errors import UsageError


def _raised(error: BaseException) -> str:
    return f"raised {type(error).__name__}: {error}"


def import_object(path: str, *, hint: str = "", reason: Callable[[BaseException], str] = _raised) -> Any:
    """Import an object by its path; modules in the current folder come after installed ones.

    Args:
        path: ``package.module:name``, or ``package.module`` for the module itself.
        hint: added to the message if there is no such module.
        reason: describes an error that the module raises.

    Raises:
        UsageError: the import fails, or the name is missing.
    """
    name, _, attribute = path.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        # A console script has its own folder in the path instead.
        sys.path.append(here)
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not (name == error.name or name.startswith(f"{error.name}.")):
            raise UsageError(f"{path}: {name} imports {error.name}, which is not installed") from None
        raise UsageError(
            f"{path}: no module {error.name} in {here} or among the installed packages{hint}"
        ) from None
    except Exception as error:
        raise UsageError(f"{path}: importing {name} {reason(error)}") from error
    if not attribute:
        return module
    if not hasattr(module, attribute):
        own = [
            key
            for key, value in vars(module).items()
            if callable(value) and getattr(value, "__module__", None) == name and not key.startswith("_")
        ]
        there = f"; it has {', '.join(sorted(own))}" if own else ""
        raise UsageError(f"{path}: {name} ({module.__file__}) has no {attribute}{there}")
    return getattr(module, attribute)
