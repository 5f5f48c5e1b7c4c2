"""`anaplot manual`: the manual page, made of what the helps of all commands say."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from textwrap import wrap

from anaplot.report.commandparser import CommandParser, commands_of
from anaplot.textfiles.wording import plain
from anaplot.version import __version__

__all__ = ["manual_page"]

_SPECIAL = {
    "\\": r"\e",
    "-": r"\-",
    "'": r"\(aq",
    '"': r"\(dq",
    "`": r"\(ga",
    "^": r"\(ha",
    "~": r"\(ti",
}
_EXIT = (
    ("0", "Done."),
    (
        "1",
        "Done, and with --fail-on-flag something is flagged, or with replay --check something "
        "differs.",
    ),
    ("2", "Wrong usage or bad input; one line on standard error says what and where."),
    ("3", "The link to the instrument failed."),
    ("4", "Not computable."),
    ("130", "Interrupted."),
)


def manual_page(parser: CommandParser) -> str:
    """Return the page in roff, for `man`.

    Parameters
    ----------
    parser
        Of the whole command line.
    """
    lines = [
        f'.TH {parser.prog.upper()} 1 "" "{parser.prog} {__version__}" "User Commands"',
        ".SH NAME",
        f"{parser.prog} \\- on\\-line photogrammetric triangulation",
        ".SH SYNOPSIS",
        f".B {parser.prog}",
        r".I COMMAND",
        r"[\fIoptions\fR]",
        ".SH DESCRIPTION",
        *_text(parser.description or ""),
        ".SH COMMANDS",
    ]
    commands = commands_of(parser)
    for title, names in parser.groups:
        lines.append(f'.SS "{_escaped(title.capitalize())}"')
        for name in names:
            lines += [".TP", rf"\fB{_escaped(name)}\fR", *_text(commands[name].description or "")]
    lines += [".SH OPTIONS", ".TP", r"\fB\-\-help\fR", "What a command takes, with examples."]
    lines += [".TP", r"\fB\-\-version\fR", "The version."]
    for name in (name for _, names in parser.groups for name in names):
        lines += _command(commands[name])
    lines.append(".SH EXIT STATUS")
    for code, means in _EXIT:
        lines += [".TP", rf"\fB{code}\fR", *_text(means)]
    return "\n".join(lines) + "\n"


def _command(parser: CommandParser) -> Iterator[str]:
    """Yield the section of a command, and those of its parts."""
    yield f'.SH "{_escaped(parser.prog.upper())}"'
    arguments = [one for one in parser._actions if one.help is not argparse.SUPPRESS]
    places = [_place(one) for one in arguments if not one.option_strings]
    yield rf"\fB{_escaped(parser.prog)}\fR " + " ".join([*places, r"[\fIoptions\fR]"])
    yield ".PP"
    yield from _text(parser.description or "")
    for one in arguments:
        if isinstance(one, argparse._SubParsersAction | argparse._HelpAction):
            continue
        yield ".TP"
        yield _heading(one)
        yield from _text(argparse.HelpFormatter(parser.prog)._expand_help(one))
    if parser.epilog:
        yield from (".PP", ".nf", *_lines(parser.epilog), ".fi")
    yield from (".PP", "Examples:", ".PP", ".nf", *_lines("\n".join(parser.examples)), ".fi")
    for part in commands_of(parser).values():
        yield from _command(part)


def _heading(action: argparse.Action) -> str:
    """Return an argument as one types it."""
    names = ", ".join(rf"\fB{_escaped(one)}\fR" for one in action.option_strings)
    place = _place(action) if action.nargs != 0 else ""
    return " ".join(part for part in (names, place) if part)


def _place(action: argparse.Action) -> str:
    """Return what stands for an argument's value."""
    if isinstance(action, argparse._SubParsersAction):
        return r"\fICOMMAND\fR"
    choices = None if action.choices is None else "|".join(map(str, action.choices))
    name = action.metavar or choices or action.dest.upper()
    place = rf"\fI{_escaped(str(name))}\fR"
    if action.nargs == "+":
        return f"{place} [{place} ...]"
    return {"?": f"[{place}]", "*": f"[{place} ...]"}.get(str(action.nargs), place)


def _text(text: str) -> list[str]:
    """Return a paragraph, filled by whoever shows it."""
    return _lines("\n".join(wrap(text, 66, break_long_words=False, break_on_hyphens=False)))


def _lines(text: str) -> list[str]:
    """Return lines as they stand."""
    shown = []
    for line in text.strip("\n").splitlines():
        # a point or an apostrophe at the beginning would be a command of roff
        guard = r"\&" if line[:1] in ("", ".", "'") else ""
        shown.append(guard + _escaped(line.rstrip()))
    return shown


def _escaped(text: str) -> str:
    """Return text in which roff sees nothing but letters."""
    return "".join(_SPECIAL.get(c, c) if c.isascii() else f"\\[u{ord(c):04X}]" for c in plain(text))
