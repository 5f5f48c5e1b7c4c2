"""The block at a glance: what authorities ask for, on the first page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from anaplot.bundle.errors.bychance import ALARM
from anaplot.bundle.solve.adjusted import AdjustedBlock, observation_in_words
from anaplot.bundle.solve.uncheckedvalues import unchecked_values
from anaplot.report.adjustdocument import (
    datum_words,
    ground_lines,
    others_flagged,
    sigma0_limit,
)
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.columns import counted
from anaplot.report.document import Answer, Document, Line, Table, named, say
from anaplot.report.html.parts import Captioned, Facts, HtmlBlock, Section
from anaplot.station.coverage import is_held

__all__ = ["accuracy_section", "glance_section"]

_MOST_CORRELATED = 5


def glance_section(found: BlockAdjustment, document: Document, free: Line | None = None) -> Section:
    """Return the figures of a block: sigma0, counts, datum, system, rejected, indicators.

    Parameters
    ----------
    found, document
        What `adjust` has found, and its document.
    free
        What is said of a free datum that nobody asked for; None: nothing.
    """
    block, answer = found.block, document.answer
    problem = block.problem
    facts: list[tuple[str, Line]] = [
        ("Sigma0", _sigma0(block, answer)),
        ("Global test", _global_test(block, answer)),
        (
            "Size",
            say(
                "{} photos, {} points, {} rays; {observations} observations, {unknowns} unknowns, "
                "redundancy {redundancy}",
                len(problem.photos),
                len(problem.points),
                len(problem.photo),
                **answer,
            ),
        ),
        ("Datum", _datum(block, answer, free)),
        ("Coordinate system", _system(block)),
        (
            "Test of observations",
            say(
                "{kind}, alpha {alpha:g}, power {power:g}, critical value {critical:.2f||none}; of "
                "good observations about {flagged_by_chance:.1f} are flagged",
                **answer["test"],
            ),
        ),
        ("Flagged", _flagged(block)),
        ("Rejected", _rejected(found)),
        (
            "Redundancy numbers",
            say("mean of x {RI_x:.3f}, of y {RI_y:.3f}, of all {RI:.3f}", **answer["indicators"]),
        ),
        ("Checked by nothing", _spurs(block)),
    ]
    return Section("glance", "At a glance", (Facts(tuple(facts)),))


def _sigma0(block: AdjustedBlock, answer: Answer) -> Line:
    if block.sigma0 is None:
        return say("none: nothing is redundant")
    um = block.problem.block.precision.image_um
    return say("{sigma0_um:.2f} um against {:g} um a priori, factor {sigma0:.2f}", um, **answer)


def _global_test(block: AdjustedBlock, answer: Answer) -> Line:
    limit, test = sigma0_limit(block), answer["global_test"]
    if limit is None or block.sigma0 is None:
        return say("none: nothing is redundant")
    words = "exceeds" if block.sigma0**2 > limit else "does not exceed"
    line = say("sigma0^2 {:.3f} {} {:.3f} (alpha {:g})", block.sigma0**2, words, limit, ALARM)
    if test is None:
        return line
    return line + say(
        "; consistent with the single tests: {critical:.3f} (alpha {alpha:.3f})", **test
    )


def _datum(block: AdjustedBlock, answer: Answer, free: Line | None) -> Line:
    line = say("{}", datum_words(block.problem))
    defect = answer["datum"]["defect"]
    if defect:
        line += say(", rank defect {}", defect)
    return line if free is None else (line + say("; ") + free).of("remark")


def _system(block: AdjustedBlock) -> Line:
    problem = block.problem
    if problem.datum == "free" or not is_held(problem.block):
        scale = (
            "its scale is that of the distances"
            if problem.gives_scale
            else "its scale is arbitrary: m stands for its unit of length"
        )
        laid = (
            "that of the approximate values, nothing given holds the block"
            if is_held(problem.block)
            else "its own: nothing ties the block to the ground"
        )
        return say("{}; {}", laid, scale)
    lines = ground_lines(problem.block.ground)
    if not lines:
        return say("that of what is given, metres; no reference system is stated")
    return Line(tuple(part for line in lines for part in (*_stripped(line).parts, " ")))


def _stripped(line: Line) -> Line:
    first, *rest = line.parts
    if not isinstance(first, str):
        return line
    return replace(line, parts=(first.strip().removeprefix("coordinates:").lstrip() + " ", *rest))


def _flagged(block: AdjustedBlock) -> Line:
    images = int(block.flagged.sum())
    line = say("{}", counted(images, "image coordinate") if images else "no image coordinate")
    others = others_flagged(block)
    if others:
        shown = named([say("{} (w {:.2f})", what, w) for w, what, _ in others], 3)
        line += say(", and {}: {}", counted(len(others), "other observation"), shown)
    return line.of("look") if images or others else line


def _rejected(found: BlockAdjustment) -> Line:
    if found.errors is None:
        return say("nothing was looked for (adjust --errors)")
    count = len(found.rejected)
    strategy = found.errors.findings.strategy
    if not count:
        return say("nothing, by the strategy {}", strategy)
    return say("{} by the strategy {}", counted(count, "observation"), strategy).of("look")


def _spurs(block: AdjustedBlock) -> Line:
    spurs = block.spurs()
    values = [observation_in_words(one.key)[0] for one in unchecked_values(block)]
    line = say("no image coordinate")
    if spurs:
        shown = named([say("{}:{} {}", *spur) for spur in spurs], 4)
        line = say("{}: {}", counted(len(spurs), "image coordinate"), shown)
    if values:
        line += say("; {}", named(values, 4))
    return line.of("remark") if spurs or values else line


def accuracy_section(document: Document, summary: Mapping[str, Table]) -> Section:
    """Return the standard deviations and the largest correlations of unknowns."""
    blocks: list[HtmlBlock] = [summary["accuracy"]]
    if len(summary["accuracy_angles"]):
        blocks.append(summary["accuracy_angles"])
    blocks += _calibration(document)
    for key, what in (("photos_correlated", "photos"), ("points_correlated", "points")):
        found = summary[key]
        if len(found):
            line = say("Correlations of the unknowns of single {}: the largest", what)
            blocks.append(Captioned(_largest(found), line))
    return Section("accuracy", "Accuracy: standard deviations and correlations", tuple(blocks))


def _largest(table: Table) -> Table:
    return replace(table, source=lambda: tuple(part[:_MOST_CORRELATED] for part in table.values))


def _calibration(document: Document) -> Iterator[HtmlBlock]:
    """Yield the tables of calibrations and additional parameters, as far as there are any."""
    for block in document.page:
        if isinstance(block, Table) and block.key in ("calibration", "parameters"):
            yield block
