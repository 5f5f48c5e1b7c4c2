"""docs/files.md says what the strict readers accept: no key more, no key less, and its examples."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.blocktoml import parse_block_toml
from anaplot.exchange.camerafile import read_camera
from anaplot.exchange.errorsetscsv import read_error_sets
from anaplot.exchange.fiducialfile import read_fiducials
from anaplot.exchange.givenmovementcsv import read_given_movement
from anaplot.exchange.modelvaluesfile import read_model_values
from anaplot.exchange.networkfile import read_network
from anaplot.exchange.operatorscsv import read_operators
from anaplot.exchange.parameterpriorscsv import read_parameter_priors
from anaplot.exchange.patternfile import read_pattern
from anaplot.exchange.platepointscsv import read_plate_points
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.textfiles import csvtable
from anaplot.textfiles.kinds import (
    Blank,
    Fields,
    Keys,
    Kind,
    ListOf,
    Made,
    Number,
    Word,
    WrongValueError,
)
from anaplot.textfiles.tomltable import TomlTable

PAGE = Path(__file__).parents[1] / "docs" / "files.md"

BLOCKS = ("block", "drone", "strips")
CAMERAS = ("rmk", "x5", "old", "table")
TABLES_OF_BLOCK = (
    *("precision", "test", "measuring", "ground", "refinement", "gnss", "imu"),
    *("camera", "strip", "photo"),
)
OWN = ("image_points", "control", "distances", "conditions")


class Row(NamedTuple):
    """A key or column of the page."""

    names: tuple[str, ...]  # the key, and those of the table that it holds
    holds: str
    default: str
    empty: str


class Part(NamedTuple):
    """What stands under a heading, above the next one."""

    rows: dict[str, Row]
    examples: list[str]


def _parts() -> dict[str, Part]:
    found: dict[str, Part] = {}
    part, fence = Part({}, []), None
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if fence is not None:
            if line == "```":
                part.examples.append("\n".join(fence) + "\n")
                fence = None
            else:
                fence.append(line)
        elif line.startswith("```"):
            fence = []
        elif heading := re.match(r"##+ (.*)", line):
            part = found.setdefault(heading[1].replace("`", ""), Part({}, []))
        elif line.startswith("| `"):
            cells = [cell.strip() for cell in line.strip("|").split(" | ")]
            names = tuple(re.findall(r"`(\w+)`", cells[0]))
            empty = cells[3] if len(cells) == 5 else ""
            if names:  # else a file
                part.rows[names[0]] = Row(names, cells[1], cells[2].strip(), empty)
    return found


PARTS = _parts()


class Known(NamedTuple):
    """A key or column as a reader declares it."""

    kind: Kind[Any] | None
    needed: bool


def _unwrapped(kind: Kind[Any] | None) -> Kind[Any] | None:
    while isinstance(kind, Made | Blank):
        kind = kind._kind
    return kind


class Recorder:
    """Notes what readers ask of tables and files."""

    def __init__(self) -> None:
        self.tables: dict[str, dict[str, list[Known]]] = {}
        self.columns: dict[str, dict[str, list[Known]]] = {}
        self.taken: Counter[str] = Counter()

    def note(self, table: str, key: str, kind: Kind[Any] | None, needed: bool) -> None:
        """Note a key of a table, and those of the table that it holds."""
        self.tables.setdefault(table, {}).setdefault(key, []).append(Known(kind, needed))
        inner = _unwrapped(kind)
        if isinstance(inner, Keys):
            self.taken[f"{table}.{key}"] += 1
            for under, one in inner._kinds.items():
                self.note(f"{table}.{key}", under, one, under in inner._required)


def _name(table: TomlTable) -> str:
    """Return how the page's tests call a table: the file, and the keys that lead to it."""
    name = "block" if table._file.stem in BLOCKS else table._file.stem
    name = "camera" if table._file.stem in CAMERAS else name
    return ".".join((name, *(part for part in table._path if isinstance(part, str))))


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    noted = Recorder()
    take, get, version, header = TomlTable.taken, TomlTable.get, TomlTable.version, csvtable._header

    def taken(self: TomlTable, keys: Keys) -> Any:
        noted.taken[_name(self)] += 1
        for key, kind in keys._kinds.items():
            noted.note(_name(self), key, kind, key in keys._required)
        for key in keys._also:
            noted.note(_name(self), key, None, False)
        return take(self, keys)

    def got(self: TomlTable, key: str, kind: Kind[Any]) -> Any:
        noted.note(_name(self), key, kind, False)
        return get(self, key, kind)

    def versioned(self: TomlTable, newest: int, key: str = "format") -> None:
        noted.note(_name(self), key, None, True)
        version(self, newest, key)

    def headed(path: Path, line: str, known: Fields, required: Fields, either: Any) -> Any:
        always = {**required, **(either[0] if len(either) == 1 else {})}
        columns = noted.columns.setdefault(path.stem, {})
        for name, kind in known.items():
            columns.setdefault(name, []).append(Known(kind, name in always))
        return header(path, line, known, required, either)

    monkeypatch.setattr(TomlTable, "taken", taken)
    monkeypatch.setattr(TomlTable, "get", got)
    monkeypatch.setattr(TomlTable, "version", versioned)
    monkeypatch.setattr(csvtable, "_header", headed)
    return noted


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The examples of the page as files."""
    whole = {
        "block.toml": PARTS["block.toml"].examples[0],
        "rmk.toml": PARTS["A camera file"].examples[0],
        "x5.toml": PARTS["A camera file"].examples[1],
        "old.toml": PARTS["A camera file"].examples[2],
        "table.toml": PARTS["A camera file"].examples[3],
        "scan.toml": PARTS["A fiducial file"].examples[0],
        "many.toml": PARTS["A fiducial file"].examples[1],
        "pattern.csv": PARTS["A pattern"].examples[0],
        "pattern.toml": PARTS["A pattern"].examples[1],
        "pier.toml": PARTS["A network"].examples[0],
        "plates.csv": PARTS["Points on plates"].examples[0],
        "drone.toml": PARTS["[[camera]]"].examples[0],
        "strips.toml": PARTS["[[strip]]"].examples[0],
    }
    for name in ("fiducials", "image_points", "control", "distances", "conditions"):
        whole[f"{name}.csv"] = PARTS[f"{name}.csv"].examples[0]
    for option in ("additional-prior", "test-set", "operators", "given-movement", "snooping-model"):
        whole[f"{option}.csv"] = PARTS[f"--{option} FILE"].examples[0]
    (tmp_path / "px").mkdir()
    whole["px/block.toml"] = whole["drone.toml"]
    whole["px/image_points.csv"] = PARTS["image_points.csv"].examples[1]
    for name, text in whole.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def _left_out(kind: Kind[Any] | None, text: str) -> list[str]:
    """Return the words and bounds of a kind that a cell does not tell."""
    kind = _unwrapped(kind)
    if isinstance(kind, Word):
        wanted = [f"`{word}`" for word in kind._words]
    elif isinstance(kind, Number):
        bounds = kind._bounds().removeprefix("be ").removeprefix("lie ")
        said = "inf" in bounds or (kind._low < 0.0 and f"up to {kind._high:g}" in text)
        wanted = [] if said else [bounds]
    elif isinstance(kind, ListOf):
        return _left_out(kind._kind, text)
    else:
        return []
    return [word for word in wanted if word not in text]


def _check_row(where: str, row: Row, known: Sequence[Known], readings: int) -> None:
    count = sum(one.needed for one in known)
    if count >= readings:
        assert row.default == "needed", where
    elif count:
        assert row.default.startswith("needed, or "), where
    else:
        assert row.default != "needed", where
    for one in known:
        assert _left_out(one.kind, row.holds) == [], where


def _check_table(noted: Recorder, table: str, part: str, but: Collection[str] = ()) -> None:
    rows, known = PARTS[part].rows, noted.tables[table]
    assert set(rows) == set(known) - set(but), part
    for key, row in rows.items():
        where = f"{part} {key}"
        _check_row(where, row, known[key], noted.taken[table])
        if len(row.names) > 1:
            under = noted.tables[f"{table}.{key}"]
            assert set(row.names[1:]) == set(under), where
            assert not any(_left_out(k.kind, row.holds) for one in under.values() for k in one)


def _check_columns(noted: Recorder, file: str, part: str) -> None:
    rows, known = PARTS[part].rows, noted.columns[file]
    assert set(rows) == set(known), part
    for column, row in rows.items():
        where = f"{part} {column}"
        _check_row(where, row, known[column], 1)
        for one in known[column]:
            assert one.kind is not None
            try:
                one.kind.of_text("")
            except WrongValueError:
                assert row.empty == "refused", where
            else:
                assert row.empty != "refused", where


def test_the_keys_of_a_block(recorder: Recorder, folder: Path) -> None:
    block = read_block(folder)
    assert (block.offsets is not None, block.air is not None) == (True, True)
    assert [p.use for p in block.image_points] == ["xy", "y", "off"]
    for name in ("drone", "strips"):
        parse_block_toml(
            (folder / f"{name}.toml").read_text(encoding="utf-8"), folder / f"{name}.toml"
        )
    _check_table(recorder, "block", "At the top", but=TABLES_OF_BLOCK)
    for table in TABLES_OF_BLOCK:
        title = f"[[{table}]]" if table in ("camera", "strip", "photo") else f"[{table}]"
        _check_table(recorder, f"block.{table}", title)
    _check_table(recorder, "block.camera.lens", "[camera.lens]")


def test_the_keys_of_camera_and_fiducial_files(recorder: Recorder, folder: Path) -> None:
    for name in CAMERAS:
        read_camera(folder / f"{name}.toml")
    _check_table(recorder, "camera", "At the top of a camera file")
    for table in ("camera", "distances", "distortion", "lens"):
        _check_table(recorder, f"camera.{table}", f"[{table}]")
    assert read_fiducials(folder / "scan.toml").photos[0].photo == "101"
    _check_table(recorder, "scan", "At the top of a fiducial file")
    assert len(read_fiducials(folder / "many.toml").photos[0].measured) == 3
    _check_columns(recorder, "fiducials", "fiducials.csv")


def test_the_keys_of_a_network_and_a_pattern(recorder: Recorder, folder: Path) -> None:
    assert len(read_network(folder / "pier.toml").stations) == 2
    _check_table(recorder, "pier", "At the top of a network", but=("camera", "station", "point"))
    _check_table(recorder, "pier.camera", "[[camera]] of a network")
    _check_table(recorder, "pier.station", "[[station]]")
    _check_table(recorder, "pier.point", "[[point]]")
    assert read_pattern(folder / "pattern.csv").ties == ("1", "2", "3")
    _check_columns(recorder, "pattern", "A pattern")
    assert read_pattern(folder / "pattern.toml").places == (("1", 0.0, 95.0),)
    assert set(recorder.tables["pattern.point"]) == set(PARTS["A pattern"].rows)


def test_the_columns_of_a_blocks_files(recorder: Recorder, folder: Path) -> None:
    assert read_block(folder / "px").in_pixels
    block = read_block(folder)
    for name in ("image_points", "control", "distances", "conditions"):
        _check_columns(recorder, name, f"{name}.csv")
    assert [p.use for p in block.control] == ["control", "control", "control", "check", "off"]
    assert [p.point for p in block.priors] == ["31"]
    assert [c.kind for c in block.conditions] == [
        *["distance"] * 2,
        "line",
        "plane",
        "angle",
        "equal",
    ]
    assert [p.sigma for p in read_plate_points(folder / "plates.csv", block).points] == [0.3, None]
    _check_columns(recorder, "plates", "Points on plates")


def test_the_columns_of_files_that_options_take(recorder: Recorder, folder: Path) -> None:
    read = {
        "additional-prior": lambda path: len(read_parameter_priors(path)),
        "test-set": lambda path: len(read_error_sets(path)),
        "operators": lambda path: len(read_operators(path, ["101", "102"])),
        "given-movement": lambda path: len(read_given_movement(path)),
        "snooping-model": lambda path: len(read_model_values(path)),
    }
    rows = {option: reader(folder / f"{option}.csv") for option, reader in read.items()}
    assert rows == {
        "additional-prior": 2,
        "test-set": 5,
        "operators": 2,
        "given-movement": 2,
        "snooping-model": 2,
    }
    for option in read:
        _check_columns(recorder, option, f"--{option} FILE")


def test_every_file_of_a_block_is_listed(recorder: Recorder, folder: Path) -> None:
    read_block(folder)
    assert set(recorder.columns) == {path.stem for path in folder.glob("*.csv") if path.stem in OWN}


def test_what_is_left_out_is_what_the_page_says(tmp_path: Path) -> None:
    path = tmp_path / "block.toml"
    least = 'format = 1\nname = "b"\n[[camera]]\nid = "k"\nc = 100.0\n'
    block = parse_block_toml(least, path)
    assert (block.precision, block.test) == (Precision(), TestSettings())
    for part, of in (("[precision]", block.precision), ("[test]", block.test)):
        for key, row in PARTS[part].rows.items():
            value = getattr(of, key)
            assert (
                row.default.strip("`") == value
                if isinstance(value, str)
                else (float(row.default) == value)
            ), key


def test_every_key_stands_in_an_example() -> None:
    examples = "".join(text for part in PARTS.values() for text in part.examples)
    for title, part in PARTS.items():
        for key in part.rows:
            header = re.search(rf"(^|,){key}(,|$)", examples, re.MULTILINE)
            stated = re.search(
                rf"(^|[{{ ]){key} = |^\[+({key}|\w+\.{key})[].]", examples, re.MULTILINE
            )
            assert header or stated, f"{title} {key}"
