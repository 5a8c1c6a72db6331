"""``scex-sumo-tool COMMAND``: the same commands with the options of SUMO's own tools.

``-c FILE`` reads a configuration whose paths are relative to it, ``-C FILE`` writes one, and
``--save-template FILE`` describes the options with their types, as netedit's forms are made of.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import sumolib.options
import typer

from scex_sumo.__main__ import start
from scex_sumo.cli import command_line
from scex_sumo.commands.shared import COMMANDS

_SHARED = ("config", "help")


def parser_of(name: str) -> tuple[Any, Any]:
    """Return sumolib's parser of a command, made of its Typer options, and the command.

    Arguments become options with the name of their parameter, e.g. ``--map-path``.
    """
    group: Any = typer.main.get_command(command_line([name]))
    command = group.commands[name]
    parser = sumolib.options.ArgumentParser(prog=f"scex-sumo-tool {name}", description=command.help)
    for param in command.params:
        if param.name not in _SHARED:
            _add(parser, param)
    return parser, command


def _add(parser: Any, param: Any) -> None:
    text = (getattr(param, "help", None) or str(param.name)).replace("%", "%%")
    names = _names(param)
    if getattr(param, "is_flag", False):
        # What is on already is turned off.
        own = param.secondary_opts if param.default is True and param.secondary_opts else names
        parser.add_argument(*own, dest=param.name, action="store_true", default=False, help=text)
        return
    kind = param.type.name
    types = {"integer": int, "int": int, "float": float, "path": parser.file}
    options: dict[str, Any] = {"type": types.get(kind, str), "help": text, "fix_path": kind == "path"}
    options["category"] = "output" if param.name == "out" else "input" if kind == "path" else "processing"
    if isinstance(param.default, int | float | str):
        options["default"] = param.default
    if kind == "float" and param.metavar == "S":
        options["type"] = parser.time  # also H:M:S
    if param.nargs == -1 or getattr(param, "multiple", False):
        options |= {"nargs": "+", "type": parser.file_list if kind == "path" else str}
    parser.add_argument(*names, dest=param.name, required=param.required, **options)


def _names(param: Any) -> list[str]:
    if param.param_type_name == "argument":
        return [f"--{param.name.replace('_', '-')}"]
    return [option for option in param.opts if option not in ("-c", "-C")]


def words_of(name: str, arguments: Sequence[str]) -> list[str]:
    """Return the words of ``scex-sumo`` for those of this tool."""
    parser, command = parser_of(name)
    given = parser.parse_args(list(arguments))
    words, last = [name], list[str]()
    for param in command.params:
        value = getattr(given, str(param.name), None)
        if getattr(param, "is_flag", False):
            if not value:
                continue
            off = param.default is True and param.secondary_opts
            words.append((param.secondary_opts if off else param.opts)[-1])
        elif value in (None, "", param.default):
            continue
        elif param.param_type_name == "argument":
            last += value if isinstance(value, list) else [str(value)]
        else:
            for one in value if isinstance(value, list) else [value]:
                words.append(f"{param.opts[-1]}={one}")
    return [*words, *(["--", *last] if last else [])]


def main() -> None:
    """Run the tool; exit statuses are those of ``scex-sumo``."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name not in COMMANDS.paths:
        known = ", ".join(sorted(COMMANDS.paths))
        print(f"scex-sumo-tool COMMAND [options]; commands: {known}", file=sys.stderr)
        raise SystemExit(0 if name in ("-h", "--help") else 2)
    sys.argv = ["scex-sumo", *words_of(name, arguments)]
    start()


if __name__ == "__main__":
    main()
