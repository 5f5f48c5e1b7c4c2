"""The correlations of a model's orientation elements, as a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array
from anaplot.report.document import Document, Table, name, number, say

__all__ = ["ELEMENT_COLUMNS", "correlations_page", "orientation_correlations"]

_ELEMENTS = ("bx", "by", "bz", "omega", "phi", "kappa")

ELEMENT_COLUMNS = (
    name("element", "", 5, gap=4),
    *(number(element, element, 3, 8) for element in _ELEMENTS),
)
"""A row for each element, and in it its correlation with every one; none of a base that is held."""


def orientation_correlations(
    elements: Sequence[str], correlations: Sequence[Sequence[float]] | Array
) -> Table:
    """Return the correlations of a model's orientation.

    Parameters
    ----------
    elements
        u names: "bx" where the scale is taken over, "by", "bz", "omega", "phi", "kappa".
    correlations
        (u, u) in their order, as `ModelAccuracy` and the key "accuracy" of `--json` have them.
    """
    rho = np.asarray(correlations, dtype=np.float64).reshape(len(elements), len(elements))
    nothing = np.full(len(elements), np.nan)
    found = [rho[:, elements.index(e)] if e in elements else nothing for e in _ELEMENTS]
    shown = ("element", *(element for element in _ELEMENTS if element in elements))
    return Table("correlations", ELEMENT_COLUMNS, (tuple(elements), *found), shown)


def correlations_page(elements: Sequence[str], correlations: Array) -> Document:
    """Return the part of a model's document that `bridge --correlations` adds."""
    found = orientation_correlations(elements, correlations)
    head = say("  CORRELATIONS of the orientation, the left photo held").of("heading")
    return Document(None, (head, found), (found,))
