"""The one small family of errors that people see, each with the exit code of its kind."""

from __future__ import annotations

__all__ = ["AnaplotError", "InputError", "LinkError", "NotComputableError", "TooFewError"]


class AnaplotError(Exception):
    """Anything that ends a command: one line for a person, and an exit code for a program.

    Parameters
    ----------
    message
        One line that names file, line, point or photo.
    """

    exit_code = 1


class InputError(AnaplotError):
    """Bad input or usage: a file, a key, a number, a locked or newer block (exit code 2)."""

    exit_code = 2


class LinkError(AnaplotError):
    """The plotter cannot be reached or stopped answering (exit code 3)."""

    exit_code = 3


class NotComputableError(AnaplotError):
    """The measurements do not determine what was asked (exit code 4)."""

    exit_code = 4


class TooFewError(NotComputableError):
    """There are fewer measurements than unknowns, whatever they are."""
