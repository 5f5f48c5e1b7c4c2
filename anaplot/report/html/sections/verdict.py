"""The verdict on a block in five lines: is it sound, what is wrong, unchecked, how good, what next.

What is to be thought of the block is `judgement`'s; here it is put into words.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import floor, log10

import numpy as np

from anaplot.adjustment.tested import sigma0_known
from anaplot.bundle.errors.bychance import ALARM
from anaplot.bundle.errors.suspects import Suspect
from anaplot.bundle.solve.adjusted import AdjustedBlock, observation_in_words
from anaplot.bundle.solve.uncheckedvalues import unchecked_values
from anaplot.report.adjustdocument import DATUM
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.columns import counted
from anaplot.report.document import Line, named, say
from anaplot.report.html.judgement import (
    Given,
    Judgement,
    Noise,
    Other,
    judged,
    mean_deviations,
    points_of_two_photos,
    tested_parts,
)
from anaplot.report.lengthunits import without_pixel_size
from anaplot.station.blockstatus import BlockStatus

__all__ = ["verdict_lines"]

_FEW = 3  # of what is rejected or unchecked; the sections have all
_ROUNDING = 1e-9  # m
_COARSE = 0.1  # m: shorter lengths are read in millimetres


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
    judgement = judged(found, status)
    return (
        _sound(found, judgement),
        _wrong(found, judgement, status),
        _unchecked(found, status, free),
        _accuracy(found, judgement),
        _next(found, judgement, status),
    )


def _sigma0(block: AdjustedBlock, judgement: Judgement) -> Line:
    um = block.problem.block.precision.image_um
    if block.sigma0 is None:
        return say("there is no sigma0")
    words = {
        "larger": "larger than",
        "smaller": "smaller than",
        "stated": "not significantly larger than",
    }[judgement.scale]
    return say(
        "sigma0 {:.2f} um is {} the {:g} um a priori (test at {:g} %)",
        block.sigma0 * um,
        words,
        um,
        100.0 * ALARM,
    )


def _sound(found: BlockAdjustment, judgement: Judgement) -> Line:
    block = found.block
    sigma0 = _sigma0(block, judgement)
    if judgement.grade == "unknown":
        return say("Sound: Nobody can tell: redundancy {}, no test is possible", block.redundancy)
    if judgement.flagged:
        return (
            say(
                "Sound: {}: {} of {} flagged",
                "With doubts" if judgement.grade == "doubts" else "No",
                judgement.flagged,
                counted(judgement.observations, "observation"),
            )
            + say(" ({:.1f} of good ones would be by chance", block.flagged_by_chance)
            + (", so that it may be); " if judgement.by_chance else "); ")
            + sigma0
        ).of("remark" if judgement.grade == "doubts" else "look")
    if judgement.grade == "wrong":
        return (say("Sound: No: a photograph is surely not the one it is called; ") + sigma0).of(
            "look"
        )
    none = say("no observation of the {} that can be tested is flagged", judgement.tested)
    if judgement.tested < judgement.observations:
        none += say(" (of {})", judgement.observations)
    if found.rejected:
        none += say(", without {}", counted(len(found.rejected), "rejected observation"))
    doubts = _doubts(judgement, sigma0)
    if doubts:
        told = say("Sound: With doubts: ") + none + say("; but {}", named(doubts))
        return told.of("remark")
    return say("Sound: Yes: ") + none + "; " + sigma0


def _doubts(judgement: Judgement, sigma0: Line) -> list[Line]:
    doubts = []
    if judgement.hardly_tested:
        bare = judgement.observations - judgement.tested
        doubts.append(say("{} of the observations nothing checks", bare))
    if judgement.scale == "smaller":
        doubts.append(sigma0 + ": the tests see less than they claim")
    elif judgement.scale == "larger":
        doubts.append(sigma0)
    if judgement.refused or isinstance(judgement.cause, Given):
        doubts.append(say("tests reject given coordinates"))
    if judgement.hints:
        doubts.append(say("points of the models need a look"))
    return doubts


def _wrong(found: BlockAdjustment, judgement: Judgement, status: BlockStatus) -> Line:
    lines = []
    if found.rejected:
        names = [observation_in_words(one.name)[0] for one in found.rejected]
        was = "observation was" if len(names) == 1 else "observations were"
        shown = named(names, _FEW, " and {} more")
        lines.append(say("{} gross {} rejected: {}", len(names), was, shown))
    if judgement.cause is not None:
        lines.append(_named_cause(found, judgement))
    lines += [_difference(one) for one in judgement.refused[:_FEW]]
    lines += [say("{}", _lengths_of(found, text)) for text in judgement.photos]
    lines += [say("{}", _lengths_of(found, text)) for text in judgement.hints]
    if judgement.scale == "larger" and not isinstance(judgement.cause, Noise):
        lines.append(_sigma0(found.block, judgement))
    if judgement.scale == "smaller":
        lines.append(say("the images are measured better than image_um states, or it is too large"))
    if status.block is not None and status.block.aside:
        lines.append(say("not connected: photos {}", named(status.block.aside, _FEW)))
    if not lines:
        return say("Wrong: Nothing shows in what is checked")
    told = say("Wrong: {}", named(lines, separator="; "))
    return told.of("remark" if len(lines) == 1 and found.rejected else "look")


def _named_cause(found: BlockAdjustment, judgement: Judgement) -> Line:
    """Name what is wrong first of all, and say what that may explain."""
    cause, block = judgement.cause, found.block
    if isinstance(cause, Noise):
        if judgement.flagged:
            return _sigma0(block, judgement) + say(
                ", and none of the {} flagged stands out", judgement.flagged
            )
        return _sigma0(block, judgement) + ", and no single observation stands out"
    others = judgement.flagged
    if isinstance(cause, Suspect):
        line = _ray(cause) + say(" (w {:.1f})", cause.w)
        if cause.partners:
            alike = [say("{} in photo {}", one.axis, one.photo) for one in cause.partners]
            line += say(", or {}, hard to tell apart", named(alike, _FEW))
        others -= 1
    elif isinstance(cause, Given):
        line = _difference(cause)
    else:
        assert isinstance(cause, Other)
        line = say("{} (w {:.1f})", cause.what, cause.w)
        others -= 1
    if others < 1:
        return line
    what = counted(others, "other is flagged", "others are flagged")
    return line + say(
        "; {}, which it may explain (all under The adjustment in its own words)", what
    )


def _ray(suspect: Suspect) -> Line:
    where = suspect.where
    line = say("{} of point {} in photo {}", where.axis, suspect.point, where.photo)
    return line if where.model is None else line + say(" (model {})", where.model)


def _difference(given: Given) -> Line:
    use, part = given
    line = say("{} of {} point {}", part.part, use, part.point)
    if part.difference is None or part.s is None:
        return line + " is rejected"
    away, spread = _lengths((part.difference, part.s))
    return line + say(" differs by {} (s {})", away, spread)


def _lengths_of(found: BlockAdjustment, text: str) -> str:
    """Return what strips say with the unit that lengths in the block's images have."""
    return text.replace("µm", "px") if without_pixel_size(found.block.problem.block) else text


def _lengths(values: Sequence[float]) -> list[Line]:
    """Return lengths [m] with two significant digits of the shortest, the unit behind each."""
    sizes = [abs(value) for value in values if abs(value) > _ROUNDING]
    fine = max(sizes, default=0.0) < _COARSE
    scale, unit = (1e3, "mm") if fine else (1.0, "m")
    digits = 1 - floor(log10(scale * min(sizes))) if sizes else 0
    decimals = min(max(digits, 0), 6)
    return [say(f"{{:.{decimals}f|{unit}}}", scale * value) for value in values]


def _unchecked(found: BlockAdjustment, status: BlockStatus, free: Line | None) -> Line:
    block = found.block
    lines: list[Line] = []
    spurs = len(block.spurs())
    if spurs:
        lines.append(say("{} that nothing checks", counted(spurs, "image coordinate")))
    given = [one.part.point for one in tested_parts(found) if one.part.verdict is None]
    values = [one.key for one in unchecked_values(block)]
    given += [str(point) for kind, point, *_ in values if kind in ("control", "point prior")]
    if given:
        points = list(dict.fromkeys(given))
        shown = named(points, _FEW)
        lines.append(say("given coordinates of {} ({})", counted(len(points), "point"), shown))
    held = [observation_in_words(key)[0] for key in values if key[0] in ("prior", "condition")]
    if held:
        lines.append(say("{}", named(held, _FEW)))
    two = points_of_two_photos(block)
    if two:
        lines.append(say("along the rays {} of two photos alone", counted(two, "point")))
    if not block.check_rows():
        lines.append(say("the coordinates as a whole: there is no check point"))
    if block.problem.datum != "control":
        what = "where it lies" if block.problem.gives_scale else "where it lies, and its scale"
        why = say("its datum is {}", DATUM[block.problem.datum]) if free is None else free
        lines.append(say("{}: ", what) + why)
    view = status.block
    if view is not None and view.weak:
        lines.append(say("{} with few redundant observations", counted(len(view.weak), "photo")))
    bare = [model.name for model in status.models if model.done and model.redundancy == 0]
    if bare:
        lines.append(say("models {} by themselves: no redundancy", named(bare, _FEW)))
    if status.accidents.unchecked:
        strips = named(status.accidents.unchecked, _FEW)
        lines.append(say("the numbering of points in strips {}", strips))
    if not lines:
        return say("Unchecked: Nothing")
    return say("Unchecked: {}", named(lines, separator="; ")).of("remark")


def _accuracy(found: BlockAdjustment, judgement: Judgement) -> Line:
    block = found.block
    mean = mean_deviations(block)
    if mean is None:
        return say("Accuracy: Not known: {}", _why_unknown(block))
    x, y, z = _lengths(mean)
    line = say("Accuracy: New points have standard deviations of ")
    line += x + " in X, " + y + " in Y and " + z + " in Z on average, by "
    if sigma0_known(block.problem.test.kind):
        line += "the a-priori sigma0"
        if judgement.scale == "larger":
            line += say(" ({:.2f} times that by the estimated one)", block.sigma0)
    else:
        line += "the estimated sigma0"
    agreed = _agreement(found)
    return line + say("; off are {}", named(agreed)) if agreed else line


def _why_unknown(block: AdjustedBlock) -> str:
    return "there is no sigma0" if block.sigma is None else "every point is given"


def _agreement(found: BlockAdjustment) -> list[Line]:
    """Say how far check points are off; without control in the datum all given ones are."""
    check = found.hypotheses.check
    words = {"XY": "in plan", "Z": "in height"}
    if check is not None:
        groups = {group.axes: group for group in check.groups}
        there = [(words[axes], groups[axes]) for axes in words if axes in groups]
        return [
            say("{} {} by {} (rms, expected {})", counted(one.coordinates, "check coordinate"),
                word, *_lengths((one.rms, one.expected)))
            for word, one in there
        ]  # fmt: skip
    rows = np.array(
        [[np.nan if v is None else v for v in d] for _, d in found.block.check_rows()]
    ).reshape(-1, 3)
    out = []
    for word, of in (("in plan", rows[:, :2]), ("in height", rows[:, 2])):
        off = of[np.isfinite(of)]
        if len(off):
            (rms,) = _lengths((float(np.sqrt(np.mean(off**2))),))
            out.append(say("{} {} by {} (rms)", counted(len(off), "given coordinate"), word, rms))
    return out


def _next(found: BlockAdjustment, judgement: Judgement, status: BlockStatus) -> Line:
    if found.rejected and not isinstance(judgement.cause, Noise):
        return say(
            "Next: Measure again what was rejected, or switch it off: adjust --errors {} --apply",
            _strategy(found),
        )
    if judgement.grade == "unknown":
        return say("Next: Measure more points, or in more photos: nothing is redundant").of("look")
    lines = [*_cures(judgement), *_steps(judgement, status)]
    if lines:
        return (say("Next: ") + lines[0]).of("look")
    nothing = say("Next: Nothing has to be measured again")
    if not found.block.check_rows():
        return nothing + "; check points would prove the coordinates"
    return nothing


_STATE_IT = "or state it ([precision] image_um)"


def _cures(judgement: Judgement) -> Iterable[Line]:
    """Yield what is to be done about what is wrong, the most urgent first."""
    cause = judgement.cause
    if isinstance(cause, Noise):
        yield say("Find out why the images are measured worse than stated, " + _STATE_IT)
    if isinstance(cause, Suspect):
        yield say(
            "Measure point {} in photo {} again ({} first), and adjust anew",
            cause.point,
            cause.where.photo,
            cause.where.axis,
        )
    if isinstance(cause, Other):
        yield say("Look at {}, and adjust anew", cause.what)
    given = (cause,) if isinstance(cause, Given) else judgement.refused[:1]
    for use, part in given:
        yield say(
            "Look at {} point {}: its given {}, its number and its rays, and adjust anew",
            use,
            part.point,
            part.part,
        )
    if judgement.scale == "larger":
        yield say("Find out why the images are measured worse than stated, " + _STATE_IT)


def _steps(judgement: Judgement, status: BlockStatus) -> Iterable[Line]:
    """Yield what comes next where nothing accuses an observation."""
    step = status.next
    if step.do in ("measure", "accept", "tie") or (
        step.do == "return" and (judgement.photos or judgement.hints)
    ):
        yield say("{}: {}", step.words, status.next_command)
    if judgement.scale == "smaller":
        yield say("Find out how well the images are measured, and state it ([precision] image_um)")
    if judgement.hardly_tested:
        yield say("Measure more points, or in more photos: too little is checked")


def _strategy(found: BlockAdjustment) -> str:
    return "NAME" if found.errors is None else found.errors.findings.strategy
