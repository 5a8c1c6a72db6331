"""Import paths of models: ``package.module:Driver``, as a user names them or an entry point does."""

from __future__ import annotations

from scex_sumo.behaviors.plug_in.usable import reason_in_model
from scex_sumo.behaviors.plug_in.user_model import UserModel, user_model
from scex_sumo.importing import import_object


def is_import_path(module: str, attribute: str) -> bool:
    """Whether ``module:attribute`` can be one: both are made of identifiers."""
    return all(part.isidentifier() for part in module.split(".")) and attribute.isidentifier()


def load_model(path: str) -> UserModel:
    """The model that an import path names.

    Raises:
        UsageError: as `import_object`, or it stands for no model.
    """
    hint = "; a model is name[:parameter=value]... or package.module:Class"
    return user_model(import_object(path, hint=hint, reason=reason_in_model), path)
