"""Layers in one frame, with axes, names, a legend and notes: what every chart is made of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from anaplot.aliases import Array
from anaplot.drawing import pathdata
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.element import NOTHING, Svg, element, escaped, joined, shortened, text
from anaplot.drawing.frame import WIDTH, Frame
from anaplot.drawing.labels import placed
from anaplot.drawing.legend import Entry, legend
from anaplot.drawing.pathdata import Shape
from anaplot.drawing.textwidth import SMALL, characters_within, folded, text_width
from anaplot.drawing.ticks import Ticks, ticks, written
from anaplot.textfiles.wording import plain

__all__ = ["Head", "Plot", "drawn"]

_SIDE = 16.0  # blank at left and right of titles and notes
_LINE = 16.5
_LONGEST_TITLE = 68
_TITLE = 15.0  # size of a title, as its style has it
_ROOM_OF_NUMBER = 62.0  # at the left of a frame
_BETWEEN = 14.0  # between two numbers of an axis
_LONGEST_NAME = 14  # characters of names beside points
_MOST_NAMES = 80  # of which room is looked for at once


@dataclass(frozen=True, slots=True)
class Head:
    """What stands above a drawing.

    Attributes
    ----------
    key
        As `Drawing` has it.
    title
        One line.
    remark
        What has to be known to read it: how many, how large, by how much exaggerated.
    """

    key: str
    title: str
    remark: str = ""

    @property
    def lines(self) -> list[str]:
        """The remark, folded."""
        return folded(plain(self.remark, 600), WIDTH - 2.0 * _SIDE)

    @property
    def bottom(self) -> float:
        """Where a frame may begin."""
        return 34.0 + _LINE * len(self.lines) + 8.0

    @property
    def svg(self) -> Svg:
        """The title and the remark."""
        lines = (text(_SIDE, 44.0 + _LINE * k, line, "t-soft") for k, line in enumerate(self.lines))
        most = characters_within(self.title, WIDTH - 2.0 * _SIDE, _TITLE, _LONGEST_TITLE)
        return joined(text(_SIDE, 25.0, self.title, "t-title", most=most), *lines)


def drawn(
    head: Head, description: str, body: Svg, height: float, notes: Iterable[str] = ()
) -> Drawing:
    """Return a drawing of what is drawn beneath its head.

    Parameters
    ----------
    head
        Its head.
    description
        What is to be seen, with numbers; foreign names may stand in it.
    body
        Elements.
    height
        Of the whole drawing.
    notes
        Sentences of the description that stand under it.
    """
    inside = joined(
        element("title", escaped(head.title)),
        element("desc", escaped(description)),
        head.svg,
        body,
    )
    svg = element(
        "svg",
        inside,
        xmlns="http://www.w3.org/2000/svg",
        class_="drawing",
        role="img",
        viewBox=f"0 0 {WIDTH:g} {np.ceil(height):g}",
    )
    title, words = plain(head.title, 300), plain(description, 2000)
    return Drawing(head.key, title, words, svg, _unsaid(words, title, head, notes))


def _unsaid(description: str, title: str, head: Head, notes: Iterable[str]) -> str:
    """Return the sentences of a description that stand nowhere in the drawing."""
    said = " ".join((plain(head.remark, 600), *(plain(note, 600) for note in notes)))
    rest = description.removeprefix(title).lstrip(":. ")
    sentences = (one for one in rest.split(". ") if not _says(said, one.rstrip(".")))
    caption = ". ".join(sentences)
    return caption if not caption or caption.endswith(".") else f"{caption}."


def _says(said: str, sentence: str) -> bool:
    """Whether a text has a sentence, or all of it behind a colon."""
    behind = sentence.partition(": ")[2]
    return sentence in said or (bool(behind) and behind in said)


class Plot:
    """A frame that is drawn into, layer upon layer.

    Parameters
    ----------
    head
        What stands above it.
    frame
        Made by `free_frame` or `equal_frame`, beginning at `head.bottom`.
    """

    def __init__(self, head: Head, frame: Frame) -> None:
        self.head = head
        self.frame = frame
        self._layers: list[Svg] = []
        self._entries: list[Entry] = []
        self._notes: list[str] = []
        self._named = np.zeros((0, 4))  # boxes of the names that were added
        self._below = frame.bottom

    def add(self, svg: Svg) -> None:
        """Add elements in units of the drawing."""
        self._layers.append(svg)

    def path(self, d: str, classes: str, width: float | None = None) -> None:
        """Add path data in units of the drawing; nothing where there are none."""
        if d:
            self.add(element("path", d=d, class_=classes, stroke_width=width))

    def explain(self, *entries: Entry) -> None:
        """Add entries to the legend."""
        self._entries.extend(entries)

    def note(self, *sentences: str) -> None:
        """Add sentences under the legend: what was left out."""
        self._notes.extend(sentences)

    def axes(
        self,
        x_title: str,
        y_title: str,
        *,
        x_ticks: Ticks | None = None,
        y_ticks: Ticks | None = None,
        grid: bool = True,
    ) -> None:
        """Add the frame, its round numbers and their meaning, with the units; and a grid.

        Parameters
        ----------
        x_title, y_title
            What the numbers are, with their units.
        x_ticks, y_ticks
            Where they are marked; None: at round numbers.
        grid
            Whether lines go on through the frame.
        """
        of = self.frame
        along = x_ticks or _apart(of)
        up = y_ticks or ticks(*of.y, 7)
        x = of.places(np.array([[value, of.y[0]] for value in along.values]).reshape(-1, 2))[:, 0]
        y = of.places(np.array([[of.x[0], value] for value in up.values]).reshape(-1, 2))[:, 1]
        if grid:
            top, bottom = np.full_like(x, of.top), np.full_like(x, of.bottom)
            left, right = np.full_like(y, of.left), np.full_like(y, of.right)
            lines = pathdata.segments(np.stack((x, top), 1), np.stack((x, bottom), 1))
            lines += pathdata.segments(np.stack((left, y), 1), np.stack((right, y), 1))
            self.path(lines, "grid")
        self.add(
            element("rect", x=of.left, y=of.top, width=of.width, height=of.height, class_="frame")
        )
        x_title, along = _relative(x_title, along)
        y_title, up = _relative(y_title, up)
        for at, label in zip(x.tolist(), along.labels, strict=True):
            middle = min(at, WIDTH - 2.0 - text_width(label, SMALL) / 2.0)
            self.add(text(middle, of.bottom + 16.0, label, "t-soft t-small t-mid"))
        for at, label in zip(y.tolist(), up.labels, strict=True):
            self.add(text(of.left - 7.0, at + 3.8, label, "t-soft t-small t-end"))
        self.add(text(of.left + of.width / 2.0, of.bottom + 34.0, x_title, "t-mid"))
        wide = max((text_width(label, SMALL) for label in up.labels), default=0.0)
        beside = max(of.left - wide - 20.0, 14.0)
        self.add(text(beside, of.top + of.height / 2.0, y_title, "t-mid", turned=True))
        self._below = of.bottom + 42.0

    def dots(self, at: Array, classes: str, width: float = 4.0) -> None:
        """Add a disc at each of (n, 2) numbers; classes colour lines ("l-...")."""
        if len(at):
            self.path(pathdata.dots(self.frame.places(at)), f"dot {classes}", width)

    def marks(self, shape: Shape, at: Array, classes: str, size: float = 4.5) -> None:
        """Add a mark at each of (n, 2) numbers."""
        if len(at):
            self.path(pathdata.marks(shape, self.frame.places(at), size), classes)

    def line(self, at: Array, classes: str) -> None:
        """Add one line through (n, 2) numbers."""
        if len(at) > 1:
            self.path(pathdata.polyline(self.frame.places(at)), f"line {classes}")

    def areas(self, corners: Array, classes: str) -> None:
        """Add closed polygons of (n, k, 2) numbers."""
        if len(corners):
            self.path(pathdata.polygons(self.frame.places(corners)), classes)

    def arrows(self, at: Array, vectors: Array, times: float, classes: str) -> int:
        """Add arrows at (n, 2) numbers, of (n, 2) differences in the same unit, exaggerated.

        One that would leave the frame ends at its side without a head; returned is how many do.
        """
        if not len(at):
            return 0
        start = self.frame.places(at)
        step = self.frame.steps(vectors) * times
        within = self.frame.within(start, step)
        whole, end = within >= 1.0, start + step * within[:, None]
        d = pathdata.arrows(start[whole], end[whole]) + pathdata.segments(
            start[~whole], end[~whole]
        )
        self.path(d, f"line {classes}")
        return int(np.count_nonzero(~whole))

    def ellipses(self, at: Array, covariance: Array, times: float, classes: str) -> None:
        """Add ellipses whose half axes are the roots of the eigenvalues, exaggerated.

        Parameters
        ----------
        at, covariance
            (n, 2) and (n, 2, 2) in the unit of the frame, and squared.
        times
            By how much the axes are exaggerated.
        classes
            Of `STYLE`.
        """
        if len(at):
            spread = self.frame.spreads(covariance) * times**2
            self.path(pathdata.ellipses(self.frame.places(at), spread), classes)

    def names(
        self,
        at: Array,
        names: Sequence[str],
        classes: str = "",
        *,
        obstacles: Array | None = None,
        gap: float = 7.0,
    ) -> list[int]:
        """Add names beside (n, 2) numbers where there is room, and return which did not find it.

        None of them covers a name that was added before.
        """
        shown = [shortened(name, _LONGEST_NAME) for name in names[:_MOST_NAMES]]
        if not shown:
            return []
        sizes = np.array([[text_width(name, SMALL), 0.8 * SMALL] for name in shown])
        others = None if obstacles is None else self.frame.places(obstacles)
        at = self.frame.places(at[:_MOST_NAMES])
        found = placed(
            self.frame, at, sizes, gap=gap, obstacles=others, boxes=self._named, most=_MOST_NAMES
        )
        whole = f"t-small t-halo {classes}".strip()
        for label in found:
            y = label.y + 0.8 * SMALL
            self.add(text(label.x, y, names[label.which], whole, most=_LONGEST_NAME))
            box = [label.x, label.y, *(sizes[label.which] + (label.x, label.y))]
            self._named = np.vstack((self._named, box))
        room = {label.which for label in found}
        return [k for k in range(len(names)) if k not in room]

    def drawing(self, description: str) -> Drawing:
        """Return what was drawn.

        Parameters
        ----------
        description
            What is to be seen, with numbers; the notes are added to it.
        """
        width = WIDTH - self.frame.left - _SIDE
        y = self._below + 6.0
        explained, height = legend(self._entries, self.frame.left, y, width)
        y += height + (4.0 if height else 0.0)
        notes, y = _noted(self._notes, self.frame.left, y, width)
        body = joined(*self._layers, explained, notes)
        return drawn(self.head, " ".join((description, *self._notes)), body, y + 10.0, self._notes)


def _apart(frame: Frame) -> Ticks:
    """Return round numbers along x whose labels stand apart."""
    for most in range(9, 2, -1):
        found = ticks(*frame.x, most)
        shown = _relative("", found)[1].labels
        wide = max((text_width(label, SMALL) for label in shown), default=0.0)
        if wide + _BETWEEN <= found.step * frame.scale[0]:
            break
    return found


def _relative(title: str, of: Ticks) -> tuple[str, Ticks]:
    """Return what stands along an axis: numbers that are too long, less a round one."""
    if max((text_width(label, SMALL) for label in of.labels), default=0.0) <= _ROOM_OF_NUMBER:
        return title, of
    base, rest = of.less()
    return f"{title} − {written(base, max(rest.decimals - 3, 0))}".replace("− −", "+ "), rest


def _noted(notes: Iterable[str], left: float, y: float, width: float) -> tuple[Svg, float]:
    parts = []
    for note in notes:
        for line in folded(plain(note, 600), width, SMALL):
            y += _LINE
            parts.append(text(left, y - 3.0, line, "t-soft t-small"))
    return (joined(*parts) if parts else NOTHING), y
