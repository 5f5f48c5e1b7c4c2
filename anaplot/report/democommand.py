"""The command `anaplot demo --auto`: each model before and after, and what became of mistakes."""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.platetransformation import TITLES
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Document,
    Line,
    Table,
    for_programs,
    say,
    table,
)
from anaplot.report.innerdocument import fiducial_table, photo_document
from anaplot.report.modeldocument import model_rows, stacked_rows
from anaplot.report.output import Output
from anaplot.simulation.automatic import InnerRecord, ModelRecord
from anaplot.simulation.demo import Demo, Outcome, run_demo
from anaplot.simulation.mistakes import Planted
from anaplot.simulation.stages import Handled, earliest_stage

__all__ = ["Keeping", "demo_block", "demo_document", "model_story", "run_demo_auto"]

_PLANTED = for_programs(*Planted._fields)
_STAGES = for_programs("model", "point", "photo", "axis", "kind", "earliest", "stage")
_OF_TABLE = for_programs("left", "right", "when")
_TITLES = {
    "planted": "planted",
    "found": "found",
    "repaired": "repaired by measuring again",
    "missed": "missed although detectable",
    "false_flags": "flagged without a mistake",
}


@contextlib.contextmanager
def demo_block(options: argparse.Namespace) -> Iterator[tuple[Demo, Path, Keeping]]:
    """Make the demonstration and its block folder, which goes afterwards unless it is to be kept.

    Keeping is called, at last, with whether an operator wants to have it.

    Raises
    ------
    InputError
        Options of `--auto` without it, or a folder or file that cannot be written.
    """
    only_auto = {"--json": options.json, "--all": options.all, "--csv": options.csv}
    for option, value in {**only_auto, "--to": options.tables}.items():
        if value and not options.auto:
            raise InputError(f"{option} goes with --auto")
    written = () if options.keep is None else block_files(options.keep)
    Output.of(options).check({"is written": written}, options.keep)
    demo = Demo.make(options.models, options.seed, fiducials=options.fiducials)
    with contextlib.ExitStack() as stack:
        keeping = Keeping(options.keep)
        folder = options.keep
        if folder is None:
            made = Path(tempfile.mkdtemp(prefix="anaplot-demo-"))
            stack.callback(keeping.clear, made)
            folder = made / "demo"
        demo.write(folder)
        yield demo, folder, keeping


class Keeping:
    """Whether the block of a demonstration is kept, and where.

    Parameters
    ----------
    folder
        Where it was asked to be from the beginning; None: it is deleted.

    Attributes
    ----------
    folder
        Where it is kept; None: it is deleted.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def keep(self, made: Path) -> None:
        """Keep a block that would be deleted: here, under a free name, or else where it is."""
        names = ("anaplot-demo", *(f"anaplot-demo-{k}" for k in range(2, 1000)))
        here = next((Path(name) for name in names if not os.path.lexists(name)), None)
        self.folder = made
        if here is not None:
            with contextlib.suppress(OSError):
                shutil.copytree(made, here)
                self.folder = here

    def clear(self, made: Path) -> None:
        """Delete the folder in which a block was made, unless the block is still kept in it."""
        if self.folder is None or self.folder.parent != made:
            shutil.rmtree(made, ignore_errors=True)


def run_demo_auto(demo: Demo, folder: Path, output: Output) -> int:
    """Have the simulated operator do the whole job and tell it, each model when it is accepted.

    Raises
    ------
    AnaplotError
        The job could not be finished.
    """

    def tell(record: ModelRecord) -> None:
        if not output.as_json:
            output.print(Document(None, model_story(record)))

    outcome = run_demo(demo, folder, on_accepted=tell)
    document = demo_document(demo.seed, outcome)
    output.write(document)
    told = sum(len(model_story(record)) for record in outcome.models)
    output.print(replace(document, page=document.page[told:]))
    return 0


def demo_document(seed: int, outcome: Outcome) -> Document:
    """Return the document of what became of the planted mistakes, model by model.

    Parameters
    ----------
    seed
        Of the demonstration.
    outcome
        What was planted, found, repaired, missed and flagged, and every table before and after.
    """
    entries = {key: _planted(key, getattr(outcome, key)) for key in _TITLES}
    stories = [block for record in outcome.models for block in model_story(record)]
    told = [line for key in _TITLES for line in _told(_TITLES[key], getattr(outcome, key))]
    models, stages = [_answer(record) for record in outcome.models], _stages(outcome)
    answer = {"seed": seed, **entries, "models": models, "stages": stages}
    parts = (
        ((record.left, record.right, when), model_rows(solution.listed))
        for record in outcome.models
        for when, solution in (("before", record.before), ("after", record.after))
        if solution is not None
    )
    return Document(
        answer,
        (*stories, say("MISTAKES PLANTED WITH SEED {}", seed).of("heading"), *told),
        (*entries.values(), stages, stacked_rows(_OF_TABLE, parts)),
    )


def _planted(key: str, entries: Iterable[Planted]) -> Table:
    return table(key, _PLANTED, entries)


def _stages(outcome: Outcome) -> Table:
    """Return of every mistake found the earliest stage that can show it, and where it was found."""
    rows = (
        (p.model, p.point, p.photo, p.axis, p.kind, earliest_stage(p), outcome.stages[p])
        for p in outcome.found
    )
    return table("stages", _STAGES, rows)


def _told(title: str, entries: tuple[Planted, ...]) -> list[Line]:
    return [
        say("  {}: {}", title, len(entries) or "none"),
        *(
            say("    {0.model}  {0.point:<8} {0.axis}  {0.size_um:9.1f} um  {0.kind}", p)
            + (say(" of photo {}", p.photo) if p.kind == "wrong fiducial" else "")
            + ("" if p.detectable or p.kind == "none" else _elsewhere(p))
            for p in entries
        ),
    ]


def _elsewhere(planted: Planted) -> Line:
    if planted.shows_in is None:
        return say("  (no model can show it)")
    return say("  (not detectable here, shows in {})", planted.shows_in)


def _answer(record: ModelRecord) -> Answer:
    answer: Answer = {
        "left": record.left,
        "right": record.right,
        "before": [] if record.before is None else model_rows(record.before.listed),
        "after": [] if record.after is None else model_rows(record.after.listed),
        "handled": _handled("point", (h for h in record.handled if not h.photo)),
    }
    if record.inners:
        answer["inner"] = [_inner_answer(inner, record) for inner in record.inners]
    return answer


def _handled(key: str, handled: Iterable[Handled]) -> list[Answer]:
    return [{key: h.point, "axis": h.axis, "action": h.action} for h in handled]


def _inner_answer(inner: InnerRecord, record: ModelRecord) -> Answer:
    """Return the inner orientation of a photo, before and after re-measurements."""
    states = {
        when: None if found is None else photo_document(inner.photo, found).answer
        for when, found in (("before", inner.before), ("after", inner.after))
    }
    handled = (h for h in record.handled if h.photo == inner.photo)
    return {
        "photo": inner.photo,
        "side": inner.side,
        **states,
        "handled": _handled("fiducial", handled),
    }


def model_story(record: ModelRecord) -> tuple[Block, ...]:
    """Return a model's tables before and after, what was done in between, and an empty line."""
    returned = ", returned to" if record.returned else ""
    page: list[Block] = [say("MODEL {}/{}{}", record.left, record.right, returned).of("heading")]
    for inner in record.inners:
        page += _inner_story(inner, [h for h in record.handled if h.photo == inner.photo])
    points = [h for h in record.handled if not h.photo]
    if record.before is not None:
        page += _state("pattern complete", record.before)
    page += _actions(points)
    if points and record.after is not None:
        page += _state("accepted", record.after)
    elif record.after is not None:
        page.append(say("  nothing flagged: accepted"))
    return (*page, BLANK)


def _state(what: str, model: ModelSolution) -> list[Block]:
    rows = model_rows(model.listed, diagnose(model).suspects)
    return [say("  {}, {}", what, _sigma0(model.sigma0_um)), rows]


def _inner_story(record: InnerRecord, handled: list[Handled]) -> list[Block]:
    """Return what happened in an inner orientation; its tables when something was wrong in it."""
    page: list[Block] = []
    title = say("  photo {} ({})", record.photo, record.side)
    if handled and record.before is not None:
        page += [
            say("{}: fiducials measured, {}", title, _sigma0(record.before.sigma0_um)),
            fiducial_table(record.before),
            *_actions(handled),
        ]
    if record.after is None:
        return page
    found, sigma0 = TITLES[record.after.kind], _sigma0(record.after.sigma0_um)
    page.append(say("{}: {} accepted, {}", title, found, sigma0))
    return [*page, fiducial_table(record.after)] if handled else page


def _actions(handled: Iterable[Handled]) -> list[Line]:
    return [
        say(
            "  {}{}{} {}",
            "fiducial " if h.photo else "",
            h.point,
            "" if h.axis is None else say(" ({})", h.axis),
            h.action,
        )
        for h in handled
    ]


def _sigma0(sigma0_um: float | None) -> Line:
    return say("sigma0 {:.2f|um|none}", sigma0_um)
