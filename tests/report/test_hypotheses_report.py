"""The hypotheses in the report and in the JSON of `anaplot adjust`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandbench import run_adjust
from wild import text_of, wild, words

from anaplot import cli
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.blockhypotheses import block_hypotheses
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.errors import InputError
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.report.hypotheses import hypotheses_document
from anaplot.report.verdicts import probability


def strip(*, planted: float = 0.0, sigma: float | None = 0.02, kind: str = "tau") -> Block:
    """Four photos in a row; `planted` is about Ebner's b3 [mm], p8 a check point."""
    rng = np.random.default_rng(12)
    points = {
        f"p{k}": np.array([x, y, rng.uniform(-40, 40)])
        for k, (x, y) in enumerate((x, y) for x in range(0, 1801, 300) for y in (-500, 0, 500))
    }
    rows = []
    for i in range(4):
        centre = np.array([600.0 * i, 0.0, 1000.0])
        rotation = rotation_matrix(*rng.normal(size=3) * 0.01)
        for name, at in points.items():
            if abs(at[0] - centre[0]) > 650:
                continue
            seen = project(centre[None], rotation[None], np.array([150.0]), at[None]).xy[0]
            off = rng.normal(size=2) * 0.005
            u, v = seen / 75.0
            off += planted * np.array([-2.0 * (u * u - 2.0 / 3.0), u * v])
            rows.append(ImagePoint(f"{i}", name, *(seen + off).tolist(), None, None))
    control = [
        ControlPoint(name, tuple(points[name].tolist()), (sigma,) * 3)
        for name in ("p0", "p2", "p9", "p11", "p18", "p20")
    ]
    control.append(ControlPoint("p8", tuple(points["p8"].tolist()), (0.01,) * 3, "check"))
    return Block(
        "strip",
        Precision(image_um=5.0),
        TestSettings(kind=kind),
        (Camera("c", 150.0),),
        tuple(Photo(f"{i}", "c") for i in range(4)),
        (),
        tuple(rows),
        tuple(control),
    )


def write(folder: Path, block: Block) -> Path:
    """Write a block folder."""
    folder.mkdir()
    lines = [f'format = 1\nname = "strip"\n[precision]\nimage_um = 5.0\n[test]\nkind = '
             f'"{block.test.kind}"\n[[camera]]\nid = "c"\nc = 150.0\n[[strip]]\nid = "1"\n'
             'photos = ["0", "1", "2", "3"]']  # fmt: skip
    lines += [f'[[photo]]\nid = "{photo.id}"\ncamera = "c"' for photo in block.photos]
    (folder / "block.toml").write_text("\n".join(lines) + "\n")
    rows = ["photo,point,x,y"]
    rows += [f"{r.photo},{r.point},{r.x:.6f},{r.y:.6f}" for r in block.image_points]
    (folder / "image_points.csv").write_text("\n".join(rows) + "\n")
    rows = ["point,X,Y,Z,sX,sY,sZ,use"]
    for r in block.control:
        rows.append(",".join([r.point, *map(str, r.xyz), *map(str, r.sigma), r.use]))
    (folder / "control.csv").write_text("\n".join(rows) + "\n")
    return folder


def report(folder: Path, **options) -> str:
    code, text, _ = run_adjust(folder, **options)
    assert code == 0
    return text


def test_the_command_tests_additional_parameters(tmp_path: Path) -> None:
    folder = write(tmp_path / "b", strip(planted=0.02))
    text = report(folder, additional="ebner")
    assert "HYPOTHESES  alpha 0.05" in text
    part = text.split("HYPOTHESES")[1]
    assert any(line.strip().startswith("all are zero") and line.endswith("<< REJECTED")
               for line in part.splitlines())  # fmt: skip
    [b3] = [line for line in part.splitlines() if line.strip().startswith("b3 ")]
    assert b3.endswith("<< REJECTED")
    assert "11 of 12 may be left out together; needed: b3" in part
    assert max(len(line) for line in part.splitlines()) <= 160
    got = json.loads(report(folder, additional="ebner", as_json=True))["hypotheses"]
    tests = got["additional"]
    assert tests["all"]["rejected"] is True
    assert tests["all"]["known"]["redundancy"] is None
    assert tests["all"]["estimated"]["dimension"] == 12
    assert len(tests["parameters"]) == len(tests["orthogonal"]) == 12
    assert [p["name"] for p in tests["parameters"] if p["verdict"]["rejected"]] == ["b3"]
    assert {"group": "block", "name": "b3"} not in tests["removable"]


def test_without_parameters_nothing_is_said_of_them(tmp_path: Path) -> None:
    folder = write(tmp_path / "b", strip())
    text = report(folder).split("HYPOTHESES")[1]
    assert "ADDITIONAL" not in text
    assert "CHECK POINTS" in text
    assert "weighted" not in text  # all control is of one kind
    assert "all is right" in text
    assert "0 of 1 point rejected; 0 of 3 coordinates rejected" in text
    got = json.loads(report(folder, as_json=True))["hypotheses"]
    assert got["additional"] is None
    assert got["alpha"] == 0.05
    [group] = [g for g in got["check"]["groups"] if g["axes"] == "XYZ"]
    assert group["verdict"]["rejected"] is False
    assert len(got["control"]["coordinates"]) == 18
    assert got["control"]["groups"][0]["conditions"] == 11


def test_the_significance_is_the_users(tmp_path: Path, capsys) -> None:
    folder = write(tmp_path / "b", strip())
    assert cli.main(["adjust", str(folder), "--json", "--hypothesis-alpha", "0.01"]) == 0
    got = json.loads(capsys.readouterr().out)["hypotheses"]
    assert got["alpha"] == 0.01
    assert got["control"]["groups"][0]["verdict"]["known"]["alpha"] == 0.01
    assert cli.main(["adjust", str(folder), "--hypothesis-alpha", "0.7"]) == 2
    assert "no significance" in capsys.readouterr().err
    assert cli.main(["adjust", str(folder), "--hypothesis-alpha", "1e-200"]) == 2
    assert "at least 1e-12" in capsys.readouterr().err
    assert cli.main(["adjust", str(folder), "--hypothesis-alpha", "1e-12"]) == 0


def test_what_cannot_be_tested_has_nothing_detectable_and_is_not_counted() -> None:
    # one redundancy: giving a coordinate up leaves none for the variance factor
    single = replace(adjust_block(strip()), redundancy=1)
    found = block_hypotheses(single)
    assert all(row.mdb is None for row in found.control.coordinates)
    text = text_of(hypotheses_document(found)).split("CONTROL")[1]
    assert "0 of 0 points rejected (6 not testable)" in text
    assert "0 of 0 coordinates rejected (18 not testable)" in text
    [row] = [line for line in text.splitlines() if line.startswith("  p0 X ")]
    assert row.endswith("-  not testable")
    known = replace(adjust_block(strip(kind="baarda")), redundancy=1)
    assert all(row.mdb for row in block_hypotheses(known).control.coordinates)


def test_the_power_is_that_of_the_block(tmp_path: Path, capsys) -> None:
    folder = write(tmp_path / "b", strip())
    plain = json.loads(report(folder, as_json=True))["hypotheses"]
    assert plain["power"] == 0.80
    toml = folder / "block.toml"
    toml.write_text(toml.read_text().replace("[test]\n", "[test]\npower = 0.95\n"))
    sharp = json.loads(report(folder, as_json=True))["hypotheses"]
    assert sharp["power"] == 0.95
    one, two = (h["control"]["coordinates"][0]["detectable"] for h in (plain, sharp))
    assert two > one
    toml.write_text(toml.read_text().replace("0.95", "0.02"))
    for call in (["adjust", str(folder)], ["compare", str(folder), str(folder)]):
        assert cli.main(call) == 2
        error = capsys.readouterr().err
        assert "alpha 0.05: must be less than power = 0.02 of [test]" in error
        assert "block.toml" in error


def test_the_exit_code_of_compare_is_its_conclusion(tmp_path: Path, capsys) -> None:
    first = write(tmp_path / "a", strip(kind="baarda"))
    second = write(tmp_path / "b", strip(planted=0.03, kind="baarda"))
    for other, moved in ((first, False), (second, True)):
        call = ["compare", str(first), str(other), "--fail-on-flag", "--separate"]
        assert cli.main([*call, "--json"]) == int(moved)
        overall = json.loads(capsys.readouterr().out)["overall"]
        families = ["all points", "common control", "points", "coordinates"]
        assert overall["families"] == families
        assert overall["rejected"] is moved
        assert (overall["significance"] < overall["alpha"]) is moved
        assert cli.main(call) == int(moved)
        text = capsys.readouterr().out
        assert f"ANYTHING MOVED: {'yes' if moved else 'no'}, P " in text
        assert f"4 families ({', '.join(families)}) together at alpha 0.05" in text


def test_a_probability_of_nothing_is_a_bound() -> None:
    assert [probability(p) for p in (0.5, 2e-7, 0.0)] == ["0.5000", "2e-07", "<1e-300"]


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_the_deciding_sigma_is_marked(kind) -> None:
    block = adjust_block(strip(planted=0.02, kind=kind), additional=additional_parameters("ebner"))
    found = block_hypotheses(block)
    lines = text_of(hypotheses_document(found)).splitlines()
    at = next(k for k, line in enumerate(lines) if line.strip().startswith("all are zero"))
    marked = lines[at + (kind == "baarda")]
    assert marked.endswith("REJECTED")
    assert ("known" in marked) == (kind == "baarda")
    assert hypotheses_document(found).to_dict()["additional"]["all"]["rejected"] is True


def test_pairs_and_sets_are_printed() -> None:
    block = adjust_block(strip(), additional=additional_parameters("physical", 300.0))
    found = block_hypotheses(block)
    text = text_of(hypotheses_document(found))
    assert "PAIRS correlated from 0.7" in text
    assert "CORRELATED SET" in text
    assert "orthogonal combinations" in text
    got = hypotheses_document(found).to_dict()["additional"]
    assert got["pairs"]
    [radial] = [s for s in got["sets"] if {"group": "block", "name": "k2"} in s["members"]]
    assert len(radial["sequential"]) == len(radial["principal"]) == len(radial["members"])
    assert len(radial["principal"][0]["loadings"]) == len(radial["members"])
    assert "all may be left out" in text
    json.dumps(got, allow_nan=False)


def test_many_rows_are_cut_in_the_text_only() -> None:
    block = adjust_block(strip(), additional=additional_parameters("ebner:photo", 5.0))
    found = block_hypotheses(block)
    text = text_of(hypotheses_document(found))
    assert "and 18 more, with larger P" in text
    assert "those of 3" in text
    assert len(hypotheses_document(found).to_dict()["additional"]["parameters"]) == 48


def test_fixed_control_and_what_checks_nothing() -> None:
    block = strip(sigma=0.0)
    text = text_of(hypotheses_document(block_hypotheses(adjust_block(block))))
    assert "free of error" in text
    assert "p0 X fixed" in text
    first, second, third, *_ = block.control
    few = (first, second, replace(third, xyz=(None, None, third.xyz[2])))
    text = text_of(hypotheses_document(block_hypotheses(adjust_block(replace(block, control=few)))))
    assert "only hold the datum" in text
    assert "checked by nothing" in text
    assert "not testable" in text


def test_names_cannot_control_the_terminal() -> None:
    block = strip()
    rows = tuple(
        replace(r, point="\x1b[2J" if r.point == "p8" else r.point) for r in block.image_points
    )
    control = tuple(
        replace(r, point="\x1b[2J" if r.point == "p8" else r.point) for r in block.control
    )
    text = text_of(
        hypotheses_document(
            block_hypotheses(adjust_block(replace(block, image_points=rows, control=control)))
        )
    )
    assert "\x1b" not in text


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_columns_never_touch(kind: str) -> None:
    block = strip(planted=0.02, kind=kind)
    found = block_hypotheses(adjust_block(block, additional=additional_parameters("ebner")))
    usual, large = text_of(hypotheses_document(found)), text_of(hypotheses_document(wild(found)))
    assert words(usual) == words(large)
    assert max(words(usual)[3:5]) >= 5


def test_given_values_of_parameters_reach_the_page_and_programs(tmp_path: Path) -> None:
    folder = write(tmp_path / "block", strip(planted=0.02))
    known = tmp_path / "calibration.csv"
    known.write_text("parameter,value,sigma\nb5,20,3\nb3,1,0\nb7,2,\n", encoding="utf-8")
    asked = {"additional": "ebner:b3,b5,b7", "additional_prior": [str(known)]}
    text = report(folder, **asked)
    assert "held at given values: b3 = 1" in text
    assert "all are as given" in text
    answer = json.loads(run_adjust(folder, as_json=True, **asked)[1])
    assert [row["value"] for row in answer["additional"]["given"]] == [20.0, 1.0, 2.0]
    rows = answer["hypotheses"]["additional"]["parameters"]
    assert [(row["name"], row["given"]) for row in rows] == [("b5", 0.02), ("b7", 0.002)]
    assert [row["owner"] for row in answer["priors"]] == ["block"]


@pytest.mark.parametrize("origin", ["measured", "format", "stated"])
def test_values_of_parameters_tell_what_length_they_belong_to(tmp_path: Path, origin: str) -> None:
    block = strip(planted=0.02)
    largest = max(max(abs(row.x), abs(row.y)) for row in block.image_points)
    asked, b, said = {}, largest, "the largest coordinate measured"
    folder = write(tmp_path / "block", block)
    if origin == "format":
        b, said, declared = 200.0, "half the format", folder / "block.toml"
        text = declared.read_text(encoding="utf-8")
        with_format = text.replace("c = 150.0\n", "c = 150.0\nformat = [400.0, 300.0]\n")
        declared.write_text(with_format, encoding="utf-8")
    if origin == "stated":
        asked, b, said = {"additional_reference_mm": 90.0}, 90.0, "as stated"
    # held values belong to it, too
    for text in ("ebner:b3,b5", "ebner:b3"):
        options = {"additional": text, "additional_prior": "b3=1+-0", **asked}
        assert f"  values belong to b {b:.3f} mm: {said}\n" in report(folder, **options)
        answer = json.loads(run_adjust(folder, as_json=True, **options)[1])
        [found] = answer["additional"]["reference"]
        assert found == {
            "camera": "c", "b_mm": pytest.approx(b, abs=1e-3), "origin": origin
        }  # fmt: skip


def test_a_calibration_is_a_file_of_any_name_or_text(tmp_path: Path) -> None:
    folder = write(tmp_path / "block", strip(planted=0.02))
    known = tmp_path / "c=150.csv"
    known.write_text("parameter,value,sigma\nb5,20,3\nb3,1,0\n", encoding="utf-8")
    asked = {"as_json": True, "additional": "ebner:b3,b5"}
    wanted = run_adjust(folder, additional_prior=["b5=20+-3,b3=1+-0"], **asked)[1]
    several = ["b5=20+-3" + " " * 300, "b3=1+-0"]  # longer than a file's name can be
    for given in (known, str(known), [known], [str(known)], several):
        assert run_adjust(folder, additional_prior=given, **asked)[1] == wanted


@pytest.mark.parametrize(
    "option", ["additional_sigma_um", "additional_prior", "additional_reference_mm"]
)
@pytest.mark.parametrize("errors", [None, "baarda"])
def test_weights_of_no_parameters_are_refused(tmp_path: Path, option: str, errors) -> None:
    folder = write(tmp_path / "block", strip())
    value = ["b3=1"] if option == "additional_prior" else 5.0
    with pytest.raises(InputError, match=rf"--{option.replace('_', '-')} goes with --additional"):
        run_adjust(folder, errors=errors, **{option: value})


def test_the_choice_of_parameters_is_shown_step_by_step(tmp_path: Path) -> None:
    folder = write(tmp_path / "block", strip(planted=0.02))
    text = report(folder, additional="auto:ebner")
    assert "CHOICE OF ADDITIONAL PARAMETERS  alpha 0.05: 0.05 for each of 1 set" in text
    answer = json.loads(run_adjust(folder, as_json=True, additional="auto:ebner")[1])
    choice = answer["choice"]
    assert choice["chosen"] == "ebner"
    assert [row["name"] for row in answer["additional"]["parameters"]] == choice["parameters"]
    steps = choice["sets"][0]["steps"]
    assert [steps[0]["stage"], steps[-1]["stage"]] == ["all", "kept"]
    assert steps[0]["verdict"]["estimated"]["critical"] > 1.0
    assert {"change_m", "rms_X_m", "sigma_after_m"} <= steps[-1]["ground"].keys()
    table = text[text.index("CHOICE") : text.index("HYPOTHESES")]
    for step, shown in (("all together", "significant"), ("what is kept", "kept")):
        line = next(line for line in table.splitlines() if line.strip().startswith(step))
        assert line.rstrip().endswith(shown)


def test_nothing_is_taken_of_a_block_without_systematic_errors(tmp_path: Path) -> None:
    folder = write(tmp_path / "block", strip())
    answer = json.loads(run_adjust(folder, as_json=True, additional="auto:ebner")[1])
    assert answer["choice"]["chosen"] is None
    assert answer["choice"]["parameters"] == []
    assert "additional" not in answer
    assert "none is taken: nothing systematic is proved" in report(folder, additional="auto:ebner")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"errors": "baarda"}, "without --errors"),
        ({"additional_sigma_um": 5.0}, "not with auto"),
        ({"additional_prior": ["b1=3"]}, "not with auto"),
        ({"additional_reference_mm": 90.0}, "not with auto"),
    ],
)
def test_what_does_not_go_with_the_choice_is_told(tmp_path: Path, more, said: str) -> None:
    folder = write(tmp_path / "block", strip())
    with pytest.raises(InputError, match=said):
        run_adjust(folder, additional="auto", **more)
