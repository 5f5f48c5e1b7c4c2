"""Reading device profiles of schema 1: strict, bounded, and never code."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from anaplot.errors import InputError
from anaplot.plotter import profilekeys as keys
from anaplot.plotter.linear import SingularError, inverse
from anaplot.plotter.schema import (
    AxisFormat,
    Checksum,
    DriveFormat,
    Example,
    Footswitch,
    Framing,
    LineSettings,
    Meaning,
    Poll,
    Profile,
    RecordFormat,
    Simulate,
    Stage,
    pressed_only,
)
from anaplot.textfiles.inputfile import decoded, read_bytes
from anaplot.textfiles.kinds import (
    FLAG,
    NUMBER,
    Fields,
    Keys,
    KnownName,
    MapOf,
    Number,
    Numbers,
    Octets,
    OneOrMore,
    Text,
    Whole,
    Word,
)
from anaplot.textfiles.tomltable import TomlTable, parse_toml
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = [
    "MAX_PROFILE_BYTES",
    "find_profiles",
    "load_profile",
    "parse_profile",
    "recorded_profile",
]

MAX_PROFILE_BYTES = 65536
SCHEMA = 1
_MOST_TABLES, _MOST_EXAMPLES = 16, 100
_COUNTS = 3.0  # by which read-outs of a carriage that stands still may differ
_MICROMETRE = 0.001  # mm, the count of an axis that tells millimetres
_LEFT_RIGHT = ("xl", "yl", "xr", "yr")
_SPECIAL_GROUPS = frozenset({"number", "switch", "code", "text"})


def profile_folders() -> list[Path]:
    """Return where profiles are looked for, the user's own folder first.

    Returns
    -------
    list of Path
        The user's ``anaplot/device_profiles`` in the configuration folder, then the profiles
        that come with the program: inside an installed package, or beside it in a source tree.
    """
    if configured := os.environ.get("XDG_CONFIG_HOME"):
        base = Path(configured)
    elif sys.platform == "win32":
        base = Path(os.environ.get("APPDATA") or Path.home() / "AppData" / "Roaming")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Application Support"
    else:
        base = Path.home() / ".config"
    package = Path(__file__).resolve().parent.parent
    inside = package / "device_profiles"
    shipped = inside if inside.is_dir() else package.parent / "device_profiles"
    return [base / "anaplot" / "device_profiles", shipped]


def find_profiles() -> dict[str, Path]:
    """Find every profile by name.

    Returns
    -------
    dict of str to Path
        File name without ``.toml`` -> file, sorted by name; a user's profile hides a shipped
        one of the same name.
    """
    found: dict[str, Path] = {}
    for folder in profile_folders():
        try:
            files = sorted(folder.glob("*.toml"))
        except OSError:
            continue
        for file in files:
            if keys.ID.fullmatch(file.stem):
                found.setdefault(file.stem, file)
    return dict(sorted(found.items()))


def load_profile(name_or_path: str | Path) -> Profile:
    """Load a profile by name or from a file.

    Parameters
    ----------
    name_or_path
        A name as `find_profiles` lists them, or a path (anything with a separator or ending
        in ``.toml``).

    Raises
    ------
    InputError
        When there is none of that name, or the file is not a valid profile.
    """
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or text.endswith(".toml") or "/" in text or "\\" in text:
        path = Path(name_or_path)
    else:
        profiles = find_profiles()
        if text not in profiles:
            raise InputError(f"no device profile {quoted(text)}{hint(text, profiles)}")
        path = profiles[text]
    if "\0" in text:
        raise InputError(f"{plain(text, 120)}: not a file name")
    return parse_profile(read_bytes(path, MAX_PROFILE_BYTES), plain(path.name, 120))


def parse_profile(raw: bytes, name: str) -> Profile:
    """Read a profile from the bytes of its file.

    Parameters
    ----------
    raw
        The file's bytes.
    name
        What errors call the file.

    Raises
    ------
    InputError
        Naming file, line, table, key and, for an unknown key, the nearest known one.
    """
    if len(raw) > MAX_PROFILE_BYTES:
        raise InputError(f"{name}: larger than {MAX_PROFILE_BYTES} bytes")
    text = decoded(raw, Path(name))
    return _Loader(parse_toml(text, Path(name)), name, raw).load()


def recorded_profile(name: str, sha256: str | None, text: str | None) -> Profile:
    """Return the profile with which a session was recorded.

    Parameters
    ----------
    name, sha256
        Of the profile, as the session says.
    text
        The profile itself, where the session has it; older sessions name it only, and it is
        looked for among the profiles of today and the former ones that come with the program.

    Returns
    -------
    Profile
        That profile, or the one that has its name today: compare `Profile.sha256`.

    Raises
    ------
    InputError
        When there is none of that name, or the text is not a valid profile.
    """
    if text is not None:
        return parse_profile(text.encode(), f"recorded profile {plain(name, 60)}")
    if keys.ID.fullmatch(name):
        for file in sorted((profile_folders()[-1] / "former").glob(f"{name}.*.toml")):
            former = load_profile(file)
            if former.sha256 == sha256:
                return former
    return load_profile(name)


class _Loader:
    """Reads the tables in the order in which they depend on each other."""

    def __init__(self, root: TomlTable, name: str, raw: bytes) -> None:
        self._root = root
        self._name = name
        self._raw = raw

    def load(self) -> Profile:
        root = self._root
        root.version(SCHEMA, "schema")
        # a misspelt table is better told as such than as missing
        head = root.take(keys.HEAD, {"confirm": FLAG}, also=keys.TABLES)
        self._links = {
            name: LineSettings(name, **table.take({}, keys.LINK))
            for name, table in self._named("link")
        }
        self._link = KnownName("link", self._links)
        self._framing = self._read_framing(root.table("framing"))
        checksum = self._read_checksum() if "checksum" in root else None
        poll = self._read_poll(root.table("poll")) if "poll" in root else None
        self._records = {
            name: self._read_record(name, table) for name, table in self._named("record")
        }
        self._axes = self._read_axes()
        self._check_records()
        stage = self._read_stage(root.table("stage"))
        switches = {
            name: self._read_footswitch(name, table)
            for name, table in self._named("footswitch", needed=False)
        }
        self._check_switched(switches)
        drive = self._read_drive(root.table("drive")) if "drive" in root else None
        safe = checksum is not None and checksum.required
        confirm = head.pop("confirm", not safe)
        if confirm:
            self._check_confirmed(switches)
        return Profile(
            **head,
            links=self._links,
            framing=self._framing,
            checksum=checksum,
            poll=poll,
            records=self._records,
            axes=self._axes,
            stage=stage,
            footswitches=switches,
            drive=drive,
            simulate=self._read_simulate(poll, switches),
            confirm=confirm,
            examples=self._read_examples(2 if stage.mono else 4),
            text=self._raw.decode(),
            sha256=hashlib.sha256(self._raw).hexdigest(),
            origin=self._name,
        )

    def _named(self, key: str, *, needed: bool = True) -> list[tuple[str, TomlTable]]:
        """Return the tables [key.NAME] with their names."""
        names = keys.AXIS_NAME if key == "axis" else keys.TABLE_NAME
        tables = list(self._root.named_tables(key, names))
        if needed and not tables:
            raise self._root.fail(f"no [{key}.NAME]: at least one {key} is needed")
        if len(tables) > _MOST_TABLES:
            raise self._root.fail(f"more than {_MOST_TABLES} tables", key)
        return tables

    def _one_link(self, table: TomlTable) -> str:
        if len(self._links) == 1 and "link" not in table:
            return next(iter(self._links))
        return table.get("link", self._link)

    def _read_framing(self, table: TomlTable) -> Framing:
        kind = table.get("kind", keys.FRAMES["kind"])
        if kind == "line":
            framing = Framing(
                **table.take(
                    {**keys.FRAMES, **keys.TERMINATOR}, {**keys.FRAMING, "lines": Whole(1, 8)}
                )
            )
            if framing.lines > 1 and framing.gap is None:
                raise table.fail("records of several lines need a gap that tells them apart")
        else:
            length = Whole(1, table.optional("max_bytes", keys.RECORD_BYTES, 80))
            given = table.take({**keys.FRAMES, "length": length}, keys.FRAMING)
            framing = Framing(**given, terminator=b"")
            if kind == "fixed" and framing.gap is None:
                raise table.fail("fixed records need a gap that tells them apart")
        return framing

    def _read_checksum(self) -> Checksum:
        table = self._root.table("checksum")
        if self._framing.kind != "line":
            raise table.fail("belongs to line framing")
        return Checksum(
            **table.take({"kind": Word("xor8", "sum8", "crc8", "crc16")}, keys.CHECKSUM)
        )

    def _read_poll(self, table: TomlTable) -> Poll:
        timeout = table.optional("timeout", Number(0.001, 60.0), 0.5)
        given = table.take(
            {"request": Octets(80, empty=False)},
            {
                "links": OneOrMore(self._link),
                "timeout": NUMBER,
                "period": Number(0.001, 60.0),
                "latency": Number(timeout, 600.0),
            },
        )
        usual = {"links": tuple(self._links), "latency": max(5.0, 2 * timeout)}
        return Poll(**{**usual, **given})

    def _read_record(self, name: str, table: TomlTable) -> RecordFormat:
        pattern = table.get("pattern", keys.PATTERN)
        groups = pattern.groupindex
        group = KnownName("group of the pattern", groups)
        most = self._framing.max_bytes
        given = table.take(
            {
                "kind": Word("position", "record", "in-position", "fault", "ignore"),
                "pattern": keys.PATTERN,
            },
            {
                "link": OneOrMore(self._link),
                "send": keys.template(groups),
                "faults": MapOf(group, MapOf(Octets(), keys.SHOWN)),
                "units": Keys({"group": group, "mm": keys.UNITS}),
                "constants": MapOf(group, Octets()),
                "max_bytes": Whole(1, most),
                "confirm": Whole(1, 9),
                "confirm_within": Number(0.01, 60.0),
            },
        )
        given["links"] = given.pop("link", tuple(self._links))
        if units := given.pop("units", None):
            given["unit_group"], given["units"] = units["group"], units["mm"]
        usual: dict[str, Any] = {"max_bytes": most, "faults": {}, "constants": {}}
        return RecordFormat(name, **{**usual, **given})

    def _read_axes(self) -> dict[str, AxisFormat]:
        axes: dict[str, AxisFormat] = {}
        taken: dict[tuple[str, str, str], str] = {}
        for name, table in self._named("axis"):
            axes[name] = axis = self._read_axis(name, table)
            for record in axis.records:
                other = taken.setdefault((axis.link, record, axis.group), name)
                if other != name:
                    raise table.fail(f"reads the same value as axis {quoted(other)}", "group")
        return axes

    def _read_axis(self, name: str, table: TomlTable) -> AxisFormat:
        link = self._one_link(table)
        group = table.optional("group", Text(), name)
        holding = [
            record.name
            for record in self._records.values()
            if link in record.links and group in record.groups
        ]
        if not holding:
            every = sorted(set().union(*(record.groups for record in self._records.values())))
            raise table.fail(
                f"no record has the group {quoted(group)}{hint(group, every)}", "group"
            )
        record = KnownName("record", self._records)
        given = table.take(
            {"range": keys.RANGE},
            {**keys.AXIS, "link": self._link, "group": Text(), "record": OneOrMore(record)},
        )
        records = given.pop("record", tuple(holding))
        for missing in (record for record in records if record not in holding):
            raise table.fail(f"record {quoted(missing)} has no group {quoted(group)}", "group")
        low, high = given.pop("range")
        scale = given.get("scale", 1.0)
        count = _MICROMETRE if given.get("encoding", "decimal") == "decimal" else scale
        usual = {"link": link, "group": group, "still": _COUNTS * count}
        return AxisFormat(name, records=records, low=low, high=high, **{**usual, **given})

    def _check_records(self) -> None:
        """Check that a footswitch's message carries all axes or none, a position at least one."""
        for name, table in self._named("record"):
            record = self._records[name]
            carried = [axis for axis in self._axes.values() if name in axis.records]
            if record.kind == "position" and not carried:
                raise table.fail("a position must carry at least one axis")
            if record.kind in ("record", "in-position") and 0 < len(carried) < len(self._axes):
                raise table.fail("must carry all axes or none")
            if record.send is not None:
                known = {axis.group for axis in carried}
                known |= _SPECIAL_GROUPS | set(record.constants or ())
                for field in sorted(record.send.names - known):
                    raise table.fail(
                        f"{{{field}}} is no axis and has no value in constants", "send"
                    )

    def _read_stage(self, table: TomlTable) -> Stage:
        names = tuple(self._axes)
        mono = "x" in table or "y" in table
        rows: list[Mapping[str, float]]
        if mono or any(key in table for key in _LEFT_RIGHT):
            sides = ("x", "y") if mono else _LEFT_RIGHT
            row = MapOf(KnownName("axis", (*names, "offset")), Number(-1e6, 1e6))
            given = table.take(dict.fromkeys(sides, row), keys.WITHIN)
            rows = [given[side] for side in sides]
            if len(names) != len(rows):
                raise table.fail(f"needs {len(rows)} axes, there are {len(names)}")
        else:
            given = table.take({}, keys.WITHIN)
            mono = set(names) == {"x", "y"}
            if not mono and set(names) != set(_LEFT_RIGHT):
                raise self._root.fail(
                    "[stage] has no map: the axes are neither xl, yl, xr, yr nor x, y"
                )
            rows = [{name: 1.0} for name in (("x", "y") if mono else _LEFT_RIGHT)]
        try:
            return _stage(mono, names, rows, given.get("within", 1.0))
        except SingularError:
            raise table.fail(
                "cannot be inverted: two coordinates depend on the same axes"
            ) from None

    def _read_footswitch(self, name: str, table: TomlTable) -> Footswitch:
        required: Fields = {"source": Word("record", "every", "modem", "key")}
        source = table.get("source", required["source"])
        if source == "modem":
            link = self._one_link(table)
            required = {**required, "line": Word("cts", "dsr", "cd", "ri")}
            given = table.take(required, {**keys.MODEM, "link": self._link})
            return Footswitch(name, **{**given, "link": link})
        if source != "record":
            return Footswitch(name, **table.take(required))
        format_ = self._records[table.get("record", KnownName("record", self._records))]
        if format_.kind not in ("record", "position"):
            raise table.fail("must be a record of kind record or position", "record")
        required = {**required, "record": Text()}
        if "group" in table:
            group = KnownName("group of the record", format_.groups)
            required = {**required, "group": group, "value": Octets()}
        elif format_.kind == "position":
            raise table.fail("no key 'group': the position's group that tells the key")
        return Footswitch(name, **table.take(required, keys.EVENT))

    def _check_switched(self, switches: Mapping[str, Footswitch]) -> None:
        """Check that every footswitch's message has its footswitch."""
        named = {switch.record for switch in switches.values()}
        for record in self._records.values():
            if record.kind == "record" and record.name not in named:
                raise self._root.fail(
                    f"no [footswitch.NAME] names the record {quoted(record.name)}: "
                    "nothing would record"
                )

    def _check_confirmed(self, switches: Mapping[str, Footswitch]) -> None:
        """Check that the read-outs around a measurement can confirm it."""
        positions = [r for r in self._records.values() if r.kind == "position"]
        if not positions:
            raise self._root.fail(
                "a measurement cannot be confirmed: no record tells positions besides", "confirm"
            )
        once = [record.name for record in positions if record.confirm == 1]
        if once and any(switch.source == "every" for switch in switches.values()):
            raise self._root.fail(
                "every position is a measurement, none confirms it: "
                f"{quoted(once[0])} needs confirm = 2",
                "confirm",
            )

    def _read_drive(self, table: TomlTable) -> DriveFormat:
        link = self._one_link(table)
        limits = MapOf(KnownName("axis", self._axes), keys.RANGE)
        given = table.take(
            {
                "command": keys.template(self._axes),
                "stop": keys.template(()),
                "in_position": KnownName("record", self._records),
            },
            {"link": self._link, "limits": limits, "terminator": Octets(4)},
        )
        if missing := sorted(set(self._axes) - given["command"].told):
            raise table.fail(f"does not tell the axis {missing[0]}", "command")
        if self._records[given["in_position"]].kind != "in-position":
            raise table.fail("must be a record of kind in-position", "in_position")
        bounds = {name: (axis.low, axis.high) for name, axis in self._axes.items()}
        for name, (low, high) in given.get("limits", {}).items():
            if not bounds[name][0] <= low < high <= bounds[name][1]:
                raise table.fail("must lie within the axis' range", "limits", name)
        usual = {"link": link, "terminator": self._framing.terminator}
        return DriveFormat(**{**usual, **given, "limits": {**bounds, **given.get("limits", {})}})

    def _read_simulate(self, poll: Poll | None, switches: Mapping[str, Footswitch]) -> Simulate:
        pressed = pressed_only(switches.values(), self._records)
        usual = {"stream": None if poll or pressed else 0.04}
        return Simulate(**{**usual, **self._root.table("simulate").take({}, keys.SIMULATE)})

    def _read_examples(self, count: int) -> tuple[Example, ...]:
        tables = list(self._root.tables("example"))
        if not tables:
            raise self._root.fail("no [[example]]: at least one is needed")
        if len(tables) > _MOST_EXAMPLES:
            raise self._root.fail(f"more than {_MOST_EXAMPLES} tables", "example")
        return tuple(self._read_example(table, count) for table in tables)

    def _read_example(self, table: TomlTable, count: int) -> Example:
        link = self._one_link(table)
        key = "hex" if "hex" in table else "bytes"
        given = table.take({key: keys.EXAMPLE[key]}, {"link": self._link}, also=("means",))
        meanings = tuple(self._read_meaning(inner, count) for inner in table.tables("means"))
        if not meanings:
            raise table.fail("no key 'means': what the bytes mean")
        return Example(link, given[key], meanings)

    def _read_meaning(self, table: TomlTable, count: int) -> Meaning:
        place = Numbers(count, keys.BOUND)
        kinds: Fields = {
            "position": place,
            "record": place,
            "in_position": keys.PlaceOrTrue(count, keys.BOUND),
            "fault": Text(),
            "refused": Text(),
            "axes": MapOf(KnownName("axis", self._axes), keys.BOUND),
        }
        found = [key for key in kinds if key in table]
        if len(found) != 1:
            table.take({}, {**kinds, **keys.PRESS, **keys.COUNT})
            raise table.fail(f"must be one of {', '.join(kinds)}")
        kind = found[0]
        press = kind == "record"
        given = table.take(
            {kind: kinds[kind], **(keys.PRESS if press else {})}, keys.COUNT if press else {}
        )
        field = {"axes": "axes", "fault": "text", "refused": "text"}.get(kind, "position")
        meant = {"kind": kind.replace("_", "-"), field: given.pop(kind)}
        return Meaning(**meant, **given)


def _stage(
    mono: bool, names: tuple[str, ...], rows: Sequence[Mapping[str, float]], within: float
) -> Stage:
    matrix = tuple(tuple(row.get(name, 0.0) for name in names) for row in rows)
    return Stage(
        mono=mono,
        axes=names,
        matrix=matrix,
        inverse=inverse(matrix),
        offset=tuple(row.get("offset", 0.0) for row in rows),
        within=within,
    )
