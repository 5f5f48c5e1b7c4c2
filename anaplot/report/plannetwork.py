"""`anaplot plan network` and its call: camera stations around an object, and what they see."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Progress
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Datum
from anaplot.bundle.solve.rulesofthumb import rules_of_thumb
from anaplot.errors import InputError
from anaplot.exchange.networkfile import NetworkFile, read_network
from anaplot.photogrammetry.block import ControlPoint
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.expectedtests import expected_tests
from anaplot.planning.idealblock import ExposureStation, IdealBlock
from anaplot.planning.networkplan import (
    Network,
    NetworkReliability,
    cube,
    looking_at,
    network_reliability,
    plan_network,
)
from anaplot.planning.plannedreliability import PlannedReliability
from anaplot.report.columns import PAGE, counted, fitted, shortened
from anaplot.report.computed import Computed
from anaplot.report.correlations import correlated_rays, correlations_document
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Document,
    Line,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    stacked,
    table,
    whole,
)
from anaplot.report.expectedtests import with_expected_tests
from anaplot.report.keywords import names_in, takes_options
from anaplot.report.planarguments import add_network_arguments
from anaplot.report.planting import planted_errors
from anaplot.report.rules import rules_json, rules_lines
from anaplot.textfiles.wording import quoted

__all__ = [
    "PlannedNetwork",
    "network_files",
    "network_from_file",
    "plan_network_document",
    "planned_network",
]

_CUBE = "cube"
_XYZ = ("X", "Y", "Z")
_FEW = 3  # with two rays one coordinate of each is checked by nothing, or next to nothing
_SHOWN, _NAMED = 12, 20
_NAME = 10  # characters
_CORRELATED = 24  # pairs that are shown


_SPURS = (name("photo", "PHOTO", 5), name("point", "POINT", 5), name("axis"))


class PlannedNetwork(NamedTuple):
    """A network that is planned.

    Attributes
    ----------
    network
        What was asked for.
    made
        Its block with image coordinates free of error, and the truth behind it.
    block
        The evaluation of that.
    reliability
        What the stations see and determine.
    """

    network: Network
    made: IdealBlock
    block: AdjustedBlock
    reliability: NetworkReliability


def network_files(network: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the file that a network is read from; the cube is in none."""
    return () if network == _CUBE else (Path(network),)


@takes_options(add_network_arguments)
def planned_network(
    network: str | os.PathLike[str],
    *,
    case: str | Sequence[str] | None = None,
    image_um: float | None = None,
    correlations: float = 0.9,
    point: str | None = None,
    plant: str | Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Computed[PlannedNetwork]:
    """Plan camera stations around an object: what they see, check and determine.

    Parameters
    ----------
    network
        "cube", that of Gruen (1978), or a file of stations and points.
    case
        Stations of the cube, "A" to "E"; None: A. Of several `networks` puts them side by side.
    image_um
        A-priori sigma0 of the cube [um]; None: 5.
    correlations
        Correlation of a point's residuals from which it is named.
    point
        Tell all correlations of this point.
    plant
        Errors "PHOTO:POINT:AXIS:UM" in image coordinates, of which it is told what the tests would
        say on average.
    progress
        Called with what is being done and the fraction of it (0 to 1).

    Raises
    ------
    InputError
        The network's name or file is wrong.
    NotComputableError
        The stations do not determine the points.
    """
    versions = () if case is None else names_in(case)
    if len(versions) > 1:
        raise InputError("--case: one version for one network")
    asked = _network(os.fspath(network), versions[0] if versions else None, image_um)
    if point is not None and point not in asked.points:
        raise InputError(f"no point {quoted(point)} is seen in this network")
    if progress is not None:
        progress("network", 0.0)
    made = plan_network(asked)
    datum: Datum = "control" if asked.control else "free"
    block = made.evaluated(datum)
    if point is not None and point not in block.problem.points:
        raise InputError(f"point {quoted(point)} is not determined in this network")
    found = network_reliability(asked, made, block)
    document = plan_network_document(asked, block, found, limit=correlations, point=point)
    if plant is not None:
        told = expected_tests(made, block, planted_errors(plant), datum)
        document = with_expected_tests(document, told)
    return Computed(PlannedNetwork(asked, made, block, found), document)


def _network(name: str, case: str | None, image_um: float | None) -> Network:
    if name == _CUBE:
        return cube(case or "A", image_um or 5.0)
    path = Path(name)
    if path.suffix.lower() != ".toml" and not os.path.lexists(path):
        raise InputError(f"no network is called {quoted(name)}: cube, or a .toml file")
    if case is not None:
        raise InputError("--case goes with the cube")
    if image_um is not None:
        raise InputError("--image-um goes with the cube; a file says itself what it measures with")
    return network_from_file(read_network(path))


def network_from_file(found: NetworkFile) -> Network:
    """Return the network that a file declares."""
    stations = {}
    for entry in found.stations:
        if entry.rotation is not None:
            rotation = rotation_matrix(*entry.rotation)
        else:
            assert entry.look_at is not None
            rotation = looking_at(entry.position, entry.look_at, entry.roll)
        stations[entry.id] = ExposureStation(np.array(entry.position), rotation, entry.camera)
    return Network(
        found.name,
        found.cameras,
        stations,
        {point.id: np.array(point.position) for point in found.points},
        tuple(
            ControlPoint(point.id, point.position, (point.control,) * 3)
            for point in found.points
            if point.control is not None
        ),
        {point.id: np.array(point.normal) for point in found.points if point.normal is not None},
        found.incidence_deg,
        found.image_um,
    )


def plan_network_document(
    network: Network,
    block: AdjustedBlock,
    found: NetworkReliability,
    *,
    limit: float = 0.9,
    point: str | None = None,
) -> Document:
    """Return the document of a planned network; people read accuracies in millimetres.

    Parameters
    ----------
    network
        The network.
    block
        Its block, evaluated.
    found
        What it determines, and what checks it.
    limit
        Correlation of a point's residuals from which they are named.
    point
        A determined point all of whose correlations are wanted.
    """
    problem, indicators = block.problem, block.indicators()._asdict()
    rules, overall = rules_of_thumb(block), block.global_test()
    photos = _reliability("photos", found.photos, "PHOTO", "POINT", ())
    points = _reliability("points", found.points, "POINT", "PHOTO", ("sX", "sY", "sZ"))
    spurs = table("spurs", _SPURS, block.spurs())
    related = correlations_document(
        correlated_rays(block, limit), limit, most=_CORRELATED, more="  and {} more"
    )
    answer: Answer = {
        "name": network.name,
        "observations": problem.observations,
        "unknowns": problem.unknowns,
        "redundancy": block.redundancy,
        "indicators": indicators,
        "rules": rules_json(rules),
        "global_test": None if overall is None else overall._asdict(),
        "new_points": {
            "determined": found.new_determined,
            "mean_s_m": found.new_s,
            "not_determined": found.not_determined,
        },
        "unused_photos": found.unused_photos,
        "unused_control": found.unused_control,
        "points": [_reliability_json(one) for one in found.points],
        "photos": [_reliability_json(one) for one in found.photos],
        "rays": found.rays,
        "spurs": spurs,
        "correlations": related.answer,
    }
    declared = counted(len(network.stations), "station"), counted(len(network.points), "point")
    page: list[Block] = [
        say("PLANNED NETWORK {:.60}: {}", network.name,
            named((*declared, say("{} of them control", len(network.control))))).folded(4)
        .of("heading"),
        say("n {observations}, u {unknowns}, redundancy {redundancy}; a-priori sigma0 {um:g} um",
            um=network.image_um, **answer),
        say("RI (mean r)         x' {ri_x:.3f}   y' {ri_y:.3f}   both {ri:.3f}", **indicators),
        say("AI (mean deviation)  {}",
            _means([indicators[axis] for axis in ("ai_x", "ai_y", "ai_z", "ai")])),
    ]  # fmt: skip
    if network.control:
        new = f"new points ({found.new_determined})"
        page.append(say("  {:<17}  {}", new, _means(found.new_s)))
    else:
        page.append(say("no control: a free network"))
    page += rules_lines(rules)
    if overall is not None:
        page.append(
            say("global test, as powerful as the single one ({power:g}): "
                "alpha {alpha:.3f}, limit {critical:.3f}", **overall._asdict()).folded(2)
        )  # fmt: skip
    page += [
        *_open(found),
        BLANK,
        say("PHOTOS, the one with the weakest observation first").of("heading"),
        photos,
        BLANK,
        say("POINTS, the one with the weakest observation first").of("heading"),
        points,
        *_few(network, found),
    ]
    if len(spurs):
        names = [say("{point} {axis} in {photo}", **spur) for spur in spurs.records()]
        page += [
            BLANK,
            say("SPUR OBSERVATIONS: next to nothing checks these {}", len(spurs)).of("look"),
            _several("  {}", names),
        ]
    page += [BLANK, *related.page]
    if point is not None:
        answer["point"], matrix = _correlations(block, point)
        page += [BLANK, *matrix]
    parts = ((("point",), points), (("photo",), photos))
    both = stacked("reliability", for_programs("kind"), points.columns, parts)
    return Document(answer, tuple(page), (both, spurs, *related.tables))


def _reliability(
    key: str,
    found: tuple[PlannedReliability, ...],
    title: str,
    other: str,
    deviations: tuple[str, ...],
) -> Table:
    columns = (
        name("name", title, _NAME, form=_short),
        whole("rays", "RAYS", 5),
        number("mean_r", "mean r", 3, 7),
        number("least_r", "least", 3, 7),
        name("weakest", f"AT {other}", _NAME, form=_short),
        name("axis", gap=1),
        number("mdb_um", "MDB um", 1, 9, unit="um"),
        *(number(f"s{axis}", f"s{axis} mm", 3, 8, unit="m", scale=1e3) for axis in _XYZ),
    )
    rows = ((*one[:7], *(one.s_xyz or (None, None, None))) for one in found)
    shown = tuple(column.key for column in columns[:7])
    return table(key, columns, rows, shown=shown + deviations, most=_SHOWN, more="  and {} more")


def _short(text: str) -> str:
    return shortened(text, _NAME)


def _reliability_json(found: PlannedReliability) -> Answer:
    figures = found._asdict()
    figures["s_m"] = figures.pop("s_xyz")
    return figures


def _means(metres: Sequence[float] | None) -> Line:
    if metres is None:
        return say("-")
    return say("X {}   Y {}   Z {}   all {} mm", *(fitted(1e3 * v, 3, 8) for v in metres))


def _several(template: str, names: Iterable[str | Line]) -> Line:
    return say(template, named(names, _NAMED, "and {} more")).folded(4)


def _open(found: NetworkReliability) -> list[Line]:
    """Return what the network leaves open."""
    lines = []
    if found.not_determined:
        names = [say("{} ({})", p, _photos(found.rays[p])) for p in found.not_determined]
        lines += [
            say("NOT DETERMINED: {}", counted(len(names), "new point")).of("look"),
            _several("  {}", names),
        ]
    if found.unused_photos:
        line = _several("STATIONS WITHOUT USABLE RAYS: {}", found.unused_photos)
        lines.append(line.of("look"))
    if found.unused_control:
        line = _several("CONTROL WITHOUT USABLE RAYS: {}", found.unused_control)
        lines.append(line.of("look"))
    return [BLANK, *lines] if lines else []


def _few(network: Network, found: NetworkReliability) -> list[Line]:
    """Return which of the determined new points are seen in few photos."""
    apart = {row.point for row in network.control} | set(found.not_determined)
    seen = {point: rays for point, rays in found.rays.items() if point not in apart}
    lines = []
    for count in range(_FEW):
        names = [point for point, rays in seen.items() if rays == count]
        if names:
            lines.append(_several(f"  {_photos(count)}: {{}}", names))
    if lines:
        return [BLANK, say("SEEN IN FEWER THAN {} PHOTOS", _FEW).of("look"), *lines]
    which = "every other" if found.not_determined else "every"
    line = say("{} new point is seen in {} photos or more", which, _FEW)
    return [BLANK, line] if seen else []


def _photos(count: int) -> str:
    return "1 photo" if count == 1 else f"{count or 'no'} photos"


def _correlations(block: AdjustedBlock, point: str) -> tuple[Answer, list[Block]]:
    """Return the correlations of a point's residuals, as many columns at a time as fit."""
    labels, rho = block.point_correlations(point)
    answer = {
        "point": point,
        "coordinates": [{"photo": photo, "axis": axis} for photo, _, axis in labels],
        "correlations": rho,
    }
    what = ("correlations of its residuals", "and what is detectable")
    head = say("POINT {:.40}: {}", point, named(what)).folded(4)
    titles = [f"{_short(photo)} {axis}" for photo, _, axis in labels]
    width = max(7, *(len(title) + 1 for title in titles))
    mdb = {
        (row.photo, one.axis): one.mdb
        for row in block.ray_rows()
        if row.point == point
        for one in row.xy
    }
    found = [
        *zip((number("", title, 3, width) for title in titles), rho.T, strict=True),
        (number("", "MDB um", 1, 9), [mdb[photo, axis] for photo, _, axis in labels]),
    ]
    at_once = (PAGE - 2 - width - 9) // width
    tables = []
    for first in range(0, len(titles), at_once):
        last = first + at_once >= len(titles)
        columns = found[first : None if last else first + at_once]
        declared, values = zip((name("", "", width), titles), *columns, strict=True)
        tables.append(Table("correlations_of_point", declared, values))
    return answer, [head.of("heading"), *tables]
