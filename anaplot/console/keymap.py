"""The user's keymap: a TOML file of `action = "key"` lines."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from pathlib import Path

from textual.keys import KEY_TO_UNICODE_NAME, Keys, _character_to_key

from anaplot.console.keys import ACTIONS
from anaplot.errors import InputError
from anaplot.textfiles.inputfile import read_text
from anaplot.textfiles.tomlvalues import TomlError, toml_values
from anaplot.textfiles.wording import place, plain

__all__ = ["check_keymap", "default_path", "keys_in_force", "load_keymap"]

_LARGEST = 64 * 1024
_MODIFIERS = frozenset({"ctrl", "shift", "alt", "super", "hyper", "meta"})
_RESERVED = frozenset({"ctrl+c", "ctrl+q", "ctrl+p"})
_NAMED = frozenset(key.value for key in Keys) | frozenset(KEY_TO_UNICODE_NAME) | {"plus", "minus"}


def default_path(environment: Mapping[str, str] | None = None) -> Path:
    """Return where the user's keymap lies: anaplot/keymap.toml in the XDG configuration folder."""
    environment = os.environ if environment is None else environment
    base = environment.get("XDG_CONFIG_HOME", "")
    # The base directory specification: a path that is not absolute is to be ignored.
    folder = Path(base) if base and Path(base).is_absolute() else Path.home() / ".config"
    return folder / "anaplot" / "keymap.toml"


def _canonical(key: str) -> str:
    """Return the name Textual gives to a key as written: "+" is plus."""
    return _character_to_key(key) if len(key) == 1 else key


def _is_key(key: str) -> bool:
    if len(key) == 1:
        return key.isprintable() and not key.isspace()
    *modifiers, last = key.split("+")
    if not set(modifiers) <= _MODIFIERS or len(set(modifiers)) != len(modifiers):
        return False
    return (len(last) == 1 and last.isprintable()) or last in _NAMED


def check_keymap(keymap: Mapping[str, object], source: str = "keymap") -> dict[str, str]:
    """Return the keymap when every action is known, every key is one, and no key means two things.

    Raises
    ------
    InputError
        Naming `source`, the action and the key.
    """
    checked: dict[str, str] = {}
    known = {action.id for action in ACTIONS}
    for name, value in keymap.items():
        if name not in known:
            near = difflib.get_close_matches(name, sorted(known), n=1)
            hint = f"; did you mean {near[0]}?" if near else f"; known: {', '.join(sorted(known))}"
            raise InputError(f"{source}: no action is called {plain(name, 120)!r}{hint}")
        if not isinstance(value, str):
            raise InputError(f'{source}: {name}: a key is a string, as in {name} = "f5"')
        keys = [key.strip() for key in value.split(",")]
        for key in keys:
            if not _is_key(key):
                raise InputError(f"{source}: {name}: {plain(key, 120)!r} is no key")
            if key in _RESERVED:
                raise InputError(f"{source}: {name}: {key} is kept for leaving and the palette")
        checked[name] = ",".join(keys)
    owner: dict[str, str] = {}
    for action, keys_of in keys_in_force(checked).items():
        for key in keys_of:
            other = owner.setdefault(_canonical(key), action)
            if other != action:
                raise InputError(f"{source}: key {key!r} would mean both {other} and {action}")
    return checked


def load_keymap(path: Path, *, required: bool = True) -> dict[str, str]:
    """Read a keymap file.

    Parameters
    ----------
    path
        The file.
    required
        Whether it must exist; otherwise a missing file is an empty keymap.

    Raises
    ------
    InputError
        When it cannot be read or is not a keymap, naming file and action or line.
    """
    if not required and _absent(path):
        return {}
    try:
        table = toml_values(read_text(path, _LARGEST))
    except TomlError as fault:
        raise InputError(f"{place(path, fault.line)}: {plain(str(fault), 120)}") from None
    return check_keymap(table, str(path))


def _absent(path: Path) -> bool:
    try:
        path.lstat()
    except FileNotFoundError:
        return True
    except (OSError, ValueError):
        return False  # the reader says what is wrong
    return False


def keys_in_force(keymap: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Return the keys of every action, the user's in place of the defaults."""
    return {
        action.id: tuple(key.strip() for key in keymap.get(action.id, action.keys).split(","))
        for action in ACTIONS
    }
