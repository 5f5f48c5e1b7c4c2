"""Every file comes in through one door: what is no regular file is refused, and at once."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import anaplot
from anaplot.console.keymap import load_keymap
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.camerafile import read_camera
from anaplot.exchange.fiducialfile import read_fiducials
from anaplot.exchange.journal import Journal, read_journal
from anaplot.exchange.networkfile import read_network
from anaplot.exchange.patternfile import read_pattern
from anaplot.exchange.runsfile import RunsFile
from anaplot.plotter.profile import load_profile
from anaplot.textfiles.inputfile import open_input, read_bytes

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="named pipes of POSIX")

GIGANTIC = 20_000_000_000


def in_block(name: str, read: Callable[[Path], object]) -> Callable[[Path], object]:
    """Read a block of which one file is the given one."""

    def reader(path: Path) -> object:
        block = path.parent / "block"
        target = block / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if name == "image_points.csv":
            (block / "block.toml").write_text(
                'format = 1\nname = "b"\n[precision]\nimage_um = 5.0\n'
                '[[camera]]\nid = "c"\nc = 150.0\n[[strip]]\nid = "1"\nphotos = ["1", "2"]\n'
                '[[photo]]\nid = "1"\ncamera = "c"\n[[photo]]\nid = "2"\ncamera = "c"\n'
            )
        path.rename(target)
        return read(block)

    return reader


READERS: dict[str, Callable[[Path], object]] = {
    "block.toml": in_block("block.toml", read_block),
    "image_points.csv": in_block("image_points.csv", read_block),
    "journal of a block": in_block("sessions/0001.jsonl", read_journal),
    "journal opened": in_block("sessions/0001.jsonl", lambda block: Journal.open(block, {})),
    "journal": read_journal,
    "camera": read_camera,
    "fiducials": read_fiducials,
    "network": read_network,
    "pattern": read_pattern,
    "runs": lambda path: RunsFile(path, {"name": "x"}, {}, 5),
    "profile": load_profile,
    "keymap": load_keymap,
}


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS.keys())
def test_a_named_pipe_is_refused_and_not_waited_for(reader, tmp_path):
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="not a regular file"):
        reader(pipe)


# a journal may be named by its folder
@pytest.mark.parametrize("name", [name for name in READERS if name != "journal"])
def test_a_folder_is_called_one(name, tmp_path):
    folder = tmp_path / "folder.toml"
    folder.mkdir()
    with pytest.raises(InputError, match=r": a folder, not a file$"):
        READERS[name](folder)


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS.keys())
def test_twenty_gigabytes_of_zeros_are_refused_by_their_size(reader, tmp_path):
    sparse = tmp_path / "zeros.toml"
    with sparse.open("wb") as file:
        file.truncate(GIGANTIC)
    with pytest.raises(InputError, match=r"MB, more than .* is not read"):
        reader(sparse)


@pytest.mark.parametrize("reader", [*READERS.values()], ids=[*READERS])
def test_a_device_is_refused(reader, tmp_path):
    link = tmp_path / "device.toml"
    link.symlink_to("/dev/zero")
    with pytest.raises(InputError, match=r"not a regular file|a link to another file"):
        reader(link)


def test_a_pipe_that_takes_the_name_after_the_look_is_refused_too(tmp_path, monkeypatch):
    file, pipe = tmp_path / "file", tmp_path / "pipe"
    file.write_bytes(b"x")
    os.mkfifo(pipe)
    status = file.stat()
    monkeypatch.setattr(Path, "stat", lambda *_, **__: status)
    with pytest.raises(InputError, match="not a regular file"):
        open_input(pipe, 100)


def test_a_file_that_is_longer_than_it_says_is_not_read_to_its_end(tmp_path):
    # Files of /proc say that they are empty.
    if not Path("/proc/self/maps").exists():
        pytest.skip("no files here that do not know their length")
    assert Path("/proc/self/maps").stat().st_size == 0
    with pytest.raises(InputError, match=r"more than 0\.1 kB is not read"):
        read_bytes(Path("/proc/self/maps"), 100)
    growing = tmp_path / "growing"
    growing.write_bytes(b"a" * 90)
    with open_input(growing, 100) as file:
        assert file.read(80) == b"a" * 80
        with growing.open("ab") as other:
            other.write(b"a" * 50_000)
        with pytest.raises(InputError, match=r"more than 0\.1 kB is not read"):
            file.read()


def test_the_limit_itself_is_read(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"\xef\xbb\xbfabc" * 20_000)
    assert read_bytes(path, 120_000) == path.read_bytes()
    with pytest.raises(InputError, match=r"120 kB, more than 120 kB is not read"):
        read_bytes(path, 119_999)


MEMORY = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (400_000_000,) * 2)
from anaplot.exchange.journal import read_journal
print(*read_journal(Path(sys.argv[1])).remarks)
"""


@pytest.mark.slow
def test_a_journal_of_one_long_line_takes_little_memory(tmp_path):
    path = tmp_path / "0001.jsonl"
    with path.open("wb") as file:
        file.truncate(250_000_000)
        file.seek(0, 2)
        file.write(b"\nmore\n")
    result = subprocess.run(
        [sys.executable, "-c", MEMORY, str(path)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(anaplot.__file__).parents[1])},
        check=True,
    )
    assert "0001.jsonl line 1: not a complete record: left out" in result.stdout
