"""CITATION.cff: what the format wants, and what the project itself says."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from anaplot.version import __version__

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def plain_yaml(text: str) -> dict[str, Any]:
    """Read what the file needs of YAML: keys at the margin with a value, a list or folded lines.

    Anything else is an error, so that nothing is read otherwise than by a reader of YAML.
    """
    found: dict[str, Any] = {}
    key = ""
    for line in text.splitlines():
        if match := re.fullmatch(r"([a-z-]+):(?: (.*))?", line):
            key, value = match[1], match[2] or ""
            assert key not in found, f"{key} twice"
            quoted = re.fullmatch(r'"([^"\\]*)"', value)
            assert quoted or not re.search(r"^[\"'&*!|@`%{\[]|: | #", value), line
            found[key] = [] if not value else quoted[1] if quoted else value
        elif re.fullmatch(r"  +\S.*", line):
            if found[key] == ">-" or (isinstance(found[key], str) and found[key].startswith(">- ")):
                found[key] += " " + line.strip()
            else:
                assert isinstance(found[key], list), line
                found[key].append(line.strip())
        else:
            raise AssertionError(line)
    return {k: v.removeprefix(">- ") if isinstance(v, str) else v for k, v in found.items()}


def test_it_has_what_version_1_2_wants() -> None:
    found = plain_yaml(TEXT)
    assert found["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= found.keys()
    assert found["type"] == "software"
    assert found["authors"] == ["- name: the anaplot developers"]
    known = {"abstract", "license", "version", "keywords", "references", "cff-version", "message"}
    assert found.keys() <= known | {"title", "authors", "type"}


def test_it_says_what_the_project_says() -> None:
    found = plain_yaml(TEXT)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert found["version"] == __version__
    assert found["license"] == project["license"]
    assert found["title"].startswith(project["name"])


def test_a_reader_of_yaml_reads_the_same() -> None:
    yaml = pytest.importorskip("yaml")
    read, found = yaml.safe_load(TEXT), plain_yaml(TEXT)
    assert read.keys() == found.keys()
    assert read["authors"] == [{"name": "the anaplot developers"}]
    assert all(read[key] == found[key] for key in ("version", "license", "title", "message"))
    assert read["abstract"] == found["abstract"]
    assert read["references"][0]["year"] == 1983
