"""Of a frame only what changes is written, and the terminal shows the same."""

from consolefake import FakeStation
from hypothesis import given
from hypothesis import strategies as st
from terminal import Terminal
from textual.drivers.headless_driver import HeadlessDriver

from anaplot.console.app import ConsoleApp
from anaplot.console.changedcells import ShownCells, writing_changes

BEGIN, END = "\x1b[?2026h", "\x1b[?2026l"


STYLES = ("", "1", "38;5;4", "1;38;5;4;48;2;1;2;3", "48;2;1;2;3", "7;31", "31;44", "92")


@st.composite
def frames(draw) -> str:
    """Some of the lines, in columns as they happen to be; no cell is painted twice."""
    out = []
    widths = draw(st.sampled_from(((4, 4, 4), (8, 4), (3, 9), (12,))))
    for line in draw(st.sets(st.integers(1, 3))):
        for k, width in enumerate(widths):
            if not draw(st.booleans()):
                continue
            out.append(f"\x1b[{line};{1 + sum(widths[:k])}H")
            texts = st.text("ab ⠿漢", min_size=1, max_size=width // 2)
            text = draw(texts) + " " * draw(st.integers(0, 1))
            style = draw(st.sampled_from(STYLES))
            out.append(f"\x1b[{style}m{text}\x1b[0m" if style else text)
    return "".join(out) + "\n\x1b[1;1H"


@given(st.lists(frames(), min_size=1, max_size=6))
def test_a_terminal_shows_what_whole_frames_would_show(drawn):
    shown, whole, spared = ShownCells(), Terminal(), Terminal()
    for data in drawn:
        whole.write(data)
        spared.write(shown.changes(data))
        assert spared.cells == whole.cells
        assert (spared.line, spared.column) == (whole.line, whole.column)
        assert not shown.changes(data)


def test_a_frame_in_which_nothing_changes_is_not_begun():
    shown = ShownCells()
    text = "\x1b[2;3H\x1b[1mabc\x1b[0m\x1b[1;1H"
    assert [shown.changes(part) for part in (BEGIN, text, END)] == ["", BEGIN + text, END]
    assert [shown.changes(part) for part in (BEGIN, text, END)] == ["", "", ""]
    other = text.replace("b", "x")
    assert shown.changes(BEGIN + other + END) == f"{BEGIN}\x1b[2;4H\x1b[1mx\x1b[0m\x1b[1;1H{END}"


def test_what_is_not_understood_passes_and_everything_is_written_after_it():
    shown = ShownCells()
    text = "\x1b[2;3Habc\x1b[1;1H"
    shown.changes(text)
    assert shown.changes("\a" + text) == "\a"
    assert shown.changes("\x1b[?1049h") == "\x1b[?1049h"
    assert shown.changes(text) == text
    assert shown.changes("\x1b]0;a title\a") == "\x1b]0;a title\a"
    assert shown.changes(text) == ""
    shown.forget()
    assert shown.changes(text) == text


def test_a_driver_writes_the_rest():
    written = []

    class Listened(HeadlessDriver):
        def write(self, data):
            written.append(data)

    driver = writing_changes(Listened, ShownCells())
    spared = driver.__new__(driver)
    for _ in range(2):
        spared.write("\x1b[1;1Ha")
    assert "".join(written) == "\x1b[1;1Ha\x1b[1;2H"


class Written(ConsoleApp):
    """Keeps the frames that it would write."""

    def __init__(self, station):
        super().__init__(station)
        self.frames = []

    def _display(self, screen, renderable):
        super()._display(screen, renderable)
        if renderable is not None and not self._batch_count:
            self.frames.append(renderable.render_segments(self.console) + "\x1b[1;1H")


async def test_a_cursor_key_writes_one_frame_of_what_changes():
    app = Written(FakeStation())
    shown, whole, spared = ShownCells(), Terminal(), Terminal()

    async def pressed(key) -> list[int]:
        """Return the sizes of the frames that a key makes."""
        await pilot.press(key)
        await pilot.pause(0.05)
        sizes = []
        for data in app.frames:
            whole.write(data)
            spared.write(rest := shown.changes(data))
            sizes.append(len(rest))
        app.frames.clear()
        return [size for size in sizes if size]

    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert sum(await pressed("j")) > 2000  # the first frame of all is in it
        for key in ("j", "k", "j"):
            assert [size < 500 for size in await pressed(key)] == [True]
        for key in ("end", "m", "question_mark", "escape", "s"):
            await pressed(key)
            assert spared.cells == whole.cells
