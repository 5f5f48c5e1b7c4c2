"""image_points.csv and control.csv: what is read, and what is refused with its line."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.exchange.controlcsv import format_control
from anaplot.exchange.imagepointscsv import format_image_points, parse_image_points
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    PointPrior,
    Precision,
    TestSettings,
)
from anaplot.textfiles import wholefile
from anaplot.textfiles.names import name_fault

HEADER = "photo,point,x,y\n"
WITH_MODEL = "photo,point,x,y,sigma_um,model\n"


def test_rows_are_read_in_file_order(make_block):
    points = (
        "model, y ,photo,x,point\n101/102,2.5,102, -1e1 ,7\n\n  \n,1,101,+.5,7\n,-0.25,102,3.,7"
    )
    block = read_block(make_block(points=points))
    assert block.image_points == (
        ImagePoint("102", "7", -10.0, 2.5, None, "101/102"),
        ImagePoint("101", "7", 0.5, 1.0),
        ImagePoint("102", "7", 3.0, -0.25),
    )


def test_line_ends_of_other_systems_and_a_byte_order_mark_are_tolerated(make_block):
    rows = '101,"a, ""b""",1,2,7.5,\n102,é,3,4,,102/103\n'
    expected = (
        ImagePoint("101", 'a, "b"', 1.0, 2.0, 7.5),
        ImagePoint("102", "é", 3.0, 4.0, None, "102/103"),
    )
    for end in ("\n", "\r\n", "\r"):
        text = "\ufeff" + (WITH_MODEL + rows).replace("\n", end)
        assert read_block(make_block(points=text)).image_points == expected


def test_a_file_with_a_header_alone_holds_no_points(make_block):
    block = read_block(make_block(points=HEADER))
    assert block.image_points == ()
    assert len(block.image_points.columns) == 0
    assert not block.in_pixels
    assert read_block(make_block(points="point,x_px,y_px,photo\n")).in_pixels


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, ["no header", "photo,point,x,y"]),
        ("\n" + HEADER, 1, ["no header"]),
        (" , \n", 1, ["no header"]),
        ("photo;point;x;y\n", 1, ["separated by commas"]),
        ("photo,point,x\n", 1, ["no column 'y'"]),
        ("photo,point,x,y,sigma\n", 1, ["unknown column 'sigma'", "mean 'sigma_um'"]),
        ("Photo,point,x,y\n", 1, ["unknown column 'Photo'", "mean 'photo'"]),
        ("photo,point,x,y,x\n", 1, ["column 'x' twice"]),
        (HEADER + "101,1,2\n", 2, ["3 fields, the header has 4"]),
        (HEADER + "101,1,2,3,4\n", 2, ["5 fields, the header has 4"]),
        (HEADER + "101\n", 2, ["1 field, the header has 4"]),
        (HEADER + ",1,2,3\n", 2, ["photo: is empty"]),
        (HEADER + "101, ,2,3\n", 2, ["point: is empty"]),
        (HEADER + "101,1,,3\n", 2, ["x: is empty"]),
        (HEADER + "101,1,2,\n", 2, ["y: is empty"]),
        (HEADER + "101,1,2,nan\n", 2, ["y: must be a finite number, not 'nan'"]),
        (HEADER + "101,1,-inf,3\n", 2, ["x: must be a finite number, not '-inf'"]),
        (HEADER + "101,1,1e999,3\n", 2, ["x: must be a finite number, not '1e999'"]),
        (HEADER + "101,1,1_0,3\n", 2, ["x: must be a finite number, not '1_0'"]),
        (HEADER + "101,1,١,3\n", 2, ["x: must be a finite number, not '١'"]),
        (HEADER + "101,1,0x10,3\n", 2, ["x: must be a finite number, not '0x10'"]),
        (HEADER + '101,1,"1,5",3\n', 2, ["x: must be a finite number, not '1,5'"]),
        (HEADER + "101,1,\x1b[2J,3\n", 2, [r"not '\x1b[2J'"]),
        (HEADER + "\n101,1,1,2\n\n1O1,1,2,3\n", 5, ["unknown photo '1O1'", "mean '101'"]),
        (HEADER + "# a comment,1,2,3\n", 2, ["unknown photo '# a comment'"]),
        (HEADER + "101,1,116,3\n", 2, ["x: 116 mm", "the format of camera 'rmk'", "115"]),
        (HEADER + "101,1,1,-115.001\n", 2, ["y: -115.001 mm lies outside"]),
        (HEADER + "101," + "p" * 256 + ",1,2\n", 2, ["longer than 255"]),
        (HEADER + "101,a\x1b[31mb,1,2\n", 2, [r"'a\x1b[31mb' holds a character"]),
        (HEADER + '101,"a\nb",1,2\n', 2, ["quotation mark"]),
        (HEADER + '101,1,2,3\n101,"a,1,2\n' + "101,2,2,3\n" * 20_000, 3, ["quotation mark"]),
        (HEADER + '101,"a"b,1,2\n', 2, ["not a CSV row"]),
        (HEADER + '101,"a', 2, ["quotation mark is not closed"]),
        (HEADER + "101," + "p" * 200_000 + ",1,2\n", 2, ["longer than 255"]),
        (HEADER + "101,1,1,2\n102,1,1,2\n101,1,3,4\n", 4, ["'1' twice", "lines 2 and 4"]),
        (WITH_MODEL + "101,1,1,2,0,\n", 2, ["sigma_um: must be greater than 0, not 0"]),
        (WITH_MODEL + "101,1,1,2,-1,\n", 2, ["sigma_um: must be greater than 0, not -1"]),
        (WITH_MODEL + "101,1,1,2,x,\n", 2, ["not 'x'"]),
        (WITH_MODEL + "101,1,1,2,,101\n", 2, ["'101' must be of the form left/right"]),
        (WITH_MODEL + "101,1,1,2,,101/\n", 2, ["must be of the form left/right"]),
        (WITH_MODEL + "101,1,1,2,,101/102/103\n", 2, ["unknown photo '102/103'"]),
        (WITH_MODEL + "101,1,1,2,,101/104\n", 2, ["model: '101/104': unknown photo '104'"]),
        (WITH_MODEL + "101,1,1,2,,102/103\n", 2, ["does not contain the row's photo '101'"]),
        (WITH_MODEL + "101,1,1,2,,102/101\n", 2, ["in flight order it is '101/102'"]),
        (WITH_MODEL + "101,1,1,2,,101/103\n", 2, ["do not follow each other in a strip"]),
        (WITH_MODEL + "101,1,1,2,,101/101\n", 2, ["do not follow each other in a strip"]),
        (
            WITH_MODEL + "102,1,1,2,,101/102\n102,1,1,2,,\n102,1,1,2,,102/103\n"
            "102,1,1,2,,102/103\n",
            5,
            ["twice", "in model '102/103'", "lines 4 and 5"],
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_line(make_block, text, line, words):
    with pytest.raises(InputError) as caught:
        read_block(make_block(points=text))
    message = str(caught.value)
    assert message.isprintable()
    assert f"image_points.csv line {line}: " in message
    for word in words:
        assert word in message


def test_bytes_that_are_not_utf8_are_named_with_their_line(make_block):
    good = (HEADER + "".join(f"101,{n},1,2\n" for n in range(5000))).encode()
    folder = make_block(points=good + b"101,\xe9,1,2\n101,last,1,2\n")
    with pytest.raises(InputError, match=r"image_points\.csv line 5002: not UTF-8"):
        read_block(folder)
    with pytest.raises(InputError, match=r"image_points\.csv line 1: not UTF-8"):
        read_block(make_block(points=HEADER.encode("utf-16")))


def test_coordinates_are_believed_up_to_the_edge_and_without_a_format_up_to_4_c(
    make_block, block_toml
):
    points = HEADER + "101,1,115,-115.0\n"
    assert read_block(make_block(points=points)).image_points[0].x == 115.0
    toml = block_toml.replace("format = [230.0, 230.0]\n", "")
    assert read_block(make_block(toml, HEADER + "101,1,609.6,-609.6\n")).image_points
    with pytest.raises(InputError, match="outside 4 c of camera 'rmk'"):
        read_block(make_block(toml, HEADER + "101,1,609.7,0\n"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_file_that_is_no_file_is_refused(make_block, tmp_path):
    folder = make_block()
    os.mkfifo(folder / "image_points.csv")
    with pytest.raises(InputError, match="not a regular file"):
        read_block(folder)
    (folder / "image_points.csv").unlink()
    (folder / "image_points.csv").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"image_points\.csv: file not found"):
        read_block(folder)


def test_a_file_too_large_is_refused_unread(make_block):
    folder = make_block(points=HEADER)
    with (folder / "image_points.csv").open("r+b") as file:
        file.truncate(256_000_001)
    with pytest.raises(InputError, match="more than 256 MB is not read"):
        read_block(folder)


def test_reading_writes_nothing(make_block, monkeypatch):
    folder = make_block(points=HEADER + "101,1,1,2\n", control="point,X,Y,Z\n1,2,3,4\n")
    opened: list[tuple[object, int]] = []
    real = os.open

    def watched(path: object, flags: int, *rest: object, **more: object) -> int:
        opened.append((path, flags))
        return real(path, flags, *rest, **more)  # type: ignore[arg-type]

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    before = {entry: entry.stat().st_mtime_ns for entry in [folder, *folder.iterdir()]}
    for name in ("mkdir", "replace", "rename", "unlink", "ftruncate", "link"):
        monkeypatch.setattr(os, name, refuse)
    monkeypatch.setattr(os, "open", watched)
    assert len(read_block(folder).image_points) == 1
    writing = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
    assert not [path for path, flags in opened if flags & writing]
    assert {entry: entry.stat().st_mtime_ns for entry in [folder, *folder.iterdir()]} == before


# -- control ---------------------------------------------------------------------------------


def test_control_points_are_read(make_block):
    control = (
        "point,X,Y,Z,sX,sY,sZ,use\r\nA,1,2,3,0,0.05,,control\r\n"
        "B,,,1e3,,,.5,check\r\n\r\nC,1,2,,,,,off\r\n"
    )
    assert read_block(make_block(control=control)).control == (
        ControlPoint("A", (1.0, 2.0, 3.0), (0.0, 0.05, None), "control"),
        ControlPoint("B", (None, None, 1000.0), (None, None, 0.5), "check"),
        ControlPoint("C", (1.0, 2.0, None), (None, None, None), "off"),
    )


def test_control_needs_neither_sigmas_nor_use(make_block):
    assert read_block(make_block(control="Z,Y,X,point\n3,2,1,A\n")).control == (
        ControlPoint("A", (1.0, 2.0, 3.0)),
    )


def test_priors_of_points_stand_apart_from_control(make_block):
    text = "point,X,Y,Z,sX,sY,sZ,use\nA,1,2,3,,,,check\nA,1,2,,3.2,3.2,,prior\nB,,,3,,,1,prior\n"
    block = read_block(make_block(control=text))
    assert [(row.point, row.use) for row in block.control] == [("A", "check")]
    assert block.priors == (
        PointPrior("A", (1.0, 2.0, None), (3.2, 3.2, None)),
        PointPrior("B", (None, None, 3.0), (None, None, 1.0)),
    )
    assert read_block(make_block(control=format_control(block.control, block.priors))) == block


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, ["no header"]),
        ("point,X,Y\n", 1, ["no column 'Z'"]),
        ("point,X,Y,Z,sx\n", 1, ["unknown column 'sx'", "mean 'sX'"]),
        ("point,X,Y,Z\n,1,2,3\n", 2, ["point: is empty"]),
        ("point,X,Y,Z\na\x07,1,2,3\n", 2, [r"'a\x07' holds a character"]),
        ("point,X,Y,Z\nA,1,2,nan\n", 2, ["Z: must be a finite number, not 'nan'"]),
        ("point,X,Y,Z\nA,1,2,1e400\n", 2, ["Z: must be a finite number, not '1e400'"]),
        ("point,X,Y,Z,sZ\nA,1,2,3,-0.1\n", 2, ["sZ: must be 0 or greater, not -0.1"]),
        ("point,X,Y,Z,use\nA,1,2,3,chek\n", 2, ["not 'chek'", "mean 'check'"]),
        ("point,X,Y,Z,use\nA,1,2,3,\n", 2, ["use: must be"]),
        ("point,X,Y,Z\nA,1,2,3\nA,1,2,3\n", 3, ["'A' twice", "lines 2 and 3"]),
        ("point,X,Y,Z\nA,1,2\n", 2, ["3 fields, the header has 4"]),
        ("point,X,Y,Z,sX\nA,1,2,3,1e-200\n", 2, ["sX: 1e-200 is too small for a standard"]),
        ("point,X,Y,Z\nA,1,-1e300,3\n", 2, ["Y: must lie between -1e+12 and 1e+12"]),
        ("point,X,Y,Z,use\nA,1,2,3,prior\n", 2, ["sX: is blank, but a prior needs a positive"]),
        ("point,X,Y,Z,sZ,use\nA,,,3,0,prior\n", 2, ["sZ: is 0, but a prior needs a positive"]),
        ("point,X,Y,Z,use\nA,,,,prior\n", 2, ["a prior without any coordinate"]),
        (
            "point,X,Y,Z,sX,use\nA,1,,,1,prior\nA,1,2,3,,off\nA,2,,,1,prior\n",
            4,
            ["'A' twice", "lines 2 and 4"],
        ),
    ],
)
def test_wrong_control_is_named_with_its_line(make_block, text, line, words):
    with pytest.raises(InputError) as caught:
        read_block(make_block(control=text))
    message = str(caught.value)
    assert message.isprintable()
    assert f"control.csv line {line}: " in message
    for word in words:
        assert word in message


# -- writing ---------------------------------------------------------------------------------

inside = st.floats(min_value=-115.0, max_value=115.0)
good_names = st.text(min_size=1, max_size=12).filter(lambda text: name_fault(text) is None)
rows = st.builds(
    lambda photo_model, point, x, y, sigma: ImagePoint(
        photo_model[0], point, x, y, sigma, photo_model[1]
    ),
    st.sampled_from(
        [("101", None), ("101", "101/102"), ("102", "101/102"), ("102", "102/103"), ("103", None)]
    ),
    good_names,
    inside,
    inside,
    st.none() | st.floats(min_value=1e-9, max_value=1e9),
)


@pytest.mark.slow
@given(st.lists(rows, max_size=8, unique_by=lambda row: (row.photo, row.point, row.model)))
def test_written_points_are_read_back_equal(tmp_path_factory, points):
    folder = _block_folder(tmp_path_factory)
    write_image_points(folder, points)
    assert read_block(folder).image_points == tuple(points)


def _block_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.getbasetemp() / "round-trip"
    if not folder.exists():
        folder.mkdir()
        toml = (
            'format = 1\nname = "r"\n[[camera]]\nid = "k"\nc = 150\nformat = [230, 230]\n'
            '[[strip]]\nid = "1"\nphotos = ["101", "102", "103"]\n'
        )
        toml += "".join(f'[[photo]]\nid = "{n}"\ncamera = "k"\n' for n in (101, 102, 103))
        (folder / "block.toml").write_text(toml)
    return folder


def test_the_file_is_readable_by_people():
    points = [ImagePoint("101", "1", 10.0, -92.123456), ImagePoint("102", "a,b", 0.1, 1e-7)]
    assert format_image_points(points) == (
        'photo,point,x,y,model\n101,1,10.0,-92.123456,\n102,"a,b",0.1,1e-07,\n'
    )
    measured = [ImagePoint("101", "1", 1.0, 2.0, 3.5, "101/102"), ImagePoint("102", "1", 1.0, 2.0)]
    assert format_image_points(measured) == (
        "photo,point,x,y,sigma_um,model\n101,1,1.0,2.0,3.5,101/102\n102,1,1.0,2.0,,\n"
    )


@pytest.mark.parametrize(
    ("points", "word"),
    [
        ([ImagePoint("101", "", 1.0, 2.0)], "is empty"),
        ([ImagePoint("1/2", "1", 1.0, 2.0, model="1/2")], "does not contain its photo"),
        ([ImagePoint("101", "a\nb", 1.0, 2.0)], "cannot be printed"),
        ([ImagePoint("101", " a", 1.0, 2.0)], "blank"),
        ([ImagePoint("101", "1", float("nan"), 2.0)], "not finite"),
        ([ImagePoint("101", "1", 1.0, float("inf"))], "not finite"),
        ([ImagePoint("101", "1", 1.0, 2.0, 0.0)], "sigma_um"),
        ([ImagePoint("101", "1", 1.0, 2.0, None, "101")], "left/right"),
        ([ImagePoint("101", "1", 1.0, 2.0, None, "102/103")], "contain its photo"),
        ([ImagePoint("101", "1", 1.0, 2.0), ImagePoint("101", "1", 1.0, 3.0)], "twice"),
    ],
)
def test_what_could_not_be_read_again_is_not_written(make_block, points, word):
    folder = make_block(points=HEADER + "101,1,1,2\n")
    before = (folder / "image_points.csv").read_bytes()
    with pytest.raises(InputError, match=word) as caught:
        write_image_points(folder, points)
    assert str(caught.value).isprintable()
    assert (folder / "image_points.csv").read_bytes() == before


@pytest.mark.parametrize("call", ["open", "write", "fsync", "replace"])
@pytest.mark.parametrize("exists", [True, False])
def test_a_failure_leaves_the_old_file_and_nothing_else(make_block, monkeypatch, call, exists):
    folder = make_block(points=HEADER + "101,1,1,2\n" if exists else None)
    before = {entry.name: entry.read_bytes() for entry in folder.iterdir()}

    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(wholefile.os, call, fail)
        with pytest.raises(InputError) as caught:
            write_image_points(folder, [ImagePoint("101", "1", 5.0, 6.0)])
    assert "image_points.csv: cannot be written: No space left on device" in str(caught.value)
    assert {entry.name: entry.read_bytes() for entry in folder.iterdir()} == before


def test_an_interrupted_writer_leaves_the_old_file_and_nothing_else(make_block, monkeypatch):
    folder = make_block(points=HEADER + "101,1,1,2\n")
    before = {entry.name: entry.read_bytes() for entry in folder.iterdir()}

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(wholefile.os, "fsync", interrupt)
        with pytest.raises(KeyboardInterrupt):
            write_image_points(folder, [ImagePoint("101", "1", 5.0, 6.0)])
    assert {entry.name: entry.read_bytes() for entry in folder.iterdir()} == before


def test_short_writes_are_continued_and_the_mode_is_kept(make_block, monkeypatch):
    folder = make_block(points=HEADER)
    (folder / "image_points.csv").chmod(0o640)
    real = os.write
    with monkeypatch.context() as patch:
        patch.setattr(wholefile.os, "write", lambda fd, data: real(fd, data[:7]))
        write_image_points(folder, [ImagePoint("101", "1", 5.0, 6.0)])
    assert read_block(folder).image_points == (ImagePoint("101", "1", 5.0, 6.0),)
    assert (folder / "image_points.csv").stat().st_mode & 0o777 == 0o640


def test_a_link_to_another_folder_is_replaced_and_its_target_kept(make_block, tmp_path):
    folder = make_block()
    truth = tmp_path / "truth.csv"
    truth.write_text(HEADER + "101,1,1,2\n")
    (folder / "image_points.csv").symlink_to(truth)
    write_image_points(folder, [ImagePoint("101", "1", 5.0, 6.0)])
    assert truth.read_text() == HEADER + "101,1,1,2\n"
    assert read_block(folder).image_points == (ImagePoint("101", "1", 5.0, 6.0),)


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"image_points\.csv: cannot be written: No such file"):
        write_image_points(tmp_path / "nowhere", [])


def test_use_and_reason_are_read(make_block):
    points = (
        "photo,point,x,y,reason,use\n101,1,1,2,,\n101,2,1,2,a lorry,off\n"
        '102,1,1,2,"dust, or a hair",y\n102,2,1,2,,xy\n'
    )
    rows = read_block(make_block(points=points)).image_points
    assert [(row.use, row.reason) for row in rows] == [
        ("xy", None),
        ("off", "a lorry"),
        ("y", "dust, or a hair"),
        ("xy", None),
    ]
    assert [(row.counts("x"), row.counts("y")) for row in rows] == [
        (True, True),
        (False, False),
        (False, True),
        (True, True),
    ]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ("of,", ["use: must be", "not 'of'", "mean 'off'"]),
        ("none,", ["use: must be", "not 'none'"]),
        ("X,", ["use: must be", "not 'X'", "mean 'x'"]),
        ("off,a\x07b", ["reason: holds a character that cannot be printed"]),
        ("off," + "a" * 401, ["reason: is longer than 400 characters"]),
    ],
)
def test_a_wrong_use_or_reason_is_named(make_block, fields, words):
    folder = make_block(points=f"photo,point,x,y,use,reason\n101,1,1,2,xy,\n101,2,1,2,{fields}\n")
    with pytest.raises(InputError) as caught:
        read_block(folder)
    message = str(caught.value)
    assert "image_points.csv line 3: " in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("row", "what"),
    [
        (ImagePoint("101", "1", 1.0, 2.0, use="yx"), "its use must be"),  # type: ignore[arg-type]
        (ImagePoint("101", "1", 1.0, 2.0, reason="two\nlines"), "its reason holds a character"),
        (ImagePoint("101", "1", 1.0, 2.0, reason=" blank"), "its reason begins or ends"),
        (ImagePoint("101", "1", 1.0, 2.0, reason=""), "its reason is empty"),
    ],
)
def test_a_use_or_reason_that_could_not_be_read_again_is_not_written(row, what):
    with pytest.raises(InputError, match=what):
        format_image_points([row])


USES = st.sampled_from(["xy", "x", "y", "off"])
REASONS = st.none() | st.text(max_size=40).filter(
    lambda text: bool(text) and text.isprintable() and text == text.strip()
)


@pytest.mark.slow
@given(st.lists(st.tuples(USES, REASONS), max_size=12))
def test_uses_and_reasons_come_back(tmp_path_factory, decided):
    block = Block(
        "b",
        Precision(),
        TestSettings(),
        (Camera("rmk", 152.4),),
        (Photo("101", "rmk"),),
        (),
    )
    rows = tuple(
        ImagePoint("101", str(k), 1.5 * k, -2.0, use=use, reason=reason)
        for k, (use, reason) in enumerate(decided)
    )
    text = format_image_points(rows)
    header = text.splitlines()[0].split(",")
    assert ("use" in header) == any(row.use != "xy" for row in rows)
    assert ("reason" in header) == any(row.reason is not None for row in rows)
    path = tmp_path_factory.getbasetemp() / "uses.csv"
    path.write_text(text, encoding="utf-8")
    assert parse_image_points(path, block) == rows


def test_models_of_photos_with_slashes_are_compared_whole(tmp_path):
    (tmp_path / "block.toml").write_text(
        'format = 1\nname = "n"\n[[camera]]\nid = "c"\nc = 100.0\n'
        '[[strip]]\nid = "1"\nphotos = ["a/1", "a/2", "3"]\n'
    )
    rows = [
        ImagePoint("a/1", "p/q", 1.0, 2.0, model="a/1/a/2"),
        ImagePoint("a/2", "p/q", 3.0, 2.0, model="a/1/a/2"),
        ImagePoint("a/2", "p/q", 3.0, 2.0, model="a/2/3"),
    ]
    write_image_points(tmp_path, rows)
    assert read_block(tmp_path).image_points == tuple(rows)
    (tmp_path / "image_points.csv").write_text("photo,point,x,y,model\na/1,p,1,2,a/2/a/1\n")
    with pytest.raises(InputError, match="in flight order it is 'a/1/a/2'"):
        read_block(tmp_path)


def test_without_strips_a_model_that_two_pairs_fit_is_an_error(tmp_path):
    (tmp_path / "block.toml").write_text(
        'format = 1\nname = "n"\n[[camera]]\nid = "c"\nc = 100.0\n'
    )
    photos = "".join(f"{name},p,1,2,\n" for name in ("a", "b/c", "a/b", "c"))
    file = tmp_path / "image_points.csv"
    file.write_text(f"photo,point,x,y,model\n{photos}a,q,1,2,a/b/c\n")
    with pytest.raises(InputError, match="more than one pair is meant"):
        read_block(tmp_path)
