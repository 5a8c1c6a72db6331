"""Output folder of one process at a time: locked, resumed after an interruption, finished as a result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import lock, unlock, write_atomic

PENDING = "incomplete.json"
_COPY = ".incomplete.json"  # used if `PENDING` is damaged
_DIGITS = 64  # of an identity, a SHA-256
_Folder = TypeVar("_Folder", bound="OutputFolder")


class OutputFolder:
    """Folder with ``incomplete.json`` while it is written, and the file of its contents once it is finished.

    Both hold the identity by which the same command finds its own folder again.
    """

    info: ClassVar[str]
    """File that makes the folder a result."""
    what: ClassVar[str]
    another: ClassVar[str]
    """Words for the result, and for a result with another configuration."""
    evidence: ClassVar[tuple[str, ...]] = ()
    """Files that together show that a folder is ours if ``info`` is damaged."""

    def __init__(self, path: Path, configuration: Mapping[str, Any], *, overwrite: bool = False) -> None:
        """Lock a folder and make it ready to be written; ``overwrite`` replaces another result.

        Raises:
            ResultError: it holds something else, cannot be written, or another process writes it.
        """
        self.path = path
        self.identity = hashlib.sha256(as_json(configuration).encode()).hexdigest()
        try:
            str(path).encode()  # SUMO and Arrow need UTF-8
            path.mkdir(parents=True, exist_ok=True)
            lock(path)
            self._make_free(overwrite)
            self._prepare()
            for name in (_COPY, PENDING):
                write_atomic(path / name, as_json({"identity": self.identity}).encode())
            (path / self.info).unlink(missing_ok=True)
        except UnicodeEncodeError:
            raise ResultError(f"{path}: this path is not UTF-8; give another folder with -o") from None
        except OSError as error:
            unlock(path)
            raise ResultError(f"{path}: cannot write the {self.what}: {error.strerror or error}") from None
        except ResultError:
            unlock(path)
            raise

    def _make_free(self, overwrite: bool) -> None:
        """Clear the folder unless it holds the same result; refuse one of another program."""
        names = (PENDING, _COPY, self.info)
        there = [name for name in names if (self.path / name).is_file()]
        identities = [found for name in there if (found := _identity_in(self.path / name))]
        if self.identity in identities:
            return
        remedy = "give another folder with -o, or --overwrite to replace it"
        if identities:
            if not overwrite:
                raise ResultError(f"{self.path}: holds {self.another}; {remedy}")
        elif there:
            if not overwrite and not self._is_ours():
                raise ResultError(f"{self.path / there[0]}: cannot be read; {remedy}")
        elif any(self.path.iterdir()):
            raise ResultError(
                f"{self.path}: not empty, and no {self.what} of scex-sumo; give another folder with -o"
            )
        for name in names:
            (self.path / name).unlink(missing_ok=True)
        self._clear()

    def _is_ours(self) -> bool:
        return bool(self.evidence) and all((self.path / name).exists() for name in self.evidence)

    def _clear(self) -> None:
        """Remove what was written before, and nothing else."""
        raise NotImplementedError

    def _prepare(self) -> None:
        """Make the folder ready to be written."""
        raise NotImplementedError

    def finish(self, info: Mapping[str, Any], *, allow_nan: bool = True) -> None:
        """Write the file of the contents: from now on the folder is a result."""
        content = as_json({**info, "identity": self.identity}, indent=2, allow_nan=allow_nan)
        write_atomic(self.path / self.info, content.encode())
        for name in (PENDING, _COPY):
            (self.path / name).unlink(missing_ok=True)

    def close(self) -> None:
        """Unlock the folder."""
        unlock(self.path)

    def __enter__(self: _Folder) -> _Folder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _identity_in(file: Path) -> str | None:
    try:
        identity = json.loads(file.read_bytes())["identity"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    return identity if isinstance(identity, str) and len(identity) == _DIGITS else None


def as_json(content: Mapping[str, Any], *, indent: int | None = None, allow_nan: bool = True) -> str:
    """Return an object as JSON: in one line with sorted keys, or indented."""
    sort = indent is None
    return json.dumps(content, sort_keys=sort, indent=indent, default=str, allow_nan=allow_nan) + "\n"
