"""A report in a browser: nothing is loaded or complained of, everything is accessible and printed.

Needs the extra `browser` and Chromium in the system; what is not there is skipped.
"""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from extras import needed

import anaplot
from anaplot.cli import main
from anaplot.exchange.blockfolder import write_image_points

playwright = needed("playwright.sync_api", "browser")
axe = needed("axe_playwright_python.sync_playwright", "browser")

pytestmark = [pytest.mark.slow, pytest.mark.long, pytest.mark.xdist_group("browser")]

WRONG = ("102", "01-02")
HOSTILE = "<img src=x onerror=alert(1)>"


def chromium() -> str:
    found = (shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome"))
    path = next((one for one in found if one is not None), None)
    if path is None:
        pytest.skip("no Chromium in the system")
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    where = chromium()
    with playwright.sync_playwright() as driver:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("TMPDIR", "/tmp")
            started = driver.chromium.launch(executable_path=where, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a planned block with noise, an error, and a name that would be markup."""
    folder = tmp_path_factory.mktemp("browser")
    block, page = folder / "block", folder / "r.html"
    with contextlib.redirect_stdout(io.StringIO()):
        assert main(["plan", "block", "--strips", "2", "--photos", "4", "--to", str(block)]) == 0
        rng = np.random.default_rng(3)
        rows = [
            replace(
                row,
                point={"02-02": HOSTILE}.get(row.point, row.point),
                x=row.x + 0.005 * rng.normal(),
                y=row.y + 0.005 * rng.normal() + 0.08 * ((row.photo, row.point) == WRONG),
            )
            for row in anaplot.read_block(block).image_points
        ]
        write_image_points(block, rows)
        assert main(["report", str(block), "-o", str(page), "--errors", "baarda"]) == 0
    return page


class Visit:
    """A page that is open, with what it said and asked for."""

    def __init__(self, browser: Any, page: Path, **how: Any) -> None:
        self.tab = browser.new_page(**how)
        self.said: list[str] = []
        self.asked: list[str] = []
        self.tab.on("console", lambda message: self.said.append(message.text))
        self.tab.on("pageerror", lambda error: self.said.append(str(error)))
        self.tab.on("dialog", lambda dialog: self.said.append(dialog.message))
        self.tab.on("request", lambda request: self.asked.append(request.url))
        self.tab.goto(page.as_uri())


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_loaded_said_or_inaccessible(browser: Any, report: Path, scheme: str) -> None:
    visit = Visit(browser, report, color_scheme=scheme, viewport={"width": 1280, "height": 900})
    visit.tab.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    found = axe.Axe().run(visit.tab).response["violations"]
    said = {one["id"]: [node["html"][:120] for node in one["nodes"][:3]] for one in found}
    assert said == {}
    assert visit.said == []
    assert visit.asked == [report.as_uri()]
    visit.tab.close()


def test_nothing_is_wider_than_a_telephone(browser: Any, report: Path) -> None:
    visit = Visit(browser, report, viewport={"width": 400, "height": 800})
    visit.tab.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    assert visit.tab.evaluate("document.documentElement.scrollWidth") <= 400
    visit.tab.close()


@pytest.mark.parametrize("kind", ["bridge", "compare", "plan network"])
def test_pages_of_other_commands_are_no_louder(
    browser: Any, report: Path, tmp_path: Path, kind: str
) -> None:
    block, page = report.parent / "block", tmp_path / "page.html"
    arguments = {"bridge": [str(block), "--errors", "tau"], "plan network": ["cube"]}
    if kind == "compare":
        later = shutil.copytree(block, tmp_path / "later")
        rng = np.random.default_rng(4)
        rows = anaplot.read_block(block).image_points
        moved = [
            replace(r, x=r.x + 0.005 * rng.normal(), y=r.y + 0.005 * rng.normal()) for r in rows
        ]
        write_image_points(later, moved)
        arguments[kind] = [str(block), str(later)]
    with contextlib.redirect_stdout(io.StringIO()):
        assert main([*kind.split(), *arguments[kind], "--report", str(page)]) == 0
    visit = Visit(browser, page, viewport={"width": 400, "height": 800})
    visit.tab.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    assert visit.tab.evaluate("document.documentElement.scrollWidth") <= 400
    assert visit.tab.locator("#verdict li").count() == 5
    found = axe.Axe().run(visit.tab).response["violations"]
    assert [one["id"] for one in found] == []
    assert visit.said == []
    assert visit.asked == [page.as_uri()]
    visit.tab.close()


def test_tables_are_sorted_by_a_press_on_a_heading(browser: Any, report: Path) -> None:
    visit = Visit(browser, report)
    visit.tab.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    rows = "[...document.querySelectorAll('#table-points tbody tr')]"
    column = f"{rows}.map(row => +row.cells[3].innerText)"
    before = visit.tab.evaluate(column)
    button = visit.tab.locator("#table-points thead th[data-key=Z] button")
    button.press("Enter")
    assert visit.tab.evaluate(column) == sorted(before)
    button.press("Enter")
    assert visit.tab.evaluate(column) == sorted(before, reverse=True)
    head = visit.tab.locator("#table-points thead th[data-key=Z]")
    assert head.get_attribute("aria-sort") == "descending"
    assert visit.said == []
    visit.tab.close()


def test_it_is_read_without_scripts(browser: Any, report: Path) -> None:
    context = browser.new_context(java_script_enabled=False)
    visit = Visit(context, report)
    assert visit.tab.locator("#verdict li").count() == 5
    visit.tab.locator("#points summary").click()
    assert visit.tab.locator("#table-points").is_visible()
    context.close()


def test_paper_has_every_table_whole(browser: Any, report: Path, tmp_path: Path) -> None:
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext in the system")
    visit = Visit(browser, report, color_scheme="dark")
    paper = tmp_path / "r.pdf"
    visit.tab.pdf(path=str(paper), prefer_css_page_size=True, print_background=True)
    visit.tab.close()
    done = subprocess.run(
        ["pdftotext", "-layout", str(paper), "-"],
        check=True, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    pages = done.stdout.split("\f")[:-1]
    assert len(pages) > 5
    lines = [set(line.split()) for line in done.stdout.splitlines()]
    html = report.read_text(encoding="utf-8")
    rows = re.findall(r"<tr(?: class=\"look\")?>(<th scope=\"row\">.*?)</tr>", html)
    assert len(rows) > 200
    missing = []
    for row in rows:
        cells = [unescape(re.sub("<.*?>", "", cell)) for cell in re.split("</t[dh]>", row)]
        numbers = [cell for cell in cells if re.fullmatch(r"-?\d+\.\d+", cell)]
        # the numbers of a row stand in one line of the paper, whatever is wrapped beside them
        if not any(line.issuperset(numbers) for line in lines):
            missing.append(cells)
    assert missing == []
    # the headings of a table that goes on stand on every page of it
    rays = [page for page in pages if "EFFECT" in page and "LENGTH" in page]
    assert len(rays) > 1
