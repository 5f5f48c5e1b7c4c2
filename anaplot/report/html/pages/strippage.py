"""The report of `bridge`: what the models of every strip are worth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from anaplot.adjustment.tested import Observation
from anaplot.orientation.accuracy import model_accuracy
from anaplot.orientation.results import ModelSolution, Row
from anaplot.orientation.strip import pooled_sigma_um
from anaplot.report.bridgecommand import BridgedBlock
from anaplot.report.columns import counted
from anaplot.report.computed import Computed
from anaplot.report.document import Answer, Document, Line, named, say
from anaplot.report.figures.bridged import figures_of_models
from anaplot.report.html.parts import Captioned, HtmlBlock, Report, Section
from anaplot.report.html.sections.models import models_section

__all__ = ["strip_report"]

_FEW = 3  # of what is wrong; the sections have all


def strip_report(found: Computed[BridgedBlock], name: str, unit: str = "µm") -> Report:
    """Return the report of the strips of a block.

    Parameters
    ----------
    found
        What `bridge` has returned.
    name
        Of the block.
    unit
        Of lengths in its images, on the drawings.
    """
    answer = found.document.answer
    figure = figures_of_models(found.result, unit)
    sections = (models_section(answer, figure), _rejected(found.document), _said(answer))
    return Report(
        say("Strips of block {}", name),
        _verdict(found.result, answer),
        tuple(section for section in sections if section is not None),
    )


def _verdict(found: BridgedBlock, answer: Answer) -> tuple[Line, ...]:
    models = [model for strip in found.strips for model in strip.models]
    errors = [strip.error for strip in found.strips if strip.error is not None]
    told = [model for strip in answer["strips"] for model in strip["models"]]
    flagged = [(model, one) for model, one in zip(models, told, strict=True) if model.flagged]
    gone = [
        say("{} of {} in model {}", *row.name[::-1], one.solution.name)
        for strip in found.cleaned or ()
        for one in strip.models
        for row in one.rejected
    ]
    strange = _strange(answer)
    return (
        _sound(models, len(flagged), errors, len(gone), doubts=bool(strange)),
        _wrong(flagged, errors, strange, gone),
        _unchecked(models),
        _accuracy(models),
        _next(flagged, errors, strange, gone),
    )


def _strange(answer: Answer) -> list[Line]:
    """Return what numbering and photographs give to think of, of the rows that are left."""
    lines = [say("{}", one["text"]) for one in answer["photo_accidents"]]
    return lines + [say("model {}: {}", one["model"], one["text"]) for one in answer["accidents"]]


def _sound(
    models: list[ModelSolution], flagged: int, errors: list[str], gone: int, *, doubts: bool
) -> Line:
    if not models:
        return say("Sound: no: no model could be computed").of("look")
    rows = sum(len(model.table) for model in models)
    pooled = say("sigma0 of all models {:.2f||none} um, a priori {:g} um",
                 pooled_sigma_um(tuple(models)), models[0].apriori_um)  # fmt: skip
    if flagged or errors:
        ends = say(", and {}", counted(len(errors), "strip ends early", "strips end early"))
        return (
            say("Sound: no: {} of {} have flagged rows", flagged, counted(len(models), "model"))
            + (ends if errors else "")
            + "; "
            + pooled
        ).of("look")
    if all(model.test.critical is None for model in models):
        return say("Sound: nobody can tell: no model has the redundancy for a test")
    without = say(", without {}", counted(gone, "rejected row")) if gone else say("")
    none = say("no row of {} in {} is flagged", rows, counted(len(models), "model")) + without
    if doubts:
        told = say("Sound: with doubts: ") + none + "; but numbering or photos need a look; "
        return (told + pooled).of("remark")
    return say("Sound: yes: ") + none + "; " + pooled


def _wrong(
    flagged: list[tuple[ModelSolution, Answer]],
    errors: list[str],
    strange: list[Line],
    gone: list[Line],
) -> Line:
    lines = [say("{}", error) for error in errors]
    if gone:
        rows = counted(len(gone), "row was", "rows were")
        lines.append(say("{} rejected: {}", rows, named(gone, _FEW)))
    lines += [say("model {}: {}", model.name, _first(one)) for model, one in flagged]
    lines += strange
    if not lines:
        return say("Wrong: nothing shows in what is checked")
    more = named(lines, _FEW, "; and {} more below", separator="; ")
    return say("Wrong: {}", more).of("look")


def _first(model: Answer) -> str:
    """Return what to do first in a model."""
    return model["advice"][0] if model["advice"] else "rows are flagged"


def _unchecked(models: list[ModelSolution]) -> Line:
    bare = [model.name for model in models if model.redundancy == 0]
    rows: list[Observation[Row]] = [
        row for model in models for row in model.table if row.w is None and model.redundancy
    ]
    parts = []
    if bare:
        parts.append(say("all of {}: no redundancy", named(bare, _FEW)))
    if rows:
        parts.append(say("{} that nothing checks", counted(len(rows), "row")))
    parts.append(say("x of every model's last points, which only the next model checks"))
    return say("Unchecked: {}", named(parts, separator="; "))


def _accuracy(models: list[ModelSolution]) -> Line:
    spread = [model_accuracy(model).rms for model in models]
    known = [one for one in spread if np.isfinite(one).all()]
    if not known:
        return say("Accuracy: not known: sigma0 does not exist")
    worst = np.max(known, axis=0).tolist()
    return say(
        "Accuracy: points of a model have standard deviations of at most {:.4f} mm in X, {:.4f} in "
        "Y and {:.4f} in Z at photo scale (root mean squares of the worst models)",
        *worst,
    )


def _next(
    flagged: list[tuple[ModelSolution, Answer]],
    errors: list[str],
    strange: list[Line],
    gone: list[Line],
) -> Line:
    if errors:
        return say("Next: mend what ends the strip, and bridge again").of("look")
    if flagged:
        model, one = flagged[0]
        return say("Next: in model {}: {}", model.name, _first(one)).of("look")
    if gone:
        return say("Next: measure again what was rejected, and bridge anew").of("look")
    if strange:
        return say("Next: look at what stands under Wrong, and bridge anew").of("look")
    return say("Next: adjust the block (anaplot adjust), which checks what models cannot")


def _rejected(document: Document) -> Section | None:
    """Return what a strategy for gross errors took out, where one was asked for."""
    found = next((table for table in document.tables if table.key == "rejected"), None)
    if found is None:
        return None
    blocks: tuple[HtmlBlock, ...] = (say("Nothing is rejected."),)
    if len(found):
        blocks = (Captioned(found, say("Rows that were rejected, model by model")),)
    return Section("rejected", "Rejected rows", (*blocks, *_evidence(document.answer)))


def _evidence(answer: Answer) -> Iterator[HtmlBlock]:
    for strip in answer["strips"]:
        for model in strip["models"]:
            errors = model["errors"]
            for pair in errors["hard_to_tell"]:
                yield say(
                    "Model {}/{}: {} {} is rejected, {} {} is kept, hard to tell apart "
                    "(correlation {:.2f})",
                    model["left"],
                    model["right"],
                    *pair["rejected"],
                    *pair["kept"],
                    pair["correlation"],
                )


def _said(answer: Answer) -> Section | None:
    """Return what numbering and photos give to think of."""
    lines: list[Line] = [
        say("model {}: {}", one["model"], one["text"]).of("look") for one in answer["accidents"]
    ]
    lines += [say("{}", one["text"]).of("look") for one in _photos(answer)]
    if "differs_from_journal" in answer:
        lines.append(say("note: {}", answer["differs_from_journal"]["remark"]).of("remark"))
    return Section("accidents", "Numbering, photos, journal", tuple(lines)) if lines else None


def _photos(answer: Answer) -> Iterable[Answer]:
    found: Iterable[Answer] = answer["photo_accidents"]
    return found
