"""Additional parameters as products of polynomials, written as they are printed.

Coordinates are divided by the reach b, so that every term is about 1 mm at the edge for 1 mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array

__all__ = ["EBNER", "GRUEN", "GRUEN50", "LETTERS", "PolynomialTerm", "polynomial_basis"]


class PolynomialTerm(NamedTuple):
    """What a parameter does: factors with blanks between, a number first; "" is nothing."""

    name: str
    dx: str
    dy: str


LETTERS: Mapping[str, Mapping[str, str]] = {
    "ebner": {"k": "x^2 - 2/3", "l": "y^2 - 2/3"},
    "gruen": {
        "k": "x^2 - 1/2",
        "l": "y^2 - 1/2",
        "p": "x^2 - 17/20",
        "q": "y^2 - 17/20",
        "r": "x^2 (x^2 - 31/28) + 9/70",
        "s": "y^2 (y^2 - 31/28) + 9/70",
    },
}
"""The letters of the terms, for b = 1."""

EBNER = tuple(
    PolynomialTerm(f"b{number}", *term)
    for number, term in enumerate(
        (
            ("x", "-y"), ("y", "x"), ("-2 k", "x y"), ("x y", "-2 l"), ("l", ""), ("", "k"),
            ("x l", ""), ("", "y k"), ("y k", ""), ("", "x l"), ("k l", ""), ("", "k l"),
        ),
        start=1,
    )
)  # fmt: skip
"""Ebner's twelve, orthogonal on 3 x 3 points (Ebner 1976)."""

_ROWS = (
    (("14", "x p"), ("23", "y k"), ("32", "x l"), ("41", "y q")),
    (("15", "r"), ("24", "x y p"), ("33", "k l"), ("42", "x y q"), ("51", "s")),
    (("25", "y r"), ("34", "x l p"), ("43", "y k q"), ("52", "x s")),
    (("35", "l r"), ("44", "x y p q"), ("53", "k s")),
    (("45", "y q r"), ("54", "x p s")),
    (("55", "r s"),),
)

GRUEN = (
    PolynomialTerm("a12", "x", "-y"),
    PolynomialTerm("a21", "y", "x"),
    PolynomialTerm("a22", "x y", "-10/7 l"),
    PolynomialTerm("a31", "l", ""),
    PolynomialTerm("b13", "", "k"),
    PolynomialTerm("b22", "-10/7 k", "x y"),
    *(
        term
        for row in _ROWS
        for term in (
            *(PolynomialTerm(f"a{number}", what, "") for number, what in row),
            *(PolynomialTerm(f"b{number}", "", what) for number, what in row),
        )
    ),
)
"""Gruen's 44, orthogonal on 5 x 5 points (1978, eq. 7).

The paper prints y q in the terms of a43 and b43; orthogonality asks for y k q.
"""

GRUEN50 = (
    *GRUEN,
    PolynomialTerm("a11", "1", ""),
    PolynomialTerm("b11", "", "1"),
    PolynomialTerm("b21", "x", "y"),
    PolynomialTerm("b12", "-y", "x"),
    PolynomialTerm("a13", "k", "x y"),
    PolynomialTerm("b31", "x y", "l"),
)
"""These, and the six that the exterior orientation has taken from the 50."""


def polynomial_basis(terms: Sequence[PolynomialTerm], x: Array, y: Array) -> Array:
    """Return (n, 2, k): what k terms do at x, y (n,), coordinates divided by the reach.

    The first of `LETTERS` where the terms are Ebner's, else the others.
    """
    xx, yy = x * x, y * y
    if terms is EBNER:
        letters = {"x": x, "y": y, "k": xx - 2.0 / 3.0, "l": yy - 2.0 / 3.0}
    else:
        letters = {
            "x": x,
            "y": y,
            "k": xx - 0.5,
            "l": yy - 0.5,
            "p": xx - 17.0 / 20.0,
            "q": yy - 17.0 / 20.0,
            "r": xx * (xx - 31.0 / 28.0) + 9.0 / 70.0,
            "s": yy * (yy - 31.0 / 28.0) + 9.0 / 70.0,
        }
    out = np.empty((len(x), 2, len(terms)))
    for k, term in enumerate(terms):
        out[:, 0, k] = _value(term.dx, letters)
        out[:, 1, k] = _value(term.dy, letters)
    return out


def _value(text: str, letters: Mapping[str, Array]) -> Array | float:
    if not text:
        return 0.0
    value: Array | float = -1.0 if text.startswith("-") else 1.0
    for factor in text.removeprefix("-").split():
        value = value * (letters[factor] if factor in letters else float(Fraction(factor)))
    return value
