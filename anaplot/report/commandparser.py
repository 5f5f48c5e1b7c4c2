"""The parser of every command: errors in one line with the nearest name, help with examples."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Callable, Generator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

from anaplot.errors import InputError
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = ["CommandParser", "Commands", "NewPage", "NewTarget", "commands_of"]

_OTHER_PAGES = (".doc", ".docx", ".odt", ".pdf", ".ps")

_MISSING = "the following arguments are required"  # as argparse begins
_SOME = {"?": 1, "*": 1, "+": 2}
"""Words behind an option of so many, from which on the last may not be meant for it."""


class _Help(argparse.RawDescriptionHelpFormatter):
    """Fills lines to the terminal's width, but for texts that have lines of their own."""

    groups: Sequence[tuple[str, Sequence[str]]] = ()

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n" in text:
            return super()._fill_text(text, width, indent)
        return argparse.HelpFormatter._fill_text(self, text, width, indent)

    def _iter_indented_subactions(
        self, action: argparse.Action
    ) -> Generator[argparse.Action, None, None]:
        found = list(super()._iter_indented_subactions(action))
        if not (self.groups and isinstance(action, argparse._SubParsersAction)):
            self._indent()
            yield from found
            self._dedent()
            return
        by_name = {one.dest: one for one in found}
        for title, names in self.groups:
            yield argparse.Action((), dest=f"{title}:")
            self._indent()
            yield from (by_name[name] for name in names)
            self._dedent()


class NewTarget(argparse.Action):
    """A file or folder that a command writes: named once, and no sign for standard output."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Keep the path."""
        if getattr(namespace, self.dest, None) not in (None, self.default):
            raise argparse.ArgumentError(self, "given twice")
        self.check(values)
        setattr(namespace, self.dest, values)

    def check(self, path: Path) -> None:
        """Raise where a path names something else than what is written."""


class NewPage(NewTarget):
    """A page of HTML that a command writes."""

    def check(self, path: Path) -> None:
        """Refuse the names of pages of other kinds."""
        if path.suffix.lower() in _OTHER_PAGES:
            raise argparse.ArgumentError(
                self, f"{plain(path.name, 60)}: the page is HTML; a browser prints it as PDF"
            )


class _AddedLater:
    """What a parser has, after what was to be added later has been."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._key = f"{name} as it is"

    def __get__(self, parser: CommandParser | None, owner: type) -> Any:
        if parser is None:
            return self
        parser.add_now()
        return vars(parser)[self._key]

    def __set__(self, parser: CommandParser, value: Any) -> None:
        vars(parser)[self._key] = value


class CommandParser(argparse.ArgumentParser):
    """A parser whose errors are one line, like every other error, and say what is meant.

    Parameters
    ----------
    examples
        Commands, shown at the end of the help; a test runs them.
    said
        As `argparse.ArgumentParser` has it.
    """

    _actions: Any = _AddedLater()
    _action_groups: Any = _AddedLater()
    _mutually_exclusive_groups: Any = _AddedLater()
    _option_string_actions: Any = _AddedLater()

    def __init__(self, *, examples: Sequence[str] = (), **said: Any) -> None:
        self._later: list[Callable[[CommandParser], None]] = []
        self.examples = tuple(examples)
        self.groups: list[tuple[str, list[str]]] = []
        super().__init__(**{"formatter_class": _Help, **said})

    def later(self, *add: Callable[[CommandParser], None]) -> None:
        """Add arguments when somebody asks for them: of all commands one is called.

        Parameters
        ----------
        add
            What adds them, in this order.
        """
        self._later += add

    def add_now(self) -> None:
        """Add what was to be added later."""
        waiting, self._later = self._later, []
        for add in waiting:
            add(self)

    # Pythons from 3.14 on, which colour helps, hand on a formatter, and the file it is for
    def format_help(self, *given: Any, **named: Any) -> str:
        """Return the help with the examples at its end."""
        shown = [f"  {one}\n" for one in self.examples]
        text = super().format_help(*given, **named)
        return text + "".join(["\nexamples:\n", *shown] if shown else [])

    def _print_message(self, message: str, file: Any = None) -> None:
        """Write a help; argparse says nothing of an output that takes none of it."""
        if message:
            (sys.stderr if file is None else file).write(message)

    def _get_formatter(self, *given: Any, **named: Any) -> argparse.HelpFormatter:
        formatter = super()._get_formatter(*given, **named)
        if isinstance(formatter, _Help):
            formatter.groups = self.groups
        return formatter

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        if action.type is Path and "" in arg_strings:
            # which the path of no name would read as the folder one stands in
            raise argparse.ArgumentError(action, "an empty name (. is the folder you are in)")
        if arg_strings == ["-"] and isinstance(action, NewTarget):
            raise argparse.ArgumentError(action, "not to standard output: name a file (./- is one)")
        return super()._get_values(action, arg_strings)

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong as an `InputError`, with the command whose help says more."""
        if message.startswith(_MISSING) and (parts := commands_of(self)):
            message = f"{self._name or self.prog} what? {', '.join(parts)}"
        meant = message.endswith("?)")
        raise InputError(message if meant else f"{message} (see {self.prog} --help)")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; what is not known is an error of the very command that does not know it."""
        words = list(sys.argv[1:] if args is None else args)
        try:
            found, unknown = super().parse_known_args(words, namespace)
        except InputError as error:
            if commands_of(self) and words and words[0].startswith("--") and words[0] != "--":
                # no command, and what stands in its place is why
                self._refuse(words[0])
            taker, again = self._taken(words)
            if again:
                with contextlib.suppress(InputError):
                    found, unknown = super().parse_known_args(again, namespace)
                    if not unknown:
                        return found, unknown
            if taker and str(error).startswith(_MISSING):
                error.args = (f"{error}; {taker} takes every word behind it: write it last",)
            raise
        if unknown:
            self._refuse(unknown[0])
        return found, unknown

    def _taken(self, words: Sequence[str]) -> tuple[str, list[str]]:
        """Return an option of several words, and a line in which it has not taken a folder, too.

        `--covariance points:A BLOCK` is `BLOCK --covariance points:A` where there is such a folder
        or file; without it nothing is guessed.
        """
        taker = ""
        for at, word in enumerate(words if "--" not in words else ()):
            option = self._option_string_actions.get(word)
            if option is None or option.nargs not in _SOME:
                continue
            behind = list(takewhile(lambda one: not one.startswith("-"), words[at + 1 :]))
            if option.nargs == "?":
                behind = behind[:1]
            if len(behind) < _SOME[option.nargs]:
                continue
            taker, last = word, at + len(behind)
            if os.path.lexists(words[last]) and words[last] not in (option.choices or ()):
                return taker, [words[last], *words[:last], *words[last + 1 :]]
        return taker, []

    def _refuse(self, word: str) -> NoReturn:
        """Say what a word of a command line may have been meant for."""
        option = word.partition("=")[0]
        if not option.startswith("-"):
            self.error(f"unrecognized argument {quoted(word)}")
        if commands_of(self):
            self.error(f"no option {quoted(option)} before the command")
        known = [one for one in self._option_string_actions if one.startswith("--")]
        self.error(f"no option {quoted(option)}{hint(option, known, listing=False)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        choices = action.choices
        if choices is None or value in choices:
            return
        if isinstance(action, argparse._SubParsersAction):
            # a part's part is found by its own name, too: pattern is plan pattern
            inner = {
                part: f"{name} {part}"
                for name, parser in commands_of(self).items()
                for part in commands_of(parser)
            }
            known = [*choices, *inner.values()]
            if value in ("help", "version"):
                known = [f"--{value}"]
            meant = hint(inner.get(value, value), known)
            self.error(f"no command {quoted(f'{self._name} {value}'.strip())}{meant}")
        meant = hint(str(value), map(str, choices))
        raise argparse.ArgumentError(action, f"no {quoted(str(value))}{meant}")

    @property
    def _name(self) -> str:
        """What the command is called, without the program."""
        return self.prog.partition(" ")[2]


class Commands:
    """The commands of a parser, in the order in which they are added.

    Parameters
    ----------
    parser
        Theirs.
    dest
        What the options call the chosen one.
    """

    def __init__(self, parser: CommandParser, dest: str) -> None:
        self._parser = parser
        self._added = parser.add_subparsers(
            dest=dest, metavar="COMMAND", required=True, title="commands"
        )

    def group(self, title: str) -> None:
        """Begin a group: its title stands above what is added from now on."""
        self._parser.groups.append((title, []))

    def add(
        self,
        name: str,
        run: Callable[[argparse.Namespace], int] | None,
        text: str,
        *examples: str,
        description: str | None = None,
    ) -> CommandParser:
        """Add a command and return its parser.

        Parameters
        ----------
        name
            What it is called.
        run
            What it does, or None where it has commands of its own.
        text
            What it is, in the list of commands.
        examples
            Two or more, beginning with "anaplot".
        description
            What its own help says of it; `text` when None.
        """
        added: CommandParser = self._added.add_parser(
            name, help=text, description=description or text, examples=examples
        )
        if run is not None:
            added.set_defaults(run=run)
        if self._parser.groups:
            self._parser.groups[-1][1].append(name)
        return added


def commands_of(parser: argparse.ArgumentParser) -> dict[str, CommandParser]:
    """Return the parsers of a parser's commands, by name; none where it has no commands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}
