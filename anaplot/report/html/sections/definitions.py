"""The definitions of the columns that a report has."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from anaplot.report.document import Column, say
from anaplot.report.html.captions import caption_of, words_of
from anaplot.report.html.definitions import Definition, definition_of
from anaplot.report.html.parts import Defined, Definitions, Report, Section, tables_in
from anaplot.textfiles.wording import first_of

__all__ = ["columns_shown", "with_definitions"]

_MOST = 2  # tables that are named where a title means two things
_TITLES = 12  # of one meaning that are all named
_LONG = re.compile(r"[:,;]| and ")  # where the name of a table goes on


def columns_shown(report: Report) -> list[tuple[str, Column]]:
    """Return the columns that people read in a report, with the keys of their tables."""
    return [
        (one.key, column)
        for one in tables_in(report.all_sections)
        if len(one)
        for column, _ in one.for_people()
        if column.key
    ]


def with_definitions(report: Report) -> Report:
    """Return a report that ends, before what it was computed with, with its definitions."""
    said: dict[Definition, dict[str, dict[str, None]]] = {}
    unknown: dict[str, None] = {}
    for key, column in columns_shown(report):
        title = column.title.strip() or words_of(column.key)
        found = definition_of(key, column.key)
        if found is None:
            unknown[title] = None
        else:
            said.setdefault(found, {}).setdefault(title, {})[caption_of(key)] = None
    meanings = Counter(title for titles in said.values() for title in titles)
    rows = tuple(
        Defined(
            _named(
                {title: tables if meanings[title] > 1 else {} for title, tables in titles.items()}
            ),
            *found,
        )
        for found, titles in said.items()
    )
    section = Section("definitions", "What the columns mean", (Definitions(rows),), folded=True)
    if unknown:
        line = say("explained where they stand: {}", ", ".join(unknown)).of("remark")
        section = replace(section, blocks=(*section.blocks, line))
    return replace(report, sections=(*report.sections, section))


def _named(titles: Mapping[str, Iterable[str]]) -> str:
    """Return titles of columns, those of the same tables together, with these behind them."""
    of: dict[str, list[str]] = {}
    for title, tables in titles.items():
        some = [*dict.fromkeys(_LONG.split(one)[0] for one in tables)]
        of.setdefault(first_of(some, _MOST, "; "), []).append(title)
    return "; ".join(
        f"{_listed(some)} ({tables})" if tables else _listed(some) for tables, some in of.items()
    )


def _listed(titles: Sequence[str]) -> str:
    if len(titles) <= _TITLES:
        return ", ".join(titles)
    return f"{', '.join(titles[:3])}, … {titles[-1]}"
