"""The site of the documents: built without a warning, and nothing in it comes from elsewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from extras import needed

needed("sphinx", "docs")
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("site")]

ROOT = Path(__file__).parents[1]
LOADS = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
STYLED = re.compile(r"@import[^;]+|url\(\s*[\"']?(?!data:)([^)\"']+)")


class Loaded(HTMLParser):
    """What a page fetches when it is opened."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        target = dict(attrs).get(LOADS.get(tag, ""))
        if target is not None:
            self.targets.append(target)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as CONTRIBUTING.md says that it is built."""
    out = tmp_path_factory.mktemp("site")
    strict = [sys.executable, "-m", "sphinx", "-W", "-n", "--keep-going", "-q"]
    done = subprocess.run(
        [*strict, "docs", str(out)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return out


def test_every_document_is_a_page(site: Path) -> None:
    for page in (ROOT / "docs").glob("*.md"):
        assert (site / f"{page.stem}.html").is_file()


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    targets = {target for page in site.glob("*.html") for target in Loaded(page).targets}
    assert any(target.endswith(".css") or ".css?" in target for target in targets)
    assert {target for target in targets if re.match(r"(\w+:)?//", target)} == set()
    styles = list((site / "_static").rglob("*.css"))
    assert styles
    for style in styles:
        for found in STYLED.finditer(style.read_text(encoding="utf-8")):
            assert found[1] is not None, found[0]
            assert not re.match(r"(\w+:)?//", found[1]), found[0]


def test_the_library_has_its_names(site: Path) -> None:
    import anaplot

    page = (site / "api.html").read_text(encoding="utf-8")
    shown = set(re.findall(r'id="anaplot\.(?:[\w.]+\.)?(\w+)"', page))
    assert set(anaplot.__all__) - {"plan"} <= shown
    assert set(anaplot.plan.__all__) <= shown
