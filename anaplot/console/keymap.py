"""The user's keymap: a TOML file of `action = "key"` lines."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from textual.keys import KEY_TO_UNICODE_NAME, Keys, _character_to_key

from anaplot.console.keys import ACTIONS
from anaplot.textfiles.kinds import Made, Text, WrongValueError
from anaplot.textfiles.tomltable import read_toml
from anaplot.textfiles.wording import quoted

__all__ = ["canonical_key", "default_path", "keys_in_force", "load_keymap"]

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


def canonical_key(key: str) -> str:
    """Return the name Textual gives to a key as written: "+" is plus."""
    return _character_to_key(key) if len(key) == 1 else key


def _is_key(key: str) -> bool:
    if len(key) == 1:
        return key.isprintable() and not key.isspace()
    *modifiers, last = key.split("+")
    if not set(modifiers) <= _MODIFIERS or len(set(modifiers)) != len(modifiers):
        return False
    return (len(last) == 1 and last.isprintable()) or last in _NAMED


def _sent_instead(key: str) -> str:
    """Return what a terminal sends for a key as written: A for shift+a, ctrl+a for ctrl+A."""
    *modifiers, last = key.split("+")
    if not modifiers or len(last) != 1:
        return key
    if "shift" in modifiers:
        modifiers.remove("shift")
        last = last.upper()
    return "+".join([*modifiers, last.lower() if "ctrl" in modifiers else last])


def _keys(text: str) -> str:
    keys = [key.strip() for key in text.split(",")]
    for key in keys:
        if not _is_key(key):
            raise WrongValueError(f"{quoted(key)} is no key")
        if (sent := _sent_instead(key)) != key:
            raise WrongValueError(f"{quoted(key)} is no key: terminals send {quoted(sent)}")
        if key in _RESERVED:
            raise WrongValueError(f"{key} is kept for leaving and the palette")
    return ",".join(keys)


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
        When it cannot be read, an action is not known, a key is none, or a key would mean two
        things; naming file, line and action.
    """
    if not required and _absent(path):
        return {}
    table = read_toml(path, _LARGEST)
    keymap = table.take({}, dict.fromkeys((action.id for action in ACTIONS), Made(Text(), _keys)))
    owner: dict[str, str] = {}
    for action, keys in keys_in_force(keymap).items():
        for key in keys:
            other = owner.setdefault(canonical_key(key), action)
            if other != action:
                at = action if action in table else other
                raise table.fail(f"key {quoted(key)} would mean both {other} and {action}", at)
    return keymap


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
