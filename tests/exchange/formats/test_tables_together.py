"""Formats of tables beside each other: each knows its own, and none is led astray by damage."""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tableblock import pixel_table_block, table_block

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats.door import AdjustedResult, Exporting, ImportOptions, PhotoResult
from anaplot.exchange.formats.door import PointResult as Point
from anaplot.exchange.formats.registry import FORMATS, module_of, recognised
from anaplot.exchange.importedfolder import write_imported
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.photogrammetry.objectconditions import ObjectCondition

PM = "Object Point ID,Photo #,X,Y,Residual X,Residual Y\n7,1,10.5,20.5,.1,.2\n7,2,11,21,0,0\n"
NEEDS = {"photomodeler": ImportOptions(c=100.0, pixels=(2000, 1500), pixel_um=6.0)}
KINDS = ("patb", "bingo", "aicon", "dbat", "bal", "photomodeler")


def result(block) -> AdjustedResult:
    """What an adjustment could say, without one."""
    zero, some = (0.0, 0.0, 0.0), ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4))
    photos = table_block().photos
    points = dict.fromkeys(row.point for row in block.image_points)
    return AdjustedResult(
        tuple(PhotoResult(p.id, p.position, zero, p.rotation, zero, 9, 0.5, 0) for p in photos),
        tuple(Point(name, (1.0, 2.0, 3.0), some, 3, 0.5, 0, "tie") for name in points),
        1.0,
    )


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A source of every kind, in as few rows as show everything."""
    folder = tmp_path_factory.mktemp("samples")
    (folder / "pm.csv").write_text(PM)
    found = {"photomodeler": folder / "pm.csv"}
    bar = ObjectCondition("distance", ("1000", "1004"), 1250.125, 0.001)
    for kind in KINDS[:-1]:
        block = pixel_table_block() if kind in ("dbat", "bal") else table_block()
        few = {"1000", "1004", "1005", "1009"}
        rays = tuple(row for row in block.image_points if row.point in few)
        conditions = (bar,) if kind == "aicon" else ()
        block = replace(block, image_points=rays, conditions=conditions)
        module_of(kind).write(Exporting(block, folder, adjusted=result(block)), folder / kind)
        found[kind] = folder / kind
    return found


def test_each_source_is_of_one_kind(samples: dict[str, Path]) -> None:
    for kind, source in samples.items():
        assert recognised(source).kind == kind
    singles = {
        "patb": "patb.im",
        "bingo": "image.dat",
        "aicon": "aicon.phc",
        "dbat": "imagepts.txt",
    }
    for kind, name in singles.items():
        assert recognised(samples[kind] / name).kind == kind
    # and what belongs to one is no source of another
    for name in ("patb/patb.con", "bingo/geoin.dat", "bingo/itera.dat", "aicon/aicon.eor"):
        path = samples["patb"].parent / name
        knows = [k for k, one in FORMATS.items() if one.reads and module_of(k).recognises(path)]
        assert not set(knows) & set(KINDS), name


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
@pytest.mark.parametrize("name", ["pipe", "a.phc", "a.im", "a.xml", "a.csv", "a.json"])
def test_a_pipe_is_of_no_kind_and_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match="of no known format"):
        recognised(tmp_path / name)
    knows = [k for k, one in FORMATS.items() if one.reads and module_of(k).recognises(tmp_path)]
    assert len(knows) <= 1  # a folder is known by names; reading then refuses the pipe
    for kind in knows:
        with pytest.raises(InputError, match="not a regular file"):
            module_of(kind).read(tmp_path, ImportOptions(c=100.0))


@pytest.mark.parametrize(
    ("kind", "sigmas"),
    [("patb", 2), ("bingo", 2), ("pixels", 2), ("bal", 2), ("aicon", 0), ("dbat", 0)],
)
def test_what_a_block_counts_with_is_told_where_it_is_not_held(
    tmp_path: Path, kind: str, sigmas: int
) -> None:
    block = pixel_table_block() if kind in ("dbat", "bal") else table_block()
    control = tuple(replace(row, sigma=(0.01, 0.01, None)) for row in block.control)
    test = TestSettings("baarda", 0.01, 0.9)
    precision = Precision(image_um=12.5, control_m=0.07)
    block = replace(block, control=control, test=test, precision=precision)
    made = module_of(kind).write(
        Exporting(block, tmp_path, adjusted=result(block)), tmp_path / kind
    )
    said = [note.text for note in made.notes if note.what == "not held"]
    told = [text for text in said if text in ("image_um = 12.5 um", "control_m = 0.07 m")]
    assert len(told) == sigmas
    assert "the settings of the test: baarda, alpha = 0.01, power = 0.9" in said


def test_scripts_of_dbat_and_documents_of_metashape_have_one_root(tmp_path: Path) -> None:
    notice = f"<!-- {'x' * 9000} -->"
    script, chunk = tmp_path / "script.xml", tmp_path / "chunk.xml"
    script.write_text(f'{notice}<document dbat_script_version="1.0"><input/></document>')
    chunk.write_text(f'{notice}<document version="1.5.0"><chunk/></document>')
    assert recognised(script).kind == "dbat"
    assert recognised(chunk).kind == "metashape"


@pytest.mark.parametrize("number", ["inf", "nan", "1e999"])
def test_a_file_whose_second_number_is_none_is_not_bingos(tmp_path: Path, number: str) -> None:
    file = tmp_path / "image.dat"
    file.write_text(f"101 {number}\n1 2.0 3.0\n")
    assert not module_of("bingo").recognises(file)


@pytest.mark.parametrize(
    ("kind", "file", "old", "told"),
    [
        # a file and a line of it; what there is no line for, and which file was read
        ("patb", "patb.con", r"(?m)^(\s*1000 +)\S+", r"patb\.con line \d+: .*no place on earth"),
        ("patb", "patb.ori", r"(?m)^( +101 +)\S+", r"patb\.ori line \d+: .*no place on earth"),
        ("aicon", "aicon.eor", r"(?m)^(\w+\s+)\S+", r"aicon\.eor line \d+: .*no place on earth"),
        ("aicon", "aicon.ior", r"(1 )-152\.4", r"/aicon: no block can hold it: .*\bc\b"),
    ],
)
def test_a_number_beyond_all_bounds_is_told_of_the_file_that_has_it(
    samples: dict[str, Path], tmp_path: Path, kind: str, file: str, old: str, told: str
) -> None:
    source = tmp_path / kind
    shutil.copytree(samples[kind], source)
    text = (source / file).read_text()
    # columns stay where they are
    wrong, count = re.subn(
        old, lambda m: m[1] + "-1e40".ljust(len(m[0]) - len(m[1])), text, count=1
    )
    assert count == 1
    (source / file).write_text(wrong)
    with pytest.raises(InputError, match=told):
        write_imported(tmp_path / "b", module_of(kind).read(source, ImportOptions()), source)
    assert not (tmp_path / "b").exists()


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links here")
@pytest.mark.parametrize("kind", [kind for kind, one in FORMATS.items() if one.reads])
def test_a_circle_of_links_is_one_line(tmp_path: Path, kind: str) -> None:
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(InputError, match="loop"):
        module_of(kind).read(tmp_path / "loop", ImportOptions(c=100.0, pixels=(2000, 1500)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_is_refused_or_makes_a_block(
    samples: dict[str, Path], tmp_path_factory: pytest.TempPathFactory, kind: str, data
) -> None:
    source = samples[kind]
    folder = tmp_path_factory.mktemp(kind)
    copy = folder / source.name
    shutil.copytree(source, copy) if source.is_dir() else shutil.copy(source, copy)
    files = sorted(copy.iterdir()) if copy.is_dir() else [copy]
    file = data.draw(st.sampled_from(files))
    raw = file.read_bytes()
    lines = raw.split(b"\n")
    where = data.draw(st.integers(0, len(lines) - 1))
    fields = lines[where].split(b" ")
    at = data.draw(st.integers(0, len(fields) - 1))
    what = data.draw(
        st.sampled_from(["cut", "drop", "twice", "swap", "field", "field", "field", "bytes"])
    )
    if what == "cut":
        raw = raw[: data.draw(st.integers(0, len(raw)))]
    elif what == "bytes":
        k = data.draw(st.integers(0, len(raw)))
        raw = raw[:k] + data.draw(st.binary(max_size=4)) + raw[k:]
    else:
        if what == "drop":
            del lines[where]
        elif what == "twice":
            lines.insert(where, lines[where])
        elif what == "swap":
            lines[0], lines[where] = lines[where], lines[0]
        else:
            words = [
                b"nan",
                b"1e999",
                b"-1",
                b"0",
                b"",
                b"-99",
                b"1e18",
                b"x" * 300,
                b"\x1b[2J",
                b"#",
            ]
            fields[at] = data.draw(st.sampled_from(words))
            lines[where] = b" ".join(fields)
        raw = b"\n".join(lines)
    file.write_bytes(raw)
    options = NEEDS.get(kind, ImportOptions())
    if kind == "aicon" and (copy / "aicon-control.obc").exists():
        options = ImportOptions(files={"control": copy / "aicon-control.obc"})
    assert module_of(kind).recognises(copy) in (True, False)
    refused = ""
    try:
        found = module_of(kind).read(copy, options)
        write_imported(folder / "block", found, copy)
    except InputError as error:
        refused = str(error)
    if refused:
        assert refused.isprintable()  # one line, and nothing that controls a terminal
        assert not (folder / "block").exists()
        return
    block = read_block(folder / "block")
    assert len(block.image_points) == len(found.block.image_points)
    assert [photo.id for photo in block.photos] == [photo.id for photo in found.block.photos]
