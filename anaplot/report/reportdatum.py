"""The datum of a report: that of control and priors; where they leave it open, a free one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from anaplot.bundle.solve.datum import OpenDatumError
from anaplot.bundle.solve.problem import Datum
from anaplot.errors import InputError
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.computed import Computed
from anaplot.report.document import Line, say
from anaplot.station.coverage import is_held

__all__ = ["InDatum", "adjusted_in_datum"]

Why = Literal["", "nothing", "too little"]


class InDatum(NamedTuple):
    """An adjusted block, and why its datum is free though nobody asked for that.

    Attributes
    ----------
    adjusted
        What `adjust` has returned.
    why
        "nothing" or "too little" says where the block lies; "": the datum was asked for, or is that
        of control and priors.
    """

    adjusted: Computed[BlockAdjustment]
    why: Why = ""

    @property
    def line(self) -> Line | None:
        """What is said of a datum that nobody asked for; None where there is nothing to say."""
        if not self.why:
            return None
        words = (
            "there is no control and no prior orientation"
            if self.why == "nothing"
            else "control and priors do not suffice"
        )
        return say("the datum is free (as with --datum free): {}", words).of("remark")


def adjusted_in_datum(
    adjust: Callable[[Datum], Computed[BlockAdjustment]], datum: Datum | None
) -> InDatum:
    """Adjust a block in a datum.

    Parameters
    ----------
    adjust
        Adjusts it in the datum that it is given.
    datum
        None: that of control and priors, or where they leave it open a free one.

    Raises
    ------
    InputError, NotComputableError
        As `adjust`; where no free datum does either, or options need control, it is told of that of
        control, or of the free one.
    """
    if datum is not None:
        return InDatum(adjust(datum))
    try:
        return InDatum(adjust("control"))
    except OpenDatumError as error:
        try:
            free = adjust("free")
        except InputError:
            # options go with control alone
            raise error from None
    held = is_held(free.result.block.problem.block)
    return InDatum(free, "too little" if held else "nothing")
