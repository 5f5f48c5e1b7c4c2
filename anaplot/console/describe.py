"""What is known of a row, and of a model, in words: pairs of label and value."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from anaplot.adjustment.tested import AppliedTest, Observation
from anaplot.console.blockline import block_line
from anaplot.console.inwork import in_work
from anaplot.console.rows import ShownRow
from anaplot.orientation.results import ModelSolution, Row
from anaplot.photogrammetry.platetransformation import TITLES
from anaplot.station.snapshot import InnerView, Snapshot

if TYPE_CHECKING:
    from anaplot.orientation.accuracy import ModelAccuracy

__all__ = ["Entry", "advice_of", "describe_model", "describe_row", "describe_test"]

Entry = tuple[str, str]


def _um(value: float | None, decimals: int = 1) -> str:
    return "–" if value is None else f"{value:.{decimals}f} µm"


def describe_test(test: AppliedTest) -> str:
    """Return a test with its critical value, or that there is none."""
    critical = "no critical value" if test.critical is None else f"critical {test.critical:.2f}"
    return f"{test.kind} {test.alpha:g}, {critical}"


def _name(key: tuple[str, str]) -> str:
    return f"{key[0]} {key[1]}"


def _odds(ratio: float) -> str:
    if not math.isfinite(ratio) or ratio >= 1e6:
        return "over a million to 1"
    if ratio >= 1.0:
        return f"{ratio:.0f} to 1" if ratio >= 10.0 else f"{ratio:.1f} to 1"
    if ratio <= 1e-6:
        return "1 to over a million"
    return f"1 to {1.0 / ratio:.0f}" if ratio <= 0.1 else f"1 to {1.0 / ratio:.1f}"


def _chances(
    mine: Observation[Row], rows: tuple[Observation[Row], ...], none: float
) -> list[Entry]:
    entries = [("holds the error", f"probability {100.0 * mine.probability:.1f} %")]
    others = [row for row in rows if row.key != mine.key and row.probability > 0.0]
    rival = max(others, key=lambda row: row.probability, default=None)
    if rival is not None:
        odds = _odds(mine.probability / rival.probability)
        entries.append(("", f"{odds} over {rival.point} {rival.axis}"))
    if none > 0.0:
        entries.append(("", f"{_odds(mine.probability / none)} over no error"))
    return entries


def _relations(key: tuple[str, str], snapshot: Snapshot) -> list[Entry]:
    if snapshot.inner is not None and snapshot.inner.solution is not None:
        alike = [
            f"{_name(p.second if p.first == key else p.first)} ({p.correlation:+.2f})"
            for p in snapshot.inner.solution.partners
            if key in (p.first, p.second)
        ]
        return [("hard to tell from", ", ".join(alike))] if alike else []
    if snapshot.diagnosis is None:
        return []
    alike = [
        f"{_name(p.second if p.first == key else p.first)} ({p.correlation:+.2f})"
        for p in snapshot.diagnosis.partners
        if key in (p.first, p.second)
    ]
    transfers = snapshot.diagnosis.transfers
    shows = [_name(t.target) for t in transfers if t.source == key and t.critical]
    nearly = [
        f"{_name(t.target)} ({t.share:.2f})"
        for t in transfers
        if t.source == key and not t.critical
    ]
    comes = [_name(t.source) for t in transfers if t.target == key]
    return [
        (label, ", ".join(names))
        for label, names in (
            ("hard to tell from", alike),
            ("shows as large in", shows),
            ("nearly as large in", nearly),
            ("may come from", comes),
        )
        if names
    ]


def describe_row(shown: ShownRow, snapshot: Snapshot) -> list[Entry]:
    """Return everything known of a row."""
    work = in_work(snapshot)
    view = next((v for v in work.points if v.point == shown.point), None)
    role = "" if view is None else f", {'tie' if view.role == 'tie' else 'new point'}"
    if view is not None and view.mark:
        role += ", control point" if view.mark == "control" else ", lateral tie"
    if snapshot.inner is not None:
        role = f", fiducial of photo {snapshot.inner.photo}"
    entries: list[Entry] = [("row", f"{shown.point} {shown.axis}{role}")]
    if view is not None and view.offered:
        place = "marked" if view.sigma is None else f"expected within {1e3 * view.sigma:.0f} µm"
        entries.append(("offered", f"{place}; the model is complete without it"))
    if view is not None:
        times = {0: "not yet", 1: "once", 2: "twice"}.get(view.times, f"{view.times} times")
        if len(view.seen) == 1:
            times = f"only in the {view.seen[0]} photo"
        entries.append(("measured", times))
        if view.off_axes or view.status == "off":
            entries.append(("switched off", ", ".join(view.off_axes) or "the whole point"))
    row = shown.row
    if row is None:
        if shown.off_um is not None:
            entries.append(("PARX", _um(shown.off_um)))
        entries.append(("verdict", shown.verdict))
    else:
        entries += [
            ("RED-N", f"{row.r:.3f}"),
            ("PARX" if snapshot.inner is None else "RESID", _um(row.residual)),
            ("EXPD", _um(row.expected)),
            ("SIGF", "–" if row.size is None else f"{row.size:.2f}"),
            ("verdict", shown.verdict),
            ("finds errors from", _um(row.mdb)),
            *_chances(row, work.table, work.none),
        ]
    entries += _relations(shown.key, snapshot)
    if snapshot.solution is not None:
        for point in snapshot.solution.points:
            if point.point == shown.point:
                entries.append(("model X Y Z", f"{point.X:.3f} {point.Y:.3f} {point.Z:.3f} mm"))
    return entries


def advice_of(snapshot: Snapshot) -> list[str]:
    """Return the sentences for the operator, the most useful first."""
    sentences = _of_model(snapshot)
    block = block_line(snapshot)
    if block:
        # the model has the first word, and the block's is not the one for which there is no room
        sentences.insert(1, block)
    known = [accident.text for accident in snapshot.accidents]
    if snapshot.hint:
        known.append(snapshot.hint)
    # a number that is wrong comes before parallaxes that may follow from it
    first = sum(accident.certain for accident in snapshot.accidents)
    return [*known[:first], *sentences, *known[first:]]


def _of_model(snapshot: Snapshot) -> list[str]:
    sentences = [snapshot.problem] if snapshot.problem else []
    if snapshot.inner is not None:
        return [*sentences, *snapshot.inner.advice]
    if snapshot.diagnosis is not None:
        sentences += snapshot.diagnosis.advice
    if snapshot.solution is not None:
        sentences += snapshot.solution.remarks
    return list(dict.fromkeys(sentences))  # the advice begins with the remarks


def _orientation(solution: ModelSolution) -> list[Entry]:
    base = ", ".join(
        f"{name} {value:.4f}" for name, value in zip(("bx", "by", "bz"), solution.base, strict=True)
    )
    rotation = ", ".join(
        f"{name} {math.degrees(value):.5f}"
        for name, value in zip(("omega", "phi", "kappa"), solution.rotation, strict=True)
    )
    from anaplot.orientation.accuracy import model_accuracy  # loaded with the page

    accuracy = model_accuracy(solution)
    return [
        ("base", f"{base} mm"),
        *_deviations(accuracy, ("bx", "by", "bz"), 1.0, 4, "mm"),
        ("rotation", f"{rotation} deg"),
        *_deviations(accuracy, ("omega", "phi", "kappa"), math.degrees(1.0), 5, "deg"),
        ("", "of the right photo in the strip system"),
        ("correlation", "{} with {} {:+.3f}".format(*accuracy.strongest)),
        *_points(accuracy),
        ("trace Q_gg", f"{accuracy.trace:.2f}, lengths in bases"),
        ("sigma0", f"{_um(solution.sigma0_um, 2)}, a priori {_um(solution.apriori_um, 2)}"),
        ("redundancy", str(solution.redundancy)),
        ("iterations", str(solution.iterations)),
        ("condition", f"{solution.condition:.3g}"),
        ("test", describe_test(solution.test)),
        ("tie variance", solution.tie_variance),
        ("ties", ", ".join(solution.ties) or "none: first model"),
        ("flagged", ", ".join(_name(row.key) for row in solution.flagged) or "nothing"),
    ]


def _deviations(
    accuracy: ModelAccuracy, elements: tuple[str, ...], factor: float, digits: int, unit: str
) -> list[Entry]:
    values = {element: accuracy.of(element) for element in elements}
    if accuracy.sigma_um is None:
        return []
    named = ", ".join(
        f"{element} held" if value is None else f"{element} {factor * value:.{digits}f}"
        for element, value in values.items()
    )
    return [("  +-", f"{named} {unit}")]


def _points(accuracy: ModelAccuracy) -> list[Entry]:
    if accuracy.sigma_um is None:
        return []
    x, y, z = accuracy.rms.tolist()
    return [("points +-", f"X {x:.4f}, Y {y:.4f}, Z {z:.4f} mm, root mean square")]


def _inner(view: InnerView) -> list[Entry]:
    name = f"{view.side} photo"
    inner = view.solution
    if inner is None:
        return [(name, f"{view.photo}: inner orientation not determined yet")]
    place = inner.placement
    shrunk_x, shrunk_y = place.shrinkage_ppm
    state = "accepted" if view.accepted else "not accepted yet"
    return [
        (name, f"{view.photo}: {TITLES[inner.kind]}, {state}"),
        (
            "",
            f"sigma0 {_um(inner.sigma0_um, 2)}, a priori {_um(inner.apriori_um, 2)}, "
            f"redundancy {inner.redundancy}",
        ),
        (
            "",
            f"centre x {place.x:.3f} y {place.y:.3f} mm on the plate, rotation "
            f"{math.degrees(place.rotation):.4f} deg",
        ),
        ("", f"film shrinkage x {shrunk_x:.0f} y {shrunk_y:.0f} ppm"),
    ]


def describe_model(snapshot: Snapshot) -> list[Entry]:
    """Return the model's orientation, or why there is none."""
    if not snapshot.left:
        return [("model", "none is chosen yet")]
    entries: list[Entry] = [
        (
            "model",
            f"{snapshot.left} / {snapshot.right}, {snapshot.model_number} of "
            f"{snapshot.model_count} in strip {snapshot.strip}",
        )
    ]
    for inner in snapshot.inners:
        entries += _inner(inner)
    if snapshot.inner is not None:
        for i, sentence in enumerate(advice_of(snapshot)):
            entries.append(("advice" if i == 0 else "", sentence))
        return entries
    if snapshot.solution is None:
        entries.append(("orientation", snapshot.problem or "not determined yet"))
        return entries
    entries += _orientation(snapshot.solution)
    for i, sentence in enumerate(advice_of(snapshot)):
        entries.append(("advice" if i == 0 else "", sentence))
    return entries
