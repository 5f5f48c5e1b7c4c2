"""`--report FILE.html` of a command: what it has computed as a page that stands by itself."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from anaplot.errors import InputError
from anaplot.report.computed import Computed
from anaplot.report.document import BLANK, Document
from anaplot.report.keywords import Declare, chosen_options, declared_options, value_typed
from anaplot.report.progress import working
from anaplot.textfiles.wording import typed_value

if TYPE_CHECKING:
    from anaplot.report.html.angles import AngleUnit
    from anaplot.report.html.parts import Report
    from anaplot.report.html.sections.provenance import InputFile

__all__ = ["AskedPage", "MakesPage", "as_typed"]

MakesPage: TypeAlias = "Callable[[Computed[Any]], Report]"
"""Makes the report of what a command has computed."""


@dataclass(frozen=True, slots=True)
class AskedPage:
    """The page that a command line asks for.

    Attributes
    ----------
    path
        Where it goes; None: none is asked for.
    command
        As one types it.
    options
        Those that are not what they are without.
    reads
        The files that the command reads.
    files
        Those that there are, with their checksums before anything is computed.
    report
        Makes it.
    figures
        A folder for its drawings, each as a file; None: they are in the page alone.
    angles
        Unit of angles in its tables.
    """

    path: Path | None
    command: str
    options: Mapping[str, Any]
    reads: tuple[Path, ...]
    files: tuple[InputFile, ...]
    report: MakesPage
    figures: Path | None = None
    angles: AngleUnit = "deg"

    @classmethod
    def of(
        cls,
        options: argparse.Namespace,
        command: str,
        declare: Declare,
        reads: Callable[[], Iterable[Path]],
        report: MakesPage,
    ) -> AskedPage:
        """Return the page that is asked for; a file that could not be written is refused.

        Parameters
        ----------
        options
            Of the command line.
        command
            Name of the command.
        declare
            Adds its options.
        reads
            Returns the files that it reads; called where a page is asked for.
        report
            Makes the page.

        Raises
        ------
        InputError
            It cannot be written, or is no earlier report; options that go with a page, and none.
        """
        if options.report is None:
            if options.figures is not None or options.angles is not None:
                raise InputError("--figures and --angles go with --report")
            return cls(None, "", {}, (), (), report)
        from anaplot.report.html.sections.provenance import checked_files
        from anaplot.report.html.write import check_report

        check_report(options.report, options.figures)
        chosen, there = chosen_options(declare, options), tuple(reads())
        typed = as_typed(command, declare, options)
        files = checked_files(there)
        angles: AngleUnit = options.angles or "deg"
        return cls(options.report, typed, chosen, there, files, report, options.figures, angles)

    @property
    def uses(self) -> Mapping[str, tuple[Path, ...]]:
        """What becomes of files, as `Output.check` takes it."""
        return {} if self.path is None else {"becomes the report": (self.path,)}

    def shown(self, found: Computed[Any]) -> Document:
        """Write the page, and return the command's document with what is said of it.

        Raises
        ------
        InputError
            It could not be written, or a file has changed meanwhile; an earlier report is as it
            was.
        """
        document = found.document
        if self.path is None:
            return document
        from anaplot.report.html.angles import with_angles_in
        from anaplot.report.html.sections.definitions import with_definitions
        from anaplot.report.html.sections.provenance import (
            checked_files,
            provenance,
            provenance_answer,
            provenance_section,
            unchanged,
        )
        from anaplot.report.html.write import write_report
        from anaplot.report.html.written import written_answer, written_lines

        with working("the page"):
            unchanged(self.files, checked_files(self.reads))
            made = provenance(self.command, self.options, self.files)
            report = replace(self.report(found), provenance=provenance_section(made))
            report = with_definitions(with_angles_in(report, self.angles))
            written = write_report(report, self.path, self.figures)
        told = {**written_answer(written), "provenance": provenance_answer(made)}
        return replace(
            document,
            answer={**document.answer, "report": told},
            page=(*document.page, BLANK, *written_lines(written)),
        )


def as_typed(command: str, declare: Declare, options: argparse.Namespace) -> str:
    """Return a command with what it is given and its options that are not the default.

    Typed again it means the same: of an option that takes several values each has its own.
    """
    actions = declared_options(declare)
    given: list[object] = []
    for key, action in actions.items():
        if not action.option_strings:
            value = getattr(options, key)
            given += value if isinstance(value, list | tuple) else [value]
    switches = {word for one in actions.values() if one.nargs == 0 for word in one.option_strings}
    words: list[str] = []
    for option, value in chosen_options(declare, options).items():
        for one in value if isinstance(value, list) else [value]:
            words += [option] if option in switches else _with_value(option, value_typed(one))
    return shlex.join(["anaplot", *command.split(), *map(typed_value, given), *words])


def _with_value(option: str, text: str) -> list[str]:
    """Return the words of an option; what begins with a dash is no further one."""
    return [f"{option}={text}"] if text.startswith("-") else [option, text]
