"""`--report` of bridge, compare and the plans: five lines, figures, the tables of the command."""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clibench import here, make_block, one_line
from hypothesis import given
from hypothesis import strategies as st

from anaplot import bridge, compare, plan
from anaplot.adjustment.hypothesis import critical_f
from anaplot.cli import command_parser
from anaplot.exchange.blockfolder import write_block
from anaplot.planning.blockplan import BlockPlan, expected_accuracy, plan_block
from anaplot.report.adjustarguments import add_bridge_arguments, add_compare_arguments
from anaplot.report.astext import line_text
from anaplot.report.figures import displacements
from anaplot.report.html.definitions import definition_of
from anaplot.report.html.pages.epochpage import epoch_report
from anaplot.report.html.pages.planpage import block_plan_report, network_plan_report
from anaplot.report.html.pages.strippage import strip_report
from anaplot.report.html.parts import Report, drawings_in, tables_in
from anaplot.report.html.render import html_of
from anaplot.report.html.sections.definitions import columns_shown
from anaplot.report.keywords import value_typed
from anaplot.report.pageoption import as_typed
from anaplot.report.planarguments import add_block_arguments, add_network_arguments
from anaplot.report.reportarguments import add_report_arguments
from anaplot.report.verdicts import probability
from anaplot.textfiles.separated import separated

HOSTILE = "</td><script>alert(1)</script>"


def text_of(report: Report) -> str:
    """What is read on the page, without markup."""
    return read(html_of(report))


def read(page: str) -> str:
    source = page.split("<main>")[1].split("</main>")[0]
    assert "<script>" not in source
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", source))


@pytest.fixture(scope="module")
def epochs():
    """Three epochs; a point with a hostile name has moved between the first two."""
    made = plan_block(BlockPlan(2, 4, 0.6, 0.6, 3, control_m=0.02)).block
    control = {row.point for row in made.control}
    free = [row.point for row in made.image_points if row.point not in control]
    wild = max(set(free), key=free.count)
    blocks = []
    for seed, shift in enumerate((0.0, 0.08, 0.08)):
        random = np.random.default_rng(seed)
        rows = []
        for row in made.image_points:
            x, y = random.normal((row.x, row.y), 0.004)
            name = HOSTILE if row.point == wild else row.point
            rows.append(replace(row, x=x + (row.point == wild) * shift, y=y, point=name))
        blocks.append(replace(made, name=f"epoch {seed + 1}", image_points=tuple(rows)))
    return blocks


def test_a_strip_in_five_lines(tmp_path: Path, capsys) -> None:
    folder, page = make_block(tmp_path / "strip", dy=0.2), tmp_path / "strip.html"
    result = here(capsys, "bridge", folder, "--report", page, "--json")
    assert (result.returncode, result.stderr) == (0, "")
    told = json.loads(result.stdout)
    size = page.stat().st_size
    made = told["report"].pop("provenance")
    assert told["report"] == {"page": str(page), "bytes": size, "cut": [], "figures": []}
    assert made["command"] == f"anaplot bridge {folder} --json --report {page}"
    assert made["options"] == {"--json": "True", "--report": str(page)}
    sums = {one["file"]: one["sha256"] for one in made["files"]}
    points = folder / "image_points.csv"
    assert sums[str(points)] == hashlib.sha256(points.read_bytes()).hexdigest()
    text = page.read_text(encoding="utf-8")
    assert text.count("<li class=") == 5
    flagged = [m for m in told["strips"][0]["models"] if any(r["flagged"] for r in m["table"])]
    assert f"{len(flagged)} of 2 models have flagged rows" in read(text)
    assert flagged[0]["advice"][0] in read(text)
    printed = here(capsys, "bridge", folder, "--report", page)
    assert "strip.html: written" in printed.stdout
    plain = here(capsys, "bridge", folder, "--json")
    assert json.loads(plain.stdout) == {k: v for k, v in told.items() if k != "report"}
    figures = tmp_path / "figures"
    more = ("--figures", figures, "--angles", "gon")
    one_line(here(capsys, "bridge", folder, *more), 2, "go with --report")
    in_gon = here(capsys, "bridge", folder, "--report", page, *more)
    assert f"2 figures in {figures}" in in_gon.stdout
    assert len(list(figures.glob("*.svg"))) == 2
    gon = told["strips"][0]["models"][0]["rotation"]["kappa"] * 200.0 / math.pi
    assert f"<td>{gon:.5f}</td>" in page.read_text(encoding="utf-8")
    before = page.read_bytes()
    page.write_text("mine")
    one_line(here(capsys, "bridge", folder, "--report", page), 2, "is no report")
    assert page.read_text() == "mine"
    page.write_bytes(before)
    one_line(
        here(capsys, "bridge", folder, "--report", page, "--csv", page), 2, "becomes the report"
    )


def test_a_good_strip_and_a_search_for_gross_errors(tmp_path: Path) -> None:
    folder = make_block(tmp_path / "strip")
    assert "Sound yes: no row" in text_of(strip_report(bridge(folder), "s"))
    found = bridge(make_block(tmp_path / "wrong", dy=0.2), errors="odds")
    report = strip_report(found, HOSTILE)
    rejected = next(table for table in tables_in(report.sections) if table.key == "rejected")
    told = found.to_dict()["strips"][0]["models"]
    assert len(rejected) == sum(len(model["errors"]["rejected"]) for model in told) > 0
    assert "102-2" in text_of(report).split("Rejected rows")[1]
    # what is rejected is named, and numbering is looked at without it
    sound, wrong, _, _, following = map(line_text, report.verdict)
    assert re.match(r"Sound: yes: .*, without \d rejected rows?; ", sound)
    assert re.match(r"Wrong: \d rows? (was|were) rejected: [xy] of 102-2 in model 101/102", wrong)
    assert found.to_dict()["accidents"] == []
    assert following == "Next: measure again what was rejected, and bridge anew"
    assert "&lt;script&gt;alert(1)" in html_of(report)


def test_displacements_have_vectors_ellipses_and_tests(epochs) -> None:
    found = compare(*epochs[:2])
    report = epoch_report(found)
    text = text_of(report)
    assert len(report.verdict) == 5
    everything = found.result.everything
    assert everything is not None
    assert everything.decisive is not None
    p = probability(everything.decisive.significance)
    moved = line_text(report.verdict[0])
    assert moved.startswith(f"Moved: yes: P {p} of all points together by the global test; P ")
    assert re.search(r"What\W+1 point", text)
    drawn = list(drawings_in(report.sections))
    assert [one.key for one in drawn] == ["displacements-1-2", "displacements-across-1-2"]
    assert "1 moved" in drawn[0].description
    (table,) = tables_in(report.sections)
    assert table is found.document.tables[0]
    # the ellipse of a point reaches its displacement where its own test is at the limit
    tests, of = found.result, found.result.differences
    k = next(i for i, p in enumerate(tests.points) if p.point == HOSTILE)
    region = displacements._regions(tests, [0, 1])[k]
    d = of.d.reshape(-1, 3)[k, :2]
    q = of.cofactors[3 * k : 3 * k + 2, 3 * k : 3 * k + 2]
    sigma = 1.0 if of.by_known else (of.vtpv / of.redundancy) ** 0.5
    statistic = d @ np.linalg.solve(q, d) / (2.0 * sigma**2)
    limit = critical_f(tests.alpha, 2, None if of.by_known else of.redundancy)
    assert d @ np.linalg.solve(region, d) == pytest.approx(statistic / limit)


@pytest.mark.parametrize(
    ("extents", "across"),
    [
        ((9, 5, 1), 2),
        ((9, 0, 1), 2),
        ((9, 1, 8), 1),
        ((1, 9, 8), 0),
        ((0, 0, 0), 2),
        ((5, 5, 9), 1),
    ],
)
def test_only_upright_objects_are_drawn_from_the_side(extents, across) -> None:
    places = np.array([5e5, 5e6, 100.0]) + np.vstack((np.zeros(3), extents))
    assert displacements._across(places) == across


def test_a_series_draws_its_marked_pairs(epochs) -> None:
    found = compare(*epochs)
    report = epoch_report(found)
    assert len(report.verdict) == 5
    keys = [one.key for one in drawings_in(report.sections)]
    assert "displacements-1-2" in keys
    assert "from 1 to 2" in text_of(report)


def test_nothing_has_moved(epochs) -> None:
    report = epoch_report(compare(epochs[1], epochs[2]))
    text = text_of(report)
    assert "What no point by itself" in text.replace(":", "")
    assert "No point by itself has moved" in next(drawings_in(report.sections)).description


def test_plans_have_maps_and_their_tables() -> None:
    block = plan.block(stabilize=0)
    report = block_plan_report(block)
    assert len(report.verdict) == 5
    keys = {one.key for one in drawings_in(report.sections)}
    assert keys >= {"block-map", "accuracy-plan", "accuracy-height", "redundancy", "detectable"}
    text = text_of(report)
    accuracy = block.to_dict()["accuracy_m"]
    for value in accuracy["rms"]:
        assert f"{value:.4f}" in text
    assert {table.key for table in tables_in(report.sections)} == {"classes", "weak_photos"}
    planned = plan.network("cube", case="A")
    worst = expected_accuracy(planned.result.block)
    assert worst is not None
    assert worst.largest[1] > max(worst.largest[0], worst.largest[2])
    told = line_text(network_plan_report(planned).verdict[3])
    assert told.endswith(f"; worst Y {worst.largest[1]:.4f} m at point {worst.points[1]}")
    network = network_plan_report(plan.network("cube", case="B"))
    assert len(network.verdict) == 5
    assert {"photos", "points"} <= {table.key for table in tables_in(network.sections)}
    assert "block-map" in {one.key for one in drawings_in(network.sections)}
    text_of(network)


def test_plans_of_several_have_no_page(tmp_path: Path, capsys) -> None:
    page = tmp_path / "p.html"
    for arguments in (("block", "--bridging", "2,4"), ("network", "cube", "--case", "A,B")):
        one_line(here(capsys, "plan", *arguments, "--report", page), 2, "--report")
    assert not page.exists()
    several = (
        ("block", "--bridging", "2,4", "one bridging distance"),
        ("network", "cube", "--case", "A,B", "one version of the cube"),
    )
    figures = tmp_path / "figures"
    for *arguments, only in several:
        for option, value in (("--figures", figures), ("--angles", "gon")):
            result = here(capsys, "plan", *arguments, option, value)
            one_line(result, 2, option, f" go with {only}")
    result = here(capsys, "plan", "network", "cube", "--case", "A,B", "--correlations", ".5")
    one_line(result, 2, "--correlations", "go with one version of the cube")
    assert not figures.exists()
    result = here(capsys, "plan", "block", "--strips", "2", "--photos", "4", "--report", page)
    assert (result.returncode, result.stderr) == (0, "")
    assert page.exists()
    folder = tmp_path / "epoch"
    write_block(folder, plan_block(BlockPlan(2, 3, 0.6, 0.6, 3, control_m=0.02)).block)
    result = here(capsys, "compare", folder, folder, "--report", tmp_path / "c.html")
    assert result.returncode in (0, 4), result.stderr


def test_every_column_of_these_pages_has_a_definition(tmp_path: Path, epochs) -> None:
    wrong = make_block(tmp_path / "wrong", dy=0.2)
    reports = [
        strip_report(bridge(wrong, errors="odds"), "s"),
        epoch_report(compare(*epochs[:2])),
        epoch_report(compare(*epochs)),
        block_plan_report(plan.block(stabilize=0)),
        network_plan_report(plan.network("cube", case="B", point="1")),
    ]
    shown = {(key, one.key) for report in reports for key, one in columns_shown(report)}
    assert len(shown) > 50
    assert {pair for pair in shown if definition_of(*pair) is None} == set()


def again_typed(typed: str) -> tuple[list[str], argparse.Namespace, list[str]]:
    """Return the words of a command, its options, and the words that they are written as again."""
    words = shlex.split(typed)
    options = command_parser().parse_args(words)
    name = " ".join(words[: 2 if words[0] == "plan" else 1])
    declare = {
        "plan block": add_block_arguments,
        "plan network": add_network_arguments,
        "compare": add_compare_arguments,
        "bridge": add_bridge_arguments,
        "report": add_report_arguments,
    }[name]
    return words, options, shlex.split(as_typed(name, declare, options))[1:]


@pytest.mark.parametrize(
    "typed",
    [
        "plan block --strips 2 --bridging 2.0,4.0 --twin",
        "plan network cube --case A,B --image-um 4.0",
        "compare 'a b' c d --no-common-parameters --stable 1,2",
        "compare a b --separate --common-parameters",
        "bridge x --correlations --errors odds",
    ],
)
def test_a_command_is_written_as_it_is_typed(typed: str) -> None:
    words, options, again = again_typed(typed)
    assert vars(command_parser().parse_args(again)) == vars(options)
    assert sorted(again) == sorted(words)


@pytest.mark.parametrize(
    "typed",
    [
        "report a -o b.html --fiducials 1.toml 2.toml",
        "report a -o b.html --fiducials 1.toml --fiducials=-2.toml",
        "report a -o b.html --covariance points photos --covariance=parameters:c,k1",
        "report a -o b.html --given-without=-7,8 --time-limit 5 --fail-on-flag",
        "report ./-a -o ./-b.html --errors search --thin --components",
        "report a -o b.html --function 'distance A B' --function='-1 2' --test-set ray:1:2",
        "report a -o b.html --calibrate c,k1 --calibrate 2:c --calibrate-sigma k1=0.01",
        "report a -o b.html --imu-boresight-sigma none --snooping-tolerance 0 --angles gon",
        "compare ./-a ./-b ./-c --stable '\"a,1\",2'",
        "compare a b --stable=-1,2",
        "plan block --bridging 2,3 --sidelap 20",
        "plan network cube --case A,B --plant '\"a,1:1:x:3\"'",
        "plan network cube --plant=-1:1:x:-3",
    ],
)
def test_a_command_that_is_typed_again_means_the_same(typed: str) -> None:
    _, options, again = again_typed(typed)
    assert vars(command_parser().parse_args(again)) == vars(options)


@given(st.lists(st.text(" ,\"'ab-", min_size=1).map(str.strip), min_size=1, max_size=4))
def test_names_are_typed_as_they_are_read(names: list[str]) -> None:
    assert separated(value_typed(names)) == tuple(names)
