"""The reports of `plan block` and `plan network`: what is to be expected before it is measured."""

from __future__ import annotations

from dataclasses import replace

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.rulesofthumb import LEAST_RI, rules_of_thumb
from anaplot.drawing.drawing import Drawing
from anaplot.planning.blockplan import expected_accuracy, weak_photos
from anaplot.planning.stabilizing import weak_ones
from anaplot.report.columns import counted
from anaplot.report.computed import Computed
from anaplot.report.document import Block, Document, Figure, Line, Table, named, say
from anaplot.report.figures.blockmap import block_map
from anaplot.report.figures.pointmaps import (
    accuracy_maps,
    detectable_map,
    effect_map,
    redundancy_map,
)
from anaplot.report.html.parts import Captioned, HtmlBlock, Report, Section
from anaplot.report.planblock import PlannedBlock
from anaplot.report.plannetwork import PlannedNetwork

__all__ = ["block_plan_report", "network_plan_report"]

_FEW = 5


def block_plan_report(found: Computed[PlannedBlock], *, written: bool = False) -> Report:
    """Return the report of a planned block, as `planned_block` has returned it.

    `written`: whether the plan is written as a block.
    """
    result = found.result
    stronger = result.stabilizing
    fly = "Next: fly it" if written else "Next: write the plan as a block (--to FOLDER), and fly it"
    if stronger:
        following = say("Next: points in the photo {} and others would help most, see below",
                        stronger[0].photo)  # fmt: skip
    elif result.added is not None:
        following = say(fly)
    elif weak_ones(result.block):  # they were not asked for
        following = say(fly + "; --stabilize 1 plans points more where photos are weak")
    else:
        following = say(fly + "; no photo is weak beside the others")
    return Report(
        say("Planned block"),
        (*_verdict(result.block), following),
        _sections(found.document, result.block),
    )


def network_plan_report(found: Computed[PlannedNetwork], *, written: bool = False) -> Report:
    """Return the report of a planned network, as `planned_network` has returned it.

    `written`: whether the plan is written as a block.
    """
    result = found.result
    lost = result.reliability.not_determined
    following = say("Next: measure it" if written else
                    "Next: write the plan as a block (--to FOLDER), and measure it")  # fmt: skip
    if lost:
        following = say("Next: more stations for {}: {}",
                        counted(len(lost), "point that is not determined",
                                "points that are not determined"),
                        named(lost, _FEW)).of("look")  # fmt: skip
    return Report(
        say("Planned network {}", result.network.name),
        (*_verdict(result.block), following),
        _sections(found.document, result.block),
    )


def _verdict(block: AdjustedBlock) -> tuple[Line, ...]:
    """Return what is to be said of a plan, but what comes next."""
    rules, indicators = rules_of_thumb(block), block.indicators()
    sound = say("Reliable: {}: mean redundancy number {:.2f} in x, {:.2f} in y; the rule of 1978 "
                "asks for {:g}", "yes" if rules.reliable else "not enough", indicators.ri_x,
                indicators.ri_y, LEAST_RI)  # fmt: skip
    weakest = weak_photos(block)[0]
    weak = say("Weakest: photo {}, mean redundancy number {:.2f} of {}; least {:.3f}, {} of point "
               "{}", weakest.photo, weakest.mean_r, counted(weakest.rays, "ray"), weakest.low_r,
               weakest.axis, weakest.point)  # fmt: skip
    return (
        sound if rules.reliable else sound.of("look"),
        weak,
        _unchecked(block),
        _accuracy(block),
    )


def _unchecked(block: AdjustedBlock) -> Line:
    rules, parts = rules_of_thumb(block), []
    spurs = block.spurs()
    if spurs:
        first = [say("{}:{} {}", *spur) for spur in spurs]
        parts.append(say("{} next to nothing checks: {}",
                         counted(len(spurs), "image coordinate that", "image coordinates that"),
                         named(first, _FEW)))  # fmt: skip
    if rules.in_fewer:
        parts.append(say("{} of {} in fewer than four photos", rules.in_fewer,
                         counted(rules.new, "new point")))  # fmt: skip
    if not parts:
        return say("Unchecked: nothing")
    return say("Unchecked: {}", named(parts, separator="; "))


def _accuracy(block: AdjustedBlock) -> Line:
    found = expected_accuracy(block)
    if found is None:
        return say("Accuracy: every point is control")
    worst = max(range(3), key=lambda axis: found.largest[axis])
    return say(
        "Accuracy: new points in X {:.4f} m, Y {:.4f} m, Z {:.4f} m (root mean squares); worst {} "
        "{:.4f} m at point {}",
        *found.rms,
        "XYZ"[worst],
        found.largest[worst],
        found.points[worst],
    )


def _sections(document: Document, block: AdjustedBlock) -> tuple[Section, ...]:
    beside = _beside(document)
    sections = [
        Section("maps", "Maps of the plan", _maps(block)),
        Section("plan", "The plan in its own words", tuple(map(_captioned, document.page))),
    ]
    if beside:
        sections.append(Section("lists", "Lists", tuple(map(_captioned, beside))))
    return tuple(sections)


def _maps(block: AdjustedBlock) -> tuple[Drawing, ...]:
    """Draw a plan: the block, expected accuracy, redundancy, what is found and what is not."""
    drawn = (
        block_map(block, planned=True),
        *accuracy_maps(block),
        redundancy_map(block),
        detectable_map(block),
        effect_map(block),
    )
    return tuple(one for one in drawn if one is not None)


_CAPTIONS = {
    "classes": "Classes of rays (Gruen 1980): sqrt(q_vv) in a-priori sigmas, detectable errors",
    "weak_photos": "Photos, the one with the smallest mean redundancy number first",
    "photos": "Photos, the one with the weakest observation first",
    "points": "Points, the one with the weakest observation first",
    "spurs": "Image coordinates that next to nothing checks",
    "correlations": "Correlated residuals of a point's rays",
    "correlations_of_point": "Correlations of a point's residuals",
}


def _captioned(block: Block) -> HtmlBlock:
    """Return a part of the page as a report has it: its tables whole."""
    if isinstance(block, Table):
        caption = say("{}", _CAPTIONS.get(block.key, block.key))
        return Captioned(replace(block, most=None), caption)
    assert not isinstance(block, Figure)  # plans draw nothing with characters
    return block


def _beside(document: Document) -> list[Table]:
    """Return the tables that the page tells in lines."""
    there = {block.key for block in document.page if isinstance(block, Table)}
    there.add("reliability")  # photos and points, one after the other
    return [table for table in document.tables if table.key not in there and len(table)]
