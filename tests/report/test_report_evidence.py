"""What a report says beside the adjustment: each section with what it is of, and without."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import pytest
from clibench import make_block
from svgs import sound

import anaplot
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.photogrammetry.block import Camera, ControlPoint
from anaplot.planning.blockplan import BlockPlan, plan_block
from anaplot.report.adjustcommand import adjust
from anaplot.report.bridgecommand import bridge
from anaplot.report.document import Document, say
from anaplot.report.figures.bridged import figures_of_models
from anaplot.report.html.blocksections import Material, block_sections
from anaplot.report.html.evidence import block_plates, evidence_sections
from anaplot.report.html.parts import Report, Section, drawings_in
from anaplot.report.html.render import html_of
from anaplot.report.html.sections import models, photoresiduals
from anaplot.report.html.sections.innerorientations import inner_section, plates_in
from anaplot.report.html.sections.models import models_section
from anaplot.report.html.sections.photoresiduals import photo_residuals_section
from anaplot.report.html.sections.switchedoff import protocol_blocks
from anaplot.report.logcommand import log_document
from anaplot.report.reportcommand import block_report
from anaplot.station.sessionlog import read_log

SESSIONS = Path(__file__).parents[1] / "sessions"
HOSTILE = "</td><script>alert(1)</script>"


class Page(HTMLParser):
    """Tables of a page by caption: heads and rows of cells; and its text."""

    def __init__(self, *sections: Section) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.text = ""
        self._cell: list[str] | None = None
        self._row: list[str] = []
        self._rows: list[list[str]] = []
        self.source = html_of(Report(say("x"), (), sections))
        self.feed(self.source.split("<main>")[1].split("</main>")[0])

    def handle_starttag(self, tag, attrs):
        if tag in ("th", "td", "caption"):
            self._cell = []
        if tag == "table":
            self._rows = []
        if tag == "tr":
            self._row = []

    def handle_data(self, data):
        self.text += data
        if self._cell is not None:
            self._cell.append(data)

    def handle_endtag(self, tag):
        if tag in ("th", "td", "caption"):
            found, self._cell = "".join(self._cell), None
            if tag == "caption":
                self.tables[found] = self._rows
            else:
                self._row.append(found)
        if tag == "tr":
            self._rows.append(self._row)


def strip(tmp_path: Path, **options) -> Path:
    return make_block(tmp_path / "strip", **options)


def titles(*sections: Section) -> list[str]:
    """Keys of sections and of those within them, from top to bottom."""
    found = []
    for section in sections:
        found += [section.key, *titles(*(b for b in section.blocks if isinstance(b, Section)))]
    return found


def test_models_have_the_numbers_of_json_rounded(tmp_path: Path) -> None:
    found = bridge(strip(tmp_path, photos=4, dy=0.2)).document
    page = Page(models_section(found.answer))
    told = found.to_dict()["strips"][0]["models"]
    assert len(told) == 3
    overview = page.tables["3 models: sigma0, largest SIGF, flagged rows"]
    for model, row in zip(told, overview[1:], strict=True):
        of = f"{model['left']}/{model['right']}"
        assert row[:5] == [
            "1", model["left"], model["right"], f"{model['sigma0_um']:.2f}",
            str(model["redundancy"]),
        ]  # fmt: skip
        assert f"sigma0 {model['sigma0_um']:.2f} um" in page.text
        _, *rows = page.tables[f"Rows of model {of}"]
        for cells, one in zip(rows, model["table"], strict=True):
            assert cells[:2] == [one["point"], one["axis"]]
            assert cells[2] == f"{one['redn']:.3f}"
            assert cells[3:5] == [f"{one['parx_um']:z.1f}", f"{one['expd_um']:z.1f}"]
        head, *rows = page.tables[f"Correlations of the orientation of model {of}"]
        accuracy = model["accuracy"]
        assert head[1:] == accuracy["elements"]
        for cells, values in zip(rows, accuracy["correlations"], strict=True):
            assert cells[1:] == [f"{value:z.3f}" for value in values]
        _, values, spread = page.tables[f"Orientation of model {of}, the left photo held"]
        assert values[2:4] == [f"{value:z.4f}" for value in model["base"][1:]]
        assert spread[1] == (
            "-" if len(accuracy["elements"]) == 5 else f"{accuracy['base'][0]:.4f}"
        )
        for sentence in model["advice"]:
            assert sentence in page.text
    flagged = [sum(row["flagged"] for row in model["table"]) for model in told]
    assert max(flagged) > 0
    assert [row[8] for row in overview[1:]] == list(map(str, flagged))


def test_every_model_is_drawn_with_its_numbers(tmp_path: Path) -> None:
    found = bridge(strip(tmp_path, photos=4, dy=0.2))
    section = models_section(found.document.answer, figures_of_models(found.result))
    drawn = list(drawings_in((section,)))
    assert [one.key for one in drawn] == ["model-1-1", "model-1-2", "model-1-3"]
    for drawing, model in zip(drawn, found.result.strips[0].models, strict=True):
        sound(drawing)
        assert drawing.title == f"Model {model.name}"
        assert f"sigma0 {model.sigma0_um:.2f} µm, redundancy {model.redundancy}" in (
            drawing.description
        )
        flagged = {row.point for row in model.flagged}
        assert (f"flagged ({len(flagged)})" in drawing.svg) is bool(flagged)
        assert all(point in drawing.description for point in flagged)


def test_of_many_models_the_flagged_are_shown_and_it_is_said(tmp_path: Path, monkeypatch) -> None:
    answer = bridge(strip(tmp_path, photos=5, dy=0.2)).document.answer
    monkeypatch.setattr(models, "MOST_MODELS", 1)
    section = models_section(answer)
    (shown,) = (block for block in section.blocks if isinstance(block, Section))
    assert shown.folded
    page = Page(section)
    assert "1 of 4 models are shown one by one" in page.text
    (rows,) = (rows for caption, rows in page.tables.items() if caption.startswith("Rows of"))
    assert any("REMEASURE" in row[-1] for row in rows)


def test_a_strip_that_ends_early_says_so_and_three_ties_are_enough(tmp_path: Path) -> None:
    folder = strip(tmp_path)
    block = read_block(folder)
    seen = [{row.point for row in block.image_points if row.photo == photo.id}
            for photo in block.photos]  # fmt: skip
    ties = sorted(seen[0] & seen[1] & seen[2])
    # points off one line
    few = {ties[0], ties[2], ties[-1]}
    rows = tuple(
        r for r in block.image_points if r.photo != "103" or r.point not in set(ties) - few
    )
    found = bridge(replace(block, image_points=rows)).document
    page = Page(models_section(found.answer))
    overview = next(rows for caption, rows in page.tables.items() if "models:" in caption)
    assert [row[5] for row in overview[1:]] == ["0", "3"]
    none = tuple(r for r in rows if r.photo != "103" or r.point not in few)
    found = bridge(replace(block, image_points=none)).document
    assert "Bridging ends early: strip 1, model 102/103" in Page(models_section(found.answer)).text
    assert models_section({"strips": []}) is None


@pytest.fixture(scope="module")
def planned():
    made = plan_block(BlockPlan(2, 4, 0.6, 0.3, 3, control_m=0.05)).block
    control = list(made.control)
    there = {row.point for row in control}
    at = next(row.point for row in made.image_points if row.point not in there)
    truth = anaplot.adjust(made).result.block
    xyz = next(row.xyz for row in truth.point_rows() if row.point == at)
    control.append(ControlPoint(at, (xyz[0] + 0.5, *xyz[1:]), (0.02, 0.02, 0.02), "check"))
    rows = list(made.image_points)
    rows[10] = replace(rows[10], use="off", reason=HOSTILE)
    rows[25] = replace(rows[25], x=rows[25].x + 0.2)
    return replace(made, control=tuple(control), image_points=tuple(rows))


def test_a_block_with_everything(planned) -> None:
    found = adjust(planned, errors="odds", as_given=True, additional="ebner:b1,b2,b3")
    sections = evidence_sections(found)
    told = found.to_dict()
    page = Page(*sections)
    assert "<script>alert" not in page.source.split("<main>")[1].split("</main>")[0]
    checks = page.tables["Rays that count in every photo, and their redundancy numbers"]
    for cells, one in zip(checks[1:], told["photos"], strict=True):
        assert cells == [
            one["photo"], str(one["rays"]), f"{one['redundancy']:.2f}", f"{one['mean_r']:.3f}",
            f"{one['least_r']:.3f}", f"{one['rms_x_um']:.2f}", f"{one['rms_y_um']:.2f}",
            str(one["flagged"]),
        ]  # fmt: skip
    overlaps = page.tables["Overlap of neighbouring photos"]
    assert [row[:3] for row in overlaps[1:]] == [
        [one["photo"], one["other"], str(one["points"])] for one in told["overlaps"]
    ]
    off = page.tables["Rows that are switched off, and the residuals they would have"]
    assert [row[-1] for row in off[1:]] == [HOSTILE]
    points = page.tables["Control and check points in plan and height"]
    for cells, one in zip(points[1:], told["hypotheses"]["plan_and_height"], strict=True):
        length = "-" if one["plan"] is None else f"{one['plan']:.4f}"
        assert cells[:3] == [one["point"], one["use"], length]
    (check,) = (row for row in points if row[1] == "check")
    assert "<< REJECTED" in check
    words = {None: "not tested", False: "passed", True: "<< REJECTED"}
    for cells, one in zip(points[1:], told["hypotheses"]["plan_and_height"], strict=True):
        assert [cells[5], cells[9]] == [words[one[f"{k}_rejected"]] for k in ("plan", "height")]
    assert any("passed" in cells for cells in points)
    rejected = page.tables["Rejected by odds, in this order"]
    assert [row[0] for row in rejected[1:]] == ["image"] * len(told["errors"]["rejected"])
    assert len(rejected) > 1
    for cells, one in zip(rejected[1:], told["errors"]["rejected"], strict=True):
        assert f"{one['error']:.4g}" in cells
    matrix = page.tables["Correlations of the additional parameters"]
    values = told["additional"]["matrix"]["values"]
    assert [row[1:] for row in matrix[1:]] == [[f"{v:z.3f}" for v in row] for row in values]


def test_a_block_with_nothing_of_that_says_it_in_lines(planned, tmp_path: Path) -> None:
    control = tuple(row for row in planned.control if row.use == "control")
    rows = tuple(replace(row, use="xy", reason=None) for row in planned.image_points)
    bare = replace(planned, control=control, image_points=rows, strips=())
    sections = evidence_sections(adjust(bare))
    assert [one.key for one in sections] == [
        "photo-checks", "photo-residuals", "given-points", "rejected", "off",
    ]  # fmt: skip
    text = Page(*sections).text
    assert "Nothing is switched off." in text
    assert "No search for gross errors was asked for" in text
    without = evidence_sections(adjust(strip(tmp_path), datum="free"))
    assert "given-points" not in titles(*without)


def test_of_many_photos_the_residuals_of_the_worst_are_drawn(planned, monkeypatch) -> None:
    block = adjust(planned).result.block
    flagged = {photo for _, photo, _, _ in block.suspects()}
    assert 0 < len(flagged) < 4
    section = photo_residuals_section(block)
    assert next(drawings_in([section])).title.split()[-1] in flagged
    assert len(list(drawings_in([section]))) == len(block.problem.photos) == 8
    assert sum(isinstance(part, Section) for part in section.blocks) == 5
    monkeypatch.setattr(photoresiduals, "MOST_PHOTOS", 2)
    fewer = photo_residuals_section(block)
    assert len(list(drawings_in([fewer]))) == 2
    assert "2 of 8 photos are drawn" in Page(fewer).text


def test_lengths_are_in_px_where_pixels_have_no_size(planned) -> None:
    (camera,) = planned.cameras
    side = camera.format[0]
    counted = Camera(camera.id, camera.c, camera.format, pixels=(int(1e3 * side),) * 2)
    sections = block_sections(Material(adjust(replace(planned, cameras=(counted,)))))
    off = Page(*sections).tables["Rows that are switched off, and the residuals they would have"]
    assert "vx [px]" in off[0]


def test_the_protocol_of_a_session_and_none() -> None:
    log = log_document(read_log(SESSIONS / "changes.jsonl"))
    changes = log.to_dict()["changes"]
    page = Page(Section("protocol", "Protocol", protocol_blocks(log, "b")))
    head, *rows = page.tables[
        "What was measured again, switched, renamed, accepted or reopened, in order"
    ]
    again = [one for one in changes if one["what"] not in ("measured", "oriented", "added")]
    assert 0 < len(again) < len(changes)
    assert [row[head.index("WHAT")] for row in rows] == [one["what"] for one in again]
    # to the second and in UTC, whose name stands in the title alone
    assert head[0] == "TIME (UTC)"
    times = [datetime.fromisoformat(one["time"]).astimezone(UTC) for one in again]
    assert [row[0] for row in rows] == [f"{time:%Y-%m-%d %H:%M:%S}" for time in times]
    for key, title in (("w_before", "w BEFORE"), ("w_after", "AFTER")):
        shown = ["-" if one[key] is None else f"{one[key]:.2f}" for one in again]
        assert title not in head or [row[head.index(title)] for row in rows] == shown
    assert f"{len(changes) - len(again)} rows are of what was measured for the first" in page.text
    assert "`anaplot log b` has every change" in page.text
    count = sum(one["what"] == "remeasured" for one in changes)
    assert f"{count} measured again" in page.text
    first = [one for one in read_log(SESSIONS / "changes.jsonl") if one.what == "measured"]
    page = Page(Section("p", "P", protocol_blocks(log_document(first), "b")))
    assert "Nothing was measured again" in page.text
    assert f"{len(first)} rows are of what was measured for the first" in page.text
    assert "no journal" in Page(Section("p", "P", protocol_blocks(None))).text
    empty = log_document(())
    assert "Nothing is journalled" in Page(Section("p", "P", protocol_blocks(empty))).text


def test_inner_orientations_of_a_session_and_of_a_file(tmp_path: Path) -> None:
    plates = plates_in(SESSIONS / "fiducials.jsonl")
    assert [(one.photo, one.model, one.who) for one in plates] == [
        ("101", "101/102", "tester"), ("102", "101/102", "tester"),
    ]  # fmt: skip
    for plate in plates:
        assert isinstance(plate.found, Document)
        page = Page(inner_section([plate]))
        (_, *rows) = page.tables[f"Fiducials of photo {plate.photo}"]
        for cells, one in zip(rows, plate.found.to_dict()["table"], strict=True):
            assert cells[:2] == [one["fiducial"], one["axis"]]
            assert cells[3] == f"{one['residual_um']:.1f}"
        _, summary = page.tables["Inner orientations of the photos"]
        assert summary[5] == f"{plate.answer['sigma0_um']:.2f}"
    assert inner_section(()) is None
    assert plates_in(SESSIONS / "changes.jsonl") == ()
    camera = tmp_path / "rmk.toml"
    camera.write_text(
        'format = 1\n[camera]\nid = "rmk"\nc = 150.0\n[fiducials]\n'
        "1 = [-106.0, 106.0]\n2 = [106.0, 106.0]\n3 = [106.0, -106.0]\n4 = [-106.0, -106.0]\n"
    )
    measured = tmp_path / "f.toml"
    measured.write_text(
        'format = 1\ncamera = "rmk.toml"\n[photo."<b>"]\n'
        "1 = [4.0, 216.0]\n2 = [216.01, 216.0]\n3 = [216.0, 4.0]\n4 = [4.0, 4.003]\n"
        "[photo.two]\n1 = [4.0, 216.0]\n"
    )
    folder = strip(tmp_path)
    found = block_plates(folder, [measured])
    assert [(one.photo, one.model, type(one.found)) for one in found] == [
        ("<b>", None, Document), ("two", None, str),
    ]  # fmt: skip
    page = Page(inner_section(found))
    assert "Fiducials of photo <b>" in page.tables
    assert "Photo two has no inner orientation" in page.text
    with pytest.raises(InputError):
        block_plates(folder, [camera])


def test_a_journal_that_cannot_be_read_is_said_on_the_page(tmp_path: Path) -> None:
    folder = strip(tmp_path)
    (folder / "sessions").mkdir()
    (folder / "sessions" / "session-1.jsonl").write_text("{no json\n{none\n")
    assert block_plates(folder) == ()
    sections = evidence_sections(adjust(folder, datum="free"), folder)
    assert "The journal cannot be read" in Page(*sections).text
    assert "models" in titles(*sections)


def test_a_report_from_a_program_has_the_inner_orientations_of_the_journal(tmp_path: Path) -> None:
    folder = strip(tmp_path)
    (folder / "sessions").mkdir()
    journal = (SESSIONS / "fiducials.jsonl").read_bytes()
    (folder / "sessions" / "0001.jsonl").write_bytes(journal)
    found = adjust(folder, datum="free")
    report = block_report(found, folder)
    assert {"inner", "protocol"} <= set(titles(*report.sections))
    page = Page(*report.sections)
    assert "Photo 101, in model 101/102, 20" in page.text
    assert "inner" not in titles(*block_report(found).sections)
