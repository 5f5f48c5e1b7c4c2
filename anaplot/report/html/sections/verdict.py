"""The verdict on a block in five lines: is it sound, what is wrong, unchecked, how good, what next.

Nothing is judged here a second time: what is flagged, suspected, weak, rejected and next is what
`adjust` and `status` say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from anaplot.bundle.hypotheses.givenparts import PartTest
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.report.adjustdocument import ALARM, DATUM, sigma0_limit
from anaplot.report.adjusttables import is_fine
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.columns import counted
from anaplot.report.document import Line, Names, named, say
from anaplot.station.blockstatus import BlockStatus

__all__ = ["verdict_lines"]

_FEW = 3  # of what is wrong; the sections have all


def verdict_lines(
    found: BlockAdjustment, status: BlockStatus, free: Line | None = None
) -> tuple[Line, ...]:
    """Return the verdict.

    Parameters
    ----------
    found
        What `adjust` has found.
    status
        Where the block stands.
    free
        What is said of a free datum that nobody asked for; None: nothing.
    """
    return (
        _sound(found, status),
        _wrong(found, status),
        _unchecked(found, status, free),
        _accuracy(found),
        _next(found, status),
    )


def _flagged(block: AdjustedBlock) -> int:
    return int(block.flagged.sum()) + sum(
        kind != "image" for _, _, kind in block.flagged_observations()
    )


def _is_certain(status: BlockStatus) -> bool:
    """Whether a point or a photo is wrong without doubt."""
    return status.accidents.surest is not None or bool(status.accidents.photos)


def _parts(found: BlockAdjustment) -> Iterator[tuple[str, PartTest]]:
    tests = found.hypotheses
    for use, tested in (("control", tests.control), ("check", tests.check)):
        yield from ((use, part) for part in (() if tested is None else tested.parts))


def _refused(found: BlockAdjustment) -> list[tuple[str, PartTest]]:
    """Return plans and heights of given points that a test rejects."""
    return [
        (use, part)
        for use, part in _parts(found)
        if part.verdict is not None and part.verdict.rejected
    ]


def _too_large(block: AdjustedBlock) -> bool:
    limit = sigma0_limit(block)
    return limit is not None and block.sigma0 is not None and block.sigma0**2 > limit


def _sigma0(block: AdjustedBlock) -> Line:
    um = block.problem.block.precision.image_um
    if block.sigma0 is None:
        return say("there is no sigma0")
    words = "larger than" if _too_large(block) else "not significantly larger than"
    return say(
        "sigma0 {:.2f} um is {} the {:g} um a priori (test at {:g} %)",
        block.sigma0 * um,
        words,
        um,
        100.0 * ALARM,
    )


def _sound(found: BlockAdjustment, status: BlockStatus) -> Line:
    block = found.block
    without = say("")
    if found.rejected:
        without = say(", without {}", counted(len(found.rejected), "rejected observation"))
    if block.critical is None or block.redundancy < 1:
        return say("Sound: Nobody can tell: redundancy {}, no test is possible", block.redundancy)
    flagged = _flagged(block)
    if flagged:
        return (
            say(
                "Sound: No: {} of {} flagged",
                flagged,
                counted(block.problem.observations, "observation"),
            )
            + say(" ({:.1f} of good ones would be by chance); ", block.flagged_by_chance)
            + _sigma0(block)
        ).of("look")
    if _is_certain(status) and not found.rejected:
        return say("Sound: No: a point or a photo is surely wrong; {}", _sigma0(block)).of("look")
    doubts = [
        *([_sigma0(block)] if _too_large(block) else []),
        *([say("tests reject given coordinates")] if _refused(found) else []),
        *([say("models or points need a look")] if status.weak_spots else []),
    ]
    if doubts:
        return (
            say("Sound: With doubts: no observation of {} is flagged", block.problem.observations)
            + without
            + say("; but {}", named(doubts, separator=", "))
        ).of("remark")
    return (
        say("Sound: Yes: no observation of {} is flagged", block.problem.observations)
        + without
        + say("; ")
        + _sigma0(block)
    )


def _several(lines: Sequence[Line]) -> Names:
    return named(lines, _FEW, "; and {} more below", separator="; ")


def _wrong(found: BlockAdjustment, status: BlockStatus) -> Line:
    lines = [say("{}", one.text) for one in status.accidents.photos]
    lines += [say("{}", spot.words) for spot in status.weak_spots]
    lines += [
        say("{} of {} point {} differs by {:.3f} m (s {:.3f})", part.part, use, part.point,
            part.difference, part.s)
        for use, part in _refused(found)
        if part.difference is not None
    ]  # fmt: skip
    if _too_large(found.block):
        lines.append(_sigma0(found.block))
    rejected = len(found.rejected)
    gone = say("")
    if rejected:
        words = "observation was" if rejected == 1 else "observations were"
        gone = say("{} gross {} rejected, with the evidence below; ", rejected, words)
    if not lines:
        rest = "nothing else shows" if rejected else "Nothing shows in what is checked"
        return say("Wrong: ") + gone + rest
    return (say("Wrong: ") + gone + say("{}", _several(lines))).of("look")


def _unchecked(found: BlockAdjustment, status: BlockStatus, free: Line | None) -> Line:
    block = found.block
    lines: list[Line] = []
    spurs = len(block.spurs())
    if spurs:
        lines.append(say("{} that nothing checks", counted(spurs, "image coordinate")))
    bare = [part.point for _, part in _parts(found) if part.verdict is None]
    if bare:
        points = list(dict.fromkeys(bare))
        shown = named(points, _FEW)
        lines.append(say("given coordinates of {} ({})", counted(len(points), "point"), shown))
    rays = np.bincount(block.problem.point, minlength=len(block.problem.points))
    two = int((rays < 3).sum())
    if two:
        lines.append(say("along the rays {} of two photos alone", counted(two, "point")))
    if not block.check_rows():
        lines.append(say("the coordinates as a whole: there is no check point"))
    if free is not None:
        lines.append(say("where it lies: ") + free)
    elif block.problem.datum != "control":
        lines.append(say("where it lies: its datum is {}", DATUM[block.problem.datum]))
    view = status.block
    if view is not None and view.weak:
        lines.append(say("{} with few redundant observations", counted(len(view.weak), "photo")))
    if status.accidents.unchecked:
        strips = named(status.accidents.unchecked, _FEW)
        lines.append(say("the numbering of points in strips {}", strips))
    if not lines:
        return say("Unchecked: Nothing")
    return say("Unchecked: {}", named(lines, separator="; ")).of("remark")


def _accuracy(found: BlockAdjustment) -> Line:
    block = found.block
    indicators, form = block.indicators(), ".6f" if is_fine(block) else ".3f"
    line = say(
        f"Accuracy: Points have standard deviations of {{:{form}}} m in X, {{:{form}}} in Y and "
        f"{{:{form}}} in Z on average",
        indicators.ai_x,
        indicators.ai_y,
        indicators.ai_z,
    )
    check = found.hypotheses.check
    groups = {} if check is None else {group.axes: group for group in check.groups}
    agreed = [
        say(
            f"{{}} {{}} by {{:{form}}} m (rms, expected {{:{form}}})",
            counted(groups[axes].coordinates, "check coordinate"),
            words,
            groups[axes].rms,
            groups[axes].expected,
        )
        for axes, words in (("XY", "in plan"), ("Z", "in height"))
        if axes in groups
    ]
    return line + say("; off are {}", named(agreed)) if agreed else line


def _next(found: BlockAdjustment, status: BlockStatus) -> Line:
    step = status.next
    block = found.block
    suspects = block.suspects()
    if found.rejected:
        return say(
            "Next: Measure again what was rejected, or switch it off: adjust --errors {} --apply",
            _strategy(found),
        )
    if step.do in ("measure", "return", "accept"):
        return say("Next: {}: {}", step.words, status.next_command).of("look")
    if suspects:
        _, photo, point, axis = suspects[0]
        return say(
            "Next: Measure point {} in photo {} again ({} first), and adjust anew",
            point,
            photo,
            axis,
        ).of("look")
    others = [what for _, what, kind in block.flagged_observations() if kind != "image"]
    if others:
        shown = named(list(islice(others, _FEW)))
        return say("Next: Look at {}, and adjust anew", shown).of("look")
    if _too_large(block):
        return say(
            "Next: Find out why the images are measured worse than stated, or state it "
            "([precision] image_um)"
        ).of("look")
    if _refused(found):
        return say("Next: Look at the given points that are rejected, and adjust anew").of("look")
    if not block.check_rows():
        return say(
            "Next: Nothing has to be measured again; check points would prove the coordinates"
        )
    return say("Next: Nothing has to be measured again")


def _strategy(found: BlockAdjustment) -> str:
    return "NAME" if found.errors is None else found.errors.findings.strategy
