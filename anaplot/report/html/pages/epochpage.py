"""The report of `compare`: what has moved, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.bundle.epochs.displacementtests import EpochTests, PointMove
from anaplot.bundle.epochs.overall import Overall
from anaplot.bundle.epochs.seriestests import PointSeries, SeriesTests
from anaplot.bundle.hypotheses.verdict import Verdict
from anaplot.report.columns import counted
from anaplot.report.computed import Computed
from anaplot.report.document import Document, Line, Listed, Table, named, say
from anaplot.report.epochtables import is_marked
from anaplot.report.figures.displacements import displacement_maps
from anaplot.report.html.parts import Captioned, HtmlBlock, Report, Section
from anaplot.report.movementdecimals import movement_decimals
from anaplot.report.verdicts import probability

__all__ = ["epoch_report"]

_DRAWN = 6  # pairs of epochs
_FEW = 5  # points in a line of the verdict; the tables have all


def epoch_report(found: Computed[EpochTests] | Computed[SeriesTests]) -> Report:
    """Return the report of a comparison of epochs, as `compare` has returned it."""
    result = found.result
    of = result.differences if isinstance(result, EpochTests) else result.series
    sections = (_displacements(found.document, result), _tests(found.document))
    return Report(
        say("Epochs {}", named(of.epochs)),
        _verdict(result),
        sections,
    )


def _verdict(found: EpochTests | SeriesTests) -> tuple[Line, ...]:
    return (
        _moved(found.overall, found.everything),
        _what(found),
        _unchecked(found),
        _accuracy(found),
        _next(found),
    )


def _moved(overall: Overall | None, everything: Verdict | None) -> Line:
    if overall is None:
        return say("Moved: nobody can tell: nothing can be tested")
    word = "yes" if overall.rejected else "no"
    p = probability(overall.significance)
    families = named(overall.families)
    test = None if everything is None else everything.decisive
    line = say("Moved: {}: ", word)
    if test is not None:
        line += say(
            "P {} of all points together by the global test; ", probability(test.significance)
        )
    line += say(
        "P {} of the tests of {}, counted as one, at alpha {:g}", p, families, overall.alpha
    )
    return line.of("look") if overall.rejected else line


def _rejected(points: Sequence[PointMove] | Sequence[PointSeries]) -> list[str]:
    return [p.point for p in points if p.verdict is not None and p.verdict.rejected]


def _what(found: EpochTests | SeriesTests) -> Line:
    if isinstance(found, EpochTests):
        marked = set(_rejected(found.points))
        form = f"{{:.{movement_decimals(found.differences) - 1}f}}"
        lines = [
            say(f"{{}} by {form} mm (s {form[:-1]}||-}})", p.point, 1e3 * p.length,
                None if p.s_length is None else 1e3 * p.s_length)
            for p in found.points
            if p.point in marked
        ]  # fmt: skip
    else:
        lines = [
            say("{} from {}", p.point, named([f"{a} to {b}" for a, b in p.moved]))
            for p in found.points
            if p.moved
        ]
    if not lines:
        return say("What: no point by itself")
    count = counted(len(lines), "point")
    return say("What: {}: {}", count, named(lines, _FEW, " and {} more below")).of("look")


def _unchecked(found: EpochTests | SeriesTests) -> Line:
    parts = []
    untested = [p.point for p in found.points if p.verdict is None]
    if untested:
        parts.append(say("points that no test reaches: {}", named(untested, _FEW)))
    only = (
        (found.differences.only_first, found.differences.only_second)
        if isinstance(found, EpochTests)
        else found.series.alone_in
    )
    for epoch, names in enumerate(only, 1):
        if names:
            parts.append(say("points in epoch {} alone: {}", epoch, named(names, _FEW)))
    if not parts:
        return say("Unchecked: nothing: every compared point is tested")
    return say("Unchecked: {}", named(parts, separator="; "))


def _accuracy(found: EpochTests | SeriesTests) -> Line:
    pairs = (found,) if isinstance(found, EpochTests) else found.pairs
    lengths = [p.s_length for pair in pairs for p in pair.points if p.s_length is not None]
    detectable = [c.mdb for pair in pairs for p in pair.points for c in p.coordinates
                  if c.mdb is not None]  # fmt: skip
    if not lengths:
        return say("Accuracy: not known: sigma0 does not exist")
    of = found.differences if isinstance(found, EpochTests) else found.series
    form = f"{{:.{movement_decimals(of) - 1}f}}"
    line = say(f"Accuracy: displacements have standard deviations of {form} mm (median)",
               1e3 * float(np.median(lengths)))  # fmt: skip
    if detectable:
        line += say(f"; a coordinate's movement is found from {form} mm on (median), with power "
                    "{:g}", 1e3 * float(np.median(detectable)), found.power)  # fmt: skip
    return line


def _next(found: EpochTests | SeriesTests) -> Line:
    of = found.differences if isinstance(found, EpochTests) else found.series
    refuted = found.agreement is not None and bool(found.agreement.rejected)
    if refuted and of.datum == "control":
        # what the epochs flag may come of it
        return say("Next: see whether the control that is named has moved, or is measured wrong, "
                   "or hold the datum by other points (--stable)").of("look")  # fmt: skip
    wrong = [(epoch, count) for epoch, count in enumerate(of.flagged, 1) if count]
    if wrong:
        shown = named([say("{} of epoch {}", count, epoch) for epoch, count in wrong])
        return say("Next: look at what each epoch flags first (anaplot adjust): {}", shown).of(
            "look"
        )
    if refuted:
        return say("Next: hold other points stable: those that were named have moved").of("look")
    if found.overall is not None and found.overall.rejected:
        return say("Next: measure the points that have moved again, to be sure of them")
    return say("Next: nothing has to be measured again")


def _displacements(document: Document, found: EpochTests | SeriesTests) -> Section:
    captions = {"displacements": "Displacements, later minus earlier, with their tests",
                "points": "Every point through its epochs"}  # fmt: skip
    blocks: list[HtmlBlock] = []
    if isinstance(found, SeriesTests):
        still = sum(not is_marked(pair) for pair in found.pairs)
        if still:
            blocks.append(say("{} with nothing marked are not shown; --csv has them",
                              counted(still, "pair of epochs", "pairs of epochs")))  # fmt: skip
    blocks += [drawing for pair in _drawn(found) for drawing in displacement_maps(pair)]
    for block in document.page:
        if isinstance(block, Table):
            blocks.append(Captioned(block, say("{}", captions.get(block.key, block.key))))
    return Section("displacements", "Displacements", tuple(blocks))


def _drawn(found: EpochTests | SeriesTests) -> list[EpochTests]:
    """Return the pairs of epochs that are drawn: the marked ones, at least the outermost two."""
    if isinstance(found, EpochTests):
        return [found]
    marked = [pair for pair in found.pairs if is_marked(pair)][:_DRAWN]
    ends = [
        pair for pair in found.pairs if pair.differences.numbers == (1, len(found.series.epochs))
    ]
    return marked or ends


def _tests(document: Document) -> Section:
    lines = tuple(block for block in document.page if isinstance(block, Line | Listed))
    return Section("tests", "Tests, in the words of compare", lines)
