"""Control and check points in plan and height, with their tests."""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.report.document import Answer, Line, Table, say
from anaplot.report.html.parts import Captioned, HtmlBlock, Section
from anaplot.report.verdicts import probability

__all__ = ["given_points_section"]

_AXES = {
    "XYZ": "All check coordinates",
    "XY": "Check points in plan",
    "X": "Check coordinates X",
    "Y": "Check coordinates Y",
    "Z": "Check points in height",
}


def given_points_section(answer: Answer) -> Section | None:
    """Return the section of control and check points; None where there are none.

    Parameters
    ----------
    answer
        What `adjust --json` prints, its tables still tables.
    """
    tests = answer["hypotheses"]
    points: Table = tests["plan_and_height"]
    if not len(points):
        return None
    blocks: list[HtmlBlock] = [
        say(
            "What the photographs make of given points, minus what is given, in m: of plans the "
            "length, of heights the difference. Of control it is what they make of it without the "
            "tested part. s belongs to the a-priori sigma0, P to the family of all plans and "
            "heights at alpha {:g}.",
            tests["alpha"],
        ),
        Captioned(points, say("Control and check points in plan and height")),
    ]
    if tests["check"] is not None:
        if tests["check"]["sigma_factor"] != 1.0:
            blocks.append(
                say(
                    "Of check points s has {:.3g} times the standard deviation that is stated, as "
                    "control has it, whose variance was estimated.",
                    tests["check"]["sigma_factor"],
                )
            )
        blocks += _groups(tests["check"]["groups"])
    return Section("given-points", "Control and check points in plan and height", tuple(blocks))


def _groups(groups: Iterable[Answer]) -> list[Line]:
    lines = []
    for group in groups:
        test = group["verdict"]["known"]
        if (
            group["verdict"]["estimated"] is not None
            and group["verdict"]["rejected"] == (group["verdict"]["estimated"]["rejected"])
        ):
            test = group["verdict"]["estimated"]
        line = say(
            "{} ({}): rms {:.4f} m, expected {:.4f} m, P {}",
            _AXES[group["axes"]],
            group["coordinates"],
            group["rms"],
            group["expected"],
            probability(test["significance"]),
        )
        lines.append((line + ": rejected").of("look") if group["verdict"]["rejected"] else line)
    return lines
