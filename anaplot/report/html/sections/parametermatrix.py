"""The correlations of additional parameters with each other, whole."""

from __future__ import annotations

from anaplot.drawing.drawing import Drawing
from anaplot.report.document import Answer, Column, Table, name, named, say
from anaplot.report.html.parts import Captioned, HtmlBlock, Section
from anaplot.textfiles.wording import plain

__all__ = ["MOST_PARAMETERS", "parameter_matrix_section"]

MOST_PARAMETERS = 40
"""Parameters whose correlations a page has whole."""


def parameter_matrix_section(answer: Answer, drawn: Drawing | None = None) -> Section | None:
    """Return the section of the correlations of additional parameters; None where there are none.

    Parameters
    ----------
    answer
        What `adjust --json` prints, its tables still tables.
    drawn
        Their matrix as a drawing; None: there is none.
    """
    additional = answer.get("additional")
    if additional is None or not len(additional["parameters"]):
        return None
    blocks: list[HtmlBlock] = []
    matrix = additional["matrix"]
    if matrix is None:
        blocks.append(say("Every photo has its own: correlations are told beyond 0.9 only."))
    elif len(matrix["rows"]) > MOST_PARAMETERS:
        blocks.append(
            say(
                "{} parameters: their correlations stand in `anaplot report --json`, key "
                "additional.matrix",
                len(matrix["rows"]),
            )
        )
    else:
        caption = say("Correlations of the additional parameters")
        blocks.append(Captioned(_table(matrix), caption))
    if drawn is not None:
        blocks.insert(0, drawn)
    pairs = additional["correlations"]
    if pairs:
        shown = [say("{first} with {second} {correlation:+.3f}", **pair) for pair in pairs]
        blocks.append(say("Beyond 0.9: {}", named(shown, 30, "; and {} more", separator="; ")))
    else:
        blocks.append(say("No two are correlated beyond 0.9, and none with an orientation."))
    return Section("parameter-correlations", "Correlations of additional parameters", tuple(blocks))


def _table(matrix: Answer) -> Table:
    groups = {row["group"] for row in matrix["rows"]}
    labels = [
        plain(row["name"] if len(groups) == 1 else f"{row['name']} of {row['group']}")
        for row in matrix["rows"]
    ]
    columns = (
        name("parameter", "", 9),
        *(Column(f"_{k}", label, 8, 3) for k, label in enumerate(labels)),
    )
    return Table("parameter_correlations", columns, (tuple(labels), *matrix["values"].T))
