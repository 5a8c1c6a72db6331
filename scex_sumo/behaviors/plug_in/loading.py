"""Import paths of models: ``package.module:Driver``, as a user names them or an entry point does."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from scex_sumo.behaviors.plug_in.usable import reason_in_model
from scex_sumo.behaviors.plug_in.user_model import UserModel, user_model
from scex_sumo.errors import UsageError


def is_import_path(module: str, attribute: str) -> bool:
    """Whether ``module:attribute`` can be one: both are made of identifiers."""
    return all(part.isidentifier() for part in module.split(".")) and attribute.isidentifier()


def load_model(path: str) -> UserModel:
    """The model that an import path names.

    Modules of the current directory are found too, after those that are installed.

    Args:
        path: ``package.module:name``.

    Raises:
        UsageError: there is no such module or name, importing it fails, or it stands for no model.
    """
    name, _, attribute = path.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        # A console script has its own folder on the path, not the one that the user is in.
        sys.path.append(here)
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not (name == error.name or name.startswith(f"{error.name}.")):
            raise UsageError(f"{path}: {name} imports {error.name}, which is not installed") from None
        raise UsageError(
            f"{path}: no module {error.name} in {here} or among the installed packages; "
            "a model is name[:parameter=value]... or package.module:Class"
        ) from None
    except Exception as error:  # whatever a user's module does when it is imported
        raise UsageError(f"{path}: importing {name} {reason_in_model(error)}") from error
    if not hasattr(module, attribute):
        own = [
            key
            for key, value in vars(module).items()
            if callable(value) and getattr(value, "__module__", None) == name and not key.startswith("_")
        ]
        there = f"; it has {', '.join(sorted(own))}" if own else ""
        raise UsageError(f"{path}: {name} ({module.__file__}) has no {attribute}{there}")
    return user_model(getattr(module, attribute), path)
