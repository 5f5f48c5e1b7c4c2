"""The documents of epochs: what two have between them, and what more have."""

from __future__ import annotations

from collections.abc import Sequence

from anaplot.bundle.epochs.displacementtests import EpochTests
from anaplot.bundle.epochs.located import Located
from anaplot.bundle.epochs.overall import Overall
from anaplot.bundle.epochs.series import EpochDifferences, EpochSeries
from anaplot.bundle.epochs.seriestests import SeriesTests
from anaplot.bundle.epochs.stabletests import held_points
from anaplot.bundle.epochs.variances import VarianceRatio
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict
from anaplot.report.document import BLANK, Answer, Block, Document, Line, named, say
from anaplot.report.epochaside import Aside
from anaplot.report.epochtables import (
    against_answer,
    against_table,
    is_marked,
    pair_answer,
    pair_table,
    pairs_table,
    point_answer,
    series_answer,
    series_table,
)
from anaplot.report.verdicts import labelled, probability, verdict_cells, verdict_json

__all__ = ["compare_document", "series_document"]

_LISTED = 12
_LABEL = 34
_NOTHING = Aside()


def compare_document(found: EpochTests, aside: Aside = _NOTHING) -> Document:
    """Return the document of two epochs; people read displacements in millimetres.

    Parameters
    ----------
    found
        The tested displacements.
    aside
        What takes no part.
    """
    of = found.differences
    points = pair_table(found)
    common = (*of.common, *(f"{name} in {' and '.join(axes)}" for name, axes in of.partly))
    page: list[Block] = [
        *_head(of),
        *_setting(of, common, (of.only_first, of.only_second), aside),
        *(say("  note: {}", remark).of("remark") for remark in found.remarks),
    ]
    if found.variance is not None:
        page.append(_ratio_line(of.numbers, found.variance, found.alpha))
    page += [
        *_hypotheses(found, found.differences.expected is not None),
        BLANK,
        points,
        *_legend(len(points), found.alpha, of.expected is not None),
        *_conclusion(found.overall, of.expected is not None),
    ]
    return Document(_answer(found) | aside.answer(), tuple(page), (points,))


def series_document(found: SeriesTests, aside: Aside = _NOTHING) -> Document:
    """Return the document of more than two epochs.

    Parameters
    ----------
    found
        The tested displacements.
    aside
        What takes no part.
    """
    of = found.series
    points, pairs = series_table(found), pairs_table(found, found.pairs)
    expected = of.expected is not None
    page: list[Block] = [
        *_head(of),
        *_setting(of, _common_of(of), of.alone_in, aside),
        _by_themselves(of),
        *(say("  note: {}", remark).of("remark") for remark in found.remarks),
    ]
    for pair in found.pairs:
        if pair.variance is not None and pair.variance.significance < pair.alpha:
            page.append(_ratio_line(pair.differences.numbers, pair.variance, pair.alpha))
    page += _hypotheses(found, expected)
    for pair in found.pairs:
        first, second = pair.differences.numbers
        page.append(_line(f"  from {first} to {second}", pair.everything))
        page += _explained(pair.located, "  ")
    for one in found.against:
        page.append(_line(f"  epoch {one.epoch} against the others", one.verdict))
        if one.explains:
            page.append(say("    explains it: without epoch {} the rest is accepted", one.epoch))
    each = found.pairs[0].alpha if found.pairs else found.alpha
    page += [
        BLANK,
        *_pairs(found),
        say("  each pair of epochs at alpha {:.2g}, all points or all coordinates together;", each),
        say("  all pairs together at {:g}", found.alpha),
        BLANK,
        points,
        say("  MOVED: from which epoch to which, so that the rest of a point's movements agrees"),
        *_legend(len(points), found.alpha, expected, single=False),
        *_conclusion(found.overall, expected),
    ]  # fmt: skip
    tables = (pairs, points, against_table(found))
    return Document(_series_answer(found) | aside.answer(), tuple(page), tables)


# --- for programs ---------------------------------------------------------------------------


def _setting_answer(of: EpochDifferences | EpochSeries) -> Answer:
    """Return how epochs were adjusted: lengths in metres, what does not exist is None."""
    common = of.common.points() if isinstance(of, EpochSeries) else of.common
    partly = of.common.lettered() if isinstance(of, EpochSeries) else of.partly
    redundancy = of.redundancy
    return {
        "epochs": list(of.epochs),
        "adjustment": "joint" if of.joint else "separate",
        "datum": of.datum,
        "common_points": list(common),
        "common_coordinates": [{"point": n, "axes": axes} for n, axes in partly],
        "common_parameters": None if of.own_parameters is None else not of.own_parameters,
        "redundancy": redundancy,
        "sigma0": (of.vtpv / redundancy) ** 0.5 if redundancy > 0 else None,
    }


def _answer(found: EpochTests) -> Answer:
    """Return what `--json` prints of two epochs."""
    differences = found.differences
    return {
        **_setting_answer(differences),
        "alpha": found.alpha,
        "power": found.power,
        "variance_ratio": None if found.variance is None else found.variance._asdict(),
        "all": verdict_json(found.everything),
        "agreement": verdict_json(found.agreement),
        "overall": _overall_answer(found.overall),
        "located": [step._asdict() for step in found.located],
        "points": [point_answer(p) for p in found.points],
        "only_first": list(differences.only_first),
        "only_second": list(differences.only_second),
        "located_stable": [step._asdict() for step in found.located_stable],
        "flagged": list(differences.flagged),
        "remarks": list(found.remarks),
        "given_movement": differences.expected is not None,
    }


def _series_answer(found: SeriesTests) -> Answer:
    """Return what `--json` prints of more than two epochs."""
    series = found.series
    return {
        **_setting_answer(series),
        "alpha": found.alpha,
        "power": found.power,
        "all": verdict_json(found.everything),
        "agreement": verdict_json(found.agreement),
        "overall": _overall_answer(found.overall),
        "located": [step._asdict() for step in found.located],
        "points": [series_answer(p) for p in found.points],
        "pairs": [pair_answer(pair) for pair in found.pairs],
        "against_others": [against_answer(one) for one in found.against],
        "only": [list(names) for names in series.alone_in],
        "located_stable": [step._asdict() for step in found.located_stable],
        "flagged": list(series.flagged),
        "by_themselves": [
            {"redundancy": redundancy, "sigma0": VarianceFactor(vtpv, redundancy, False).sigma}
            for vtpv, redundancy in series.alone
        ],
        "remarks": list(found.remarks),
        "given_movement": series.expected is not None,
    }


def _overall_answer(overall: Overall | None) -> Answer | None:
    if overall is None:
        return None
    return {**overall._asdict(), "families": list(overall.families), "rejected": overall.rejected}


# --- for people -----------------------------------------------------------------------------


def _head(of: EpochDifferences | EpochSeries) -> list[Block]:
    sigma0 = say("no redundancy")
    if of.redundancy > 0:
        sigma0 = say("sigma0 {:.3f}", (of.vtpv / of.redundancy) ** 0.5)
    *others, last = (say("{} ({})", name, k) for k, name in enumerate(of.epochs, start=1))
    line = say(
        "COMPARE  {} and {}, adjusted {}, redundancy {}, {}; tests with the {} sigma0",
        named(others),
        last,
        "jointly" if of.joint else "separately",
        of.redundancy,
        sigma0,
        "a-priori" if of.by_known else "estimated",
    )
    return [line.of("heading")]


def _setting(
    of: EpochDifferences | EpochSeries,
    common: Sequence[str],
    only: Sequence[Sequence[str]],
    aside: Aside,
) -> list[Block]:
    """Say what is common, what is in one epoch alone, and what takes no part."""
    out: list[Block] = []
    if common:
        what = "control" if of.datum == "control" else "stable points"
        out.append(say("  common {}: {}", what, named(common, _LISTED)))
    if of.own_parameters is not None:
        which = "both" if len(of.epochs) == 2 else "all"
        whose = "each epoch its own" if of.own_parameters else f"common to {which} epochs"
        out.append(say("  additional parameters: {}", whose))
    for epoch, names in enumerate(only, start=1):
        if names:
            out.append(say("  in epoch {} alone: {}", epoch, named(names, _LISTED)))
    return [*out, *aside.lines(len(of.epochs))]


def _common_of(of: EpochSeries) -> list[str]:
    """Return what is common, and to which epochs where not to all."""
    every = len(of.epochs)

    def where(epochs: frozenset[int]) -> str:
        numbers = " and ".join(str(k + 1) for k in sorted(epochs))
        return "" if len(epochs) == every else f" in epochs {numbers}"

    out = [name + where(of.common.whole(name)) for name in of.common.points()]
    for name, axes in of.common.lettered():
        epochs = of.common.axes[name]["XYZ".index(axes[0])]
        out.append(f"{name} in {' and '.join(axes)}{where(epochs)}")
    return out


def _by_themselves(of: EpochSeries) -> Line:
    parts = []
    for number, (vtpv, redundancy) in enumerate(of.alone, start=1):
        sigma = VarianceFactor(vtpv, redundancy, by_known=False).sigma
        parts.append(say("{:.3f||none} ({})", sigma, number))
    return say("  sigma0 of each epoch by itself: {}", named(parts, _LISTED))


def _pairs(found: SeriesTests) -> list[Block]:
    """Return the pairs in which something is marked; every pair has its line among the tests."""
    marked = [pair for pair in found.pairs if is_marked(pair)]
    out: list[Block] = [pairs_table(found, marked)] if marked else []
    left = len(found.pairs) - len(marked)
    if left:
        which = "the pair" if left == 1 else f"the {left} pairs"
        out.append(say("  {} of epochs with nothing marked: --csv and --json have them all", which))
    return out


def _ratio_line(numbers: tuple[int, int], ratio: VarianceRatio, alpha: float) -> Line:
    return say(
        "  variance of epoch {} over epoch {}: {:.3f}, P {}{}",
        *numbers,
        ratio.ratio,
        probability(ratio.significance),
        "  << THEY DIFFER" if ratio.significance < alpha else "",
    )


def _hypotheses(found: EpochTests | SeriesTests, expected: bool) -> list[Block]:
    none = "every point has moved as given" if expected else "no point has moved"
    out: list[Block] = [
        BLANK,
        say("  {:<34}    b      f         T  critical        P", "HYPOTHESIS"),
        _line(none, found.everything),
        *_explained(found.located),
    ]
    if found.agreement is not None:
        of = found.differences if isinstance(found, EpochTests) else found.series
        have = "has" if of.datum == "control" else "have"
        label = f"the {held_points(of.datum)} {have} not moved"
        out.append(_line(label, found.agreement))
        out += _explained(found.located_stable)
    return out


def _line(label: str, verdict: Verdict | None) -> Line:
    test = None if verdict is None else verdict.decisive
    if test is None:
        return labelled(label, _LABEL) + "  not testable"
    line = labelled(label, _LABEL) + verdict_cells(test)
    return (line + "  << REJECTED").of("look") if test.rejected else line + "  accepted"


def _explained(located: tuple[Located, ...], indent: str = "") -> list[Block]:
    if not located:
        return []
    names = named((step.point for step in located), _LISTED)
    line = say("  explain it, one after the other until the rest is accepted: {}", names)
    return [Line((indent,)) + line]


def _legend(count: int, alpha: float, expected: bool, *, single: bool = True) -> list[Block]:
    many = say("all {} points", count) if count > 1 else say("the point")
    coordinates = ", or all coordinates," if single else ""
    against = [say("  tested against the given movement w")] if expected else []
    return [
        *against,
        say("  P of each point by itself; marked (B Bonferroni, S Scheffe) what exceeds the limit"
            " for"),
        say("  {}{} together at alpha {:g}; O: so does the orthogonal", many, coordinates, alpha),
        say("  component that stands for it, in which correlated neighbours show a little"),
    ]  # fmt: skip


def _conclusion(overall: Overall | None, expected: bool) -> list[Block]:
    """Return the one verdict that `--fail-on-flag` goes by."""
    if overall is None:
        return []
    families = say("{} at", overall.families[0])
    if len(overall.families) > 1:
        families = say(
            "{} families ({}) together at", len(overall.families), named(overall.families)
        )
    line = say(
        "  ANYTHING MOVED{}: {}, P {}; {} alpha {:g}",
        " OTHERWISE THAN GIVEN" if expected else "",
        "yes" if overall.rejected else "no",
        probability(overall.significance),
        families,
        overall.alpha,
    )
    return [BLANK, line.of("look") if overall.rejected else line]
