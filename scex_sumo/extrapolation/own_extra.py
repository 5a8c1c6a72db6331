"""Extra of the user, given by its import path and options."""

from __future__ import annotations

from typing import Any

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import Option, options_of
from scex_sumo.extrapolation.extras import Extra
from scex_sumo.results.extras import EXTRAS


def extra_named(given: str | Extra) -> Extra:
    """Return an extra by its name or import path and options, ``package.module:Class[:option=value]...``.

    Raises:
        UsageError: there is no such extra, or it has no such option.
    """
    if not isinstance(given, str):
        return given
    name, *rest = given.split(":")
    while rest and "=" not in rest[0]:
        name = f"{name}:{rest.pop(0)}"
    kind = EXTRAS.load(name)
    if not (isinstance(kind, type) and issubclass(kind, Extra)):
        raise UsageError(f"--extra {name}: is no class derived from scex_sumo.Extra")
    values = {}
    for entry in rest:
        key, equals, text = entry.partition("=")
        known = options_of(kind)
        if not equals or key not in known:
            raise UsageError(
                f"--extra {given}: {entry!r} is no option of it; it has {', '.join(known) or 'none'}"
            )
        values[key] = _value(known[key], getattr(kind, key, None), text, given)
    return kind(**values)


def _value(option: Option, default: Any, text: str, given: str) -> Any:
    if option.read is not None:
        return option.read([text] if option.several else text)
    if isinstance(default, bool):
        return text.lower() in ("true", "1")
    try:
        return type(default)(text) if isinstance(default, int | float) else text
    except ValueError:
        raise UsageError(f"--extra {given}: {text!r} is no number") from None
