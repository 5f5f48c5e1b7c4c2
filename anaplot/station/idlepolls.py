"""Runs of identical polls, folded into one entry of the journal.

A device that is asked twenty times a second and stands still says the same all day. What a replay
needs of it is the beginning of each run and the polls right before and after whatever happens;
these stay whole. Between them stands ["same", COUNT, "ASKED ANSWERED ASKED ANSWERED", WHEN]: how
many polls, and when the first and the last of them were asked and answered.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["SAME", "Item", "folded", "is_one_run", "recent_part"]

Item = tuple[str, str, str, float]
"""What the journal keeps of the line: kind, link, text, time [s]."""

SAME = "same"
"""Kind of the entry that stands for a run."""


class _Part(NamedTuple):
    """Items that belong together.

    `content`: what was asked and answered, link by link, where it is a whole poll; else None.
    """

    items: tuple[Item, ...]
    content: tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]] | None

    @property
    def asked(self) -> float:
        return self.items[0][3]

    @property
    def answered(self) -> float:
        return self.items[-1][3]


def folded(items: list[Item], before: float) -> list[Item]:
    """Return items with every run of identical polls that ended before a time as one entry.

    Parameters
    ----------
    items
        In order; entries of runs folded before may be among them.
    before
        Polls answered later stay whole [s].
    """
    out: list[Item] = []
    standing: object = None  # what the poll said that the last of `out` belongs to
    parts = _parts(items)
    for at, part in enumerate(parts):
        if part.items[0][0] == SAME:
            out += part.items
            continue
        # the last one may not be answered to its end yet
        old = part.answered < before and at + 1 < len(parts)
        if part.content is not None and part.content == standing and old:
            out[-1:] = _longer(out[-1], part)
            continue
        out += part.items
        standing = part.content
    return out


def is_one_run(items: list[Item]) -> bool:
    """Whether items are nothing but one run; the last poll may not be answered to its end yet."""
    whole = [part for part in _parts(items) if part.items[0][0] != SAME]
    if not whole or whole[0].content is None:
        return False
    said = sum(len(text) for *_, text, _ in whole[0].items)
    rest = sum(len(text) for *_, text, _ in whole[-1].items)
    return rest <= said and all(part.content == whole[0].content for part in whole[:-1])


def recent_part(items: list[Item], before: float) -> int:
    """Return the index of the first item that belongs to a poll answered at a time or later."""
    index = 0
    for part in _parts(items):
        if part.answered >= before:
            break
        index += len(part.items)
    return index


def _longer(last: Item, part: _Part) -> list[Item]:
    """Return what stands in place of the last item when one more poll said the same."""
    asked, answered = part.asked, part.answered
    if last[0] != SAME:
        return [last, (SAME, "1", _times(asked, answered, asked, answered), asked)]
    first = last[2].split()[:2]
    times = _times(float(first[0]), float(first[1]), asked, answered)
    return [(SAME, str(int(last[1]) + 1), times, last[3])]


def _times(*times: float) -> str:
    return " ".join(f"{time:.5f}" for time in times)


def _parts(items: list[Item]) -> list[_Part]:
    """Divide items: a part begins with the first request after an answer or anything else."""
    groups: list[list[Item]] = []
    asking = False
    for item in items:
        out = item[0] == "out"
        alone = item[0] not in ("in", "out")
        if not groups or alone or (out and not asking) or groups[-1][-1][0] not in ("in", "out"):
            groups.append([])
        groups[-1].append(item)
        asking = out
    return [_Part(tuple(group), _content(group)) for group in groups]


def _content(
    group: list[Item],
) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]] | None:
    asked = tuple((link, text) for kind, link, text, _ in group if kind == "out")
    answers: dict[str, str] = {}
    for kind, link, text, _ in group:
        if kind == "in":
            answers[link] = answers.get(link, "") + text
    links = {link for link, _ in asked}
    if not asked or answers.keys() != links or any(item[0] not in ("in", "out") for item in group):
        return None
    return asked, tuple(sorted(answers.items()))
