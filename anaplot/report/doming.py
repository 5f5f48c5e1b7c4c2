"""The verdict on bent heights as a part of a block's document."""

from __future__ import annotations

from math import sqrt

from anaplot.bundle.hypotheses.doming import LEAST_HEIGHTS, Doming, HeightDifferences, doming
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.planning.domingflights import MOST_RAYS, DomingFlight, doming_flights
from anaplot.report.columns import counted
from anaplot.report.document import Block, Document, Line, name, named, number, say, table

__all__ = ["doming_document"]

_MATTERS = 1.0  # bend by the calibration over the standard deviation of control
_HELPS = 0.7  # of the bend that a flight leaves, at most, to be called a help
_SHOWN = 4

_SAID = {
    "as it is": "the block as it is",
    "across": "turned by 90 degrees (across)",
    "higher": "from 1.4 times the distance",
    "oblique": "oblique, leant by 30 degrees",
    "control in the middle": "a control point in the middle",
}


def doming_document(block: AdjustedBlock) -> Document | None:
    """Return the document of what the calibration does to heights; None where it is not asked."""
    found = doming(block)
    if found is None or block.sigma is None:
        return None
    flights = doming_flights(found, block.sigma) if _matters(found) else ()
    page: list[Block] = [say("DOMING: what the calibration does to heights").of("heading")]
    page += _freed(found) if found.held else _free(found)
    for one in found.differences:
        page += _difference(one)
    page += _flights(found, flights)
    columns = (
        name("flight", "FLIGHT", 30, form=lambda kind: _SAID[kind]),
        number("bend", "bend [m]", 4, 10, unit="m"),
        *(number(f"s_{k}", f"s {text}", 6, 12) for k, text in enumerate(_labels(found)[:_SHOWN])),
    )
    cells = [(one.kind, one.bend, *one.s[:_SHOWN]) for one in flights]
    flown = table("doming", columns, cells)
    if flights:
        page.append(flown)
    return Document(_json(found, flights), tuple(page), (flown,) if flights else ())


def _matters(found: Doming) -> bool:
    """Whether the calibration does more to heights than what is known of them."""
    if found.held:
        return any(one.bent for one in found.differences)
    rest = sqrt(max(found.bend**2 - found.calibration**2, 0.0))
    return found.calibration > _MATTERS * (rest if found.control_s is None else found.control_s)


def _labels(found: Doming) -> list[str]:
    several = len({group for group, _ in found.names}) > 1
    return [f"{one} of {group}" if several else one for group, one in found.names]


def _free(found: Doming) -> list[Line]:
    rest = sqrt(max(found.bend**2 - found.calibration**2, 0.0))
    lines = [
        say(
            "  one standard deviation of the calibration bends heights by {:.4f} m, middle against "
            "edge ({:.0f} m),",
            found.calibration,
            found.radius,
        ),
        say("  everything else by {:.4f} m; it is {}", rest, _combination(found)),
    ]
    if found.control_s is not None:
        word = "more" if found.calibration > _MATTERS * found.control_s else "less"
        lines.append(
            say("  that is {} than the {:.4f} m of control heights", word, found.control_s)
        )
    return lines


def _combination(found: Doming) -> Line:
    parts = sorted(zip(found.worst, _labels(found), strict=True), key=lambda one: -abs(one[0]))
    terms = [say("{:+.2f} s of {}", size, label) for size, label in parts[:_SHOWN]]
    return say("{}", named(terms))


def _freed(found: Doming) -> list[Line]:
    changes = [
        say("{} of {} by {:+.6f} (s {:.6f})", one.name, one.camera, one.change, one.s)
        for one in found.freed[: 2 * _SHOWN]
    ]
    return [
        say("  the lens is held as stated; the photographs would change {}", named(changes)),
        say(
            "  and bend heights by {:+.4f} m (s {:.4f}), middle against edge ({:.0f} m)",
            found.bent_by,
            found.calibration,
            found.radius,
        ),
    ]


def _difference(one: HeightDifferences) -> list[Line]:
    lines = [
        say(
            "  {}: rms {:.4f} m, expected {:.4f}",
            counted(one.count, f"{one.use} height"),
            one.rms,
            one.expected,
        )
    ]
    if one.bend is not None:
        verdict = "more than is expected" if one.bent else "no more than is expected"
        lines[0] += say("; bent by {:+.4f} m (s {:.4f}): {}", *one.bend, verdict)
    elif one.count < LEAST_HEIGHTS:
        lines[0] += say("; a bend is told by {:d} heights at least", LEAST_HEIGHTS)
    else:
        lines[0] += "; they lie so that they tell no bend from a tilt"
    why = one.explained
    if why is None:
        return lines
    if why.name is None:
        lines.append(
            say(
                "    of what is expected the calibration makes {:.4f} m; what it leaves open "
                "explains all but {:.4f}",
                one.calibration,
                why.left,
            )
        )
        return lines
    lines.append(
        say(
            "    {} of {} changed by {:+.6f} (s {:.6f}) explains all but {:.4f} m of it; the "
            "photographs {}",
            why.name,
            why.camera,
            why.change,
            why.s,
            why.left,
            why.photographs,
        )
    )
    return lines


def _flights(found: Doming, flights: tuple[DomingFlight, ...]) -> list[Line]:
    if not flights:
        if len(found.problem.photo) > MOST_RAYS and _matters(found):
            return [say("  (no flights are computed for more than {} rays)", MOST_RAYS)]
        return []
    now, *others = flights
    if not others:
        return []
    best = others[0]
    photos = max((one.photos for one in others), key=len)
    point = next((one.point for one in others if one.point is not None), None)
    what = [say("taken once more: {}", named(list(photos), 12))] if photos else []
    if point is not None:
        what.append(say("control in the middle: {}", point))
    if best.bend > _HELPS * now.bend:
        advice = say("  none of these flights would tell the lens from the heights much better:")
    else:
        advice = say(
            "  what would tell them apart best: {}, {:.4f} m instead of {:.4f}",
            _SAID[best.kind],
            best.bend,
            now.bend,
        )
    return [advice, say("  {}", named(what, separator="; "))]


def _json(found: Doming, flights: tuple[DomingFlight, ...]) -> dict[str, object]:
    parameters = [
        {"group": group, "name": one, "share": share}
        for (group, one), share in zip(found.names, found.worst, strict=True)
    ]
    return {
        "held": found.held,
        "radius": found.radius,
        "bend": found.bend,
        "calibration": found.calibration,
        "parameters": parameters,
        "control": found.control_s,
        "freed": [one._asdict() for one in found.freed],
        "bent_by": found.bent_by,
        "differences": [
            {
                "use": one.use,
                "count": one.count,
                "rms": one.rms,
                "given": one.given,
                "expected": one.expected,
                "calibration": one.calibration,
                "bend": None if one.bend is None else one.bend._asdict(),
                "explained": None
                if one.explained is None
                else {**one.explained._asdict(), "photographs": one.explained.photographs},
            }
            for one in found.differences
        ],
        "flights": [
            {
                "kind": one.kind,
                "photos": list(one.photos),
                "point": one.point,
                "bend": one.bend,
                "s": list(one.s),
            }
            for one in flights
        ],
    }
