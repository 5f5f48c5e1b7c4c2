"""The stereo view as a widget: two patches and the floating mark, or the bare read-out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.color import Color
from textual.geometry import Size
from textual.strip import Strip

from anaplot.console.bignumber import big_number
from anaplot.console.halftone import TONES
from anaplot.console.repainting import DrawnWidget
from anaplot.console.stationlike import ControlsLike
from anaplot.console.stereodrawing import StereoLayer, draw_patch, patch_size
from anaplot.console.text import fit
from anaplot.console.wheels import Wheels
from anaplot.session.plates import ReadOut
from anaplot.simulation.stereo import StereoPair
from anaplot.station.snapshot import Snapshot

__all__ = ["StereoView"]

_UNDER = 2  # lines below the patches: ruler and read-out
_BIG = 3  # lines of a large number
_SIGN = 3  # cells of its sign
_GAP = 3
_DARKEST = 0.25  # dots of the darkest tone, from paper to full light

Part = tuple[str, str]


@dataclass(frozen=True, slots=True)
class _Viewed:
    """What the view shows.

    Attributes
    ----------
    left, right
        Names of the photos.
    pair
        The patches; None shows the bare read-out.
    readout
        The live read-out, or None while there is none.
    wheels
        Field and step.
    hand
        Whether the simulated hand sets the mark.
    mono
        Whether it is a mono comparator's read-out.
    """

    left: str
    right: str
    pair: StereoPair | None
    readout: ReadOut | None
    wheels: Wheels
    hand: bool
    mono: bool


class StereoView(DrawnWidget):
    """The patches side by side, each with the mark in its middle; field, step, px and py below."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "stereo--picture",
        "stereo--name",
        "stereo--mark",
        "stereo--label",
        "stereo--value",
    }

    DEFAULT_CSS = """
    StereoView {
        .stereo--picture { color: $foreground; }
        .stereo--name { color: $text-accent; text-style: bold; }
        .stereo--mark { color: $text-warning; text-style: bold; }
        .stereo--label { color: $text-muted; }
        .stereo--value { color: $foreground; text-style: bold; }
    }
    """

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 - Textual's name
        super().__init__(id=id)
        self._viewed: _Viewed | None = None
        self._tones: list[Style] = []

    @property
    def raster(self) -> tuple[int, int] | None:
        """Columns and rows of the patches [dots], or None when there is no room for them."""
        patch = self._patch
        return None if patch is None else (2 * patch[0], 4 * patch[1])

    @property
    def _patch(self) -> tuple[int, int] | None:
        return patch_size((self.size.width - 1) // 2, self.size.height - 1 - _UNDER)

    def look(
        self,
        snapshot: Snapshot,
        readout: ReadOut | None,
        controls: ControlsLike | None,
        wheels: Wheels,
    ) -> None:
        """Look into a simulated plotter's eyepieces, or at the bare read-out."""
        raster = self.raster
        pair, hand = None, False
        if controls is not None:
            hand = controls.hand
            if raster is not None:
                pair = controls.stereo(*raster, wheels.field_mm)
        mono = snapshot.mono if readout is None else readout.mono
        viewed = _Viewed(snapshot.left, snapshot.right, pair, readout, wheels, hand, mono)
        if viewed != self._viewed:
            self._viewed = viewed
            self.draw()

    def notify_style_update(self) -> None:
        """Draw again in the new colours."""
        self._tones = []
        super().notify_style_update()

    def drawn(self, size: Size) -> list[Strip]:
        """Return the lines in this size."""
        viewed, patch = self._viewed, self._patch
        if viewed is None:
            return []
        if viewed.pair is None or patch is None:
            return self._bare(viewed.readout, size, mono=viewed.mono)
        if viewed.pair.left.shape != (4 * patch[1], 2 * patch[0]):
            return []  # seen in the former size: the next look is on its way
        return [
            *self._pictures(viewed, viewed.pair, patch[0], size.width),
            *self._below(viewed.readout, patch[1], size),
        ]

    # -- pictures --------------------------------------------------------------------------

    def _pictures(self, viewed: _Viewed, pair: StereoPair, columns: int, width: int) -> list[Strip]:
        label, paper = self._style("label"), self.rich_style
        gap = width - 2 * columns

        def line(left: list[Segment], right: list[Segment]) -> Strip:
            return Strip([*left, Segment(" " * gap, paper), *right], width)

        def words(what: str, name: str) -> list[Segment]:
            return [
                Segment(f"{what} ", label),
                Segment(fit(name, columns - len(what) - 1), self._style("value")),
            ]

        styles = self._picture_styles()
        drawn = [
            [[Segment(text, styles[layer]) for text, layer in row] for row in canvas.runs()]
            for canvas in (
                draw_patch(pair.left, pair.left_marks, negative=self._negative),
                draw_patch(pair.right, pair.right_marks, negative=self._negative),
            )
        ]
        wheels = viewed.wheels
        ruler = f" {wheels.field_mm:g} mm ".center(columns - 2, "─")
        step = f"step {wheels.step_um()} µm{' coarse' if wheels.coarse else ''}"
        state = fit(f"{step}  {'hand on' if viewed.hand else 'hand off'}", columns)
        return [
            line(words("left", viewed.left), words("right", viewed.right)),
            *(line(left, right) for left, right in zip(*drawn, strict=True)),
            line([Segment(f"├{ruler}┤", label)], [Segment(state, label)]),
        ]

    @property
    def _negative(self) -> bool:
        return not self.app.current_theme.dark

    def _picture_styles(self) -> list[Style]:
        """Return the styles of the layers: tones from the paper to full light, name, mark."""
        if not self._tones:
            full = self._style("picture")
            shades = [full] * TONES
            if (
                full.color is not None
                and full.bgcolor is not None
                and not self.app.native_ansi_color
            ):
                paper, light = (Color.from_rich_color(c) for c in (full.bgcolor, full.color))
                shares = (_DARKEST + (1.0 - _DARKEST) * k / (TONES - 1) for k in range(TONES))
                shades = [
                    full + Style(color=paper.blend(light, share).rich_color) for share in shares
                ]
            by_layer = {StereoLayer.NAME: "name", StereoLayer.MARK: "mark"}
            self._tones = [*shades, *(self._style(by_layer[layer]) for layer in StereoLayer)]
        return self._tones

    def _style(self, name: str) -> Style:
        return self.get_component_rich_style(f"stereo--{name}")

    # -- numbers ---------------------------------------------------------------------------

    def _below(self, readout: ReadOut | None, rows: int, size: Size) -> list[Strip]:
        """Return px and py below the patches, large where there is room."""
        values = (None, None) if readout is None else (readout.px, readout.py)
        named = list(zip(("px", "py"), values, strict=True))
        if size.height - rows - _UNDER >= _BIG + 1 and size.width >= self._big_width(2):
            return [Strip.blank(size.width, self.rich_style), *self._large(named, size.width)]
        return [self._small(named, size.width)]

    @staticmethod
    def _big_width(numbers: int) -> int:
        return numbers * len(big_number(0.0)[0]) + (numbers - 1) * _GAP

    def _small(self, named: list[tuple[str, float | None]], width: int) -> Strip:
        parts: list[Segment] = []
        for name, value in named:
            shown = "–".rjust(8) if value is None else f"{value:+8.3f}"
            parts += [
                Segment(f"{'' if not parts else '   '}{name} ", self._style("label")),
                Segment(shown, self._style("value")),
            ]
        parts.append(Segment(" mm", self._style("label")))
        return Strip(parts).adjust_cell_length(width, self.rich_style)

    def _large(self, named: list[tuple[str, float | None]], width: int) -> list[Strip]:
        """Return numbers beside each other in large digits."""
        lines: list[list[Segment]] = [[] for _ in range(_BIG)]
        for name, value in named:
            for i, part in enumerate(big_number(value)):
                gap = Segment(" " * _GAP if lines[i] else "", self.rich_style)
                # above the sign a number is blank: there is room for its name
                style = "label" if i == 0 else "value"
                head = Segment(name.ljust(_SIGN) if i == 0 else part[:_SIGN], self._style(style))
                lines[i] += [gap, head, Segment(part[_SIGN:], self._style("value"))]
        return [Strip(line).adjust_cell_length(width, self.rich_style) for line in lines]

    def _bare(self, readout: ReadOut | None, size: Size, *, mono: bool) -> list[Strip]:
        """Return all six numbers, or the two of a mono comparator, as large as there is room."""
        r = readout
        values = [None] * 6 if r is None else [r.xl, r.xr, r.yl, r.yr, r.px, r.py]
        named = list(zip(("x'", "x''", "y'", "y''", "px", "py"), values, strict=True))
        pairs = [named[0:2], named[2:4], named[4:6]]
        if mono:
            pairs = [[("x", values[0]), ("y", values[2])]]
            named = pairs[0]
        blank = Strip.blank(size.width, self.rich_style)
        for beside in (2, 1):
            rows = pairs if beside == 2 else [[one] for one in named]
            room = size.height // len(rows)
            if size.width >= self._big_width(beside) and room >= _BIG:
                spread = [blank] * min(room - _BIG, 1)
                return [line for row in rows for line in (*self._large(row, size.width), *spread)]
        return [self._small(pair, size.width) for pair in pairs]
