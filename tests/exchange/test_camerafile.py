"""Camera files: what is read, what a block takes from them, and what is wrong and where."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_new_block
from anaplot.exchange.blocktoml import format_block_toml, parse_block_toml
from anaplot.exchange.camerafile import (
    camera_path,
    format_camera,
    parse_camera,
    read_camera,
    write_camera,
)
from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.camera import (
    CameraCalibration,
    Fiducial,
    FiducialDistance,
    RadialPolynomial,
    RadialTable,
)
from anaplot.textfiles.names import name_fault

RMK = """\
format = 1
[camera]
id = "rmk"
c = 152.40
format = [230.0, 230.0]
principal_point = [0.012, -0.004]
[fiducials]
1 = [-106.003, 106.001]
2 = [106.000, 105.998]
"lower right" = [106.002, -106.000]
[distortion]
table = [[20.0, 1.5], [40.0, 2.2]]
decentring = [1e-8, -2e-8]
"""

OLD = """\
format = 1
[camera]
id = "old"
c = 210.0
[distances]
mm = [
  ["1", "3", 226.002],
  ["4", "2", 226.010],
]
[distortion]
radial = [0.0, 1.2e-8, 0.0, 0.0]
"""


def test_everything_the_example_states_is_read():
    assert parse_camera(RMK, Path("rmk.toml")) == CameraCalibration(
        id="rmk",
        c=152.40,
        principal_point=(0.012, -0.004),
        format=(230.0, 230.0),
        fiducials=(
            Fiducial("1", -106.003, 106.001),
            Fiducial("2", 106.0, 105.998),
            Fiducial("lower right", 106.002, -106.0),
        ),
        radial=RadialTable((20.0, 40.0), (1.5, 2.2)),
        decentring=(1e-8, -2e-8),
    )
    old = parse_camera(OLD, Path("old.toml"))
    assert old == CameraCalibration(
        id="old",
        c=210.0,
        distances=(FiducialDistance("1", "3", 226.002), FiducialDistance("4", "2", 226.010)),
        distance_sigma_um=2.0,
        radial=RadialPolynomial((0.0, 1.2e-8, 0.0, 0.0)),
    )
    assert old.fiducial_names() == ("1", "3", "4", "2")


def test_no_more_than_id_and_constant_is_needed():
    text = 'format = 1\n[camera]\nid = "k"\nc = 100\n'
    assert parse_camera(text, Path("k.toml")) == CameraCalibration("k", 100.0)


def refused(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_camera(text, Path("B/rmk.toml"))
    message = str(caught.value)
    assert "\n" not in message
    assert message.isprintable()
    assert message.startswith("B/rmk.toml")
    return message


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("format = 1\n", "format = 2\n", 1, ["newer version"]),
        ("format = 1\n", "", None, ["no key 'format'"]),
        ("[camera]", "[kamera]", 2, ["[kamera]: unknown table", "did you mean 'camera'"]),
        ('id = "rmk"\n', "", 2, ["[camera]: no key 'id'"]),
        ("c = 152.40", "c = nan", 4, ["c: must be a finite number"]),
        ("c = 152.40", "c = 0", 4, ["greater than 0"]),
        ("c = 152.40", "focal = 152.40", 4, ["[camera] focal: unknown key"]),
        ("[230.0, 230.0]", "[230.0, 0]", 5, ["format: must be greater than 0"]),
        ("principal_point", "principle_point", 6, ["did you mean 'principal_point'"]),
        ("[0.012, -0.004]", "[0.012]", 6, ["2 numbers, not 1"]),
        ("[0.012, -0.004]", "[412.0, 0.0]", 6, ["further off than c"]),
        ("2 = [106.000,", "2 = [inf,", 9, ["[fiducials] 2: must be a finite number"]),
        ("2 = [106.000,", "1 = [106.000,", 9, ["not valid TOML"]),
        ("2 = [106.000,", "2 = [1060.00,", 9, ["'2' lies far outside the format"]),
        ("2 = [106.000, 105.998]", "2 = [-106.003, 106.001]", 9, ["same place as '1'"]),
        ('"lower right"', '" right"', 10, ["' right'", "begins or ends with a blank"]),
        ('"lower right"', r'"\u001b[2J"', 10, [r"\x1b[2J", "printed"]),
        ("[distortion]", "[distorsion]", 11, ["did you mean 'distortion'"]),
        ("table =", "tables =", 12, ["[distortion] tables", "did you mean 'table'"]),
        ("[[20.0, 1.5],", "[20.0,", 12, ["must be a list of 2 numbers, not a number"]),
        ("[[20.0, 1.5],", "[[20.0],", 12, ["2 numbers, not 1"]),
        ("[[20.0, 1.5],", "[[50.0, 1.5],", 12, ["radius 40", "must grow"]),
        ("[[20.0, 1.5],", "[[-1.0, 1.5],", 12, ["radius -1"]),
        ("[[20.0, 1.5],", "[[0.0, 1.5],", 12, ["at radius 0 must be 0"]),
        ("[[20.0, 1.5],", "[[20.0, nan],", 12, ["table: must be a finite number"]),
        ("[[20.0, 1.5],", '[[20.0, "1"],', 12, ["must be a number, not text"]),
        ("[[20.0, 1.5], [40.0, 2.2]]", "[]", 12, ["table: is empty"]),
        ("[[20.0, 1.5], [40.0, 2.2]]", "7", 12, ["not a number"]),
        ("[[20.0, 1.5], [40.0, 2.2]]", f"[{'[1, 2], ' * 1001}]", 12, ["more than 1000 radii"]),
        ("decentring", "radial = [0, 0, 0, 0]\ndecentring", 12, ["only one of them"]),
        ("table = [[20.0, 1.5], [40.0, 2.2]]", "radial = [0, 1e-2, 0, 0]", 11, ["folds"]),
        ("table = [[20.0, 1.5], [40.0, 2.2]]", "radial = [0, 1e-9]", 12, ["4 numbers, not 2"]),
    ],
)
def test_what_is_wrong_is_named_with_its_line(old, new, line, words):
    assert old in RMK
    message = refused(RMK.replace(old, new, 1))
    for word in words:
        assert word in message
    if line is not None:
        assert message.startswith(f"B/rmk.toml line {line}: ")


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("[distances]", "[fiducials]\n1 = [1.0, 2.0]\n[distances]", 7, ["beside [fiducials]"]),
        ("[distances]", "[fiducials]", 7, ["mm: must be a number, not a list"]),
        ("mm = [", "sigma = 1\nmm = [", 6, ["[distances] sigma: unknown key", "'sigma_um'"]),
        ("mm = [", "sigma_um = 0\nmm = [", 6, ["greater than 0"]),
        ('  ["4", "2", 226.010],\n', "", 6, ["two distances at least"]),
        ('"2", 226.010', '"2"', 8, ["3 items, not 2"]),
        ('"2", 226.010', '"2", -226.010', 8, ["greater than 0"]),
        ('"2", 226.010', '"2", inf', 8, ["finite"]),
        ('"4", "2"', '"4", "4"', 8, ["from '4' to itself"]),
        ('"4", "2"', '"3", "1"', 8, ["between '3' and '1' twice"]),
        ('"4", "2"', '4, "2"', 8, ["quotes"]),
        ('["4", "2", 226.010]', "5", 8, ["not a number"]),
    ],
)
def test_what_is_wrong_with_distances(old, new, line, words):
    assert old in OLD
    message = refused(OLD.replace(old, new, 1))
    for word in words:
        assert word in message
    assert message.startswith(f"B/rmk.toml line {line}: ")


def test_bounds_on_their_number():
    many = "".join(f"{k} = [{k / 10}, 0.0]\n" for k in range(401))
    assert "more than 400 fiducials" in refused(
        'format = 1\n[camera]\nid = "k"\nc = 100\n[fiducials]\n' + many
    )
    rows = ",".join(f'["{k}", "{k + 1}", 1.0]' for k in range(401))
    head = 'format = 1\n[camera]\nid = "k"\nc = 100\n'
    assert "more than 400 distances" in refused(f"{head}[distances]\nmm = [{rows}]\n")
    assert "[fiducials]: is empty" in refused(f"{head}[fiducials]\n")
    assert "not valid TOML" in refused("x = " + "[" * 10_000)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: file not found"):
        read_camera(tmp_path / "none.toml")
    (tmp_path / "big.toml").write_bytes(b"#" * 1_000_001)
    with pytest.raises(InputError, match="more than 1 MB is not read"):
        read_camera(tmp_path / "big.toml")


# -- writing ---------------------------------------------------------------------------------

names = st.text(min_size=1, max_size=12).filter(lambda text: name_fault(text) is None)
mm = st.floats(-115.0, 115.0)
fractions = st.floats(-1e-9, 1e-9)


@st.composite
def calibrations(draw: st.DrawFn) -> CameraCalibration:
    ids = draw(st.lists(names, min_size=3, max_size=6, unique=True))
    places = draw(st.lists(st.tuples(mm, mm), min_size=len(ids), max_size=len(ids), unique=True))
    radii = sorted(draw(st.lists(st.integers(1, 30), min_size=1, max_size=5, unique=True)))
    radial = draw(
        st.none()
        | st.builds(RadialPolynomial, st.tuples(fractions, fractions, st.just(0.0), st.just(0.0)))
        | st.builds(
            RadialTable,
            st.just(tuple(6.7 * r for r in radii)),
            st.lists(st.floats(-50.0, 50.0), min_size=len(radii), max_size=len(radii)).map(tuple),
        )
    )
    distances = draw(st.booleans())
    return CameraCalibration(
        id=draw(names),
        c=draw(st.floats(80.0, 610.0)),
        principal_point=(draw(st.floats(-1.0, 1.0)), draw(st.floats(-1.0, 1.0))),
        format=draw(st.none() | st.just((230.0, 229.5))),
        fiducials=()
        if distances
        else tuple(Fiducial(name, x, y) for name, (x, y) in zip(ids, places, strict=True)),
        distances=tuple(
            FiducialDistance(a, b, draw(st.floats(0.1, 300.0))) for a, b in pairwise(ids)
        )
        if distances
        else (),
        distance_sigma_um=draw(st.floats(0.1, 9.0)) if distances else 2.0,
        radial=radial,
        decentring=(draw(fractions), draw(fractions)),
    )


@pytest.mark.slow
@given(calibrations())
def test_a_written_camera_is_read_back_equal(calibration):
    assert parse_camera(format_camera(calibration), Path("k.toml")) == calibration


def test_a_new_camera_file_is_written_once(tmp_path):
    calibration = parse_camera(RMK, Path("rmk.toml"))
    path = tmp_path / "rmk.toml"
    write_camera(path, calibration)
    assert read_camera(path) == calibration
    with pytest.raises(InputError, match=r"rmk\.toml: exists already"):
        write_camera(path, calibration)
    with pytest.raises(InputError, match="printed"):
        write_camera(tmp_path / "x.toml", CameraCalibration("a\nb", 1.0))
    assert [entry.name for entry in tmp_path.iterdir()] == ["rmk.toml"]


# -- in a block ------------------------------------------------------------------------------

CAMERA_TABLE = '[[camera]]\nid = "rmk"\nc = 152.40\nformat = [230.0, 230.0]\n'


@pytest.fixture
def make_camera_block(make_block, block_toml):
    """Return a function that writes a block whose [[camera]] is given, with rmk.toml beside it."""

    def make(table: str, camera: str | None = RMK) -> Path:
        folder = make_block(toml=block_toml.replace(CAMERA_TABLE, f"[[camera]]\n{table}\n"))
        if camera is not None:
            (folder / "rmk.toml").write_text(camera)
        return folder

    return make


@pytest.mark.parametrize(
    "table",
    [
        'file = "rmk.toml"',
        'id = "rmk"\nfile = "./rmk.toml"',
        'id = "rmk"\nc = 152.4\nformat = [230, 230]\nfile = "rmk.toml"',
    ],
)
def test_a_block_takes_its_camera_from_the_file(make_camera_block, table):
    (camera,) = read_block(make_camera_block(table)).cameras
    assert (camera.id, camera.c, camera.format) == ("rmk", 152.40, (230.0, 230.0))
    assert camera.calibration == parse_camera(RMK, Path("rmk.toml"))
    assert camera.reach() == (115.0, 115.0)


def test_a_file_elsewhere_by_its_absolute_path(make_camera_block, tmp_path):
    elsewhere = tmp_path / "rmk.toml"
    elsewhere.write_text(RMK)
    folder = make_camera_block(f"file = '{elsewhere}'", None)
    (camera,) = read_block(folder).cameras
    assert camera.calibration is not None
    assert camera.file == str(elsewhere)


def test_a_format_that_only_the_block_states(make_camera_block):
    without = RMK.replace("format = [230.0, 230.0]\n", "")
    folder = make_camera_block('file = "rmk.toml"\nformat = [180.0, 180.0]', without)
    (camera,) = read_block(folder).cameras
    assert camera.format == (180.0, 180.0)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('file = "rmk.toml"\nc = 152.41', ["c: 152.41, but 'rmk.toml' says 152.4"]),
        ('file = "rmk.toml"\nid = "rmx"', ["id: 'rmx', but 'rmk.toml' says 'rmk'"]),
        ('file = "rmk.toml"\nformat = [230, 229]', ["format: [230.0, 229.0], but", "230.0]"]),
        ('file = "../rmk.toml"', ["leads out of the folder"]),
        ('file = "a/../../rmk.toml"', ["leads out of the folder"]),
        ('file = ""', ["'' is not a file name"]),
        (r'file = "a\u0000b"', [r"'a\x00b' is not a file name"]),
        ("file = 7", ["file: must be text, not a number"]),
        ('fiel = "rmk.toml"', ["[[camera]] fiel: unknown key", "'file'"]),
    ],
)
def test_what_is_wrong_between_block_and_camera_file(make_camera_block, table, words):
    folder = make_camera_block(table)
    with pytest.raises(InputError) as caught:
        read_block(folder)
    message = str(caught.value)
    assert message.isprintable()
    assert "block.toml line " in message
    for word in words:
        assert word in message


def test_what_is_wrong_in_the_camera_file_is_named_there(make_camera_block):
    with pytest.raises(InputError, match=r"rmk\.toml: file not found"):
        read_block(make_camera_block('file = "rmk.toml"', None))
    broken = RMK.replace("c = 152.40", "c = 1e999")
    with pytest.raises(
        InputError, match=r"rmk\.toml line 4: \[camera\] c: must be a finite number"
    ):
        read_block(make_camera_block('file = "rmk.toml"', broken))
    folder = make_camera_block('file = "."')
    with pytest.raises(InputError, match="a folder, not a file"):
        read_block(folder)


def test_a_camera_of_another_table_twice(make_camera_block):
    folder = make_camera_block('file = "rmk.toml"\n[[camera]]\nfile = "rmk.toml"')
    with pytest.raises(InputError, match="camera 'rmk' twice"):
        read_block(folder)


def test_a_block_with_a_camera_file_is_written_and_read_back(make_camera_block, tmp_path):
    block = read_block(make_camera_block('file = "rmk.toml"'))
    new = tmp_path / "new"
    write_new_block(new, block)
    assert read_block(new) == block
    assert parse_block_toml(format_block_toml(block), new / "block.toml") == block


def test_a_calibration_without_a_file_is_not_written_away(make_camera_block):
    block = read_block(make_camera_block('file = "rmk.toml"'))
    camera = Camera("rmk", 152.4, None, block.cameras[0].calibration)
    with pytest.raises(InputError, match="camera 'rmk' cannot be written: its calibration has no"):
        format_block_toml(replace(block, cameras=(camera,)))


def test_paths():
    assert camera_path(Path("B"), "a/rmk.toml") == Path("B/a/rmk.toml")
    assert camera_path(Path("B"), "/c/rmk.toml") == Path("/c/rmk.toml")
    assert camera_path(Path("B"), "/c/../rmk.toml") == Path("/c/../rmk.toml")
    for wrong in ("..", "../x", "a/../b", " ", "x" * 401, "a\nb"):
        with pytest.raises(ValueError, match=r"not a file name|leads out"):
            camera_path(Path("B"), wrong)
