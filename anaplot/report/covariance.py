"""`adjust --covariance`: which unknowns, and their covariance as a part of a block's document."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any, TypeAlias

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.covariances import Covariance, covariance_of
from anaplot.bundle.solve.placeaccuracy import Ellipse, pair_accuracies, place_accuracies
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.unknownnames import UnknownName, unknowns_meant, unknowns_of
from anaplot.errors import InputError
from anaplot.photogrammetry.posterior import MOST_COORDINATES, CoordinateName
from anaplot.report.adjustdocument import DATUM
from anaplot.report.columns import counted
from anaplot.report.covariancefile import write_covariance
from anaplot.report.document import (
    BLANK,
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
    whole,
)
from anaplot.report.keywords import names_in
from anaplot.report.npzfile import check_npz_path
from anaplot.textfiles.wholefile import check_place

__all__ = [
    "MOST_SHOWN",
    "AskedCovariance",
    "CovarianceQuestion",
    "Names",
    "any_covariance",
    "covariance_document",
    "write_asked",
]

Names: TypeAlias = str | Sequence[str] | bool
"""Names, with commas between or one by one; True: all."""

MOST_SHOWN = 600
"""Unknowns whose matrix is a part of the document: 360 000 numbers; a file may hold more."""

_OPTION = "--covariance"
_PRINTED = 24  # unknowns whose matrix a person reads
_COLUMNS = 6  # of it on one page
_NUMBER, _COVARIANCE, _CORRELATION = " {:>11}", " {:>11.3e}", " {:>+11.4f||          -}"
_DEGREES = 180.0 / pi


@dataclass(frozen=True, slots=True, eq=False)
class AskedCovariance:
    """A covariance that was asked for.

    Attributes
    ----------
    covariance
        Of what the adjusted block has.
    test
        The test whose sigma0 it has, "tau" or "baarda".
    gone
        What a cleaning left nothing of.
    file
        Where it was written; None: nowhere.
    """

    covariance: Covariance
    test: str
    gone: tuple[UnknownName, ...] = ()
    file: Path | None = None


@dataclass(frozen=True, slots=True)
class CovarianceQuestion:
    """What `--covariance` asks for.

    Attributes
    ----------
    wanted
        As `unknowns_meant` has it.
    file
        Where it is to be written, or None.
    names
        What that is in the block before it is adjusted; None where it is not known yet.
    """

    wanted: tuple[str, ...]
    file: Path | None
    names: tuple[UnknownName, ...] | None = None

    @classmethod
    def of(
        cls,
        wanted: str | Sequence[str] | None,
        file: str | os.PathLike[str] | None,
        posterior: object,
    ) -> CovarianceQuestion | None:
        """Return what is asked; None where nothing is.

        Raises
        ------
        InputError
            Options that do not go together.
        """
        if wanted is None:
            if file is not None:
                raise InputError("--covariance-to goes with --covariance")
            return None
        path = None if file is None else Path(file)
        if path is not None:
            check_npz_path(path, "--covariance-to")
            check_place(path)
            if isinstance(posterior, str | os.PathLike) and Path(posterior) == path:
                raise InputError("--posterior and --covariance-to name one file")
        return cls((wanted,) if isinstance(wanted, str) else tuple(wanted), path)

    def checked(self, problem: Problem) -> CovarianceQuestion:
        """Return it with the unknowns of a bundle; raises InputError for what is not in it."""
        return replace(self, names=self._meant(problem))

    def answered(self, block: AdjustedBlock) -> AskedCovariance:
        """Return the covariance; `write_asked` writes it where it is to be.

        Raises
        ------
        InputError
            What is not in the block.
        NotComputableError
            omega or kappa of a photo with phi at 90 degrees.
        """
        names = self._meant(block.problem) if self.names is None else self.names
        # a cleaning may have left nothing of what there was
        there = {one.text: one for one in unknowns_of(block.problem)}
        found = covariance_of(block, [there[one.text] for one in names if one.text in there])
        gone = tuple(one for one in names if one.text not in there)
        return AskedCovariance(found, block.problem.test.kind, gone, self.file)

    def _meant(self, problem: Problem) -> tuple[UnknownName, ...]:
        most = MOST_SHOWN if self.file is None else MOST_COORDINATES
        more = f"; --covariance-to FILE.npz takes {MOST_COORDINATES}" if self.file is None else ""
        return _unknowns_meant(problem, self.wanted, most, more)


def write_asked(found: AskedCovariance | None) -> None:
    """Write a covariance where it was asked to be written; raises as `write_covariance`."""
    if found is not None and found.file is not None:
        write_covariance(found.file, found.covariance)


def any_covariance(
    block: AdjustedBlock, points: Names, photos: Names, parameters: Names, offsets: Names
) -> Covariance:
    """Return the covariance of what is named of each kind; True: all of it."""
    wanted: list[str] = []
    of = {"point": points, "photo": photos, "parameter": parameters, "offset": offsets}
    for kind, given in of.items():
        if isinstance(given, bool):
            wanted += [f"{kind}s"] * given
        else:
            wanted += [f"{kind}:{one}" for one in names_in(given)]
    return covariance_of(block, _unknowns_meant(block.problem, wanted, MOST_COORDINATES))


def _unknowns_meant(
    problem: Problem, wanted: Sequence[str], most: int, more: str = ""
) -> tuple[UnknownName, ...]:
    names = unknowns_meant(problem, wanted, _OPTION)
    if not names:
        raise InputError(f"{_OPTION}: nothing is named")
    if len(names) > most:
        raise InputError(f"{_OPTION}: {len(names)} unknowns with each other: at most {most}{more}")
    return names


_UNKNOWNS = (
    whole("", "", 5),
    name("kind", "UNKNOWN", 5),
    name("owner", gap=1),
    name("unknown", gap=1),
    Column("", "VALUE", 17, form=lambda shown: format(*shown)),
    Column("", "S", 11, form="{:.4g}".format),
    name("", "UNIT", 3, gap=1),
    *for_programs("value", "s", "unit"),
)


def _unknowns(found: Covariance) -> Table:
    rows = []
    for k, one in enumerate(found.names):
        angle = one.unit == "rad"
        factor = _DEGREES if angle else 1.0
        value, s = float(found.values[k]), float(found.deviations[k])
        form = ".6f" if angle else ".4f" if isinstance(one, CoordinateName) else ".6g"
        rows.append(
            (
                k + 1,
                one.kind,
                one.owner,
                one.unknown,
                (value * factor, form),
                None if s != s else s * factor,
                "deg" if angle else one.unit,
                value,
                s,
                one.unit,
            )
        )
    return table("covariance", _UNKNOWNS, rows)


_PAIRED = for_programs("first", "second", "covariance", "correlation")


def _matrix(found: Covariance) -> Table:
    """Return one row for every two unknowns, each with itself too."""

    def rows() -> Iterator[tuple[Any, ...]]:
        texts = [one.text for one in found.names]
        matrix, rho = found.matrix, found.correlations
        for i in range(len(texts)):
            for j in range(i, len(texts)):
                yield texts[i], texts[j], float(matrix[i, j]), float(rho[i, j])

    return table("covariance_matrix", _PAIRED, rows)


_ELLIPSE = (
    number("ellipse_a", "a", 4, 9, unit="m"),
    number("ellipse_b", "b", 4, 9, unit="m"),
    number("ellipse_direction", "dir", 1, 7, unit="rad", scale=_DEGREES),
)


def _cells(ellipse: Ellipse) -> tuple[float, ...]:
    return ellipse.a, ellipse.b, ellipse.direction


_PLACES = (
    name("kind", "PLACE", 5),
    name("name", gap=1),
    *(number(f"s{axis}", f"s{axis}", 4, 9, unit="m") for axis in "XYZ"),
    *_ELLIPSE,
)


def _places(found: Covariance) -> Table:
    rows = ((*one.place, *one.s, *_cells(one.ellipse)) for one in place_accuracies(found))
    return table("covariance_places", _PLACES, rows, units=">")


_PAIRS = (
    name("first_kind", "FROM", 5),
    name("first", gap=1),
    name("second_kind", "TO", 5),
    name("second", gap=1),
    *(Column(f"d{axis}", unit="m") for axis in "XYZ"),
    *(number(f"sd{axis}", f"sd{axis}", 4, 9, unit="m") for axis in "XYZ"),
    number("distance", "DISTANCE", 4, 13, unit="m"),
    number("s_distance", "s", 4, 9, unit="m"),
    *_ELLIPSE,
)


def _pairs(found: Covariance) -> Table:
    rows = (
        (*one.first, *one.second, *one.difference, *one.s, one.distance, one.s_distance,
         *_cells(one.ellipse))
        for one in pair_accuracies(found)
    )  # fmt: skip
    return table("covariance_pairs", _PAIRS, rows, units=">", most=30, more="    and {} more")


def covariance_document(asked: AskedCovariance) -> Document:
    """Return the document of a covariance.

    Units are m and rad, of additional parameters mm (c, x0, y0 of a lens, and the effects of other
    sets) or none, of drifts m/s or m/photo; people read angles in degrees. Ellipses are standard
    ones, directions from X towards Y.
    """
    found, test, gone, file = asked.covariance, asked.test, asked.gone, asked.file
    count = len(found.names)
    page: list[Block] = [
        say("COVARIANCE of {} with each other", counted(count, "unknown")).of("heading")
    ]
    if found.sigma is None:
        page.append(say("  no redundancy: test {} has no sigma0, and nothing a covariance", test))
    elif found.estimated:
        page.append(
            say("  with the estimated sigma0: factor {:.4f} of the a-priori one (test {})",
                found.sigma, test)
        )  # fmt: skip
    else:
        page.append(say("  with the a-priori sigma0, factor 1 (test {})", test))
    if found.datum != "control":
        page.append(
            say("  in the datum of {}: another datum has another covariance", DATUM[found.datum])
        )
    if gone:
        owners = dict.fromkeys(f"{one.kind} {one.owner}" for one in gone)
        page.append(
            say("  left out, for the cleaning leaves nothing of them: {}", named(owners, 12)).of(
                "remark"
            )
        )
    answer: dict[str, Any] = {
        "names": [one.text for one in found.names],
        "units": list(found.units),
        "values": found.values,
        "s": found.deviations,
        "factor": found.sigma,
        "sigma0": "estimated" if found.estimated else "a-priori",
        "datum": found.datum,
        "left_out": [one.text for one in gone],
        "file": None if file is None else str(file),
    }
    if file is not None:
        page.append(say("  written: names, units, x, covariance and factor of numpy.load"))
    if count > MOST_SHOWN:
        return Document(answer | {"matrix": None, "places": None, "pairs": None}, tuple(page), ())
    unknowns, matrix = _unknowns(found), _matrix(found)
    places, pairs = _places(found), _pairs(found)
    answer |= {
        "matrix": None if found.sigma is None else found.matrix,
        "places": places,
        "pairs": pairs,
    }
    page.append(unknowns)
    if any(one.kind == "parameter" for one in found.names):
        page.append(say("  values of parameters are corrections of what the cameras state"))
    if count <= _PRINTED and found.sigma is not None:
        page += [BLANK, say("  covariances, angles in rad").of("heading")]
        page += _lines(found.matrix.tolist(), _COVARIANCE)
        page += [BLANK, say("  correlations").of("heading")]
        page += _lines(found.correlations.tolist(), _CORRELATION)
    elif found.sigma is not None:
        page.append(say("  the matrix itself is in --json and in covariance_matrix.csv of --to"))
    if len(places):
        page += [BLANK, places]
    if len(pairs):
        page += [BLANK, pairs]
    if len(places):
        page.append(
            say(
                "  a, b, dir: standard ellipse in plan (39 %; 2.45 times as large: 95 %), "
                "of pairs that of the difference; dir from X towards Y [deg]"
            ).folded(2)
        )
    return Document(answer, tuple(page), (unknowns, matrix, places, pairs))


def _lines(values: list[list[float]], cell: str) -> Iterator[Line]:
    """Return a symmetric matrix, its unknowns by their numbers."""
    count = len(values)
    for start in range(0, count, _COLUMNS):
        some = range(start, min(start + _COLUMNS, count))
        if start:
            yield BLANK
        line = say("  {:>4}", "")
        for j in some:
            line += say(_NUMBER, j + 1)
        yield line
        for k, row in enumerate(values):
            line = say("  {:>4}", k + 1)
            for j in some:
                line += say(cell, None if row[j] != row[j] else row[j])
            yield line
