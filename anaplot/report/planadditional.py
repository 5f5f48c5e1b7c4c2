"""`anaplot plan additional` and its call: what a set of additional parameters does."""

from __future__ import annotations

import argparse
from typing import Literal

from anaplot.aliases import Progress
from anaplot.bundle.solve.additional import ParameterSet, additional_parameters
from anaplot.bundle.solve.polynomialterms import EBNER, GRUEN50, LETTERS, PolynomialTerm
from anaplot.planning.additionaldesign import AdditionalDesign, additional_design
from anaplot.report.columns import counted
from anaplot.report.computed import Computed
from anaplot.report.document import BLANK, Answer, Block, Document, name, number, say, table
from anaplot.report.keywords import takes_options
from anaplot.report.planarguments import add_additional_arguments
from anaplot.report.running import run_computation

__all__ = ["planned_additional", "run_plan_additional"]

_GRIDS = {"3x3": 3, "5x5": 5}
_TERMS: dict[str, tuple[PolynomialTerm, ...]] = {"ebner": EBNER, "gruen": GRUEN50}


@takes_options(add_additional_arguments)
def planned_additional(
    additional: str,
    *,
    points: Literal["3x3", "5x5"] | None = None,
    reach: float = 100.0,
    c: float = 150.0,
    progress: Progress | None = None,
) -> Computed[AdditionalDesign]:
    """Show a set of additional parameters: its terms, and what they have in common.

    Parameters
    ----------
    additional
        As `adjust --additional` has it: "gruen", "ebner:b1,b2", "gruen50:-b12".
    points
        The grid; None: 3x3 for Ebner's set, 5x5 for the others.
    reach
        The grid goes from minus to plus this in x and y [mm].
    c
        Camera constant [mm].
    progress
        Called with what is being done and the fraction of it (0 to 1).

    Raises
    ------
    InputError
        No such set or parameter.
    """
    chosen = additional_parameters(additional).set
    side = _GRIDS[points or ("3x3" if chosen.name == "ebner" else "5x5")]
    if progress is not None:
        progress("grid", 0.0)
    found = additional_design(chosen, side, reach, c)
    return Computed(found, _document(chosen, found, reach, c))


def run_plan_additional(options: argparse.Namespace) -> int:
    """Show a set of additional parameters and return the exit code.

    Raises
    ------
    InputError
        No such set or parameter.
    """
    return run_computation(options, planned_additional, ())


_PARAMETERS = (
    name("name", "PARAM", 6, gap=2),
    name("dx", "dx", 11),
    name("dy", "dy", 11),
    number("rms_mm", "RMS mm", 3, 8),
    number("cosine", "with others", 3, 13),
    name("nearest", "", 6, gap=1),
    number("orientation", "with orientation", 3, 18),
)


def _document(chosen: ParameterSet, found: AdditionalDesign, reach: float, c: float) -> Document:
    family = "gruen" if chosen.name.startswith("gruen") else chosen.name
    terms = {term.name: term for term in _TERMS.get(family, ())}
    letters = LETTERS.get(family, {})
    rows = []
    for one in found.parameters:
        term = terms.get(one.name)
        dx, dy = (None, None) if term is None else (term.dx or "0", term.dy or "0")
        rows.append(
            (one.name, dx, dy, one.rms_mm, one.cosine, one.nearest or None, one.orientation)
        )
    parameters = table("parameters", _PARAMETERS, rows)
    count = len(found.parameters)
    possible = 2 * found.side**2
    answer: Answer = {
        "set": chosen.name,
        "count": count,
        "points": found.side**2,
        "letters": dict(letters),
        "largest_cosine": found.largest,
        "largest_with_orientation": found.largest_orientation,
        "rank": found.rank,
        "possible": possible,
        "parameters": parameters,
    }
    page: list[Block] = [
        say("ADDITIONAL PARAMETERS {}: {} of them on {} x {} points", chosen.name, count,
            found.side, found.side).of("heading"),
        say("points from -{:g} to {:g} mm in x and y, camera constant {:g} mm", reach, reach, c),
    ]  # fmt: skip
    if letters:
        page.append(say("in x and y divided by {:g} mm:", reach))
        page += [say("  {} = {}", letter, text) for letter, text in letters.items()]
    page += [BLANK, parameters, BLANK]
    if found.orthogonal:
        page.append(say("all are orthogonal to each other on these points"))
    else:
        page.append(
            say("not orthogonal on these points: cosines up to {:.3f}", found.largest).of("look")
        )
    if found.largest_orientation == 0.0:
        page.append(say("and to the exterior orientation of a vertical photo over flat ground"))
    else:
        page.append(
            say("what an exterior orientation does over flat ground they do too, up to {:.3f}",
                found.largest_orientation).of("look")
        )  # fmt: skip
    page.append(
        say("with the orientation's 6 they span {} of the {} that {} can show", found.rank,
            possible, counted(found.side**2, "point"))
    )  # fmt: skip
    return Document(answer, tuple(page), (parameters,))
