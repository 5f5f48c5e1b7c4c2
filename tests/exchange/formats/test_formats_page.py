"""docs/formats.md: the format that it writes out is one, and its commands are known."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import pytest

from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats import registry
from anaplot.report.doorarguments import add_export_arguments, add_import_arguments

PAGE = Path(__file__).parents[3] / "docs" / "formats.md"
MARKS = "marks 152.4\n101 7 1.5 -2.25\n101 8 0.5 0.1\n102 7 -90.25 3.0\n101 7 1.75 -2.0\n"


@pytest.fixture
def marks(monkeypatch: pytest.MonkeyPatch) -> None:
    """The format of the page, as its module."""
    page = PAGE.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (line,) = re.findall(r"`(Format\(.*?\))`;? ?", page.replace("\n", " "))
    module = ModuleType("anaplot.exchange.formats.marks")
    exec(compile(code, str(PAGE), "exec"), module.__dict__)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    declared = eval(line, {"Format": registry.Format})
    monkeypatch.setitem(registry.FORMATS, "marks", declared)


@pytest.mark.usefixtures("marks")
def test_the_format_of_the_page_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("plates.txt").write_text(MARKS)
    assert main(["import", "marks", "plates.txt", "-o", "b"]) == 0
    said = capsys.readouterr().out
    assert "2 photos, 1 camera" in said
    assert "doubled: 1 rays" in said
    assert "assumed: 5 um" in said
    block = read_block("b")
    assert [(row.point, row.x, row.use) for row in block.image_points] == [
        ("7", 1.5, "xy"),
        ("8", 0.5, "xy"),
        ("7", -90.25, "xy"),
        ("7~2", 1.75, "off"),
    ]
    assert Path("b/source/plates.txt").read_text() == MARKS
    assert main(["export", "marks", "b", "-o", "again.txt"]) == 0
    assert "dropped: 1 rays that do not count" in capsys.readouterr().out
    assert Path("again.txt").read_text() == "".join(MARKS.splitlines(keepends=True)[:-1])
    Path("plates.txt").write_text(MARKS + "103 1 nan 0\n")
    assert main(["import", "marks", "plates.txt", "-o", "c"]) == 2
    assert "plates.txt line 6: a coordinate must be a finite number" in capsys.readouterr().err


def test_commands_of_the_page_are_what_the_command_line_takes() -> None:
    """Every option and every kind on the page is known, and every format stands on it."""
    page = PAGE.read_text(encoding="utf-8").replace("\\\n", " ")
    commands = re.findall(r"^    anaplot (import|export) (.*)$", page, re.MULTILINE)
    assert len(commands) > 5
    named = set()
    for command, rest in commands:
        parser = argparse.ArgumentParser(exit_on_error=False)
        add_import_arguments(parser) if command == "import" else add_export_arguments(parser)
        options = parser.parse_args(shlex.split(rest))
        named.add(options.kind)
        if command == "export" and options.kind != "KIND":
            assert registry.format_of(options.kind).writes
        known = registry.FORMATS.get(options.kind)
        if known is not None:
            taken = known.import_options if command == "import" else known.export_options
            rest_of = ["kind", "source"] if command == "import" else ["kind", "block"]
            usual = parser.parse_args([*rest_of, "-o", "x"])
            given = {
                key
                for key, value in vars(options).items()
                if value != getattr(usual, key)
                and key not in ("kind", "source", "output", "block", "json")
            }
            assert given <= set(taken), (command, rest)
    assert set(registry.FORMATS) <= named
    for kind in registry.FORMATS:
        assert f"| `{kind}` |" in page
