"""Photos named by a range: "101" to "120" is twenty names, "220" to "201" counts down."""

from __future__ import annotations

import re

__all__ = ["MAX_PHOTOS", "photo_range", "split_range"]

MAX_PHOTOS = 10_000
"""Most photos that one range names."""

_ENDING = re.compile(r"([0-9]{1,9})\Z")


def photo_range(first: str, last: str) -> tuple[str, ...]:
    """Return the names from one photo to another; the number at their end counts up or down.

    Parameters
    ----------
    first, last
        Names that agree but for the number at their end. Leading zeros are kept: "008" to "011".

    Raises
    ------
    ValueError
        A name without a number, names that differ before it, or more than MAX_PHOTOS photos.
    """
    ends = []
    for name in (first, last):
        found = _ENDING.search(name)
        if found is None:
            raise ValueError(f"{name!r} has no number at its end to count by")
        ends.append((name[: found.start()], found.group(1)))
    (before, one), (other, two) = ends
    if before != other:
        raise ValueError(f"{first!r} and {last!r} differ before the number at their end")
    padded = any(len(digits) > 1 and digits[0] == "0" for digits in (one, two))
    if padded and len(one) != len(two):
        raise ValueError(f"{first!r} and {last!r}: numbers with leading zeros must be equally long")
    start, end = int(one), int(two)
    step = 1 if end >= start else -1
    if abs(end - start) >= MAX_PHOTOS:
        raise ValueError(f"{first!r} to {last!r} are more than {MAX_PHOTOS} photos")
    width = len(one) if padded else 1
    return tuple(f"{before}{number:0{width}d}" for number in range(start, end + step, step))


def split_range(text: str) -> tuple[str, str] | None:
    """Return the ends of a range written in one word ("101-120", "A-1-A-9"), or None."""
    for at in range(1, len(text) - 1):
        if text[at] != "-":
            continue
        first, last = text[:at].strip(), text[at + 1 :].strip()
        one, two = _ENDING.search(first), _ENDING.search(last)
        if one and two and first[: one.start()] == last[: two.start()]:
            return first, last
    return None
