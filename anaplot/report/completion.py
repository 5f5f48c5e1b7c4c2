"""`anaplot completion SHELL`: the shell completes commands, options, choices, names and files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, get_args

from anaplot.report.commandparser import CommandParser, commands_of

__all__ = ["completion_script"]

# as shtab has it, but for names with blanks; bash escapes what a function "_file" or "_dir" finds,
# and fish completes files behind a command that it does not know
_FISH_FILES = 'complete -C "_anaplot_any_file "(commandline -ct)'
_FILE = {
    "bash": "_anaplot_file",
    "zsh": "_files",
    "fish": "(_anaplot_file)",
    "preamble": {
        "bash": '_anaplot_file() {\n  compgen -f -- "$1"\n}',
        "fish": f"function _anaplot_file\n  {_FISH_FILES}\nend",
    },
}
_FOLDER = {
    "bash": "_anaplot_dir",
    "zsh": "_files -/",
    "fish": "(__fish_complete_directories)",
    "preamble": {"bash": '_anaplot_dir() {\n  compgen -d -- "$1"\n}'},
}

_FOLDERS = re.compile("BLOCK|FOLDER|EPOCH")
# a name that a shell takes as it stands: profiles are files that people name
_PLAIN = re.compile(r"[A-Za-z0-9][\w./+-]*", re.ASCII)


def completion_script(parser: CommandParser, shell: str) -> str:
    """Return a script with which a shell completes what a parser takes.

    Parameters
    ----------
    parser
        Of the whole command line; it is not used for anything else after that.
    shell
        "bash", "zsh" or "fish".
    """
    import shtab

    _describe(parser)
    return shtab.complete(parser, shell)


def _describe(parser: CommandParser) -> None:
    """Say of every argument of a parser and its commands what may stand there."""
    for action in parser._actions:
        if action.choices is not None or action.nargs == 0:
            continue
        known = _NAMES.get((parser.prog, action.dest)) or _NAMES.get(("", action.dest))
        metavar = str(action.metavar)
        complete: Any = None
        if known is not None:
            complete = _words(f"{parser.prog} {action.dest}", known)
        elif action.dest == "session":
            complete = _FILE  # of a block or by itself
        elif action.type is Path:
            complete = _FOLDER if _FOLDERS.match(metavar) else _FILE
        elif metavar.startswith("FILE") or action.dest in ("additional_prior", "test_set"):
            complete = _FILE
        if complete is not None:
            vars(action)["complete"] = complete
    for one in commands_of(parser).values():
        _describe(one)


def _words(what: str, known: _Known) -> dict[str, Any]:
    """Return how shells complete names, and perhaps files beside them."""
    function = "_" + re.sub(r"\W", "_", what) + "_file" * known.files
    names = " ".join(name for name in known.names() if _PLAIN.fullmatch(name))
    lines = {
        "bash": (f'compgen -W "{names}" -- "$1"', 'compgen -f -- "$1"'),
        "zsh": (f"compadd -- {names}", "_files"),
        "fish": (f"printf '%s\\n' {names}", _FISH_FILES),
    }
    bodies = {shell: "\n  ".join(one[: 1 + known.files]) for shell, one in lines.items()}
    return {
        "bash": function,
        "zsh": function,
        "fish": f"({function})",
        "preamble": {
            "bash": f"{function}() {{\n  {bodies['bash']}\n}}",
            "zsh": f"{function}() {{\n  {bodies['zsh']}\n}}",
            "fish": f"function {function}\n  {bodies['fish']}\nend",
        },
    }


class _Known(NamedTuple):
    """Names that an argument may have; `files`: or a file."""

    names: Callable[[], Iterable[str]]
    files: bool = True


def _kinds(way: str) -> list[str]:
    from anaplot.exchange.formats.registry import FORMATS

    return [kind for kind, one in FORMATS.items() if getattr(one, way)]


def _profiles() -> list[str]:
    from anaplot.plotter.profile import find_profiles

    return list(find_profiles())


def _patterns() -> list[str]:
    from anaplot.orientation.patterns import PATTERNS

    return list(PATTERNS)


def _cameras() -> list[str]:
    from anaplot.report.newquestions import camera_types

    return [name for name, _ in camera_types()]


def _scenarios() -> list[str]:
    from anaplot.planning.scenarionames import scenario_names

    return [*scenario_names(), *_patterns(), "cube"]


def _sets() -> tuple[str, ...]:
    from anaplot.aliases import SetName

    return get_args(SetName)


# by command and argument; "" of every command
_NAMES = {
    ("anaplot import", "kind"): _Known(partial(_kinds, "reads")),
    ("anaplot export", "kind"): _Known(partial(_kinds, "writes"), files=False),
    ("", "profile"): _Known(_profiles),
    ("", "pattern"): _Known(_patterns),
    ("anaplot new", "camera"): _Known(_cameras),
    ("anaplot plan network", "network"): _Known(lambda: ("cube",)),
    ("anaplot plan simulate", "scenario"): _Known(_scenarios),
    ("", "additional"): _Known(_sets, files=False),
}
