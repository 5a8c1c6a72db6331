"""Pickles for worker processes, which keep their copies of what they are sent again."""

from __future__ import annotations

import io
import pickle
from collections import OrderedDict
from typing import Any
from uuid import uuid4

from scex_sumo.base.errors import UsageError
from scex_sumo.base.owned import SentOnce, owner_cache

MAX_COPIES = 8


def pickled(content: Any) -> bytes:
    """Pickle; classes of the user's script by value, because a worker does not run it."""
    try:
        packed = _packed(content)
    except (pickle.PicklingError, AttributeError, TypeError):
        packed = b"__main__"
    if b"__main__" not in packed:
        return packed
    import cloudpickle

    try:
        by_value: bytes = cloudpickle.dumps(content)
    except Exception as error:  # of a user's object
        raise UsageError(f"a model or metric cannot be sent to workers ({error}); use --workers 1") from None
    return by_value


def unpickled(packed: bytes) -> Any:
    """Return what `pickled` packed; a `SentOnce` is the copy that this process has of it."""
    return _Unpickler(io.BytesIO(packed)).load()


def _packed(content: Any) -> bytes:
    buffer = io.BytesIO()
    _Pickler(buffer, content).dump(content)
    return buffer.getvalue()


@owner_cache
def _named(content: SentOnce) -> tuple[str, bytes]:
    """Return a name of an object, and its pickle."""
    return uuid4().hex, _packed(content)


class _Pickler(pickle.Pickler):
    def __init__(self, buffer: io.BytesIO, whole: Any) -> None:
        super().__init__(buffer, protocol=pickle.HIGHEST_PROTOCOL)
        self._whole = whole

    def persistent_id(self, content: Any) -> tuple[str, bytes] | None:
        return _named(content) if isinstance(content, SentOnce) and content is not self._whole else None


_copies: OrderedDict[str, Any] = OrderedDict()


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, named: tuple[str, bytes]) -> Any:
        name, packed = named
        if name not in _copies:
            _copies[name] = unpickled(packed)
        _copies.move_to_end(name)
        if len(_copies) > MAX_COPIES:
            _copies.popitem(last=False)
        return _copies[name]
