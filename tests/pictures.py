"""Take the pictures of README and documents anew: screens of the console, report and its figure.

    python tests/pictures.py docs/pictures                      # all but the report's page
    python tests/pictures.py docs/pictures --browser chromium   # that too

Everything in them is simulated from fixed seeds and drawn by the program: no clock, no path, no
terminal. Taken twice they are the same, byte for byte; the report's page, which a browser draws, is
where the browser is. Nothing in them is fetched: the link to a font that Textual writes into its
pictures is taken out. What the page's verdict says is written into its picture as text, too.
"""

from __future__ import annotations

import argparse
import asyncio
import re
import struct
import subprocess
import sys
import tempfile
import threading
import zlib
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from xml.sax.saxutils import unescape

import numpy as np
from textual.pilot import Pilot

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.live import LiveBlock
from anaplot.console.app import ConsoleApp
from anaplot.drawing.standalone import standalone
from anaplot.photogrammetry.block import Block
from anaplot.plotter.readings import Position
from anaplot.report.adjustcommand import adjust
from anaplot.report.astext import line_text
from anaplot.report.figures.blockmap import block_map
from anaplot.report.html.write import write_report
from anaplot.report.planblock import planned_block
from anaplot.report.reportcommand import block_report
from anaplot.session.plates import ReadOut
from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.demo import Demo
from anaplot.simulation.stereo import StereoGround, StereoPair
from anaplot.station.blockanswer import view_of
from anaplot.station.blockview import BlockView
from anaplot.station.snapshot import Snapshot

PICTURES = ("console-table.svg", "console-stereo.svg", "console-block.svg", "report-map.svg")
PAGE = "report-page.png"

_FONTS = '"DejaVu Sans Mono", Menlo, Consolas, "Liberation Mono", monospace'
_SEED = 4
_PAGE = (1000, 460)  # px
_KEYWORD = b"Description\0\0\0\0\0"  # of an iTXt chunk: neither compressed nor in a language
_NEAR = (0.18, 0.06)  # mm beside a point: its mark is seen beside the floating one


class Still:
    """A station at which nothing moves, and its eyepieces."""

    automatic = False
    hand = True

    def __init__(self, snapshot: Snapshot, ground: StereoGround, at: Position) -> None:
        self._snapshot, self._ground, self._at = snapshot, ground, at

    def snapshot(self) -> Snapshot:
        return self._snapshot

    def readout(self) -> ReadOut:
        return ReadOut(*astuple(self._at))

    def subscribe(self, _: object) -> Callable[[], None]:
        return lambda: None

    subscribe_notices = subscribe

    def stereo(self, columns: int, rows: int, field_mm: float) -> StereoPair:
        return self._ground.look(self._at, columns, rows, field_mm)


def measured_model(seed: int = 8) -> Still:
    """Return the demonstration when its first model is measured, and nothing measured again."""
    demo = Demo.make(1, seed)
    seen: list[Snapshot] = []
    complete = threading.Event()

    def look(snapshot: Snapshot) -> None:
        if snapshot.diagnosis is not None and all(p.status != "pending" for p in snapshot.points):
            seen.append(snapshot)
            complete.set()

    with tempfile.TemporaryDirectory() as folder:
        demo.write(Path(folder) / "demo")
        with demo.open(Path(folder) / "demo", 1000.0) as station:
            station.subscribe(look)
            operator = AutomaticOperator(station)
            operator.start(lambda *_: None)
            if not complete.wait(60.0):
                raise SystemExit("the simulated operator did not come to the end of a model")
            operator.stop()
    found = seen[0]
    truth = demo.strip.truth
    left, right = truth[found.left], truth[found.right]
    point = found.next_point or found.points[0].point
    (x1, y1), (x2, y2) = left[point], right[point]
    dx, dy = _NEAR
    return Still(
        replace(
            found,
            link=replace(found.link, state="live", port="", detail=""),
            block_view=None,
            status=None,
            target=point,
        ),
        StereoGround(found.left, found.right, left, right),
        Position(x1 + dx, y1, x2 + dx, y2 + dy),
    )


def flown_block() -> Block:
    """Return three strips of six photos with 5 um of noise, and one point identified wrongly."""
    block = planned_block(strips=3, photos=6, control_m=0.05, measured="mono").result.block
    planned = block.problem.block
    random = np.random.default_rng(_SEED)
    rows = [
        replace(row, x=row.x + dx, y=row.y + dy)
        for row, (dx, dy) in zip(
            planned.image_points,
            random.normal(0.0, 1e-3 * planned.precision.image_um, (len(planned.image_points), 2)),
            strict=True,
        )
    ]
    wrong = next(k for k, row in enumerate(rows) if row.photo == "203" and row.point == "03-03")
    rows[wrong] = replace(rows[wrong], x=rows[wrong].x + 0.06)
    return replace(planned, name="flown", image_points=tuple(rows))


def seen_block(block: Block) -> BlockView:
    """Return what the console says of a block that was measured elsewhere."""
    return view_of(LiveBlock(block).update(block), BlockView("", 0, provisional=False), None)


def without_network(svg: str) -> str:
    """Return a picture of Textual's that fetches no font, and says not where it comes from."""
    svg = re.sub(r"\s*@font-face \{[^}]*\}", "", svg)
    svg = re.sub(r"\s*<!-- Generated[^>]*-->", "", svg)
    svg = svg.replace("Fira Code, monospace", _FONTS).replace(
        "font-family: Fira Code", f"font-family: {_FONTS}"
    )
    return "\n".join(line.rstrip() for line in svg.splitlines() if line.strip()) + "\n"


def words(svg: str) -> str:
    """Return what stands in a picture."""
    parts = re.findall(r"<(?:text|title|desc|tspan)\b[^>]*>([^<]*)<", svg)
    return "\n".join(unescape(part, {"&#160;": " ", "&nbsp;": " "}).rstrip() for part in parts)


async def screen(station: Still, size: tuple[int, int], *keys: str) -> str:
    """Return the picture of a screen, some keys after its start."""
    app = ConsoleApp(station, controls=station)  # type: ignore[arg-type]
    async with app.run_test(size=size) as pilot:
        await pilot.press(*keys)
        await _settled(app, pilot)
        return without_network(app.export_screenshot(title="anaplot"))


async def _settled(app: ConsoleApp, pilot: Pilot[int]) -> None:
    """Wait until two pictures in a row are the same."""
    before = ""
    while (now := app.export_screenshot(title="anaplot")) != before:
        before = now
        await pilot.pause(0.2)


async def pictures() -> dict[str, str]:
    """Return the pictures by their names."""
    model, block = measured_model(), flown_block()
    view = seen_block(block)
    drawn = Still(replace(model.snapshot(), block_view=view), model._ground, model._at)
    figure = standalone(block_map(adjust_block(block)))
    screens = [
        await screen(model, (104, 30)),
        await screen(model, (80, 24), "v"),
        await screen(drawn, (132, 36), "b"),
    ]
    return dict(zip(PICTURES, [*screens, figure], strict=True))


def written_report(folder: Path) -> tuple[Path, str]:
    """Write the report of the block; returns its page, and what its verdict says."""
    report = replace(block_report(adjust(flown_block())), lead=None)  # it names the time
    return write_report(report, folder / "report.html").page, "\n".join(
        map(line_text, report.verdict)
    )


def photographed(page: Path, verdict: str, browser: str) -> bytes:
    """Return the upper part of a page as a browser draws it, with what its verdict says."""
    with tempfile.TemporaryDirectory() as folder:
        taken = Path(folder) / "page.png"
        subprocess.run(
            [
                browser,
                *("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"),
                *("--force-device-scale-factor=1", f"--user-data-dir={folder}/profile"),
                f"--window-size={_PAGE[0]},{_PAGE[1]}",
                f"--screenshot={taken}",
                page.as_uri(),
            ],
            check=True,
            capture_output=True,
            timeout=120.0,
        )
        png = taken.read_bytes()
    body = b"iTXt" + _KEYWORD + verdict.encode()
    text = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return png[:-12] + text + png[-12:]  # before IEND


def told(png: bytes) -> str:
    """Return what is written into the picture of a page."""
    at = png.index(b"iTXt")
    (length,) = struct.unpack(">I", png[at - 4 : at])
    return png[at + 4 + len(_KEYWORD) : at + 4 + length].decode()


def main(arguments: list[str] | None = None) -> int:
    """Write the pictures into a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--browser", help="a Chromium, which takes the report's page")
    options = parser.parse_args(arguments)
    folder: Path = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, svg in asyncio.run(pictures()).items():
        (folder / name).write_text(svg, encoding="utf-8", newline="\n")
        print(f"{folder / name}: {len(svg.encode()) / 1e3:.0f} kB")
    if options.browser is not None:
        with tempfile.TemporaryDirectory() as made:
            png = photographed(*written_report(Path(made)), options.browser)
        (folder / PAGE).write_bytes(png)
        print(f"{folder / PAGE}: {len(png) / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
