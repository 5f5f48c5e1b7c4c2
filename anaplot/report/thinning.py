"""A thinned block as a part of its document: what went, and what that costs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from math import degrees
from typing import Any

import numpy as np

from anaplot.adjustment.watch import Watch
from anaplot.bundle.hypotheses.coordinatefunctions import CoordinateFunction
from anaplot.bundle.hypotheses.errorsets import ErrorSet
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.unknownnames import unknowns_meant
from anaplot.bundle.thinning.accuracy import Deviations, deviations
from anaplot.bundle.thinning.imageparts import REGIONS
from anaplot.bundle.thinning.thinning import Thinning, thin_block
from anaplot.exchange.rejectedrows import next_time, rejecting_reason
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.planting import PlantedError
from anaplot.photogrammetry.posterior import CoordinateName
from anaplot.report.columns import counted
from anaplot.report.document import (
    Answer,
    Document,
    Line,
    for_programs,
    name,
    named,
    number,
    say,
    table,
    whole,
)

__all__ = ["named_points", "thinned", "thinned_rows", "thinning_document"]

_MOST = 8  # names in a line
_SHOWN = 5e-4  # of redundancy numbers
_NOTHING = 1e-6  # sigma0 of measurements without errors: nothing is estimated
_PLACES = (
    *("upper left", "upper middle", "upper right"),
    *("middle left", "middle", "middle right"),
    *("lower left", "lower middle", "lower right"),
)


def named_points(
    before: AdjustedBlock,
    functions: Iterable[CoordinateFunction],
    sets: Iterable[ErrorSet],
    planted: Iterable[PlantedError],
    unknowns: Iterable[str],
) -> frozenset[str]:
    """Return the points that are asked for by name: they stay.

    Parameters
    ----------
    before
        The block with all its points.
    functions, sets, planted
        What is asked of points and rays.
    unknowns
        Words as `unknowns_meant` has them; of all points none stays for that.
    """
    names = {point for one in functions for point in one.points}
    names.update(str(key[2]) for one in sets for key in one.observations if key[0] == "image")
    places = {one.where for one in planted}
    names.update(
        row.point
        for row in before.problem.block.image_points
        if f"{row.photo}:{row.point}" in places
    )
    for word in unknowns:
        if word not in ("points", "photos", "parameters", "offsets"):
            meant = unknowns_meant(before.problem, (word,), "--covariance")
            names.update(
                one.owner
                for one in meant
                if isinstance(one, CoordinateName) and one.kind == "point"
            )
    return frozenset(names)


def thinned(before: AdjustedBlock, least: float, keep: Collection[str], watch: Watch) -> Thinning:
    """Return a block with as few rays as keep every part of every photo controlled."""
    return thin_block(before, least, keep=keep, off=_switched_off, watch=watch)


def thinned_rows(rows: Iterable[ImagePoint], points: Collection[str]) -> tuple[ImagePoint, ...]:
    """Return rows of image_points.csv without those of some points; the reason is "thin"."""
    rows = tuple(rows)
    time = next_time(rows, "thin")
    return tuple(
        replace(row, use="off", reason=rejecting_reason("thin", row.use, row.reason, time))
        if row.point in points and row.use != "off"
        else row
        for row in rows
    )


def _switched_off(block: Block, points: Collection[str]) -> Block:
    return replace(block, image_points=thinned_rows(block.image_points, points))


_PHOTOS = (
    name("photo", "PHOTO", 5),
    whole("rays_before", "RAYS", 6),
    whole("rays", "left", 6),
    number("redn_before", "RED-N", 3, 8),
    number("redn", "then", 3, 7),
    number("worst_before", "WORST", 3, 8),
    number("worst", "then", 3, 7),
    name("worst_region", "REGION", 6),
    number("s_before", "s [m]", 4, 10, unit="m"),
    number("s", "then", 4, 9, unit="m"),
    number("s_more", "more %", 1, 8, scale=100.0),
    *for_programs("s_angle_before", "s_angle", unit="rad"),
    number("s_angle_more", "angles %", 1, 10, scale=100.0),
)


def thinning_document(found: Thinning) -> Document:
    """Return the document of a thinned block.

    Standard deviations are for the a-priori sigma0, in the same datum before and after.
    """
    spread = deviations(found)
    photos = table("thinning", _PHOTOS, list(_photo_rows(found, spread)))
    before, after = found.before, found.block
    answer: Answer = {
        "least": found.least,
        "regions": REGIONS,
        "complete": found.complete,
        "rounds": found.rounds,
        "rays_before": len(before.problem.photo),
        "rays": len(after.problem.photo),
        "points_before": len(before.problem.points),
        "points": len(after.problem.points),
        "redundancy_before": before.redundancy,
        "redundancy": after.redundancy,
        "RI_before": before.indicators().ri,
        "RI": after.indicators().ri,
        "sigma0_before": before.sigma0,
        "sigma0": after.sigma0,
        "accuracy": {what: _change(found, pair) for what, pair in spread._asdict().items()},
        "weak": [
            {
                "photo": before.problem.photos[found.parts.owner[k]],
                "region": _place(found, k),
                "redn_before": float(found.means_before[k]),
                "redn": float(found.means[k]),
            }
            for k in np.flatnonzero(found.weak).tolist()
        ],
        "photos": photos,
        "gone": list(found.gone),
    }
    return Document(answer, (*_lines(found, answer), photos), (photos,))


def _change(found: Thinning, pair: Any) -> Answer:
    first, then = pair.mean(axis=1).tolist() if pair.shape[1] else (0.0, 0.0)
    ratio = then / first if first > 0.0 else None
    estimated = None
    sigma0, sigma0_before = found.block.sigma0, found.before.sigma0
    if sigma0 is not None and sigma0_before is not None and sigma0_before > _NOTHING:
        estimated = None if ratio is None else ratio * sigma0 / sigma0_before
    return {"before": first, "after": then, "ratio": ratio, "ratio_estimated": estimated}


def _place(found: Thinning, part: int) -> str | None:
    """Return where a region lies in its photo; None of a whole photo."""
    cell = int(found.parts.cell[part])
    return None if cell < 0 else _PLACES[cell]


def _photo_rows(found: Thinning, spread: Deviations) -> Iterator[tuple[Any, ...]]:
    parts, problem = found.parts, found.before.problem
    left = found.kept[problem.point]
    n = len(problem.photos)
    rays = np.bincount(problem.photo, minlength=n)
    then = np.bincount(problem.photo[left], minlength=n)
    for k, photo in enumerate(problem.photos):
        regions = parts.of_photo[k][1:]
        known = regions[np.isfinite(found.means[regions])]
        worst: tuple[Any, ...] = (None, None, None)
        if len(known):
            part = int(known[np.argmin(np.round(found.means[known], 9))])
            worst = (
                float(found.means_before[known].min()), float(found.means[part]),
                _place(found, part),
            )  # fmt: skip
        s, angle = spread.positions[:, k].tolist(), spread.angles[:, k].tolist()
        yield (
            photo, int(rays[k]), int(then[k]), float(found.means_before[k]),
            float(found.means[k]), *worst, *s, _more(s), *angle, _more(angle),
        )  # fmt: skip


def _more(pair: list[float]) -> float | None:
    return pair[1] / pair[0] - 1.0 if pair[0] > 0.0 else None


def _lines(found: Thinning, answer: Answer) -> list[Line]:
    lines = [
        say(
            "THINNING: mean redundancy number of every photo and region at least {}", found.least
        ).of("heading"),
        say(
            "  {rays_before} rays of {points_before} points before, redundancy "
            "{redundancy_before}, RI {RI_before:.3f}",
            **answer,
        ),
        say(
            "  {rays} rays of {points} points are left ({:.0f} %), redundancy {redundancy}, "
            "RI {RI:.3f}",
            100.0 * answer["rays"] / answer["rays_before"],
            **answer,
        ),
    ]
    if not found.gone and found.complete:
        lines.append(say("  no point can go"))
    lines.append(say("  mean standard deviations, a-priori sigma0 and the same datum:"))
    for what, words, unit, scale in (
        ("positions", "positions of photos", "m", 1.0),
        ("angles", "angles of photos", "deg", degrees(1.0)),
        ("points", "points that are left", "m", 1.0),
    ):
        one = answer["accuracy"][what]
        if one["ratio"] is None:
            continue
        line = say(
            "    {:20} {:.4g} " + unit + ", then {:.4g}: {:+.1f} %",
            words,
            scale * one["before"],
            scale * one["after"],
            100.0 * (one["ratio"] - 1.0),
        )
        if one["ratio_estimated"] is not None:
            line += say(
                " ({:+.1f} % with the estimated sigma0)", 100.0 * (one["ratio_estimated"] - 1.0)
            )
        lines.append(line)
    return [*lines, *_weak_lines(found), *_end_lines(found)]


def _weak_lines(found: Thinning) -> list[Line]:
    weak = np.flatnonzero(found.weak)
    if len(weak) == 0:
        return []
    photos = weak[weak < found.parts.photos]
    regions = len(weak) - len(photos)
    of = dict.fromkeys(found.before.problem.photos[found.parts.owner[k]] for k in weak.tolist())
    parts = [counted(len(photos), "photo")] * (len(photos) > 0)
    parts += [counted(regions, "region")] * (regions > 0)
    one = len(weak) == 1
    lost = float(np.max(found.means_before[weak] - found.means[weak]))
    falls = f", but {'loses' if one else 'lose up to'} {lost:.3f}" if lost >= _SHOWN else ""
    return [
        say(
            "  {} below {} before, and {} all points{}: in {}",
            f"{' and '.join(parts)} {'was' if one else 'were'}",
            found.least,
            "keeps" if one else "keep",
            falls,
            named(list(of), _MOST),
        )
        .of("remark")
        .folded(4)
    ]


def _end_lines(found: Thinning) -> list[Line]:
    if found.complete:
        return []
    return [say("  ended early: more points could go").of("remark")]
