"""block.toml: what is read, and one line that says what is wrong and where."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_new_block
from anaplot.exchange.blocktoml import format_block_toml, parse_block_toml
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    Photo,
    Precision,
    Strip,
    TestSettings,
)
from anaplot.textfiles.names import name_fault

MINIMAL = """\
format = 1
name = "m"
[[camera]]
id = "k"
c = 100
[[strip]]
id = "s"
photos = ["a", "b"]
[[photo]]
id = "a"
camera = "k"
[[photo]]
id = "b"
camera = "k"
"""


def refused(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_block_toml(text, Path("B/block.toml"))
    message = str(caught.value)
    assert "\n" not in message
    assert message.isprintable()
    assert message.startswith("B/block.toml")
    return message


def test_everything_the_example_states_is_read(make_block):
    block = read_block(make_block())
    assert block.name == "demo"
    assert block.precision == Precision(5.0, "paper", 0.05)
    assert block.test == TestSettings("tau", 0.001, 0.80)
    assert block.cameras == (Camera("rmk", 152.40, (230.0, 230.0)),)
    assert block.strips == (Strip("1", ("101", "102", "103"), 92.0),)
    first, second, third = block.photos
    assert first.position == (1000.0, 2000.0, 1500.0)
    assert first.rotation == pytest.approx((0.0, math.pi / 2, -math.pi))
    assert first.position_sigma == (10.0, 10.0, 10.0)
    assert first.rotation_sigma == pytest.approx((math.pi / 2000,) * 3)
    assert second == Photo("102", "rmk")
    assert third == Photo("103", "rmk")
    assert block.image_points == ()
    assert block.control == ()


def test_what_may_be_left_out_has_the_documented_defaults():
    block = parse_block_toml(MINIMAL, Path("block.toml"))
    assert block.precision == Precision(5.0, "paper", 0.05)
    assert block.test == TestSettings("tau", 0.001, 0.80)
    assert block.cameras == (Camera("k", 100.0, None),)
    assert block.strips == (Strip("s", ("a", "b"), None),)


def test_the_sign_of_the_base_is_left_to_the_data(block_toml):
    block = parse_block_toml(block_toml.replace("base = 92.0", "base = -92.0"), Path("block.toml"))
    assert block.strips[0].base == 92.0


def test_line_ends_of_other_systems_and_a_byte_order_mark_are_tolerated(make_block, block_toml):
    plain = read_block(make_block())
    crlf = b"\xef\xbb\xbf" + block_toml.replace("\n", "\r\n").encode()
    assert read_block(make_block(toml=crlf)) == plain


@pytest.mark.parametrize(
    ("unit", "full_turn"), [("deg", 360.0), ("gon", 400.0), ("rad", 2.0 * math.pi)]
)
def test_angles_are_radians_inside(block_toml, unit, full_turn):
    old = 'rotation = { omega = 0.0, phi = 90.0, kappa = -180.0, unit = "deg" }'
    new = f'rotation = {{ omega = 0, phi = {full_turn / 4}, kappa = {full_turn}, unit = "{unit}" }}'
    block = parse_block_toml(block_toml.replace(old, new), Path("block.toml"))
    assert block.photos[0].rotation == pytest.approx((0.0, math.pi / 2, 2.0 * math.pi))


def number_of(text: str, line: str) -> int:
    return text.splitlines().index(line) + 1


@pytest.mark.parametrize(
    ("old", "new", "at", "words"),
    [
        ("format = 1\n", "", None, ["no key 'format'"]),
        ("format = 1\n", "format = 2\n", "format = 2", ["newer version"]),
        ("format = 1\n", "format = 0\n", "format = 0", ["format: must be 1"]),
        ("format = 1\n", "format = true\n", "format = true", ["whole number"]),
        ("format = 1\n", 'format = "1"\n', 'format = "1"', ["whole number", "text"]),
        ('name = "demo"\n', "", None, ["no key 'name'"]),
        ('name = "demo"', "name = 5", "name = 5", ["quotes"]),
        ('name = "demo"', 'name = ""', 'name = ""', ["is empty"]),
        ('name = "demo"', f'name = "{"n" * 256}"', f'name = "{"n" * 256}"', ["longer than 255"]),
        ('name = "demo"', r'name = "a\u001b[2J"', r'name = "a\u001b[2J"', [r"\x1b[2J", "printed"]),
        ('name = "demo"', 'name = " a"', 'name = " a"', ["blank"]),
        (
            'name = "demo"',
            'nmae = "demo"',
            'nmae = "demo"',
            ["nmae: unknown key", "did you mean 'name'"],
        ),
        ("[precision]", "[precison]", "[precison]", ["did you mean 'precision'"]),
        ("image_um = 5.0", "image_µm = 5.0", None, ["not valid TOML"]),
        ("image_um = 5.0", "imageum = 5.0", "imageum = 5.0", ["[precision]", "'image_um'"]),
        ("image_um = 5.0", "image_um = 0", "image_um = 0", ["image_um", "greater than 0"]),
        (
            "image_um = 5.0",
            "image_um = 1e-160",
            "image_um = 1e-160",
            ["is too small for a standard"],
        ),
        ("image_um = 5.0", "image_um = nan", "image_um = nan", ["finite"]),
        ("image_um = 5.0", "image_um = inf", "image_um = inf", ["finite"]),
        ("image_um = 5.0", "image_um = 1e999", "image_um = 1e999", ["finite"]),
        ("image_um = 5.0", "image_um = 1" + "0" * 400, "image_um = 1" + "0" * 400, ["finite"]),
        ("image_um = 5.0", 'image_um = "5"', 'image_um = "5"', ["must be a number, not text"]),
        ("image_um = 5.0", "image_um = true", "image_um = true", ["not true or false"]),
        ("image_um = 5.0", "image_um = 1999-01-01", "image_um = 1999-01-01", ["a date"]),
        ("control_m = 0.05", "control_m = -1", "control_m = -1", ["must be 0 or greater, not -1"]),
        ('"paper"', '"papers"', 'tie_variance = "papers"', ["did you mean 'paper'"]),
        ('kind = "tau"', "kind = 3", "kind = 3", ['must be "tau" or "baarda"']),
        ("alpha = 0.001", "alpha = 0", "alpha = 0", ["between 0 and 1"]),
        ("alpha = 0.001", "alpha = 1.0", "alpha = 1.0", ["between 0 and 1"]),
        ("power = 0.80", "power = 80", "power = 80", ["between 0 and 1"]),
        ("power = 0.80", "power = 0.0005", "power = 0.0005", ["greater than alpha = 0.001"]),
        ("alpha = 0.001\npower = 0.80", "alpha = 0.8", "alpha = 0.8", ["power = 0.8 must be"]),
        ("c = 152.40", "c = -152.40", "c = -152.40", ["greater than 0"]),
        ("c = 152.40", "cc = 152.40", "cc = 152.40", ["[[camera]]", "did you mean 'c'"]),
        ("c = 152.40\n", "", "[[camera]]", ["[[camera]]: no key 'c'"]),
        ('id = "rmk"\n', "", "[[camera]]", ["no key 'id'"]),
        ("[230.0, 230.0]", "[230.0]", "format = [230.0]", ["2 numbers, not 1"]),
        ("[230.0, 230.0]", "230.0", "format = 230.0", ["list of 2 numbers"]),
        ("[230.0, 230.0]", "[230.0, -1]", "format = [230.0, -1]", ["greater than 0"]),
        ("[230.0, 230.0]", '[230.0, "x"]', 'format = [230.0, "x"]', ["must be a number"]),
        ("[[camera]]", "[camera]", "[camera]", ["must be written [[camera]]"]),
        ("base = 92.0", "base = 0.0", "base = 0.0", ["base: must not be 0"]),
        ("base = 92.0", "base = nan", "base = nan", ["finite"]),
        ('photos = ["101", "102", "103"]', 'first = "101"', "[[strip]]", ["no key 'last'"]),
        ('"102", "103"]', '"102", "102"]', 'photos = ["101", "102", "102"]', ["'102' twice"]),
        ('"102", "103"]', '"102", 103]', 'photos = ["101", "102", 103]', ["quotes"]),
        ('["101", "102", "103"]', '["101"]', 'photos = ["101"]', ["fewer than 2 photos"]),
        ('["101", "102", "103"]', '"101"', 'photos = "101"', ["list of photos"]),
        ("position = [1000.0,", "position = [", None, ["3 numbers, not 2"]),
        ("position = [1000.0,", "position = [nan,", None, ["finite"]),
        ('unit = "deg"', 'unit = "grad"', None, ["unit", '"deg" or "gon" or "rad"']),
        (', unit = "deg" }', " }", None, ["rotation: no key 'unit'"]),
        ("phi = 90.0, kappa", "kappa", None, ["rotation: no key 'phi'"]),
        ("phi = 90.0", "ph = 90.0", None, ["[[photo]] rotation.ph: unknown key", "'phi'"]),
        ("phi = 90.0", "phi = 90.0, phi = 2", None, ["not valid TOML"]),
        ("position = [1000.0, 2000.0, 1500.0]\n", "", None, ["position_sigma without position"]),
        ("[10.0, 10.0, 10.0]", "[10.0, 1e300, 10.0]", None, ["1e+300 is too large for a standard"]),
        (
            "[1000.0, 2000.0, 1500.0]",
            "[1000.0, 1e160, 1500.0]",
            None,
            ["position", "between -1e+12"],
        ),
        ("[10.0, 10.0, 10.0]", "[10.0, 0.0, 10.0]", None, ["position_sigma", "greater than 0"]),
        ("omega = 0.1", "omega = -0.1", None, ["rotation_sigma", "greater than 0"]),
        ('name = "demo"', 'name = "demo', 'name = "demo', ["not valid TOML"]),
    ],
)
def test_what_is_wrong_is_named_with_its_line(block_toml, old, new, at, words):
    assert old in block_toml
    text = block_toml.replace(old, new, 1)
    message = refused(text)
    for word in words:
        assert word in message
    if at is not None:
        assert f"block.toml line {number_of(text, at)}: " in message


@pytest.mark.parametrize("latitude", [-95.0, 90.5, -90.0, 90.0])
def test_the_origin_of_a_local_frame_lies_on_earth(latitude):
    ground = f'[ground]\ncrs = "EPSG:4979"\nframe = "local"\norigin = [8.25, {latitude}, 400.0]\n'
    if abs(latitude) > 90.0:
        assert "the second is a latitude, from -90 to 90 degrees" in refused(MINIMAL + ground)
    else:
        assert parse_block_toml(MINIMAL + ground, Path("B")).ground.origin[1] == latitude


def test_duplicates_name_both_lines(block_toml):
    for what, identity in (("camera", "rmk"), ("strip", "1"), ("photo", "102")):
        rest = {
            "camera": "c = 1.0",
            "strip": 'photos = ["101", "102"]',
            "photo": 'camera = "rmk"',
        }[what]
        text = block_toml + f'[[{what}]]\nid = "{identity}"\n{rest}\n'
        message = refused(text)
        first = number_of(text, f'id = "{identity}"')
        assert (
            f"line {len(text.splitlines()) - 1}: [[{what}]] id: {what} '{identity}' twice"
            in message
        )
        assert f"(first in line {first})" in message


ONE = '[[camera]]\nid = "k"\nc = 100\n'
TWO = ONE + '[[camera]]\nid = "l"\nc = 150\n'
HEAD = 'format = 1\nname = "m"\n'


def test_a_block_needs_a_camera_and_photos():
    assert "no camera" in refused(HEAD)
    assert "with several cameras each photo is declared" in refused(HEAD + TWO)


def test_photos_that_a_strip_names_belong_to_the_only_camera():
    strips = (
        '[[strip]]\nid = "s"\nphotos = ["a", "b"]\n[[strip]]\nid = "t"\nfirst = "12"\nlast = "9"\n'
    )
    declared = '[[photo]]\nid = "b"\ncamera = "k"\nposition = [1, 2, 3]\n'
    block = parse_block_toml(HEAD + ONE + strips + declared, Path("block.toml"))
    assert [photo.id for photo in block.photos] == ["b", "a", "12", "11", "10", "9"]
    assert {photo.camera for photo in block.photos} == {"k"}
    assert block.photos[0].position == (1.0, 2.0, 3.0)
    assert block.strips[1].photos == ("12", "11", "10", "9")
    # written out, it is the same block
    again = parse_block_toml(format_block_toml(block), Path("block.toml"))
    assert again == block


def test_with_several_cameras_a_photo_is_declared():
    strip = '[[strip]]\nid = "s"\nphotos = ["a", "b"]\n'
    assert "[[strip]] photos: unknown photo 'a'" in refused(HEAD + TWO + strip)
    ranged = '[[strip]]\nid = "s"\nfirst = "1"\nlast = "3"\n'
    photos = "".join(f'[[photo]]\nid = "{k}"\ncamera = "l"\n' for k in (1, 3))
    assert "[[strip]] first: unknown photo '2'" in refused(HEAD + TWO + ranged + photos)


def test_a_range_of_photos_that_is_none():
    def strip(keys: str) -> str:
        return refused(HEAD + ONE + '[[strip]]\nid = "s"\n' + keys)

    assert "photos beside first and last" in strip('photos = ["1", "2"]\nfirst = "1"\nlast = "2"\n')
    assert "differ before the number" in strip('first = "a1"\nlast = "b2"\n')
    assert "no number at its end" in strip('first = "a"\nlast = "b"\n')
    assert "equally long" in strip('first = "098"\nlast = "1001"\n')
    assert "more than 10000 photos" in strip('first = "1"\nlast = "999999999"\n')
    assert "fewer than 2" in strip('first = "7"\nlast = "7"\n')


def test_with_what_a_block_is_measured():
    text = HEAD + '[measuring]\nprofile = "anaplot-ascii"\npattern = "9"\n' + ONE
    text += '[[strip]]\nid = "s"\nfirst = "1"\nlast = "3"\n'
    block = parse_block_toml(text, Path("block.toml"))
    assert (block.measuring.profile, block.measuring.pattern) == ("anaplot-ascii", "9")
    assert parse_block_toml(format_block_toml(block), Path("block.toml")) == block
    assert "did you mean 'pattern'" in refused(text.replace("pattern", "patern"))


def test_an_unknown_camera_is_named_with_the_nearest(block_toml):
    text = block_toml.replace('camera = "rmk"', 'camera = "rmx"', 1)
    message = refused(text)
    assert "[[photo]] camera: unknown camera 'rmx' (did you mean 'rmk'?)" in message
    at = number_of(text, 'camera = "rmx"')
    assert f"line {at}: " in message


def test_a_slash_is_part_of_a_name_and_two_models_of_one_name_are_refused(block_toml):
    block = parse_block_toml(block_toml.replace('"102"', '"10/2"'), Path("block.toml"))
    assert block.photos[1].id == "10/2"
    text = """format = 1
name = "n"
camera = [{ id = "c", c = 1.0 }]
[[strip]]
id = "1"
photos = ["a", "b/c"]
[[strip]]
id = "2"
photos = ["a/b", "c"]
"""
    assert "two models would be called 'a/b/c'" in refused(text)


def test_a_newer_format_is_told_before_its_unknown_keys(block_toml):
    text = block_toml.replace("format = 1", "format = 3").replace("name", "title")
    assert "newer version" in refused(text)


def test_the_line_of_an_element_in_a_long_list_is_named(block_toml):
    text = block_toml.replace(
        '["101", "102", "103"]', '[\n  "101", # first\n  "102",\n  "10 3",\n]'
    )
    text = text.replace("c = 152.40", 'c = 152.40\n[[camera]]\nid = "other"\nc = 9')
    at = number_of(text, '  "10 3",')
    assert f"line {at}: [[strip]] photos: unknown photo '10 3'" in refused(text)


@pytest.mark.parametrize(
    "text",
    [
        "x = " + "[" * 100_000,
        "x = " + "9" * 5000,
        "format = 0x" + "f" * 5000,
        "format = 1\nname = 0x" + "f" * 5000,
        "a." * 2000 + "b = 1",
        "\r",
        "\x00",
        "=",
        "",
    ],
)
def test_hostile_texts_are_input_errors(text):
    refused(text)


def test_files_that_cannot_be_read(make_block, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="nowhere: no such folder"):
        read_block(tmp_path / "nowhere")
    with pytest.raises(InputError, match="cannot be read"):
        read_block(Path("a\0b"))
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match=r"block\.toml: file not found"):
        read_block(empty)
    folder = make_block()
    with pytest.raises(InputError, match=r"block\.toml: not a folder"):
        read_block(folder / "block.toml")
    with pytest.raises(InputError, match=r"block\.toml line 2: not UTF-8"):
        read_block(make_block(toml=b'format = 1\nname = "\xff"\n'))
    with pytest.raises(InputError, match=r"block\.toml line 2: not UTF-8"):
        read_block(make_block(toml=b'\xef\xbb\xbfformat = 1\nname = "\xff"\n'))
    with pytest.raises(InputError, match="more than 64 MB is not read"):
        read_block(make_block(toml=b"#" * 64_000_001))
    make_block()
    monkeypatch.setattr(os, "open", _permission_denied)
    with pytest.raises(InputError, match=r"block\.toml: cannot be read: Permission denied"):
        read_block(folder)


def _permission_denied(*_: object, **__: object) -> None:
    raise PermissionError(13, "Permission denied")


def test_what_is_measured_in_flight():
    offsets = (
        '[gnss]\nshift = "strip"\nshift_sigma = [1, 2, 3]\ndrift = "block"\n'
        '[imu]\nboresight = "camera"\n'
        'boresight_sigma = { omega = 10, phi = 20, kappa = 30, unit = "gon" }\n'
    )
    arm = ONE + "lever_arm = [0.35, -0.6, 1.8]\n"
    photo = '[[photo]]\nid = "1"\ncamera = "k"\nposition = [1, 2, 3]\ntime = -345600.25\n'
    text = HEAD + offsets + arm + photo
    block = parse_block_toml(text, Path("block.toml"))
    assert block.offsets is not None
    assert (block.offsets.shift, block.offsets.drift) == ("strip", "block")
    assert (block.offsets.shift_sigma, block.offsets.drift_sigma) == ((1, 2, 3), None)
    assert block.offsets.boresight == "camera"
    assert block.offsets.boresight_sigma == pytest.approx([k * math.pi / 20 for k in (1, 2, 3)])
    assert block.cameras[0].lever_arm == (0.35, -0.6, 1.8)
    assert block.photos[0].time == -345600.25
    assert parse_block_toml(format_block_toml(block), Path("block.toml")) == block
    assert parse_block_toml(HEAD + ONE + photo, Path("block.toml")).offsets is None
    assert "did you mean 'shift'" in refused(text.replace('shift = "', 'shfit = "'))
    assert 'must be "block" or "strip"' in refused(text.replace('"strip"', '"camera"'))
    assert 'must be "block" or "camera"' in refused(text.replace('"camera"\nb', '"strip"\nb'))
    assert "shift_sigma without shift" in refused(text.replace('shift = "strip"\n', ""))
    assert "boresight_sigma without" in refused(text.replace('boresight = "camera"\n', ""))
    assert "greater than 0" in refused(text.replace("[1, 2, 3]\ndrift", "[1, 0, 3]\ndrift"))
    assert "3 numbers, not 2" in refused(text.replace("-0.6, 1.8", "1.8"))
    assert "time" in refused(text.replace("-345600.25", '"noon"'))
    assert "time: must" in refused(text.replace("-345600.25", "1e300"))
    assert "lever_arm" in refused(text.replace("0.35", "1e300"))


# -- writing ---------------------------------------------------------------------------------

# what no name may have is mostly not drawn at all
letters = st.characters(exclude_categories=("C", "Zl", "Zp"))
names = (
    st.text(letters, min_size=1, max_size=20)
    .map(str.strip)
    .filter(lambda text: name_fault(text) is None)
)
positive = st.floats(min_value=1e-12, max_value=1e12)
numbers = st.floats(allow_nan=False, allow_infinity=False)
triples = st.tuples(numbers, numbers, numbers)
metres = st.floats(-1e12, 1e12)
places = st.tuples(metres, metres, metres)
sigmas = st.tuples(positive, positive, positive)


@st.composite
def blocks(draw: st.DrawFn) -> Block:
    cameras = tuple(
        Camera(name, draw(st.floats(1e-6, 1e9)), draw(st.none() | st.tuples(positive, positive)))
        for name in draw(st.lists(names, min_size=1, max_size=3, unique=True))
    )
    photo_names = draw(st.lists(names, min_size=2, max_size=5, unique=True))
    photos = []
    for name in photo_names:
        position, rotation = draw(st.none() | places), draw(st.none() | triples)
        photos.append(
            Photo(
                name,
                draw(st.sampled_from(cameras)).id,
                position,
                rotation,
                draw(sigmas) if position and draw(st.booleans()) else None,
                draw(sigmas) if rotation and draw(st.booleans()) else None,
            )
        )
    return Block(
        name=draw(names),
        precision=Precision(
            draw(positive), draw(st.sampled_from(("paper", "propagated"))), draw(positive)
        ),
        test=TestSettings(
            draw(st.sampled_from(("tau", "baarda"))),
            draw(st.floats(1e-9, 0.5)),
            draw(st.floats(0.5, 0.999, exclude_min=True)),
        ),
        cameras=cameras,
        photos=tuple(photos),
        strips=(Strip(draw(names), tuple(photo_names), draw(st.none() | positive)),),
    )


@pytest.mark.slow
@given(blocks())
def test_a_written_block_is_read_back_equal(block):
    assert parse_block_toml(format_block_toml(block), Path("block.toml")) == block


def test_a_new_block_is_written_once(tmp_path, block_toml):
    block = parse_block_toml(block_toml, Path("block.toml"))
    folder = tmp_path / "deep" / "block"
    write_new_block(folder, block)
    assert read_block(folder) == block
    before = (folder / "block.toml").read_bytes()
    with pytest.raises(InputError, match=r"block\.toml: exists already"):
        write_new_block(folder, block)
    assert (folder / "block.toml").read_bytes() == before
    assert [entry.name for entry in folder.iterdir()] == ["block.toml"]


@pytest.mark.parametrize("name", ["", "a\nb", "\x1b[31m", "x" * 256, " a"])
def test_a_block_that_could_not_be_read_again_is_not_written(tmp_path, block_toml, name):
    block = parse_block_toml(block_toml, Path("block.toml"))
    bad = Block(name, block.precision, block.test, block.cameras, block.photos, block.strips)
    with pytest.raises(InputError) as caught:
        write_new_block(tmp_path / "new", bad)
    assert str(caught.value).isprintable()
    assert not (tmp_path / "new").exists()
