"""Results with numbers far larger than any table was laid out for."""

from __future__ import annotations

from copy import copy
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from anaplot.report.astext import page_text
from anaplot.report.document import Document

FACTOR = 1.23456789e9


def wild(value: Any, factor: float = FACTOR) -> Any:
    """Return a result with all its floating point numbers multiplied."""
    if isinstance(value, float):
        return value * factor
    if isinstance(value, np.ndarray):
        return value * factor if value.dtype.kind == "f" else value
    if isinstance(value, tuple):
        items = [wild(item, factor) for item in value]
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    if is_dataclass(value) and not isinstance(value, type):
        grown = copy(value)
        for one in fields(value):  # past the checks of what is sensible
            object.__setattr__(grown, one.name, wild(getattr(value, one.name), factor))
        return grown
    return value


def words(text: str) -> list[int]:
    """Return how many words stand in each line before a mark: fewer where two numbers touch."""
    return [len(line.split("<<")[0].split()) for line in text.splitlines()]


def text_of(document: Document) -> str:
    """Return a document's page as it is printed without options."""
    return page_text(document.page)
