"""A report: one page that stands by itself, whose numbers are those of --json."""

from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path

import pytest

from anaplot.drawing.drawing import Drawing
from anaplot.errors import InputError
from anaplot.report.document import name, number, say, table
from anaplot.report.html.parts import Report, Section
from anaplot.report.html.render import html_of
from anaplot.report.html.views import page_view
from anaplot.report.html.write import check_report, write_report

HOSTILE = "</td><script>alert(1)</script>\u202e\x1b[2J"
COLUMNS = (name("point", "POINT", 5), number("X", "X", 3, 12, unit="m"), name("flagged", look=bool))


def report(rows: int, title: str = "block") -> Report:
    data = [(f"{title}{k}", k / 7.0, "<< CHECK" if k % 100 == 3 else "") for k in range(rows)]
    found = table("points", COLUMNS, data)
    drawing = Drawing("map", "Map", "A map.", '<svg class="drawing" role="img"></svg>')
    inner = Section("inner", say("of {}", title), (found, drawing), folded=True)
    line = say("look at {}", title).of("look")
    return Report(say("{}", title), (line,), (Section("outer", "Outer", (line, inner)),))


def test_what_a_file_says_is_no_markup() -> None:
    text = html_of(report(3, HOSTILE))
    assert "<script>alert" not in text
    assert text.count("<script>") == 1
    assert "\x1b" not in text
    assert "\u202e" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text


def test_the_policy_lets_its_own_style_and_script_run_and_nothing_else() -> None:
    text = html_of(report(3))
    [policy] = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)
    assert policy.startswith("default-src &#39;none&#39;;")
    for tag in ("style", "script"):
        [inside] = re.findall(f"<{tag}>(.*?)</{tag}>", text, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()
        assert f"{tag}-src &#39;sha256-{digest}&#39;" in policy
    assert not re.search(r"(?:src|href)=\"(?!#)", text)
    assert "://" not in text
    assert " style=" not in text


def test_a_cut_table_stands_whole_beside_the_page(tmp_path: Path) -> None:
    page = tmp_path / "r.html"
    written = write_report(report(250), page, tmp_path / "figures", most_rows=100)
    text = page.read_text(encoding="utf-8")
    assert text.count('<th scope="row">') == 3
    assert "3 of 250 rows are shown, those that need a look" in text
    [whole] = written.cut
    assert whole.relative_to(tmp_path).as_posix() in text
    assert len(whole.read_text().splitlines()) == 251
    assert (tmp_path / "figures" / "map.svg").read_text().startswith("<?xml")


def test_of_a_long_table_that_needs_no_look_the_first_rows_are_shown(tmp_path: Path) -> None:
    rows = [(f"p{k}", float(k), "") for k in range(250)]
    whole = Report(say("x"), (), (Section("s", "S", (table("points", COLUMNS, rows),)),))
    text = html_of(page_view(whole, most_rows=100, beside="r.html.tables"))
    assert re.findall(r'<th scope="row"><bdi>(p\d+)</bdi>', text) == [f"p{k}" for k in range(50)]
    assert "50 of 250 rows are shown, the first, since none needs a look; r.html.tables/" in text


def test_an_earlier_report_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "r.html"
    write_report(report(250), page, tmp_path / "f", most_rows=100)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*.*") if file.is_file()}
    assert len(before) == 3

    def interrupted(*_: object) -> None:
        told.append(1)
        if len(told) == len(before):
            raise KeyboardInterrupt

    # the page was the old one, beside a table of the new one
    told: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        write_report(report(251), page, tmp_path / "f", most_rows=100, progress=interrupted)
    assert {file: file.read_bytes() for file in before} == before
    write_report(report(251), page, tmp_path / "f", most_rows=100)
    assert page.read_bytes() != before[page]
    write_report(report(3), page, tmp_path / "f")
    assert list((tmp_path / "r.html.tables").iterdir()) == []
    other = tmp_path / "notes.html"
    other.write_text("<html>mine</html>")
    with pytest.raises(InputError, match="is no report, and is not overwritten"):
        write_report(report(3), other)
    assert other.read_text() == "<html>mine</html>"
    write_report(report(251), page, most_rows=100)
    for foreign in ("mine.txt", "mine.csv"):
        mine = tmp_path / "r.html.tables" / foreign
        mine.write_text("mine")
        with pytest.raises(InputError, match=f"tables: holds '{foreign}', which no report"):
            write_report(report(3), page)
        assert mine.read_text() == "mine"
        mine.unlink()
    mine = tmp_path / "f" / "mine.svg"
    mine.write_text("<svg/>")
    with pytest.raises(InputError, match="nor one of figures alone"):
        write_report(report(3), page, tmp_path / "f")
    assert mine.read_text() == "<svg/>"
    new = tmp_path / "n.html"
    for figures in (new, tmp_path / "n.html.tables", tmp_path / "f" / ".." / "n.html.tables"):
        with pytest.raises(InputError, match="no folder for figures"):
            check_report(new, figures)
        with pytest.raises(InputError, match="no folder for figures"):
            write_report(report(250), new, figures, most_rows=100)
    assert not new.exists()
