"""A digest of what a computation is asked, its options and its block: the same digest, the same."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

import numpy as np

from anaplot.errors import InputError
from anaplot.photogrammetry.imagepoints import ImagePoints
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.wording import place, plain, reason

__all__ = ["digest_of", "name_of", "unwrapped"]

_LARGEST = 4 * 1024**3  # bytes of a file that an option names


def digest_of(what: str, asked: Any, *, names_files: bool = False) -> str:
    """Return a digest of everything that values say: SHA-256, in hexadecimal.

    Parameters
    ----------
    what
        What messages call it.
    asked
        Dataclasses, mappings, sequences, sets, arrays, plain values, functions of a module.
        A path stands for what is in its file.
    names_files
        A text that names a file stands for what is in it, too.

    Raises
    ------
    InputError
        It holds something of which nobody can tell whether it is the same, or a file that cannot
        be read.
    """
    return _digest(what, asked, names_files).hex()


def unwrapped(
    compute: Callable[..., Any],
) -> tuple[Callable[..., Any], tuple[partial[Any], ...]]:
    """Return the function that is called, and the partial ones around it, the outermost first."""
    partials: list[partial[Any]] = []
    while isinstance(compute, partial):
        partials.append(compute)
        compute = compute.func
    return compute, tuple(partials)


def name_of(compute: Callable[..., Any]) -> tuple[str, tuple[Any, ...]]:
    """Return the name of a function of a module, and what it is given in part.

    Raises
    ------
    InputError
        It is no such function: its name does not say what it does.
    """
    compute, partials = unwrapped(compute)
    parts = [part for one in partials for part in (one.args, sorted(one.keywords.items()))]
    name = getattr(compute, "__qualname__", "<>")
    of_a_module = isinstance(compute, FunctionType | type) or (
        isinstance(compute, BuiltinFunctionType) and isinstance(compute.__self__, ModuleType)
    )
    if "<" in name or not of_a_module:
        raise InputError(
            f"{plain(repr(compute), 80)}: is no function of a module; answers cannot be kept of it"
        )
    return f"{compute.__module__}.{name}", tuple(parts)


def _digest(what: str, asked: Any, names_files: bool) -> bytes:
    digest = hashlib.sha256()
    waiting: list[Any] = [asked]
    while waiting:
        one = waiting.pop()
        if is_dataclass(one) and not isinstance(one, type):
            # not its repr: that leaves the rows out
            digest.update(f"{_kind(one)}(".encode())
            waiting += [getattr(one, field.name) for field in fields(one)]
        elif isinstance(one, Mapping):
            digest.update(f"{{{len(one)}".encode())
            waiting += [part for item in one.items() for part in item]
        elif isinstance(one, list | tuple | ImagePoints):
            digest.update(f"[{len(one)}".encode())
            waiting += one
        elif isinstance(one, set | frozenset):
            digest.update(f"<{len(one)}".encode())
            for part in sorted(_digest(what, part, names_files) for part in one):
                digest.update(part)
        elif isinstance(one, np.ndarray | np.generic) and not one.dtype.hasobject:
            digest.update(f"{one.dtype.str}{one.shape}".encode())
            digest.update(one.tobytes())
        elif isinstance(one, os.PathLike):
            digest.update(_file(Path(one)))
        elif isinstance(one, Enum):
            digest.update(f"{_kind(one)}.{one.name};".encode())
        elif one is None or isinstance(one, bool | int | float | complex | str | bytes):
            # surrogates: names of files are not all text
            digest.update(f"{one!r};".encode("utf-8", "surrogatepass"))
            if names_files and isinstance(one, str) and _is_file(one):
                digest.update(_file(Path(one)))
        elif callable(one):
            name, parts = name_of(one)
            digest.update(f"{name};".encode())
            waiting.append(parts)
        else:
            raise InputError(
                f"{what}: holds a {plain(type(one).__name__, 60)}: nobody can tell whether it is "
                "the same, answers cannot be kept of it"
            )
    return digest.digest()


def _is_file(text: str) -> bool:
    try:
        return Path(text).is_file()
    except (OSError, ValueError):  # it is no name at all
        return False


def _kind(one: object) -> str:
    return type(one).__qualname__


def _file(path: Path) -> bytes:
    try:
        with open_input(path, _LARGEST) as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError as error:
        raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from None
