"""Every key of a profile and what it may hold, as docs/write-a-profile.md lists them.

What is left out has the default of its class in `anaplot.plotter.schema`; what depends on other
tables (names of links, records, axes) is put together where it is read.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any, get_args

from anaplot.plotter.pattern import compile_pattern
from anaplot.plotter.schema import Encoding
from anaplot.plotter.template import Template, parse_template
from anaplot.textfiles.kinds import (
    FLAG,
    Among,
    Fields,
    Kind,
    Made,
    MapOf,
    Number,
    Numbers,
    Octets,
    OneOrMore,
    Text,
    Whole,
    Word,
    WrongValueError,
)
from anaplot.textfiles.wording import hint, plain

MAX_RECORD_BYTES = 1024
TABLES = frozenset({"schema", "link", "framing", "checksum", "poll", "record", "axis", "stage"}) | {
    "footswitch",
    "drive",
    "simulate",
    "example",
}

ID = re.compile(r"[a-z0-9][a-z0-9._-]{0,60}")


class PlaceOrTrue(Numbers):
    """Coordinates, or only true."""

    def of(self, value: Any) -> tuple[float, ...]:
        """Return the coordinates, none for true."""
        return () if value is True else super().of(value)


def _spelled(pattern: str, rule: str) -> Kind[str]:
    """Return the kind of a text that is spelled by a rule."""

    def check(text: str) -> str:
        if not re.fullmatch(pattern, text):
            raise WrongValueError(rule)
        return text

    return Made(Text(), check)


def _or_none(high: float) -> Kind[float | None]:
    """Return the kind of a number of which 0 says that there is none."""
    return Made(Number(0.0, high), lambda value: value or None)


def template(names: Collection[str]) -> Kind[Template]:
    """Return the kind of a template whose fields are among some names."""

    def check(text: str) -> Template:
        template = parse_template(text)
        for name in sorted(template.names - set(names)):
            raise WrongValueError(f"{{{name}}} is unknown{hint(name, names)}")
        return template

    return Made(Text(300), check)


def _ascending(pair: tuple[float, ...]) -> tuple[float, ...]:
    if pair[0] >= pair[1]:
        raise WrongValueError("must go from the smaller to the larger value")
    return pair


def _filled(table: dict[bytes, float]) -> dict[bytes, float]:
    if not table:
        raise WrongValueError("is empty")
    return table


def _character(octets: bytes) -> bytes:
    if len(octets) != 1:
        raise WrongValueError("must be one character")
    return octets


SHOWN = Made(Text(200), lambda text: plain(text, 120))
BOUND = Number(-1e15, 1e15)
RANGE = Made(Numbers(2, BOUND), _ascending)
PATTERN = Made(Text(1000), compile_pattern)
UNITS = Made(MapOf(Octets(), Number(1e-9, 1e6)), _filled)
TABLE_NAME = _spelled(
    "[A-Za-z][A-Za-z0-9_-]{0,30}", "a name is a letter and up to 30 letters, digits, - or _"
)
AXIS_NAME = _spelled(
    "(?!offset$)[a-z][a-z0-9_]{0,30}",
    "an axis is named by lower case letters, digits and _, not offset",
)
HEAD: Fields = {
    "id": _spelled(ID.pattern, "must be lower case letters, digits, . _ or -"),
    "title": SHOWN,
    "status": Word("verified", "from-manual", "simulated"),
    "sources": Made(
        OneOrMore(Text(300, empty=False)), lambda texts: tuple(plain(text, 300) for text in texts)
    ),
}
LINK: Fields = {
    "baud": Whole(50, 4_000_000),
    "bytesize": Whole(7, 8),
    "parity": Word("none", "even", "odd", "mark", "space"),
    "stopbits": Among(1.0, 1.5, 2.0),
    "flow": Word("none", "rtscts", "xonxoff"),
    "silence": _or_none(3600.0),
}
RECORD_BYTES = Whole(1, MAX_RECORD_BYTES)
FRAMES: Fields = {"kind": Word("line", "fixed", "sync-bit")}
TERMINATOR: Fields = {"terminator": Octets(4, empty=False)}
FRAMING: Fields = {
    "max_bytes": RECORD_BYTES,
    "gap": _or_none(10.0),
    "joined": Word("start", "middle"),
}
CHECKSUM: Fields = {
    "marker": Made(Octets(1), _character),
    "required": FLAG,
    "host": FLAG,
}
SIMULATE: Fields = {
    "stream": _or_none(60.0),
    "latency": Number(0.0, 60.0),
    "byte_timing": FLAG,
    "resolution_um": Number(1e-4, 1000.0),
    "noise_um": Number(0.0, 1000.0),
    "backlash_um": Number(0.0, 1000.0),
    "speed": Number(0.001, 10000.0),
    "hold": Whole(1, 100),
    "hold_period": Number(0.0, 10.0),
    "tells_release": FLAG,
}
AXIS: Fields = {
    "direction": Among(1, -1),
    "encoding": Word(*get_args(Encoding)),
    "scale": Number(1e-9, 1e6),
    "incremental": FLAG,
    "still": Number(0.0, 10.0),
    "fastest": _or_none(1e6),
}
EVENT: Fields = {"edge": FLAG, "release": _or_none(10.0)}
MODEM: Fields = {"active": FLAG, "debounce": Number(0.0, 5.0)}
PRESS: Fields = {"switch": Text()}
COUNT: Fields = {"number": Made(Whole(-1, 10**9), lambda n: None if n < 0 else n)}
EXAMPLE: Fields = {"hex": Made(Text(4096), bytes.fromhex), "bytes": Octets(4096)}
WITHIN: Fields = {"within": Number(0.001, 60.0)}
