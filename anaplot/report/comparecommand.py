"""`anaplot compare` and its call: two epochs in, displacements and their document out."""

from __future__ import annotations

from collections.abc import Sequence

from anaplot.aliases import Progress
from anaplot.bundle.epochs.displacements import compare_epochs
from anaplot.bundle.epochs.displacementtests import EpochTests, Located, PointMove, epoch_tests
from anaplot.bundle.hypotheses.verdict import Verdict
from anaplot.errors import InputError
from anaplot.photogrammetry.block import ImagePoint
from anaplot.report.adjustarguments import add_compare_arguments
from anaplot.report.columns import fitted
from anaplot.report.computed import Computed
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Column,
    Document,
    Line,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    table,
)
from anaplot.report.journalnote import journal_note, with_journal_notes
from anaplot.report.keywords import names_in, takes_options
from anaplot.report.parameters import parameters_of
from anaplot.report.power import check_power
from anaplot.report.running import BlockOrFolder, block_of
from anaplot.report.verdicts import labelled, probability, verdict_cells, verdict_json

__all__ = ["compare", "compare_document"]

OffRow = tuple[int, ImagePoint]

_LISTED = 12
_LABEL = 34


@takes_options(add_compare_arguments)
def compare(
    first: BlockOrFolder,
    second: BlockOrFolder,
    *,
    separate: bool = False,
    additional: str | None = None,
    additional_sigma_um: float | None = None,
    additional_prior: Sequence[str] | None = None,
    common_parameters: bool | None = None,
    stable: str | Sequence[str] | None = None,
    points: str | Sequence[str] | None = None,
    alpha: float = 0.05,
    progress: Progress | None = None,
) -> Computed[EpochTests]:
    """Compare two epochs of one object: what has moved.

    Parameters
    ----------
    first, second
        Two blocks, or their folders; they are only read.
    separate
        Whether each epoch is adjusted by itself; otherwise both in one, with common control.
    additional
        A set of additional parameters, some of it, and its scope, as `adjust` has them.
    additional_sigma_um
        Their a-priori standard deviation as effect in the image [um]; None: free.
    additional_prior
        An a-priori calibration, as `adjust` has it.
    common_parameters
        Whether both epochs have the same ones; None: jointly, of block and camera, they have.
    stable
        Points that have not moved and hold the datum in place of control: a sequence of names, or
        names separated by commas.
    points
        Compare these only.
    alpha
        Significance of the global test, of every family of single tests, and of all together.
    progress
        Called with what is being done and the fraction of it (0 to 1).

    Returns
    -------
    Computed of EpochTests
        Displacements, second minus first [m], with covariances and tests; flagged when anything
        has moved, all tests together at `alpha`.

    Raises
    ------
    InputError
        Bad input; options that do not go together.
    NotComputableError
        Something is not determined, or the epochs have nothing in common.
    """
    for option, text in (("--stable", stable), ("--points", points)):
        if text is not None and not names_in(text):
            raise InputError(f"{option}: no point is named")
    if additional is None and additional_sigma_um is not None:
        raise InputError("--additional-sigma-um goes with --additional")
    chosen = parameters_of(additional, additional_sigma_um, additional_prior)
    (one, where), (other, _) = block_of(first), block_of(second)
    notes = journal_note(first, one), journal_note(second, other)
    check_power("--alpha", alpha, one.test, where)
    left_aside = [k for k, block in ((1, one), (2, other)) if block.conditions]
    found = compare_epochs(
        one,
        other,
        separate=separate,
        additional=chosen,
        common_parameters=common_parameters,
        stable=names_in(stable or ()),
        points=names_in(points or ()),
        progress=progress,
    )
    tested = epoch_tests(found, alpha=alpha)
    off = [
        (epoch, row)
        for epoch, block in ((1, one), (2, other))
        for row in block.image_points
        if row.use != "xy"
    ]
    document = compare_document(tested, off, left_aside)
    document = with_journal_notes(document, *notes)
    return Computed(tested, document, tested.any_moved)


def _moved(verdict: Verdict | None) -> bool | None:
    return None if verdict is None else verdict.rejected


def _answer(found: EpochTests) -> Answer:
    """Return what `--json` prints: lengths in metres, what does not exist is None."""
    differences = found.differences
    redundancy = differences.redundancy
    sigma0 = (differences.vtpv / redundancy) ** 0.5 if redundancy > 0 else None
    return {
        "epochs": list(differences.epochs),
        "adjustment": "joint" if differences.joint else "separate",
        "datum": differences.datum,
        "common_points": list(differences.common),
        "common_coordinates": [{"point": n, "axes": axes} for n, axes in differences.partly],
        "common_parameters": None
        if differences.own_parameters is None
        else not differences.own_parameters,
        "redundancy": redundancy,
        "sigma0": sigma0,
        "alpha": found.alpha,
        "power": found.power,
        "variance_ratio": None if found.variance is None else found.variance._asdict(),
        "all": verdict_json(found.everything),
        "agreement": verdict_json(found.agreement),
        "overall": _overall_json(found),
        "located": [step._asdict() for step in found.located],
        "points": [_point_json(p) for p in found.points],
        "only_first": list(differences.only_first),
        "only_second": list(differences.only_second),
        "located_stable": [step._asdict() for step in found.located_stable],
        "flagged": list(differences.flagged),
        "remarks": list(found.remarks),
    }


def _overall_json(found: EpochTests) -> Answer | None:
    overall = found.overall
    if overall is None:
        return None
    return {**overall._asdict(), "families": list(overall.families), "rejected": overall.rejected}


def _point_json(p: PointMove) -> Answer:
    return {
        "point": p.point,
        **dict(zip("XYZ", p.place, strict=True)),
        "length": p.length,
        "s_length": p.s_length,
        "bonferroni": verdict_json(p.verdict),
        "scheffe": p.scheffe,
        "coordinates": [
            {
                "axis": c.axis,
                "d": c.d,
                "s": c.s,
                "given": c.given,
                "bonferroni": verdict_json(c.verdict),
                "scheffe": c.scheffe,
                "half_bonferroni": c.half_bonferroni,
                "half_scheffe": c.half_scheffe,
                "detectable": c.mdb,
            }
            for c in p.coordinates
        ],
    }


def _line(label: str, verdict: Verdict | None) -> Line:
    test = None if verdict is None else verdict.decisive
    if test is None:
        return labelled(label, _LABEL) + "  not testable"
    line = labelled(label, _LABEL) + verdict_cells(test)
    return (line + "  << REJECTED").of("look") if test.rejected else line + "  accepted"


def _millimetres(value: float | str) -> str:
    return value if isinstance(value, str) else fitted(value * 1e3, 2, 8)


_POINTS = (
    name("point", "POINT", 5),
    *for_programs("X", "Y", "Z", "dX", "dY", "dZ"),
    *(Column("", f"d{axis} [mm]", 9, form=_millimetres) for axis in "XYZ"),
    *(number(f"s{axis}", f"s{axis}", 2, 9, unit="m", scale=1e3) for axis in "XYZ"),
    number("length", "length", 2, 9, unit="m", scale=1e3),
    number("s_length", "s", 2, 9, unit="m", scale=1e3),
    Column("P", "P", 9, form=probability),
    *for_programs("moved_bonferroni", "moved_scheffe"),
    name("", "marks", head="", look=bool),
)


def _point_table(found: EpochTests) -> Table:
    rows = []
    for p in found.points:
        test = None if p.verdict is None else p.verdict.decisive
        rows.append(
            (p.point, *p.place, *(c.d for c in p.coordinates),
             *("given" if c.given else c.d for c in p.coordinates), *(c.s for c in p.coordinates),
             p.length, p.s_length, None if test is None else test.significance, _moved(p.verdict),
             p.scheffe, _marks(p))
        )  # fmt: skip
    return table("displacements", _POINTS, rows)


def compare_document(
    found: EpochTests, off: Sequence[OffRow] = (), left_aside: Sequence[int] = ()
) -> Document:
    """Return the document of two epochs; people read displacements in millimetres.

    Parameters
    ----------
    found
        The tested displacements.
    off
        Rows of which not both coordinates count, with the number of their epoch.
    left_aside
        Epochs with conditions between points, which take no part.
    """
    of = found.differences
    points = _point_table(found)
    sigma0 = say("no redundancy")
    if of.redundancy > 0:
        sigma0 = say("sigma0 {:.3f}", (of.vtpv / of.redundancy) ** 0.5)
    page: list[Block] = [
        say(
            "COMPARE  {} (1) and {} (2), adjusted {}, redundancy {}, {}; tests with the {} sigma0",
            *of.epochs,
            "jointly" if of.joint else "separately",
            of.redundancy,
            sigma0,
            "a-priori" if of.by_known else "estimated",
        ).of("heading")
    ]
    what = "control" if of.datum == "control" else "stable points"
    common = (*of.common, *(f"{name} in {' and '.join(axes)}" for name, axes in of.partly))
    if common:
        page.append(say("  common {}: {}", what, named(common, _LISTED)))
    if of.own_parameters is not None:
        whose = "each epoch its own" if of.own_parameters else "common to both epochs"
        page.append(say("  additional parameters: {}", whose))
    for epoch, names in ((1, of.only_first), (2, of.only_second)):
        if names:
            page.append(say("  in epoch {} alone: {}", epoch, named(names, _LISTED)))
    for epoch in (1, 2):
        rows = [f"{r.point} in photo {r.photo} ({_gone(r)})" for of_, r in off if of_ == epoch]
        if rows:
            page.append(say("  switched off in epoch {}: {}", epoch, named(rows, _LISTED)))
    for epoch in left_aside:
        page.append(say("  distances.csv and conditions.csv of epoch {} take no part", epoch))
    page += [say("  note: {}", remark).of("remark") for remark in found.remarks]
    if found.variance is not None:
        differ = found.variance.significance < found.alpha
        page.append(
            say(
                "  variance of epoch 1 over epoch 2: {:.3f}, P {}{}",
                found.variance.ratio,
                probability(found.variance.significance),
                "  << THEY DIFFER" if differ else "",
            )
        )
    page += [
        BLANK,
        say("  {:<34}    b      f         T  critical        P", "HYPOTHESIS"),
        _line("no point has moved", found.everything),
        *_explained(found.located),
    ]
    if found.agreement is not None:
        page.append(_line("the stable points have not moved", found.agreement))
        page += _explained(found.located_stable)
    many = say("all {} points", len(points)) if len(points) > 1 else say("the point")
    page += [
        BLANK,
        points,
        say("  P of each point by itself; marked (B Bonferroni, S Scheffe) what exceeds the limit"
            " for"),
        say("  {}, or all coordinates, together at alpha {:g}", many, found.alpha),
        *_conclusion(found),
    ]  # fmt: skip
    answer = _answer(found)
    if off:
        answer = {**answer, "off": [_off_json(epoch, row) for epoch, row in off]}
    if left_aside:
        answer = {**answer, "without_conditions": list(left_aside)}
    return Document(answer, tuple(page), (points,))


def _gone(row: ImagePoint) -> str:
    """Return which coordinates do not count."""
    return "".join(axis for axis in "xy" if not row.counts(axis))


def _off_json(epoch: int, row: ImagePoint) -> Answer:
    return {
        "epoch": epoch,
        "photo": row.photo,
        "point": row.point,
        "model": row.model,
        "use": row.use,
        "reason": row.reason,
    }


def _conclusion(found: EpochTests) -> list[Block]:
    """Return the one verdict that `--fail-on-flag` goes by."""
    overall = found.overall
    if overall is None:
        return []
    families = say("{} at", overall.families[0])
    if len(overall.families) > 1:
        families = say(
            "{} families ({}) together at", len(overall.families), named(overall.families)
        )
    line = say(
        "  ANYTHING MOVED: {}, P {}; {} alpha {:g}",
        "yes" if overall.rejected else "no",
        probability(overall.significance),
        families,
        overall.alpha,
    )
    return [BLANK, line.of("look") if overall.rejected else line]


def _explained(located: tuple[Located, ...]) -> list[Block]:
    if not located:
        return []
    names = named((step.point for step in located), _LISTED)
    return [say("  explain it, one after the other until the rest is accepted: {}", names)]


def _marks(p: PointMove) -> str:
    """Name the point's and its coordinates' verdicts."""

    def letters(bonferroni: bool | None, scheffe: bool | None) -> str:
        return ("B" if bonferroni else "") + ("S" if scheffe else "")

    own = letters(_moved(p.verdict), p.scheffe)
    single = [
        f"{c.axis} {found}"
        for c in p.coordinates
        if (found := letters(_moved(c.verdict), c.scheffe))
    ]
    parts = ([f"MOVED {own}"] if own else []) + single
    return f"<< {', '.join(parts)}" if parts else ""
