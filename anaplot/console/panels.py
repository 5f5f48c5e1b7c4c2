"""The lines around map and table: who, what, where the mark stands, what to do, what happened."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice

from rich.cells import cell_len
from textual.content import Content
from textual.geometry import Size

from anaplot.console.describe import Entry, advice_of, describe_row
from anaplot.console.inwork import in_work
from anaplot.console.lineswidget import LinesWidget
from anaplot.console.overview import verdict
from anaplot.console.rows import ShownRow
from anaplot.console.text import fit, fit_end, number, wrap
from anaplot.session.plates import ReadOut
from anaplot.station.snapshot import Snapshot
from anaplot.textfiles.wording import plain

__all__ = [
    "WELCOME",
    "AdvicePanel",
    "DetailsPane",
    "ExpectedLine",
    "HeaderPanel",
    "MessagePanel",
    "ReadOutLine",
    "entry_lines",
    "said_line",
]

Part = tuple[str, str]
_GAP: Part = ("   ", "")
_NARROW_GAP: Part = (" ", "")
_SECONDS_SHOWN = 10.0
_MOST_SHOWN = 20
_SECONDS_HELD = 6.0  # in which nothing takes the place of where a report lies

WELCOME = (
    "Welcome. The line NOW says what to do, and with which key; Enter does it.",
    "After every point the table says which measurement is wrong, and how sure.",
    "? explains screen and keys, u takes back, q leaves: records are on disk.",
)
"""What stands on the screen when it is seen for the first time."""


_STYLES = {
    "error": "bold $text-error",
    "warning": "bold $text-warning",
    "hint": "$text-warning",
    "record": "$text-success",
    "report": "$text-success",
}


def said_line(severity: str, text: str, width: int) -> Content:
    """Return a message as one line; of where a report lies the end is kept, its name."""
    spoken, room = _spoken(severity, text), width - 2
    if cell_len(spoken) > room and severity == "report":
        head = _spoken(severity, "")
        spoken = head + fit_end(text, room - 8 - cell_len(head)) + " (l: all)"
    elif cell_len(spoken) > room:
        spoken = f"{fit(spoken, room - 8)} (l: all)"
    return Content.styled(f" {spoken}", _style(severity))


def _spoken(severity: str, text: str) -> str:
    return text if severity in ("info", "hint") else f"{severity}: {text}"


def _style(severity: str) -> str:
    return _STYLES.get(severity, "$foreground-muted")


def _width(parts: list[Part]) -> int:
    return sum(cell_len(text) for text, _ in parts)


def _between(left: list[Part], right: list[Part], width: int) -> Content:
    """Return a line with parts at either end; the right end is kept, the left one cut."""
    space = width - _width(left) - _width(right) - 2
    if space < 1:
        left = [_NARROW_GAP if part is _GAP else part for part in left]
        space = width - _width(left) - _width(right) - 2
    if space < 1:
        kept: list[Part] = []
        room = width - _width(right) - 3
        for text, style in left:
            kept.append((fit(text, min(cell_len(text), room)), style))
            room -= cell_len(text)
            if room <= 0:
                break
        left = kept
        space = max(width - _width(left) - _width(right) - 2, 1)
    return Content.assemble(" ", *left, " " * space, *right, " ")


def entry_lines(entries: list[Entry], width: int, label: int = 18) -> list[Content]:
    """Return label and value pairs as lines, values wrapped beside their label."""
    lines: list[Content] = []
    for name, value in entries:
        wrapped = wrap(value, width - label) or [""]
        for i, part in enumerate(wrapped):
            head = fit(name if i == 0 else "", label)
            lines.append(Content.assemble((head, "$foreground-muted"), part))
    return lines


class HeaderPanel(LinesWidget):
    """Block, model and link; choices in force and the model's figures."""

    DEFAULT_CSS = "HeaderPanel { height: 2; background: $panel; }"

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._snapshot: Snapshot | None = None
        self._automatic, self._hand = False, True

    def show(self, snapshot: Snapshot, *, automatic: bool, hand: bool = True) -> None:
        """Show this from now on; `hand`: what sets the mark is there, simulated or a person."""
        shown = (snapshot, automatic, hand)
        if snapshot is not self._snapshot or shown[1:] != (self._automatic, self._hand):
            self._snapshot, self._automatic, self._hand = shown
            self.show_lines()

    def lines(self, width: int, height: int) -> list[Content]:
        """Return two lines."""
        if self._snapshot is None:
            return []
        wide = width >= 110
        return [
            _between(self._model(wide), self._link(wide), width),
            _between(self._figures(wide), self._mode(), width),
        ][:height]

    def _model(self, wide: bool) -> list[Part]:
        shown = self._snapshot
        assert shown is not None
        names, photos = (24, 12) if wide else (14, 7)

        def short(text: str, most: int) -> str:
            return fit(text, min(cell_len(plain(text)), most))

        parts: list[Part] = [(short(shown.block, names), "bold")]
        if shown.strip:
            parts += [_GAP, (f"strip {short(shown.strip, photos)}", "")]
        if shown.inner is not None:
            photo = f"photo {short(shown.inner.photo, photos)} {shown.inner.side}"
            parts += [_GAP, ("INNER ORIENTATION", "bold reverse $text-accent"), _NARROW_GAP]
            parts += [(photo, "bold"), _GAP]
            parts += [(f"model {shown.model_number} of {shown.model_count}", "")]
        elif shown.left:
            pair = f"{short(shown.left, photos)} | {short(shown.right, photos)}"
            parts += [_GAP, ("photos ", "$foreground-muted"), (pair, "bold")]
            if shown.mono:
                lies = short(shown.laid, photos) if shown.laid else "none"
                parts += [_NARROW_GAP, (f" in: {lies} ", "reverse $text-accent")]
            parts += [_GAP, (f"model {shown.model_number} of {shown.model_count}", "")]
        return parts

    def _link(self, wide: bool) -> list[Part]:
        assert self._snapshot is not None
        link = self._snapshot.link
        parts: list[Part] = []
        if link.simulated:
            parts += [(" SIMULATED ", "bold reverse $text-warning"), (" ", "")]
        if link.state == "none":
            return [*parts, ("no plotter", "$foreground-muted")]
        good = link.state == "live"
        state = link.state if good else f" {link.state.upper()} "
        if wide and link.profile:
            port = f" {link.port}" if link.port else ""
            parts += [(fit(link.profile + port, min(cell_len(plain(link.profile + port)), 40)), "")]
            parts += [(" ", "")]
        parts.append((plain(state), "$text-success" if good else "bold reverse $text-error"))
        if link.parity_unchecked:
            parts += [(" ", ""), ("parity not checked" if wide else "no parity", "$text-warning")]
        return parts

    def _figures(self, wide: bool) -> list[Part]:
        shown = self._snapshot
        assert shown is not None
        parts: list[Part] = [
            ("ties ", "$foreground-muted"),
            (plain(shown.tie_variance)[:16], ""),
            _GAP,
            ("test ", "$foreground-muted"),
            (plain(shown.test)[:20], ""),
        ]
        work = in_work(shown)
        if not work.solved:
            needed = work.needed
            done = sum(view.status != "pending" for view in needed)
            where = ""
            if shown.mono and shown.inner is None and shown.laid:
                side = "left" if shown.laid == shown.left else "right"
                done = sum(side in view.seen for view in needed)
                where = f" in {fit(shown.laid, min(cell_len(plain(shown.laid)), 12))}"
            if needed:
                words = f"{done} of {len(needed)} measured{where}"
                parts += [_GAP, (words, "$foreground-muted")]
            return parts
        critical = work.critical
        if wide:
            parts += [(" critical ", "$foreground-muted")]
            parts += [("none" if critical is None else f"{critical:.2f}", "")]
        sigma0 = f"{number(work.sigma0_um, 4, 2).strip()} µm"
        parts += [_GAP, ("sigma0 ", "$foreground-muted"), (sigma0, "")]
        parts += [_GAP, ("r ", "$foreground-muted"), (str(work.redundancy), "")]
        if work.flagged:
            parts += [_GAP, (f"{len(work.flagged)} flagged", "bold $text-error")]
        if wide:
            parts += [_GAP, ("accepted ", "$foreground-muted"), (str(len(shown.accepted)), "")]
        return parts

    def _mode(self) -> list[Part]:
        parts: list[Part] = []
        if not self._hand:
            parts.append((" hand off ", "bold reverse $text-warning"))
        if self._automatic:
            parts.append((" AUTO ", "bold reverse $text-accent"))
        return parts


class ReadOutLine(LinesWidget):
    """x' y' x'' y'' px py [mm] as they are now; dashes while nothing is known.

    Before a photo's inner orientation is accepted its coordinates are those of the plate, and in
    place of the parallaxes, which mean nothing then, stands which photo's they are. A mono
    comparator has x and y only. Of a device that speaks only when it records the last read-out
    stays, dimmed and called old.
    """

    DEFAULT_CSS = "ReadOutLine { height: 1; background: $surface; text-style: bold; }"

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._readout: ReadOut | None = None
        self._live = False
        self._old = False

    def show(self, readout: ReadOut | None, *, live: bool) -> None:
        """Show this read-out; one of a link that is not live is not shown as if it were."""
        old = live and self._live and readout is None and self._readout is not None
        if old:
            readout = self._readout
        if (readout, live, old) != (self._readout, self._live, self._old):
            self._readout, self._live, self._old = readout, live, old
            self.show_lines()

    def lines(self, width: int, height: int) -> list[Content]:
        """Return one line."""
        values: list[float | None] = [None] * 6
        if self._live and self._readout is not None:
            r = self._readout
            values = [r.xl, r.yl, r.xr, r.yr, r.px, r.py]
        parts: list[Part] = []
        gap = "   " if width >= 100 else " "
        names = ("x'", "y'", "x''", "y''", "px", "py")
        plates = _plates(self._readout) if self._live else ""
        most = 4 if plates else 6
        if self._live and self._readout is not None and self._readout.mono:
            names, most = ("x", "y", "", "", "", ""), 2
        for name, value in list(zip(names, values, strict=True))[:most]:
            shown = "–".rjust(8) if value is None else f"{value:8.3f}"
            style = "$foreground-muted not bold" if self._old else ""
            parts += [(f"{gap}{name} ", "$foreground-muted not bold"), (shown, style)]
        parts.append((" old" if self._old else " mm", "$foreground-muted not bold"))
        if plates:
            parts += [(gap, ""), (f" {plates} ", "reverse $text-accent")]
        return [Content.assemble(*parts)]


def _plates(readout: ReadOut | None) -> str:
    """Return which photos' coordinates are plate coordinates, or nothing."""
    if readout is None or not (readout.plate_left or readout.plate_right):
        return ""
    if readout.mono:
        return "PLATE"
    if readout.plate_left and readout.plate_right:
        return "left and right: PLATE"
    return "left: PLATE" if readout.plate_left else "right: PLATE"


class ExpectedLine(LinesWidget):
    """What the operator is expected to do now; two lines when one is too short.

    The second line stays while the cursor moves, if the sentence needs it on any row: everything
    below stands still then.
    """

    DEFAULT_CSS = "ExpectedLine { height: auto; min-height: 1; max-height: 2; }"

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._head: Part = ("", "")
        self._text = ""
        self._longest = ""

    def show(self, snapshot: Snapshot, text: str, longest: str = "") -> None:
        """Show this from now on.

        `text`: what is to be done, with its keys. `longest`: what it would be on another row.
        """
        head: Part = (" NOW ", "bold reverse $text-accent")
        if snapshot.finished and snapshot.returning is None:
            head = (" DONE ", "bold reverse $text-success")
        elif snapshot.suspended:
            head = (" SUSPENDED ", "bold reverse $text-warning")
        if (head, text, longest) == (self._head, self._text, self._longest):
            return
        before = self._needed(self.size.width)
        self._head, self._text, self._longest = head, text, longest
        if self._needed(self.size.width) == before:
            self.show_lines()
        else:  # a new layout is costly
            self._shown = None
            self.refresh(layout=True)

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        """Return how many lines the sentence needs."""
        return self._needed(width)

    def _needed(self, width: int) -> int:
        room = width - self._indent - 1
        texts = (self._text, self._longest) if self._head[0] else ()
        return max((min(len(wrap(text, room)), 2) for text in texts), default=0)

    @property
    def _indent(self) -> int:
        return cell_len(self._head[0]) + 1

    def lines(self, width: int, height: int) -> list[Content]:
        """Return one or two lines."""
        if not self._head[0]:
            return []
        indent = self._indent
        room = width - indent - 1
        first, *rest = wrap(self._text, room) or [""]
        lines = [Content.assemble(self._head, " ", (first, "bold"))]
        if rest and height > 1:
            lines.append(Content.assemble(" " * indent, (fit(" ".join(rest), room), "bold")))
        return lines


class AdvicePanel(LinesWidget):
    """What the model says and advises, the most useful first."""

    DEFAULT_CSS = "AdvicePanel { height: 3; background: $surface; }"

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._snapshot: Snapshot | None = None
        self._errors = ""
        self._welcome: tuple[str, ...] = ()

    def greet(self, welcome: tuple[str, ...]) -> None:
        """Show these lines in place of all advice, or none of them any more."""
        if welcome != self._welcome:
            self._welcome = welcome
            self.show_lines()

    def show(self, snapshot: Snapshot, errors: str = "") -> None:
        """Show this from now on; `errors`: what the chosen strategy for gross errors says."""
        self._snapshot, self._errors = snapshot, errors
        self.show_lines()

    def lines(self, width: int, height: int) -> list[Content]:
        """Return the sentences, wrapped; if they are too many, the last line says so."""
        if self._welcome:
            return [Content(f" {fit(line, width - 2)}") for line in self._welcome]
        if self._snapshot is None:
            return []
        lines: list[str] = []
        sentences = advice_of(self._snapshot)
        if self._errors:
            sentences.insert(1, self._errors)
        for sentence in sentences:
            first, *rest = wrap(sentence, width - 4) or [""]
            lines += [f" · {first}", *(f"   {line}" for line in rest)]
        if len(lines) > height:
            note = f" (+{len(lines) - height} lines: F2)"
            last = lines[height - 1]
            lines[height - 1] = fit(last, min(cell_len(last), width - len(note) - 1)) + note
        style = "bold" if in_work(self._snapshot).flagged else ""
        return [Content.styled(line, style if i == 0 else "") for i, line in enumerate(lines)]


class MessagePanel(LinesWidget):
    """What happened, the newest last; what is old goes.

    With the next key all of it, and after some seconds whatever is neither warning nor error.
    Where a report lies stays some seconds whatever comes: it is written while measuring goes on.

    Parameters
    ----------
    clock
        Seconds that never go back.
    """

    DEFAULT_CSS = "MessagePanel { height: 1; }"

    def __init__(
        self,
        *,
        clock: Callable[[], float] = time.monotonic,
        id: str | None = None,  # noqa: A002 - Textual's name
    ) -> None:
        super().__init__(id=id)
        self._clock = clock
        self._messages: deque[tuple[str, str]] = deque(maxlen=200)
        self._recent: list[tuple[str, str, float]] = []
        self._question = self._short = ""

    def say(self, severity: str, text: str) -> None:
        """Add a message."""
        message = plain(severity), plain(text)
        self._messages.append(message)
        self._recent = [*self._recent[-_MOST_SHOWN:], (*message, self._clock())]
        self.show_lines()

    def clear(self) -> None:
        """Let what is shown go: it has been read."""
        kept = self._held()
        if kept != self._recent:
            self._recent = kept
            self.show_lines()

    def _held(self) -> list[tuple[str, str, float]]:
        """Return what stays for now, whatever comes."""
        until = self._clock() - _SECONDS_HELD
        return [one for one in self._recent if one[0] == "report" and one[2] > until]

    def age(self) -> None:
        """Let what is old go."""
        now = self._clock()
        kept = [
            (severity, text, since)
            for severity, text, since in self._recent
            if severity in ("warning", "error") or now - since < _SECONDS_SHOWN
        ]
        if len(kept) != len(self._recent):
            self._recent = kept
            self.show_lines()

    def ask(self, question: str, short: str = "") -> None:
        """Show this question, or none, below the messages, beside them where there is one line.

        Where there is one, and what is said does not fit beside the question, its short form stands
        there until that has gone.
        """
        if question != self._question:
            self._question, self._short = question, short
            self.show_lines()

    def lines(self, width: int, height: int) -> list[Content]:
        """Return the newest messages, one line each, then what is asked."""
        question, room = plain(self._question), width
        if question and height == 1:
            room = max(width - cell_len(question) - 2, 0)
            said = self._recent[-1:]
            if said and self._short and cell_len(_spoken(*said[0][:2])) > room - 2:
                question = plain(self._short)
                room = max(width - cell_len(question) - 2, 0)
        count = height - 1 if question and height > 1 else height
        held = self._held()
        recent = [one for one in self._recent if one not in held] + held
        lines = [said_line(severity, text, room) for severity, text, _ in recent[-count:]]
        if not question:
            return lines
        asked = Content.styled(fit(question, cell_len(question)), "bold $text-accent")
        if height > 1:
            return [*lines, Content.assemble(" ", asked)]
        beside = lines[-1] if lines and room > 12 else Content("")
        gap = " " * max(width - cell_len(beside.plain) - cell_len(question) - 1, 1)
        return [Content.assemble(beside, gap, asked)]

    def history(self, width: int, most: int | None = None) -> list[Content]:
        """Return all messages, the newest first, wrapped; or no more lines of them than `most`."""
        return list(islice(self._wrapped(width), most))

    def _wrapped(self, width: int) -> Iterator[Content]:
        for severity, text in reversed(self._messages):
            style = _style(severity)
            for i, line in enumerate(wrap(_spoken(severity, text), width - 2)):
                yield Content.styled(f"{'  ' if i else '· '}{line}", style)


class DetailsPane(LinesWidget):
    """All that is known of the selected row; below it, where there is room, block and history.

    Parameters
    ----------
    history
        Returns what happened, the newest first, wrapped to a width, in at most so many lines.
    """

    DEFAULT_CSS = "DetailsPane { background: $surface; padding: 0 1; }"

    def __init__(
        self,
        history: Callable[[int, int], list[Content]],
        *,
        id: str | None = None,  # noqa: A002 - Textual's name
    ) -> None:
        super().__init__(id=id)
        self._history = history
        self._snapshot: Snapshot | None = None
        self._selected: ShownRow | None = None

    def show(self, snapshot: Snapshot, selected: ShownRow | None) -> None:
        """Show this row from now on."""
        self._snapshot, self._selected = snapshot, selected
        self.show_lines()

    def lines(self, width: int, height: int) -> list[Content]:
        """Return label and value pairs."""
        shown, row = self._snapshot, self._selected
        if shown is None:
            return []
        entries = [] if row is None else describe_row(row, shown)
        head = Content.styled("SELECTED ROW", "bold $foreground-muted")
        lines = [head, *entry_lines(entries, width)]
        block = [Content(line) for line in wrap(verdict(shown.block_view), width)]
        more = [Content(""), Content.styled("BLOCK", "bold $foreground-muted"), *block]
        more += [Content(""), Content.styled("HISTORY", "bold $foreground-muted")]
        if height < len(lines) + len(more) + 1:
            return lines
        return [*lines, *more, *self._history(width, height - len(lines) - len(more))]
