"""The models of every strip: an overview, and of each its table, orientation and correlations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import pi
from typing import Any, NamedTuple

from anaplot.drawing.drawing import Drawing
from anaplot.report.columns import counted
from anaplot.report.document import Answer, Table, name, named, number, say, table, whole
from anaplot.report.html.parts import Captioned, HtmlBlock, Section
from anaplot.report.modelcorrelations import orientation_correlations

__all__ = ["MOST_MODELS", "ModelFigure", "models_section"]

ModelFigure = Callable[[str, int], Drawing | None]
"""Draws a model, by its strip and which of its models it is (from 0)."""

MOST_MODELS = 60
"""Models that a page has one by one, flagged ones first; its overview has them all."""

_OPEN = 3  # models that are not folded
_DEGREES = 180.0 / pi

_OVERVIEW = (
    name("strip", "STRIP", 5),
    name("left", "LEFT", 4),
    name("right", "RIGHT", 5),
    number("sigma0_um", "sigma0 [um]", 2, 12, unit="um"),
    whole("redundancy", "redundancy", 11),
    whole("ties", "ties", 5),
    number("largest", "largest SIGF", 2, 13),
    name("at", "AT", 2),
    whole("flagged", "flagged", 8),
    whole("off", "off", 4),
    number("correlation", "largest correlation", 3, 20),
    name("of", "OF", 2),
    name("", "look", head="", look=bool),
)
_ORIENTATION = (
    name("what", "", 5),
    *(number(key, key, 4, 10, unit="mm") for key in ("bx", "by", "bz")),
    *(number(k, k, 5, 11, unit="rad", scale=_DEGREES) for k in ("omega", "phi", "kappa")),
)


class _Model(NamedTuple):
    """A model of the answer of `bridge`."""

    strip: str
    at: int
    answer: Answer
    rows: list[Answer]

    @property
    def flagged(self) -> int:
        return sum(bool(row["flagged"]) for row in self.rows)


def models_section(answer: Answer, figure: ModelFigure | None = None) -> Section | None:
    """Return the section of the models; None where there is no strip.

    Parameters
    ----------
    answer
        What `bridge --json` prints, its tables still tables.
    figure
        Draws a model; None: there are no drawings.
    """
    strips = answer["strips"]
    if not strips:
        return None
    models = [
        _Model(strip["strip"], k, one, one["table"].records())
        for strip in strips
        for k, one in enumerate(strip["models"])
    ]
    blocks: list[HtmlBlock] = [
        say("Bridging ends early: {}", strip["error"]).of("look")
        for strip in strips
        if "error" in strip
    ]
    if models:
        caption = say("{}: sigma0, largest SIGF, flagged rows", counted(len(models), "model"))
        blocks.append(Captioned(_overview(models), caption))
    # flagged ones first where not all are shown; on the page in the order of the strips
    first = sorted(range(len(models)), key=lambda k: (not models[k].flagged, k))[:MOST_MODELS]
    if len(first) < len(models):
        line = say(
            "{} of {} models are shown one by one, those with flagged rows first; "
            "`anaplot bridge` prints every one",
            len(first),
            len(models),
        )
        blocks.append(line.of("remark"))
    for number_, k in enumerate(sorted(first), 1):
        blocks.append(_model(models[k], number_, figure, folded=len(models) > _OPEN))
    return Section("models", "Models", tuple(blocks))


def _overview(models: Iterable[_Model]) -> Table:
    return table("models", _OVERVIEW, (_summary(model) for model in models))


def _summary(model: _Model) -> tuple[Any, ...]:
    one = model.answer
    tested = [row for row in model.rows if row["sigf"] is not None]
    largest = max(tested, key=lambda row: row["sigf"], default=None)
    first, second, rho = _strongest(one["accuracy"])
    return (
        model.strip,
        one["left"],
        one["right"],
        one["sigma0_um"],
        one["redundancy"],
        len(one["ties"]),
        None if largest is None else largest["sigf"],
        None if largest is None else f"{largest['point']} {largest['axis']}",
        model.flagged,
        sum(bool(row.get("off")) for row in model.rows),
        rho,
        f"{first} {second}",
        "look" if model.flagged else "",
    )


def _strongest(accuracy: Answer) -> tuple[str, str, float]:
    elements, rho = accuracy["elements"], accuracy["correlations"]
    pairs = ((i, j) for i in range(len(elements)) for j in range(i + 1, len(elements)))
    i, j = max(pairs, key=lambda pair: abs(rho[pair[0]][pair[1]]))
    return elements[i], elements[j], rho[i][j]


def _model(model: _Model, number_: int, figure: ModelFigure | None, *, folded: bool) -> Section:
    one = model.answer
    title = say("Strip {}, model {}/{}", model.strip, one["left"], one["right"])
    if model.flagged:
        title += say(": {} flagged", counted(model.flagged, "row"))
    blocks = [*_lines(one), *_tables(one)]
    drawn = None if figure is None else figure(model.strip, model.at)
    if drawn is not None:
        blocks.insert(1, drawn)
    return Section(f"model-{number_}", title, tuple(blocks), folded, "beside")


def _lines(one: Answer) -> Iterator[HtmlBlock]:
    accuracy = one["accuracy"]
    yield say(
        "sigma0 {sigma0_um:.2f|um|none}, redundancy {redundancy}; test {test[kind]}, alpha "
        "{test[alpha]:g}, critical value {test[critical]:.2f||none}",
        **one,
    )
    if one["ties"]:
        yield say("Ties: {}", named(one["ties"], 24)).folded()
    for sentence in one["advice"]:
        yield say("{}", sentence)
    yield say("Trace of Q_gg {:.2f}, lengths in bases", accuracy["trace_q_gg"])


def _tables(one: Answer) -> Iterator[HtmlBlock]:
    of = say("model {left}/{right}", **one)
    accuracy, angles = one["accuracy"], ("omega", "phi", "kappa")
    rows = [("value", *one["base"], *(one["rotation"][angle] for angle in angles))]
    if accuracy["sigma_um"] is not None:
        rows.append(("+-", *accuracy["base"], *(accuracy["rotation"][angle] for angle in angles)))
    orientation = table("orientation", _ORIENTATION, rows)
    yield Captioned(one["table"], say("Rows of ") + of)
    yield Captioned(orientation, say("Orientation of ") + of + say(", the left photo held"))
    related = orientation_correlations(accuracy["elements"], accuracy["correlations"])
    yield Captioned(related, say("Correlations of the orientation of ") + of)
