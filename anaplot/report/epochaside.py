"""What takes no part in a comparison of epochs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.report.document import Answer, Line, named, say

__all__ = ["Aside", "aside_of"]

_LISTED = 12


class Aside(NamedTuple):
    """What takes no part, with the number of its epoch, from 1.

    Attributes
    ----------
    off
        Rows of which not both coordinates count.
    conditions
        Epochs with conditions between points.
    priors
        Epochs with priors of points.
    """

    off: tuple[tuple[int, ImagePoint], ...] = ()
    conditions: tuple[int, ...] = ()
    priors: tuple[int, ...] = ()

    def answer(self) -> Answer:
        """Return what programs read, where there is something."""
        out: Answer = {}
        if self.off:
            out["off"] = [
                {
                    "epoch": epoch,
                    "photo": row.photo,
                    "point": row.point,
                    "model": row.model,
                    "use": row.use,
                    "reason": row.reason,
                }
                for epoch, row in self.off
            ]
        if self.conditions:
            out["without_conditions"] = list(self.conditions)
        if self.priors:
            out["without_priors"] = list(self.priors)
        return out

    def lines(self, epochs: int) -> list[Line]:
        """Return what people read."""
        out = []
        for epoch in range(1, epochs + 1):
            rows = [f"{r.point} in photo {r.photo} ({_gone(r)})" for k, r in self.off if k == epoch]
            if rows:
                out.append(say("  switched off in epoch {}: {}", epoch, named(rows, _LISTED)))
        out += [
            say("  distances.csv and conditions.csv of epoch {} take no part", epoch)
            for epoch in self.conditions
        ]
        out += [
            say("  priors of points (use prior in control.csv) of epoch {} take no part", epoch)
            for epoch in self.priors
        ]
        return out


def aside_of(blocks: Sequence[Block]) -> Aside:
    """Return what of several epochs takes no part."""
    numbered = list(enumerate(blocks, start=1))
    return Aside(
        tuple(
            (k, block.image_points[row])
            for k, block in numbered
            for row in columns_of(block.image_points).with_use("x", "y", "off").tolist()
        ),
        tuple(k for k, block in numbered if block.conditions),
        tuple(k for k, block in numbered if block.priors),
    )


def _gone(row: ImagePoint) -> str:
    """Return which coordinates do not count."""
    return "".join(axis for axis in "xy" if not row.counts(axis))
