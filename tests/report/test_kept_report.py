"""Reports that are kept in a block's folder."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

import pytest

from anaplot.cli import main
from anaplot.console.reportwriting import reports_of
from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.blockpack import pack_block
from anaplot.report.adjustcommand import adjust
from anaplot.report.html.render import is_report
from anaplot.report.keptreport import REPORTS, keep_report


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "block"
    options = [
        "--strips",
        "2",
        "--photos",
        "3",
        "--points",
        "5x5",
        "--sidelap",
        "60",
        "--control-m",
        "0.05",
        "--to",
        str(folder),
    ]
    assert main(["plan", "block", *options]) == 0
    return folder


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def test_every_report_is_one_more_and_the_block_is_as_it_was(folder: Path, tmp_path: Path) -> None:
    before, block = files(folder), read_block(folder)
    pages = [keep_report(folder).page for _ in range(3)]
    assert len(set(pages)) == 3
    for page in pages:
        assert page.parent == folder / REPORTS
        assert re.fullmatch(r"\d{4}-\d\d-\d\d-\d{4}(-[23])?\.html", page.name)
        assert is_report(page.read_bytes())
    assert files(folder) == before | {REPORTS, *(f"{REPORTS}/{page.name}" for page in pages)}
    assert read_block(folder) == block
    assert not any(REPORTS in name for name in pack_block(folder, tmp_path / "packed.zip"))


def test_the_name_of_anything_is_left_to_it(folder: Path) -> None:
    first = keep_report(folder).page
    first.unlink()
    tables = first.with_name(first.name + ".tables")
    tables.mkdir()
    other = keep_report(folder).page
    assert other != first
    assert list(tables.iterdir()) == []


def test_the_datum_is_that_of_the_call(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def noting(block: Path, **options: object) -> object:
        asked.append(options["datum"])
        return adjust(block)

    monkeypatch.setattr("anaplot.report.keptreport.adjust", noting)
    keep_report(folder, datum="free")
    # the console's key asks by whether the block is free of control
    write = reports_of(folder)
    pages = [write(free=free, progress=lambda *_: None) for free in (True, False)]
    assert asked == ["free", "free", "control"]
    assert all(page.parent == folder / REPORTS and page.exists() for page in pages)


def without_control(folder: Path) -> None:
    (folder / "control.csv").unlink()


def test_without_control_the_datum_is_free_and_the_page_says_so(folder: Path) -> None:
    without_control(folder)
    page = reports_of(folder)(free=False, progress=lambda *_: None)
    text = re.sub(r"<[^>]*>", "", page.read_text(encoding="utf-8"))
    said = "the datum is free (as with --datum free): there is no control and no prior orientation"
    # verdict, at a glance, what it was computed with
    assert text.count(said) == 3
    assert "m stands for its unit of length" in text


def test_a_report_takes_a_free_datum_where_control_leaves_it_open(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    control = (folder / "control.csv").read_text(encoding="utf-8").splitlines()
    (folder / "control.csv").write_text("\n".join(control[:3]) + "\n", encoding="utf-8")
    page = tmp_path / "r.html"
    command = ["report", str(folder), "-o", str(page)]
    for words in (["--datum", "control"], ["--errors", "odds", "--control-last"]):
        assert main([*command, *words]) == 4
        assert "not determined" in capsys.readouterr().err
        assert not page.exists()
    assert main(command) == 0
    assert "the datum is free" in capsys.readouterr().out
    assert main([*command, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["datum"]["kind"] == "free"
    assert answer["report"]["free_datum"] == "too little"
    assert main([*command, "--datum", "free", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["report"]["free_datum"] is None


def test_a_block_that_cannot_be_adjusted_leaves_nothing(folder: Path) -> None:
    without_control(folder)
    with pytest.raises(NotComputableError, match="no control"):
        keep_report(folder, datum="control")
    assert not (folder / REPORTS).exists()


def test_what_progress_raises_ends_it_and_nothing_is_left(folder: Path) -> None:
    class EnoughError(Exception):
        pass

    def enough(_what: str, _share: float) -> None:
        raise EnoughError

    with pytest.raises(EnoughError):
        keep_report(folder, progress=enough)
    assert not (folder / REPORTS).exists()


def test_it_can_be_given_up_until_the_page_has_its_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class EnoughError(Exception):
        pass

    told: list[str] = []

    def telling(what: str, _share: float) -> None:
        assert not list(folder.glob(f"{REPORTS}/*.html"))
        told.append(what)
        if len(told) == stop:
            raise EnoughError

    # of the adjustment nothing is told here
    monkeypatch.setattr(
        "anaplot.report.keptreport.adjust", lambda block, *, datum, progress: adjust(block)
    )
    stop = 0
    keep_report(folder, progress=telling).page.unlink()
    (folder / REPORTS).rmdir()
    most = len(told)
    assert {"accidents of numbering", "models", "tables of models", "the page"} <= set(told)
    for share in (0.0, 0.5, 1.0):
        stop = max(int(share * most), 1)
        told.clear()
        with pytest.raises(EnoughError):
            keep_report(folder, progress=telling)
        assert not (folder / REPORTS).exists()


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root writes anywhere")
def test_a_block_that_cannot_be_written_is_one_line(folder: Path) -> None:
    folder.chmod(0o500)
    try:
        with pytest.raises(InputError, match=REPORTS):
            keep_report(folder)
    finally:
        folder.chmod(0o700)


def test_a_file_in_the_place_of_the_folder_is_one_line(folder: Path) -> None:
    (folder / REPORTS).write_text("mine")
    with pytest.raises(InputError, match=REPORTS):
        keep_report(folder)
    assert (folder / REPORTS).read_text() == "mine"
    assert adjust(folder).document.answer["redundancy"] > 0
