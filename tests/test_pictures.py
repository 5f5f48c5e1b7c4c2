"""The pictures in README and documents are those that the program draws today."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from pictures import PAGE, PICTURES, pictures, told, without_network, words, written_report

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "pictures"
LARGEST = 150_000  # bytes
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md"))]


def kept(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def test_the_folder_has_the_pictures_and_each_is_shown_somewhere() -> None:
    assert sorted(path.name for path in FOLDER.iterdir()) == sorted((*PICTURES, PAGE))
    pages = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    for name in (*PICTURES, PAGE):
        # with words for those who do not see it
        assert re.search(rf"!\[[^\]]{{20,}}\]\((?:docs/)?pictures/{re.escape(name)}\)", pages), name


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_fetches_nothing_and_tells_nothing_of_where_it_was_taken(name: str) -> None:
    text = kept(name)
    assert len(text.encode()) < LARGEST
    ElementTree.fromstring(text)
    assert set(re.findall(r"https?://[^\s\"')]+", text)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"@font-face|@import|<script|<image|<foreignObject|\bon\w+=", text)
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", text))
    said = words(text)
    assert len(said) > 100
    assert not re.search(r"/tmp|/home|/dev|\d{4}-\d\d-\d\d|\d\d:\d\d:\d\d", said)


def test_a_link_to_a_font_is_taken_out() -> None:
    svg = (
        "<svg>\n    <!-- Generated with Rich https://example.org -->\n<style>\n"
        '    @font-face {\n  font-family: "Fira Code";\n  src: url("https://example.org/f");\n }\n'
        "    .m {\n font-family: Fira Code, monospace;\n }\n</style></svg>"
    )
    clean = without_network(svg)
    assert "example.org" not in clean
    assert "Fira" not in clean
    assert "monospace;" in clean


@pytest.mark.slow
def test_the_verdict_in_the_picture_of_the_report_is_that_of_today(tmp_path: Path) -> None:
    png = (FOLDER / PAGE).read_bytes()
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    assert len(png) < LARGEST
    page, verdict = written_report(tmp_path)
    above, _ = page.read_text(encoding="utf-8").split("Sound", 1)
    assert not re.search(r"\d{4}-\d\d-\d\d|\d\d:\d\d", re.sub(r"(?s)<head>.*</head>", "", above))
    assert len(verdict.splitlines()) == 5
    assert told(png) == verdict, "python tests/pictures.py docs/pictures --browser chromium"


@pytest.mark.slow
def test_they_are_those_that_the_program_draws_today_whenever_they_are_taken() -> None:
    first, second = (asyncio.run(pictures()) for _ in range(2))
    assert first == second
    for name in PICTURES:
        assert first[name] == kept(name), f"{name}: python tests/pictures.py docs/pictures"
