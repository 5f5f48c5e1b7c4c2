"""A block as one file, and back; whatever is not one is refused with one line."""

from __future__ import annotations

import io
import json
import time
import zipfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.blockpack import MANIFEST, pack_block, unpack_block

PATTERN = "label,x,y,tie\na,0,80,yes\nb,0,0,yes\nc,0,-80,yes\nd,92,80,no\ne,92,0,no\nf,92,-80,no\n"


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A measured block with a journal and a camera file."""
    folder = tmp_path_factory.mktemp("packed") / "block"
    assert main(["demo", "--auto", "--models", "1", "--fiducials", "--keep", str(folder)]) == 0
    (folder / "control.csv").write_text("point,X,Y,Z\n101-1,1,2,3\n")
    (folder / "notes.txt").write_text("mine\n")
    return folder


@pytest.fixture(scope="module")
def packed(block: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    file = tmp_path_factory.mktemp("pack") / "block.zip"
    pack_block(block, file)
    return file.read_bytes()


@pytest.mark.slow
def test_a_round_trip(block: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, again = tmp_path / "b.zip", tmp_path / "new" / "again"
    assert main(["pack", str(block), "-o", str(file)]) == 0
    assert main(["unpack", str(file), "-o", str(again)]) == 0
    out = capsys.readouterr().out
    assert "5 files, checked" in out
    assert read_block(again) == read_block(block)
    names = {p.relative_to(again).as_posix() for p in again.rglob("*") if p.is_file()}
    assert {"block.toml", "image_points.csv", "control.csv", "sessions/0001.jsonl"} < names
    # neither the lock nor what does not belong to a block
    assert "notes.txt" not in names
    assert "sessions/lock" not in names
    for name in names:
        assert (again / name).read_bytes() == (block / name).read_bytes()
    assert main(["replay", str(again), "--check"]) == 0
    # nothing is overwritten
    assert main(["pack", str(block), "-o", str(file)]) == 2
    assert main(["unpack", str(file), "-o", str(again)]) == 2
    assert capsys.readouterr().err.count("exists already") == 2


def test_what_a_block_was_imported_from_is_part_of_it(tmp_path: Path) -> None:
    folder, again = tmp_path / "b", tmp_path / "again"
    assert main(["new", str(folder), "--strip", "1-3"]) == 0
    (folder / "source" / "sparse").mkdir(parents=True)
    (folder / "source" / "cameras.bin").write_bytes(b"\x00\x01")
    (folder / "source" / "sparse" / "0").write_bytes(b"\x02")
    (folder / "source" / "link").symlink_to(folder / "block.toml")
    names = pack_block(folder, tmp_path / "b.zip")
    assert names[-2:] == ("source/cameras.bin", "source/sparse/0")
    unpack_block(tmp_path / "b.zip", again)
    for name in names:
        assert (again / name).read_bytes() == (folder / name).read_bytes()
    assert sorted(p.name for p in (again / "source").iterdir()) == ["cameras.bin", "sparse"]


@pytest.mark.parametrize("name", ["mine:1.csv", "mine\\1.csv"])
def test_what_unpack_refuses_is_not_packed(tmp_path: Path, name: str) -> None:
    folder, pattern = tmp_path / "b", tmp_path / "mine.csv"
    pattern.write_text(PATTERN)
    assert main(["new", str(folder), "--strip", "1-3", "--pattern", str(pattern)]) == 0
    (folder / "mine.csv").rename(folder / name)
    text = (folder / "block.toml").read_text()
    (folder / "block.toml").write_text(text.replace('"mine.csv"', f"'{name}'"))
    with pytest.raises(InputError, match="is no file name on every system: rename it"):
        pack_block(folder, tmp_path / "b.zip")
    assert not (tmp_path / "b.zip").exists()


@pytest.mark.slow
def test_every_changed_byte_of_a_file_is_noticed(packed: bytes, tmp_path: Path) -> None:
    with zipfile.ZipFile(io.BytesIO(packed)) as pack:
        contents = {name: pack.read(name) for name in pack.namelist()}
    for name in contents:
        if name == MANIFEST:
            continue
        changed = contents | {name: contents[name][:-1] + b" "}
        refused(zipped(changed), tmp_path, "is not what was packed")
        refused(zipped({n: c for n, c in contents.items() if n != name}), tmp_path, "not there")


def zipped(contents: dict[str, bytes]) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as pack:
        for name, data in contents.items():
            pack.writestr(name, data)
    return made.getvalue()


def refused(data: bytes, tmp_path: Path, words: str) -> None:
    file = tmp_path / "bad.zip"
    file.write_bytes(data)
    before = sorted(p.name for p in tmp_path.iterdir())
    with pytest.raises(InputError) as caught:
        unpack_block(file, tmp_path / "out")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    # nothing is left behind
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def manifest(files: dict[str, object]) -> bytes:
    return json.dumps({"format": 1, "files": files}).encode()


@pytest.mark.parametrize(
    "name",
    ["../out.toml", "/etc/passwd", "a/../../b", "c:\\x", "a\\b", "..", "", "a//b", "a/./b", "\x1b"],
)
def test_names_that_lead_elsewhere_are_refused(tmp_path: Path, name: str) -> None:
    files = {name: {"bytes": 1, "sha256": "0" * 64}}
    refused(zipped({MANIFEST: manifest(files)}), tmp_path, "no name of a block's file")


@pytest.mark.slow
def test_what_claims_too_much_is_refused(tmp_path: Path) -> None:
    claim = {"block.toml": {"bytes": 10**12, "sha256": "0" * 64}}
    refused(zipped({MANIFEST: manifest(claim), "block.toml": b""}), tmp_path, "larger than")
    # a file that unpacks to more than was said is not read on
    bomb = {"block.toml": {"bytes": 10, "sha256": "0" * 64}}
    large = {MANIFEST: manifest(bomb), "block.toml": b"\0" * 50_000_000}
    refused(zipped(large), tmp_path, "is not what was packed")
    refused(zipped({MANIFEST: manifest({}), "more": b""}), tmp_path, "not listed")
    refused(zipped({MANIFEST: b'{"format": 2, "files": {}}'}), tmp_path, "newer version")
    refused(zipped({MANIFEST: b"[" * 100_000}), tmp_path, "not what anaplot writes")
    refused(zipped({MANIFEST: b'{"format": 1, "files": [1]}'}), tmp_path, "not what anaplot")
    refused(zipped({"block.toml": b""}), tmp_path, f"holds no {MANIFEST}")
    refused(zipped({MANIFEST: manifest({})}), tmp_path, "block.toml")
    refused(b"no zip at all", tmp_path, "not a sound zip file")


@pytest.mark.slow
@given(data=st.data())
def test_damaged_bytes_are_refused_or_the_same_block(  # type: ignore[no-untyped-def]
    packed: bytes, tmp_path_factory: pytest.TempPathFactory, data
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    at = data.draw(st.integers(0, len(packed) - 1))
    change = data.draw(st.sampled_from(["cut", "flip"]))
    value = data.draw(st.integers(1, 255))
    bad = packed[:at] if change == "cut" else bytearray(packed)
    if isinstance(bad, bytearray):
        bad[at] ^= value
    file = folder / "b.zip"
    file.write_bytes(bytes(bad))
    refusal = None
    try:
        unpack_block(file, folder / "out")
    except InputError as error:
        refusal = str(error)
    if refusal is None:
        read_block(folder / "out")
    else:
        assert "\n" not in refusal
        assert not (folder / "out").exists()


def test_a_camera_file_elsewhere_is_told(tmp_path: Path, block: Path) -> None:
    folder = tmp_path / "b"
    folder.mkdir()
    text = (block / "block.toml").read_text()
    name = read_block(block).cameras[0].file
    assert name is not None
    (folder / "block.toml").write_text(text.replace(f'"{name}"', f'"{block / name}"'))
    with pytest.raises(InputError, match="stands outside of the block"):
        pack_block(folder, tmp_path / "b.zip")
    assert not (tmp_path / "b.zip").exists()


def test_the_file_of_a_pattern_is_part_of_the_block(tmp_path: Path) -> None:
    folder, pattern = tmp_path / "b", tmp_path / "mine.csv"
    pattern.write_text(PATTERN)
    assert main(["new", str(folder), "--strip", "1-3", "--pattern", str(pattern)]) == 0
    assert "mine.csv" in pack_block(folder, tmp_path / "b.zip")
    unpack_block(tmp_path / "b.zip", tmp_path / "again")
    assert (tmp_path / "again" / "mine.csv").read_bytes() == (folder / "mine.csv").read_bytes()
    (folder / "mine.csv").unlink()
    with pytest.raises(InputError, match=r"mine\.csv"):
        pack_block(folder, tmp_path / "c.zip")
    text = (folder / "block.toml").read_text()
    (folder / "block.toml").write_text(text.replace('"mine.csv"', f'"{pattern}"'))
    with pytest.raises(InputError, match=r"pattern file '.*' stands outside of the block"):
        pack_block(folder, tmp_path / "c.zip")


@pytest.mark.parametrize("year", [1970, 2200])
def test_the_clock_of_the_machine_does_not_matter(
    block: Path, tmp_path: Path, year: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a board without a battery begins in 1970, of which a zip file knows nothing
    now = time.struct_time((year, 1, 1, 0, 0, 0, 3, 1, 0))
    monkeypatch.setattr(time, "localtime", lambda *_: now)
    pack_block(block, tmp_path / "b.zip")
    assert main(["unpack", str(tmp_path / "b.zip"), "-o", str(tmp_path / "again")]) == 0
