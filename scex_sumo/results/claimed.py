"""Folder that one process writes: claimed before, resumed after an interruption, a result once finished."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from scex_sumo.errors import ResultError
from scex_sumo.files import lock, unlock, write_atomic

PENDING = "incomplete.json"
_Folder = TypeVar("_Folder", bound="ClaimedFolder")


class ClaimedFolder:
    """Has ``incomplete.json`` from the claim on, and the file of its contents once it is finished.

    Both hold the identity of what is written, by which the same command finds its own folder again.
    """

    info: ClassVar[str]
    """Name of the file that makes the folder a result."""
    what: ClassVar[str]
    another: ClassVar[str]
    """Words for what is written here, and for one that was made otherwise."""

    def __init__(self, path: Path, configuration: Mapping[str, Any], *, overwrite: bool = False) -> None:
        """Claim a folder.

        Args:
            path: the folder; it need not exist.
            configuration: what the identity is of.
            overwrite: replace what was made otherwise.

        Raises:
            ResultError: it holds something else, cannot be written, or another process writes it.
        """
        self.path = path
        self.identity = hashlib.sha256(as_json(configuration).encode()).hexdigest()
        try:
            str(path).encode()  # SUMO and Arrow write to no other paths
            path.mkdir(parents=True, exist_ok=True)
            lock(path)
            found = self._found_identity()
            if found != self.identity:
                self._check_free(found, overwrite)
                for name in (self.info, PENDING):
                    (path / name).unlink(missing_ok=True)
                self._clear()
            self._prepare()
            write_atomic(path / PENDING, as_json({"identity": self.identity}).encode())
            (path / self.info).unlink(missing_ok=True)
        except UnicodeEncodeError:
            raise ResultError(f"{path}: this path is not UTF-8; give another folder with -o") from None
        except OSError as error:
            unlock(path)
            raise ResultError(f"{path}: cannot write the {self.what}: {error.strerror or error}") from None
        except ResultError:
            unlock(path)
            raise

    def _found_identity(self) -> str | None:
        """Identity that the folder tells; empty for one that cannot be read."""
        for file in (self.path / PENDING, self.path / self.info):
            if file.is_file():
                try:
                    return str(json.loads(file.read_text())["identity"])
                except (ValueError, KeyError, TypeError):
                    return ""
        return None

    def _check_free(self, found: str | None, overwrite: bool) -> None:
        if found is not None and not overwrite:
            remedy = "give another folder with -o, or --overwrite to replace it"
            raise ResultError(f"{self.path}: holds {self.another}; {remedy}")
        if found is None and any(self.path.iterdir()):
            raise ResultError(
                f"{self.path}: not empty, and no {self.what} of scex-sumo; give another folder with -o"
            )

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
        (self.path / PENDING).unlink(missing_ok=True)

    def close(self) -> None:
        """Let go of the folder."""
        unlock(self.path)

    def __enter__(self: _Folder) -> _Folder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def as_json(content: Mapping[str, Any], *, indent: int | None = None, allow_nan: bool = True) -> str:
    """An object as a line of text, or as several."""
    sort = indent is None
    return json.dumps(content, sort_keys=sort, indent=indent, default=str, allow_nan=allow_nan) + "\n"
