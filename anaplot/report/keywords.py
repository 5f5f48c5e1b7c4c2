"""The options of a command as the keywords of a function: the same names, limits and checks."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable, Mapping
from functools import cache, wraps
from inspect import signature
from typing import Any, ParamSpec, TypeAlias, TypeVar

from anaplot.errors import InputError
from anaplot.textfiles.separated import separated
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = [
    "Declare",
    "chosen_options",
    "declared_options",
    "keywords_of",
    "names_in",
    "takes_options",
    "value_typed",
]

P = ParamSpec("P")
T = TypeVar("T")

Declare: TypeAlias = Callable[[argparse.ArgumentParser], None]
"""Adds a command's options to its parser."""


class _Options(argparse.ArgumentParser):
    """Remembers what is added to it."""

    def __init__(self) -> None:
        super().__init__(add_help=False)
        self.declared: dict[str, argparse.Action] = {}

    def add_argument(self, *names: Any, **said: Any) -> argparse.Action:
        action = super().add_argument(*names, **said)
        self.declared[action.dest] = action
        return action


@cache
def declared_options(declare: Declare) -> dict[str, argparse.Action]:
    """Return a command's options by the names of the keywords."""
    options = _Options()
    declare(options)
    return options.declared


def chosen_options(declare: Declare, options: argparse.Namespace) -> dict[str, Any]:
    """Return a command line's options that are not what they are without, by what one types."""
    return {
        _typed(action, getattr(options, key)): getattr(options, key)
        for key, action in declared_options(declare).items()
        if action.option_strings and getattr(options, key) != action.default
    }


def _typed(action: argparse.Action, value: object) -> str:
    """Return the word that gives an option a value: the first long one, or that says no."""
    if isinstance(action, argparse.BooleanOptionalAction) and value is False:
        return action.option_strings[-1]
    return next(word for word in action.option_strings if word.startswith("--"))


def takes_options(declare: Declare) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Have the keywords of a function checked as the options of a command are.

    Parameters
    ----------
    declare
        Adds the options to the command's parser.

    Returns
    -------
    callable
        Decorates the function. A value that is no good is an `InputError` that names the option.
    """

    def around(compute: Callable[P, T]) -> Callable[P, T]:
        form = signature(compute)

        @wraps(compute)
        def checked(*args: P.args, **keywords: P.kwargs) -> T:
            options = declared_options(declare)
            given = form.bind(*args, **keywords)
            for name, value in given.arguments.items():
                if name in options and options[name].option_strings:
                    given.arguments[name] = _checked(options[name], value)
            return compute(*given.args, **given.kwargs)

        return checked

    return around


def keywords_of(compute: Callable[..., object], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of a command line's options that a function takes by their names."""
    parameters = signature(compute).parameters.values()
    wanted = {one.name for one in parameters if one.kind is not one.VAR_POSITIONAL}
    return {name: value for name, value in options.items() if name in wanted}


def names_in(given: str | Iterable[str]) -> tuple[str, ...]:
    """Return names that are given one by one, or `separated` by commas."""
    return tuple(name for name in (separated(given) if isinstance(given, str) else given) if name)


def _checked(action: argparse.Action, value: Any) -> Any:
    """Return a value as the command line would have it."""
    option = action.option_strings[0]
    if value is None and action.default is None:
        return None
    if action.nargs == 0:
        if not isinstance(value, bool):
            raise InputError(f"{option}: neither True nor False")
        return value
    if isinstance(action, argparse._AppendAction) and isinstance(value, str):
        return [value]  # what may stand several times stands once
    if callable(action.type):
        try:
            value = action.type(value_typed(value))
        except argparse.ArgumentTypeError as error:
            raise InputError(f"{option}: {plain(str(error))}") from error
    elif action.choices is not None:
        value = value_typed(value)
    if action.choices is not None and value not in action.choices:
        known = [str(choice) for choice in action.choices]
        raise InputError(f"{option}: no {quoted(str(value))}{hint(str(value), known)}")
    return value


def value_typed(value: Any) -> str:
    """Return a value as one types it: a list with commas."""
    if isinstance(value, os.PathLike):
        return os.fsdecode(value)
    if not isinstance(value, list | tuple):
        return str(value)
    from anaplot.textfiles.csvlines import quoted_cell

    return ",".join(quoted_cell(str(part)) for part in value)
