"""Commands as processes, and a block to run them on."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anaplot.cli import main
from anaplot.exchange.blockfolder import write_image_points, write_new_block
from anaplot.photogrammetry.block import ImagePoint, TestSettings
from anaplot.planning.synthetic import synthetic_strip
from anaplot.report.commandparser import CommandParser, commands_of

ROOT = Path(__file__).parents[1]
TIMEOUT = 120.0


# what packages announce for their later releases is no failure of today's command
ANNOUNCED = ("DeprecationWarning", "PendingDeprecationWarning", "FutureWarning")
WARNINGS = ",".join(("error", *(f"ignore::{kind}" for kind in ANNOUNCED)))


def every_parser(parser: CommandParser) -> Iterator[CommandParser]:
    """The parser and those of all commands below it."""
    yield parser
    for one in commands_of(parser).values():
        yield from every_parser(one)


def environment(**more: str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": WARNINGS, **more}


def anaplot(
    *arguments: object, env: dict[str, str] | None = None, prefix: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        [*prefix, *command(*arguments)],
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        env=environment(**(env or {})),
        stdin=subprocess.DEVNULL,
        check=False,
    )


def here(
    capsys: pytest.CaptureFixture[str], *arguments: object
) -> subprocess.CompletedProcess[str]:
    """Run a command in this process: nothing is started and loaded for it."""
    capsys.readouterr()
    words = [str(word) for word in arguments]
    try:
        code = main(words)
    except SystemExit as end:
        code = end.code
    return subprocess.CompletedProcess(words, code, *capsys.readouterr())


def command(*arguments: object) -> Sequence[str]:
    return [sys.executable, "-m", "anaplot", *map(str, arguments)]


def one_line(result: subprocess.CompletedProcess[str], code: int, *words: str) -> str:
    """Check that a command ended with one line on standard error, and return it."""
    assert result.returncode == code, (result.stdout, result.stderr)
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("anaplot: ")
    assert lines[0].isprintable()
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in lines[0], lines[0]
    return lines[0]


def make_block(folder: Path, *, photos: int = 3, dy: float = 0.0, kind: str = "baarda") -> Path:
    """Write a measured strip with 3 um noise; `dy` [mm] is a mistake at the point 102-2."""
    made = synthetic_strip(photos, seed=21, image_um=3.0)
    write_new_block(folder, replace(made.block, test=TestSettings(kind=kind, alpha=1e-6)))
    rng = np.random.default_rng(21)
    points = [
        ImagePoint(photo, point, x + rng.normal(0, 0.003), y + rng.normal(0, 0.003))
        for photo, seen in made.truth.items()
        for point, (x, y) in seen.items()
    ]
    moved = [
        replace(p, y=p.y + dy) if (p.photo, p.point) == ("102", "102-2") else p for p in points
    ]
    write_image_points(folder, moved)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
