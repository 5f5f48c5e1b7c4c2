"""The documents name what is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
FILE = re.compile(r"`((?:[\w-]+/)*[\w-]+\.(?:py|toml|md)|(?:[\w-]+/)+)`")
LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


def test_the_house_stands_as_it_is_described() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = FILE.findall(page)
    assert len(named) > 40
    missing = [n for n in named if not any((at / n).exists() for at in (ROOT, ROOT / "anaplot"))]
    assert missing == []
    rooms = {p.name for p in (ROOT / "anaplot").iterdir() if (p / "__init__.py").is_file()}
    assert rooms == {n.rstrip("/") for n in re.findall(r"^\| `(\w+/)`", page, re.MULTILINE)}
