"""One point under two names and two under one, in the document of an adjusted block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from anaplot.bundle.errors.doublenames import DoubleName
from anaplot.report.document import Document, say

__all__ = ["with_double_names"]


def with_double_names(document: Document, found: Sequence[DoubleName]) -> Document:
    """Return a document that ends with the names that are double, where any are.

    Programs read them under `double_names`, a key that is there where any are.
    """
    if not found:
        return document
    lines = [say("{}", one.text).of("look") for one in found]
    rows = [{**one._asdict(), "text": one.text} for one in found]
    answer = document.answer | {"double_names": rows}
    return replace(document, answer=answer, page=(*document.page, *lines))
