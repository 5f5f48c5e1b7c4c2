"""`anaplot plotter list`: the ports of this computer and the device profiles."""

from __future__ import annotations

import argparse

from anaplot.errors import AnaplotError, InputError
from anaplot.plotter.profile import find_profiles, load_profile
from anaplot.plotter.serialport import ports
from anaplot.report.document import BLANK, Document, Line, Table, name, say, table
from anaplot.report.output import Output

__all__ = ["instrument_document", "list_instruments"]

_PORTS = (
    name("address", "PORT", 20, gap=0),
    name("usb", "USB", 12, none=""),
    name("description", "WHAT IT IS", 10, none=""),
)
_PROFILES = (
    name("profile", "PROFILE", 20, gap=0),
    name("status", "STATUS", 12),
    name("title", "INSTRUMENT", 10),
)


def list_instruments(options: argparse.Namespace) -> int:
    """Show ports and profiles; exit code 0, or 2 when a profile cannot be read.

    Raises
    ------
    InputError
        The table cannot be written where it was to be.
    """
    output = Output.of(options)
    output.check()
    found, complete = instrument_document()
    output.show(found)
    return 0 if complete else InputError.exit_code


def instrument_document() -> tuple[Document, bool]:
    """Return the document of ports and profiles, and whether every profile could be read."""
    here = [(info.address, info.identity or None, info.description or None) for info in ports()]
    profiles, wrong = [], []
    for profile, path in find_profiles().items():
        try:
            read = load_profile(path)
        except AnaplotError as error:
            wrong.append({"profile": profile, "error": str(error)})
            continue
        profiles.append((profile, read.status, read.title))
    known, there = table("profiles", _PROFILES, profiles), table("ports", _PORTS, here)
    none = "no port found; socket://host:port and rfc2217://host:port work as well"
    page: list[Line | Table] = [there if here else say(none), BLANK, known]
    page += [say("{profile}: {error}", **one).of("look") for one in wrong]
    answer = {"ports": there, "profiles": known, "not_readable": wrong}
    return Document(answer, tuple(page), (known, there)), not wrong
