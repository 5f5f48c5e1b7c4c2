"""The ideal model of a pattern, with exact coordinates that a test can spoil."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.orientation.idealmodel import ideal_model
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.patterns import Pattern, pattern
from anaplot.photogrammetry.block import TieVariance


def ideal_pair(name, base=60.0, d=66.0, c=100.0):
    """The ideal model of a pattern, with exact coordinates that a test can spoil."""
    p = pattern(name)
    places = p.positions(base, d)
    xl = np.array([places[label] for label in p.labels])
    return Stereopair(
        left="1",
        right="2",
        points=p.labels,
        xl=xl,
        xr=xl - [base, 0.0],
        c_left=c,
        c_right=c,
        ties={label: (*places[label], -c) for label in p.ties} or None,
        preceding_bx=base if p.ties else None,
        base=base,
    )


def spoiled(pair, point, axis, size_mm):
    """The pair with an error in one right image coordinate."""
    xr = pair.xr.copy()
    xr[pair.points.index(point), "xy".index(axis)] += size_mm
    return replace(pair, xr=xr)


def ideal(of: Pattern, base: float, d: float, c: float, form: TieVariance = "paper"):
    """Orient the ideal model of a pattern: vertical photos, equal bases, flat ground [mm]."""
    return ideal_model(of.positions(base, d), of.ties, base, c, form)
