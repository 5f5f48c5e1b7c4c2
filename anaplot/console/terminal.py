"""Whether there is a terminal on which a screen can be drawn."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping

from anaplot.errors import InputError

__all__ = ["need_terminal"]


def need_terminal(environment: Mapping[str, str] | None = None) -> None:
    """Go on only where keys come from a terminal and a screen can be drawn on it.

    Parameters
    ----------
    environment
        By default the process'.

    Raises
    ------
    InputError
        Input or output is no terminal, or the terminal can move no cursor (TERM=dumb).
    """
    environment = os.environ if environment is None else environment
    if environment.get("TERM", "") == "dumb":
        raise InputError("the console needs a terminal that can move its cursor: TERM is dumb")
    # the screen is drawn on standard error
    for stream, name in (
        (sys.stdin, "input"),
        (sys.stdout, "output"),
        (sys.stderr, "error"),
    ):
        if stream is None or stream.closed or not stream.isatty():
            raise InputError(f"the console needs a terminal, and standard {name} is none")
