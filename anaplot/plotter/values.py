"""The numbers in a record: from bytes to values in the device's units."""

from __future__ import annotations

import re

from anaplot.plotter.refusal import RefusedError
from anaplot.plotter.schema import AxisFormat
from anaplot.textfiles.wording import plain

__all__ = ["axis_number", "whole_number"]

_DECIMAL = re.compile(rb"([-+]?) {0,30}(\d{1,15}(?:\.\d{0,15})?|\.\d{1,15})")
_INTEGER = re.compile(rb"[-+]?\d{1,15}")
_HEX = re.compile(rb"[0-9A-Fa-f]{1,14}")


def whole_number(raw: bytes) -> int | None:
    """Return the value of decimal digits, or None when they are none."""
    text = raw.strip()
    return int(text) if _INTEGER.fullmatch(text) else None


def axis_number(raw: bytes, axis: AxisFormat) -> float:
    """Return the value of a group in the device's units.

    Raises
    ------
    RefusedError
        It is no number in the axis' encoding.
    """
    encoding = axis.encoding
    if encoding == "decimal":
        match = _DECIMAL.fullmatch(raw.strip(b" "))
        if match is None:
            raise RefusedError(f'axis {axis.name}: "{plain(raw, 30)}" is not a number')
        value = float(match.group(2))
        return -value if match.group(1) == b"-" else value
    if encoding in ("integer", "hex"):
        pattern = _INTEGER if encoding == "integer" else _HEX
        if pattern.fullmatch(raw) is None:
            raise RefusedError(f'axis {axis.name}: "{plain(raw, 30)}" is not a number')
        return float(int(raw, 10 if encoding == "integer" else 16))
    if len(raw) > 8:
        raise RefusedError(f"axis {axis.name}: more than 8 bytes")
    if encoding in ("bits6", "bits7"):
        bits = 6 if encoding == "bits6" else 7
        mask = (1 << bits) - 1
        return float(sum((byte & mask) << (bits * at) for at, byte in enumerate(raw)))
    order = "little" if encoding == "int-le" else "big"
    return float(int.from_bytes(raw, order, signed=True))  # type: ignore[arg-type]
