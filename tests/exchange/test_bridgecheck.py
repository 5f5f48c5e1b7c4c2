"""What bridging asks of a block, and which rows belong to a model."""

from __future__ import annotations

import json
import re

import pytest
from clibench import make_block as make_demo
from hypothesis import given
from hypothesis import strategies as st

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import check_for_bridge, read_block
from anaplot.photogrammetry.block import ImagePoint
from anaplot.photogrammetry.selection import model_name, points_of, rows_by_photo

HEADER = "photo,point,x,y,model\n"
GOOD = HEADER + "101,1,1,2,\n102,1,3,4,101/102\n102,1,3,4,102/103\n103,1,5,6,\n"


def camera_of(toml: str) -> str:
    found = re.search(r'^\[\[camera\]\]\s+id = "([^"]+)"', toml, re.MULTILINE)
    assert found is not None
    return found[1]


def refused(folder) -> str:
    block = read_block(folder)
    with pytest.raises(InputError) as caught:
        check_for_bridge(block)
    return str(caught.value)


def test_a_block_that_can_be_begun_passes(make_block):
    block = read_block(make_block(points=GOOD))
    check_for_bridge(block)
    assert len(block.image_points) == 4


def test_a_photo_in_no_strip(make_block, block_toml):
    toml = block_toml + '[[photo]]\nid = "999"\ncamera = "rmk"\n'
    assert "photo '999' is in no strip" in refused(make_block(toml, GOOD))


def test_a_photo_without_points(make_block, block_toml):
    message = refused(make_block(points=HEADER + "102,1,3,4,\n103,1,5,6,\n"))
    assert message == "image_points.csv: photo '101' of strip '1' has no image points"
    # a later one is not measured yet: what is there can be computed
    begun = make_block(points=HEADER + "101,1,1,2,\n102,1,3,4,\n")
    check_for_bridge(read_block(begun))


def test_a_strip_that_is_not_begun_does_not_stop_the_others(tmp_path, capsys):
    folder = make_demo(tmp_path / "b", photos=4)
    toml = (folder / "block.toml").read_text()
    more = '[[strip]]\nid = "2"\nphotos = ["201", "202", "203"]\n'
    names = "".join(
        f'[[photo]]\nid = "{n}"\ncamera = "{camera_of(toml)}"\n' for n in (201, 202, 203)
    )
    (folder / "block.toml").write_text(toml + more + names)
    rows = (folder / "image_points.csv").read_text().splitlines()
    (folder / "image_points.csv").write_text("\n".join(r for r in rows if r[:4] != "104,") + "\n")
    assert main(["bridge", str(folder), "--json"]) == 4
    out, err = capsys.readouterr()
    first, second = json.loads(out)["strips"]
    assert [(m["left"], m["right"]) for m in first["models"]] == [("101", "102"), ("102", "103")]
    assert first["error"] == "strip 1, model 103/104: photo 104 has no image points"
    assert second["models"] == []
    assert second["error"] == "strip 2, model 201/202: photo 201 has no image points"
    assert first["error"] in err


def test_no_points_at_all(make_block):
    message = refused(make_block())
    assert message.startswith("image_points.csv: photo '101' of strip '1' has no image points")


@pytest.mark.parametrize(
    "rows",
    [
        "101,1,1,2,\n102,2,3,4,\n103,1,5,6,\n",
        "101,1,1,2,\n102,1,3,4,102/103\n103,1,5,6,\n",
    ],
)
def test_a_first_model_without_common_points(make_block, rows):
    message = refused(make_block(points=HEADER + rows))
    assert "photos '101' and '102' of strip '1' have no common points" in message


def test_a_later_model_without_common_points_is_left_to_the_computation(make_block):
    rows = "101,1,1,2,\n102,1,3,4,\n103,2,5,6,\n"
    block = read_block(make_block(points=HEADER + rows))
    check_for_bridge(block)
    assert not points_of(block.image_points, "102", "102/103").keys() & points_of(
        block.image_points, "103", "102/103"
    )


def test_a_model_takes_its_own_row_else_the_row_without_a_model():
    plain = ImagePoint("102", "1", 1.0, 1.0)
    only_plain = ImagePoint("102", "2", 2.0, 2.0)
    other = ImagePoint("102", "1", 3.0, 3.0, None, "102/103")
    only_other = ImagePoint("102", "3", 4.0, 4.0, None, "102/103")
    own = ImagePoint("102", "1", 5.0, 5.0, None, "101/102")
    elsewhere = ImagePoint("101", "1", 6.0, 6.0, None, "101/102")
    rows = [plain, only_plain, other, only_other, own, elsewhere]
    assert list(points_of(rows, "102", "101/102").items()) == [("2", only_plain), ("1", own)]
    assert list(points_of(rows[::-1], "102", "101/102").items()) == [
        ("1", own),
        ("2", only_plain),
    ]
    assert list(points_of(rows, "102", "102/103").values()) == [only_plain, other, only_other]
    assert points_of(rows, "103", "102/103") == {}


row = st.builds(
    ImagePoint,
    st.sampled_from(["a", "b", "c"]),
    st.sampled_from(["1", "2", "3"]),
    st.floats(-1, 1),
    st.just(0.0),
    st.none(),
    st.sampled_from([None, "a/b", "b/c"]),
)


@given(st.lists(row, max_size=27, unique_by=lambda r: (r.photo, r.point, r.model)))
def test_selection_follows_the_rule_for_any_rows(rows):
    grouped = rows_by_photo(rows)
    assert {photo: len(group) for photo, group in grouped.items()} == {
        photo: sum(r.photo == photo for r in rows) for photo in {r.photo for r in rows}
    }
    for left, right in (("a", "b"), ("b", "c")):
        model = model_name(left, right)
        for photo in (left, right):
            chosen = points_of(rows, photo, model)
            assert chosen == points_of(grouped.get(photo, []), photo, model)
            assert list(chosen.values()) == [r for r in rows if r in chosen.values()]
            for point in ("1", "2", "3"):
                candidates = {r.model: r for r in rows if r.photo == photo and r.point == point}
                expected = candidates.get(model, candidates.get(None))
                assert chosen.get(point) == expected
