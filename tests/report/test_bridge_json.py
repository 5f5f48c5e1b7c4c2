"""The JSON of `bridge`: keys, order of rows, nulls (conventions, "What programs read")."""

import json
from dataclasses import replace

import numpy as np
import pytest

from anaplot.orientation.model import orient
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.patterns import pattern
from anaplot.orientation.strip import BridgedStrip, bridge_strip
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ImagePoint,
    Photo,
    Precision,
    Strip,
    TestSettings,
)
from anaplot.report.asjson import json_text
from anaplot.report.astext import page_text
from anaplot.report.bridgecommand import bridge_block, bridge_document
from anaplot.report.modeldocument import model_document, model_rows

B, D, C = 92.0, 100.0, 152.4


def block():
    """Three vertical photos over hilly ground; points in no particular order, one tie switched."""
    rng = np.random.default_rng(6)
    ground = {}
    for k in range(3):
        for label, (x, y) in pattern("13").positions(B, D, (4.0, 4.0)).items():
            if label[0] in "123" or (label[0] in "789" and k < 2):
                ground[f"{k}-{label}"] = np.array([x + k * B, y, rng.uniform(-165, -140)])
    order = list(ground)
    rng.shuffle(order)
    rows = []
    for k in range(3):
        for name in order:
            x, y, z = ground[name] - [k * B, 0.0, 0.0]
            if abs(int(name[0]) - k) <= 1:
                x, y = np.array([x, y]) * C / -z + 0.004 * rng.standard_normal(2)
                rows.append(ImagePoint(str(k), name, float(x), float(y)))
    return Block(
        "b",
        Precision(5.0, "propagated"),
        TestSettings(),
        (Camera("c", C),),
        tuple(Photo(str(k), "c") for k in range(3)),
        (Strip("s", ("0", "1", "2"), B),),
        tuple(rows),
    )


def parsed(data, strips=None):
    document = bridge_document(data, bridge_block(data) if strips is None else strips)
    answer = json.loads(json_text(document.answer))
    assert answer == document.to_dict()
    return answer


def answer_of(model):
    return json.loads(json_text(model_document(model, strip="s", number=1, count=1).answer))


def test_keys_and_units():
    data = block()
    bridged = bridge_strip(data, data.strips[0])
    assert bridged.error is None
    (strip,) = parsed(data, [bridged])["strips"]
    assert strip["strip"] == "s"
    assert "error" not in strip
    assert len(strip["models"]) == 2
    keys = {
        "left", "right", "base", "rotation", "sigma0_um", "redundancy", "iterations", "test",
        "table", "points", "ties",
    }  # fmt: skip
    for model, solution in zip(strip["models"], bridged.models, strict=True):
        assert keys <= set(model)
        odds = model["odds"]
        assert [(r["point"], r["axis"]) for r in odds["rows"]] == [r.key for r in solution.table]
        total = odds["none"] + sum(r["probability"] for r in odds["rows"])
        assert total == pytest.approx(1.0)
        assert set(model["rotation"]) == {"omega", "phi", "kappa"}
        assert model["test"] == {
            "kind": "tau",
            "alpha": 0.001,
            "critical": solution.test.critical,
        }
        assert model["base"] == pytest.approx(solution.base)
        assert model["base"][0] == pytest.approx(B, rel=0.02)
        assert abs(model["rotation"]["kappa"]) < 0.01
        for row in model["table"]:
            assert list(row) == [
                "point", "axis", "redn", "parx_um", "expd_um", "sigf", "flagged",
            ]  # fmt: skip
        assert all(set(p) == {"point", "X", "Y", "Z", "sX", "sY", "sZ"} for p in model["points"])
    assert strip["models"][0]["ties"] == []
    # two models of one system: the rotation is that in the strip, the points agree
    first, second = ({p["point"]: p for p in m["points"]} for m in strip["models"])
    for name in strip["models"][1]["ties"]:
        assert second[name]["X"] == pytest.approx(first[name]["X"], abs=0.3)
        assert second[name]["Z"] == pytest.approx(first[name]["Z"], abs=0.3)


def test_rows_all_y_in_the_order_of_the_left_photo_then_all_x():
    data = block()
    bridged = bridge_strip(data, data.strips[0])
    (strip,) = parsed(data, [bridged])["strips"]
    previous: list[str] = []
    for k, model in enumerate(strip["models"]):
        right = {p.point for p in data.image_points if p.photo == str(k + 1)}
        common = [p.point for p in data.image_points if p.photo == str(k) and p.point in right]
        ties = [p for p in common if p in previous]
        keys = [(row["point"], row["axis"]) for row in model["table"]]
        assert keys == [(p, "y") for p in common] + [(p, "x") for p in ties]
        assert [p["point"] for p in model["points"]] == common
        assert model["ties"] == ties
        previous = common


def five_points():
    p = pattern("6")
    places = p.positions(B, D)
    labels = p.labels[:4] + p.labels[5:]
    xl = np.array([places[label] for label in labels])
    pair = Stereopair("1", "2", labels, xl, xl - [B, 0.0], C, C, base=B)
    return orient(pair, Precision(), TestSettings())


def test_what_does_not_exist_is_null():
    model = answer_of(five_points())
    assert model["sigma0_um"] is None
    assert model["redundancy"] == 0
    assert model["test"]["critical"] is None
    assert all(row["expd_um"] is None and row["sigf"] is None for row in model["table"])
    assert all(row["flagged"] is False for row in model["table"])


def test_a_point_at_infinity_is_null_and_not_infinite():
    model = five_points()
    nowhere = np.array([[np.inf], [np.nan], [-np.inf]])
    cofactors = np.full((1, 3, 3), np.nan)
    model = replace(
        model, names=("9",), of_coordinates=lambda: nowhere, of_points=lambda: cofactors
    )
    data = answer_of(model)
    (point,) = data["points"]
    assert point == {"point": "9", **dict.fromkeys(("X", "Y", "Z", "sX", "sY", "sZ"))}


def test_a_strip_that_ended_early_carries_its_error():
    model = five_points()
    strips = [BridgedStrip("s", (model,), "strip s, model 2/3: no ties"), BridgedStrip("t", ())]
    data = block()
    data = replace(data, strips=(*data.strips, Strip("t", ("3", "4"))))
    first, second = parsed(data, strips)["strips"]
    assert first["error"] == "strip s, model 2/3: no ties"
    assert len(first["models"]) == 1
    assert second == {"strip": "t", "models": []}


def test_sigma0_is_the_estimated_one_under_baarda_too():
    data = replace(block(), test=TestSettings("baarda"))
    bridged = bridge_strip(data, data.strips[0])
    (strip,) = parsed(data, [bridged])["strips"]
    for model in strip["models"]:
        v = np.array([row["parx_um"] for row in model["table"]])
        q = np.array([2.0 if row["axis"] == "y" else 6.0 for row in model["table"]])
        expected = float(np.sqrt(v @ (v / q) / model["redundancy"]))
        assert model["sigma0_um"] == pytest.approx(expected, rel=0.02)
        assert model["test"]["critical"] == pytest.approx(3.29, abs=0.002)
        for row in model["table"]:
            assert row["sigf"] == pytest.approx(abs(row["parx_um"]) / row["expd_um"])


def test_rows_of_any_table():
    rows = model_rows(five_points().table).records()
    assert [row["point"] for row in rows] == ["1", "2", "3", "4", "6"]


def switched_off():
    """Return the block with two rows, a tie and a new point of its second model off."""
    uses = {"1-1": "x", "1-2": "y", "1-3": "off", "2-1": "off"}
    data = block()
    rows = (
        replace(row, use=uses.get(row.point, "xy")) if row.photo == "2" else row
        for row in data.image_points
    )
    return replace(data, image_points=tuple(rows))


def test_what_is_switched_off_stays_in_the_table_in_its_place():
    data = switched_off()
    (strip,) = parsed(data)["strips"]
    (whole,) = parsed(block())["strips"]
    first, second = strip["models"]
    # nobody is told of it where nothing is off
    assert first == whole["models"][0]
    assert "off" not in first["table"][0]
    rows = second["table"]
    before = whole["models"][1]["table"]
    assert [(row["point"], row["axis"]) for row in rows] == [
        (row["point"], row["axis"]) for row in before
    ]
    off = [row for row in rows if row["off"]]
    assert {(row["point"], row["axis"]) for row in off} == {
        *(("1-1", "y"), ("1-2", "x"), ("1-3", "y"), ("1-3", "x"), ("2-1", "y"))
    }
    for row in off:
        assert [row[key] for key in ("redn", "expd_um", "sigf", "flagged")] == [
            *(None, None, None, False)
        ]
        assert isinstance(row["parx_um"], float)
    assert second["redundancy"] == whole["models"][1]["redundancy"] - len(off)
    assert sum(row["redn"] for row in rows if not row["off"]) == pytest.approx(second["redundancy"])
    assert "1-3" not in {point["point"] for point in second["points"]}
    assert len(second["odds"]["rows"]) == len(rows) - len(off)
    document = bridge_document(data, bridge_block(data))
    text = page_text(document.page)
    lines = [line.split() for line in text.splitlines() if line.endswith("  off")]
    assert [line[:3] for line in lines] == [[row["point"], row["axis"], "-"] for row in off]
    assert all(line[4:] == ["-", "-", "off"] for line in lines)
    # one file, one set of columns: the first model's rows say that they are on
    table = document.tables[0].records()
    assert [row["off"] for row in table].count(True) == len(off)
    assert {row["off"] for row in table if row["right"] == "1"} == {False}


def test_files_hold_the_tables_of_all_models_with_what_they_belong_to():
    data = block()
    document = bridge_document(data, bridge_block(data, "baarda"))
    (strip,) = document.to_dict()["strips"]
    rows, points, rejected = document.tables
    for one, key in ((rows, "table"), (points, "points")):
        assert one.records() == [
            {"strip": "s", "left": model["left"], "right": model["right"], **row}
            for model in strip["models"]
            for row in model[key]
        ]
    assert [column.key for column, _ in rejected.for_programs()][:4] == [
        "strip", "left", "right", "point",
    ]  # fmt: skip
    assert len(rejected) == sum(len(model["errors"]["rejected"]) for model in strip["models"])
    assert len(bridge_document(data, bridge_block(data)).tables) == 2


def test_correlations_of_orientations_are_those_of_the_accuracy_on_every_page_and_in_a_table():
    data = block()
    document = bridge_document(data, bridge_block(data), correlations=True)
    models = document.to_dict()["strips"][0]["models"]
    pages = page_text(document.page).split("STRIP s")[1:]
    (found,) = (one for one in document.tables if one.key == "correlations")
    rows = found.records()
    for model, page in zip(models, pages, strict=True):
        accuracy = model["accuracy"]
        elements, rho = accuracy["elements"], accuracy["correlations"]
        mine = [
            row for row in rows if (row["left"], row["right"]) == (model["left"], model["right"])
        ]
        assert [row["element"] for row in mine] == elements
        head, *lines = page.split("the left photo held")[1].splitlines()[1:]
        assert head.split() == elements
        for row, line, values in zip(mine, lines, rho, strict=False):
            assert [row[element] for element in elements] == values
            assert line.split() == [row["element"], *(f"{value:.3f}" for value in values)]
            assert row[row["element"]] == 1.0
    assert [row["bx"] is None for row in rows] == [True] * 5 + [False] * 6
    without = bridge_document(data, bridge_block(data))
    assert "left photo held" not in page_text(without.page)
    assert [one.key for one in without.tables] == ["rows", "points"]
    with_matrix = bridge_document(data, bridge_block(data), correlations=True, matrix=True)
    keys = [one.key for one in with_matrix.tables]
    assert keys == ["rows", "points", "correlations", "matrix"]
