"""`anaplot report`: numbers are those of --json, names are text, nothing else is written over."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import anaplot
from anaplot.cli import main
from anaplot.exchange.blockfolder import write_image_points
from anaplot.report.document import say
from anaplot.report.html.blocksections import Material, block_sections
from anaplot.report.html.definitions import definition_of
from anaplot.report.html.parts import Report, tables_in
from anaplot.report.html.sections.definitions import columns_shown
from anaplot.report.keptblock import without_rejected

NAMES = {
    "03-02": "<script>alert('x')</script>",
    "02-03": 'نقطة & "zwölf"',
    "04-02": "n" * 200,
}
OPTIONS = ("--errors", "baarda", "--additional", "ebner", "--additional-sigma-um", "5")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A planned block with noise, one gross error, a check point and hostile names."""
    path = tmp_path_factory.mktemp("report") / "block"
    assert main(["plan", "block", "--strips", "2", "--photos", "4", "--to", str(path)]) == 0
    control = (path / "control.csv").read_text(encoding="utf-8")
    control = control.replace("03-04,2760.0,805.0,0.0,0.0,0.0,0.0,control",
                              "03-04,2760.0,805.0,0.0,0.05,0.05,0.05,check")  # fmt: skip
    assert "check" in control
    (path / "control.csv").write_text(control, encoding="utf-8")
    rng = np.random.default_rng(1)
    rows = []
    for row in anaplot.read_block(path).image_points:
        x, y = rng.normal(size=2) * 0.005
        wrong = 0.08 if (row.photo, row.point) == ("102", "01-02") else 0.0
        point = NAMES.get(row.point, row.point)
        rows.append(replace(row, point=point, x=row.x + x, y=row.y + y + wrong))
    write_image_points(path, rows)
    return path


class Tables(HTMLParser):
    """Reads the tables of a page back: by their ids the keys and the cells of each row."""

    def __init__(self) -> None:
        super().__init__()
        self.keys: dict[str, list[str]] = {}
        self.rows: dict[str, list[list[str]]] = {}
        self._table, self._text = "", None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = dict(attrs)
        if tag == "table":
            self._table = said.get("id") or ""
            self.keys[self._table], self.rows[self._table] = [], []
        elif tag == "tr":
            self.rows[self._table].append([])
        elif tag in ("td", "th"):
            self._text = ""
            if "data-key" in said:
                self.keys[self._table].append(said["data-key"] or "")
        elif tag == "bdi" and said.get("title") and self._text is not None:
            self._text, self._whole = "", said["title"] or ""

    _whole = ""

    def handle_data(self, data: str) -> None:
        if self._text is not None:
            self._text += data

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th") and self._text is not None:
            self.rows[self._table][-1].append(self._whole or self._text)
            self._text, self._whole = None, ""


def read(page: Path) -> Tables:
    tables = Tables()
    tables.feed(page.read_text(encoding="utf-8"))
    return tables


def lists(answer: Any) -> Iterator[list[dict[str, Any]]]:
    """Every list of rows in an answer, and the image coordinates with a row for each axis."""
    if isinstance(answer, dict):
        if "image_points" in answer:
            yield [
                {"photo": one["photo"], "point": one["point"], "axis": axis,
                 "v_um": one[f"v{axis}_um"], "r": one[f"r{axis}"], "w": one[f"w{axis}"],
                 "mdb_um": one[f"mdb_{axis}_um"], "effect": one[f"effect_{axis}"],
                 "largest_effect": one[f"largest_effect_{axis}"],
                 "largest_effect_at": one[f"largest_effect_at_{axis}"],
                 "standardized_effect": one[f"standardized_effect_{axis}"], "verdict": ...}
                for one in answer["image_points"]
                for axis in "xy"
            ]  # fmt: skip
        for value in answer.values():
            yield from lists(value)
    elif isinstance(answer, list):
        if answer and all(isinstance(one, dict) for one in answer):
            yield answer
        for value in answer:
            yield from lists(value)


IN_WORDS = {"unit", "verdict", "COORDINATE", "look"}  # for people only
LENGTHS = ("effect", "largest_effect")  # vectors in m, of which people read the length in mm


def agrees(text: str, value: Any, scale: float) -> bool:
    """Whether a cell is a value, rounded to as many decimals as it shows."""
    if value is ... or isinstance(value, bool):
        return True  # in words
    if value is None:
        return text in ("-", "", "not tested")
    if isinstance(value, str):
        return text == value
    if isinstance(value, dict | list):
        return True
    if value in (0.0, 1.0) and not any(one.isdigit() for one in text):
        return True  # a yes or no of CSV, in words
    if text.startswith("<"):
        return float(text[1:]) > value
    half = 0.5 * 10.0 ** -len(text.partition("e")[0].partition(".")[2])
    if "e" in text:
        half *= 10.0 ** int(text.partition("e")[2])
    return abs(float(text) - value * scale) <= half * (1 + 1e-9) + 1e-12


@pytest.fixture(scope="module")
def written(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A page, and what the same command prints with --json and writes with --to."""
    place = tmp_path_factory.mktemp("page")
    page, csv_files = place / "r.html", place / "csv"
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        to = ("-o", str(page), "--json", "--to", str(csv_files))
        assert main(["report", str(folder), *to, *OPTIONS]) == 0
        begun = printed.tell()
        assert main(["bridge", str(without_errors(folder, place)), "--json"]) == 0
    text = printed.getvalue()
    answer = {**json.loads(text[:begun]), "bridge": json.loads(text[begun:])}
    answer["files"] = [
        [
            {key: value_of(text) for key, text in row.items()}
            for row in csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))
        ]
        for path in csv_files.glob("*.csv")
    ]
    return page, answer


def put_together(answer: dict[str, Any]) -> Iterator[list[dict[str, Any]]]:
    """Tables that a page puts together of several rows, and matrices."""
    matrix = answer["additional"]["matrix"]
    names = [row["name"] for row in matrix["rows"]]
    yield [
        {"parameter": of, **{f"_{k}": value for k, value in enumerate(row)}}
        for of, row in zip(names, matrix["values"], strict=True)
    ]
    overview = []
    for strip in answer["bridge"]["strips"]:
        for model in strip["models"]:
            accuracy = model["accuracy"]
            elements, rho = accuracy["elements"], accuracy["correlations"]
            yield matrix_rows("element", elements, rho)
            angles = ("omega", "phi", "kappa")
            axes = ("bx", "by", "bz")
            yield [
                {"what": what, **dict(zip(axes, of["base"], strict=True)),
                 **{angle: of["rotation"][angle] for angle in angles}}
                for what, of in (("value", model), ("+-", accuracy))
            ]  # fmt: skip
            of_pair = {(i, j): rho[i][j] for i in range(len(rho)) for j in range(i + 1, len(rho))}
            i, j = max(of_pair, key=lambda pair: abs(of_pair[pair]))
            rows = [row for row in model["table"] if row["sigf"] is not None]
            worst = max(rows, key=lambda row: row["sigf"], default=None)
            overview.append(
                {"strip": strip["strip"], **{k: model[k] for k in ("left", "right")},
                 "sigma0_um": model["sigma0_um"], "redundancy": model["redundancy"],
                 "ties": len(model["ties"]), "largest": worst and worst["sigf"],
                 "at": worst and f"{worst['point']} {worst['axis']}",
                 "flagged": sum(row["flagged"] for row in model["table"]),
                 "off": sum(bool(row.get("off")) for row in model["table"]),
                 "correlation": of_pair[i, j], "of": f"{elements[i]} {elements[j]}",
                 "look": ...}
            )  # fmt: skip
    yield overview


def matrix_rows(key: str, names: list[str], values: list[list[float]]) -> list[dict[str, Any]]:
    return [{key: of, **dict(zip(names, row, strict=True))}
            for of, row in zip(names, values, strict=True)]  # fmt: skip


def told_of(row: dict[str, Any], key: str) -> Any:
    """What an answer has in a row; of a vector [m] its length [mm]."""
    value = row.get(key, ...)
    return (
        1e3 * float(np.linalg.norm(value)) if isinstance(value, list) and key in LENGTHS else value
    )


def without_errors(folder: Path, place: Path) -> Path:
    """The block without the image points that `OPTIONS` reject a coordinate of."""
    found = anaplot.adjust(folder, errors="baarda", additional="ebner", additional_sigma_um=5.0)
    assert found.result.rejected
    kept = shutil.copytree(folder, place / "kept")
    write_image_points(kept, without_rejected(found.result.block).image_points)
    return kept


def value_of(text: str) -> Any:
    """What a cell of a CSV file says."""
    try:
        return float(text) if text else None
    except ValueError:
        return text


def scale_of(table: str, key: str) -> float:
    angles = ("omega", "phi", "kappa", "somega", "sphi", "skappa")
    if table.startswith("table-correlations"):
        return 1.0
    if key in angles or (table == "table-accuracy-angles" and key != "unknown"):
        return 180.0 / pi
    if table in ("table-overlaps",) and key in ("share", "overlap"):
        return 100.0
    effects = ("table-parameters", "table-hypotheses-parameters")  # mm, which people read in um
    return 1e3 if table.startswith(effects) and key in ("value", "s", "detectable") else 1.0


def test_every_cell_is_the_number_of_json_rounded(
    written: tuple[Path, dict[str, Any]],
) -> None:
    page, answer = written
    tables = read(page)
    every = [*lists(answer), *put_together(answer)]
    compared = set()
    for name, keys in tables.keys.items():
        rows = [row for row in tables.rows[name] if len(row) == len(keys)][1:]
        if not rows or not keys:
            continue
        for one in every:
            if (
                len(one) >= len(rows)
                and set(keys) - IN_WORDS <= set(one[0])
                and all(
                    agrees(text, told_of(found, key), scale_of(name, key))
                    for row, found in zip(rows, one, strict=False)
                    for key, text in zip(keys, row, strict=True)
                )
            ):
                compared.add(name)
    assert set(tables.keys) - {""} - compared == set()
    assert len(compared) >= 14


def test_names_of_files_are_text(written: tuple[Path, dict[str, Any]]) -> None:
    page, _ = written
    text = page.read_text(encoding="utf-8")
    assert text.count("<script>") == 1
    assert "<bdi>&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;</bdi>" in text
    assert "<bdi>نقطة &amp; &#34;zwölf&#34;</bdi>" in text
    assert f'title="{"n" * 200}"' in text
    assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")
    assert "https://" not in text


def test_every_column_has_a_definition(folder: Path) -> None:
    found = anaplot.adjust(
        folder, errors="baarda", additional="ebner", additional_sigma_um=5.0, snooping=True,
        components="axes", correlations=0.5, function=["distance 01-01 01-04"],
        covariance=["points:01-02,01-03"], test_set=["point:01-02"],
    )  # fmt: skip
    report = Report(say("x"), (), block_sections(Material(found, folder)))
    shown = columns_shown(report)
    assert len(shown) > 60
    assert {(key, one.key) for key, one in shown if definition_of(key, one.key) is None} == set()
    # the pairs of a point's rays, and the matrix of a model's orientation, have the same key
    said = {key: definition_of("correlations", key) for key in ("point", "first_photo", "phi")}
    assert said["point"] == definition_of("rays", "point")
    assert len(set(said.values())) == 3
    tables = {table.key for table in tables_in(report.sections)}
    people = {one.key for one in found.document.tables if one.for_people() and len(one)}
    assert people - tables == set()


def test_nothing_is_written_over_what_is_no_report(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.html"
    mine.write_text("mine", encoding="utf-8")
    assert main(["report", str(folder), "-o", str(mine)]) == 2
    assert main(["report", str(folder), "-o", str(folder / "block.toml")]) == 2
    assert main(["report", str(folder), "-o", str(tmp_path / "no" / "r.html")]) == 2
    assert capsys.readouterr().out == ""
    assert mine.read_text(encoding="utf-8") == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.html"]


def test_it_says_from_which_bytes_it_comes(
    written: tuple[Path, dict[str, Any]], folder: Path
) -> None:
    page, answer = written
    files = answer["report"]["provenance"]["files"]
    assert {Path(one["file"]).name for one in files} == {
        "block.toml",
        "image_points.csv",
        "control.csv",
    }
    for one in files:
        data = Path(one["file"]).read_bytes()
        assert one["bytes"] == len(data)
        assert one["sha256"] == hashlib.sha256(data).hexdigest()
        assert one["sha256"] in page.read_text(encoding="utf-8")


def test_files_that_change_meanwhile_are_no_report(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "block"))
    adjust = anaplot.adjust

    def slow(block: Path, **options: Any) -> Any:
        found = adjust(block, **options)
        with (copy / "control.csv").open("a", encoding="utf-8") as file:
            file.write("\n")
        return found

    monkeypatch.setattr("anaplot.report.reportcommand.adjust", slow)
    assert main(["report", str(copy), "-o", str(tmp_path / "r.html")]) == 2
    assert "control.csv: has changed meanwhile, nothing is written" in capsys.readouterr().err
    assert not (tmp_path / "r.html").exists()


def test_long_tables_are_cut_and_stand_whole_beside_the_page(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "r.html"
    assert main(["report", str(folder), "-o", str(page), "--rows", "15", "--angles", "gon"]) == 0
    said = capsys.readouterr().out
    assert "cut to what needs a look; whole in" in said
    text = page.read_text(encoding="utf-8")
    cut = sorted(path.name for path in (tmp_path / "r.html.tables").iterdir())
    assert "table-rays.csv" in cut
    assert len(re.findall(r"r\.html\.tables/[\w-]+\.csv has every row", text)) == len(cut)
    whole = (tmp_path / "r.html.tables" / "table-rays.csv").read_text(encoding="utf-8")
    assert len(whole.splitlines()) == 161
    assert '<span class="unit">[gon]</span>' in text
    assert "[deg]" not in text


@pytest.mark.parametrize("name", ["block.pdf", "BLOCK.PDF", "page.docx"])
def test_a_page_is_not_called_what_it_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    for words in (["report", "b", "-o"], ["plan", "block", "--report"]):
        assert main([*words, str(tmp_path / name)]) == 2
        [line] = capsys.readouterr().err.splitlines()
        assert f"{name}: the page is HTML; a browser prints it as PDF" in line
    assert list(tmp_path.iterdir()) == []
