"""Options of a command from a file: ``--config``, a TOML file or the ``run.json`` of a run."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Final

from typer.core import TyperArgument, TyperCommand

from scex_sumo.base.errors import UsageError, nearest
from scex_sumo.base.options import present_names

SHARED: Final = ("config", "quiet", "verbose", "json", "help")


def options_of_file(ctx: Any, path: Path) -> dict[str, Any]:
    """Return the options of a file for the command of a context."""
    return (_of_run if path.suffix == ".json" else _of_toml)(ctx, path)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeError) as error:
        raise UsageError(
            f"--config {path}: cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None


def _of_run(ctx: Any, path: Path) -> dict[str, Any]:
    try:
        words = json.loads(_read(path))["command"]
        program, name, *words = present_names(map(str, words))
    except (ValueError, KeyError, TypeError):
        raise UsageError(
            f"--config {path}: holds no command; only runs of the command line can be repeated"
        ) from None
    if name != ctx.info_name:
        raise UsageError(f"--config {path}: is of {program} {name}; give it to that command")
    given = ctx.command.make_parser(ctx).parse_args([str(word) for word in words])[0]
    return {k: v for k, v in given.items() if v not in (None, (), []) and type(v).__name__ != "Sentinel"}


def _of_toml(ctx: Any, path: Path) -> dict[str, Any]:
    """Return the options of a TOML file, whose keys are long options without dashes, or arguments."""
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib

    try:
        content = tomllib.loads(_read(path))
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"--config {path}: {error}") from None
    known, options = _keys(ctx.command), {}
    for key, value in content.items():
        param, positive = known.get(key.replace("_", "-"), (None, True))
        if param is None:
            raise UsageError(f"--config {path}: unknown key {key!r}; nearest: {nearest(key, known)}")
        options[param.name] = _value(param, value, path, key, positive=positive)
    return options


def _keys(command: TyperCommand) -> dict[str, tuple[Any, bool]]:
    """Return each key's parameter, and whether true means to set it: ``no-report = true`` clears it."""
    keys: dict[str, tuple[Any, bool]] = {}
    for param in command.params:
        if isinstance(param, TyperArgument):
            keys[(param.metavar or str(param.name)).rstrip(".").lower().split("|")[0]] = param, True
    for param in command.params:
        if not isinstance(param, TyperArgument) and param.name not in SHARED:
            keys |= {name[2:]: (param, True) for name in param.opts if name.startswith("--")}
            keys |= {name[2:]: (param, False) for name in param.secondary_opts if name.startswith("--")}
    return keys


def _value(param: Any, value: Any, path: Path, key: str, *, positive: bool) -> Any:
    """Return a TOML value as an option takes it: lists are joined by commas, tables become ``KEY=VALUE``.

    Paths are relative to the folder of the file.
    """
    several = getattr(param, "multiple", False) or param.nargs == -1
    entries = [f"{k}={v}" for k, v in value.items()] if isinstance(value, dict) else value
    if getattr(param, "is_flag", False):
        if not isinstance(value, bool):
            raise UsageError(f"--config {path}: {key} is {value!r}, needs true or false")
        return value is positive
    words = [str(entry) for entry in (entries if isinstance(entries, list) else [entries])]
    if param.type.name in ("path", "file", "directory"):
        words = [str(path.parent / entry) for entry in words]
    return words if several else ",".join(words)


def words_of(command: TyperCommand, ctx: Any) -> list[str]:
    """Return the command line of all that is given, by the file or here."""
    words: list[str] = []
    last: list[str] = []
    for param in command.params:
        source = ctx.get_parameter_source(param.name)
        if param.name in SHARED or source is None or source.name not in ("COMMANDLINE", "DEFAULT_MAP"):
            continue
        value = ctx.params[param.name]
        values = list(value) if isinstance(value, list | tuple) else [value]
        if isinstance(param, TyperArgument):
            last += map(str, values)
        elif getattr(param, "is_flag", False):
            words += (
                [param.opts[0] if value else param.secondary_opts[0]] if value or param.secondary_opts else []
            )
        else:
            words += [word for entry in values for word in (param.opts[-1], str(entry))]
    return [*words, *(["--"] if any(word.startswith("-") for word in last) else []), *last]
