"""Reading device profiles of schema 1: strict, bounded, and never code."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, cast

from anaplot.errors import InputError
from anaplot.plotter.linear import SingularError, inverse
from anaplot.plotter.pattern import PatternError, compile_pattern
from anaplot.plotter.schema import (
    AxisFormat,
    Checksum,
    Drive,
    Encoding,
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
)
from anaplot.plotter.template import Template, TemplateError, parse_template
from anaplot.plotter.tomltable import TomlTable, nearest, parse_toml
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wording import plain

__all__ = [
    "MAX_PROFILE_BYTES",
    "find_profiles",
    "load_profile",
    "parse_profile",
    "recorded_profile",
]

MAX_PROFILE_BYTES = 65536
MAX_RECORD_BYTES = 1024
_TABLES = (
    "schema",
    "id",
    "title",
    "status",
    "sources",
    "link",
    "framing",
    "checksum",
    "confirm",
    "poll",
    "record",
    "axis",
    "stage",
    "footswitch",
    "drive",
    "simulate",
    "example",
)
_MICROMETRE = 0.001  # mm, the count of an axis that tells millimetres
_COUNTS = 3.0  # by which read-outs of a carriage that stands still may differ
_LEFT_RIGHT = ("xl", "yl", "xr", "yr")
_SPECIAL_GROUPS = frozenset({"number", "switch", "code", "text"})
_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,60}")


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
            if _NAME.fullmatch(file.stem):
                found.setdefault(file.stem, file)
    return dict(sorted(found.items()))


def load_profile(name_or_path: str | Path) -> Profile:
    """Load a profile by name or from a file.

    Parameters
    ----------
    name_or_path
        A name as `find_profiles` lists them, or a path (anything with a separator or ending
        in ``.toml``).

    Returns
    -------
    Profile
        The profile.

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
            near = nearest(text, list(profiles))
            raise InputError(f'no device profile "{plain(text, 60)}"{near}')
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

    Returns
    -------
    Profile
        The profile.

    Raises
    ------
    InputError
        Naming file, line, table, key and, for an unknown key, the nearest known one.
    """
    if len(raw) > MAX_PROFILE_BYTES:
        raise InputError(f"{name}: larger than {MAX_PROFILE_BYTES} bytes")
    return _Loader(parse_toml(raw, name), name, raw).load()


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
    if _NAME.fullmatch(name):
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
        for key in _TABLES:
            root.has(key)
        schema = root.raw("schema")
        if isinstance(schema, bool) or not isinstance(schema, int):
            root.fail("must be the schema's number, 1", "schema")
        if schema != 1:
            newer = ", written for a newer version" if schema > 1 else ""
            root.fail(f"is {str(schema)[:20]}, not 1{newer}", "schema")
        # a misspelt table is better told as such than as missing
        root.done()
        identifier = root.string("id", limit=61)
        if not _NAME.fullmatch(identifier):
            root.fail("must be lower case letters, digits, . _ or -", "id")
        title = plain(root.string("title"), 120)
        status = root.choice("status", ("verified", "from-manual", "simulated"))
        sources = tuple(plain(item, 300) for item in root.strings("sources"))
        self._links = self._read_links()
        self._framing = self._read_framing()
        checksum = self._read_checksum()
        poll = self._read_poll()
        self._records = self._read_records()
        self._axes = self._read_axes()
        self._check_records()
        stage = self._read_stage()
        footswitches = self._read_footswitches()
        self._check_switched(footswitches)
        drive = self._read_drive()
        confirm = self._read_confirm(checksum, footswitches)
        simulate = self._read_simulate(poll, footswitches)
        examples = self._read_examples(stage)
        return Profile(
            id=identifier,
            title=title,
            status=cast(Literal["verified", "from-manual", "simulated"], status),
            sources=sources,
            links=self._links,
            framing=self._framing,
            checksum=checksum,
            poll=poll,
            records=self._records,
            axes=self._axes,
            stage=stage,
            footswitches=footswitches,
            drive=drive,
            simulate=simulate,
            confirm=confirm,
            examples=examples,
            text=self._raw.decode(),
            sha256=hashlib.sha256(self._raw).hexdigest(),
            origin=self._name,
        )

    def _read_links(self) -> dict[str, LineSettings]:
        links: dict[str, LineSettings] = {}
        for name, table in self._root.named_tables("link").items():
            stopbits = table.number("stopbits", 1.0)
            if stopbits not in (1.0, 1.5, 2.0):
                table.fail("must be 1, 1.5 or 2", "stopbits")
            silence = table.number("silence", 0.0, low=0.0, high=3600.0)
            links[name] = LineSettings(
                name=name,
                baud=table.integer("baud", 9600, low=50, high=4_000_000),
                bytesize=table.integer("bytesize", 8, low=7, high=8),
                parity=table.choice("parity", ("none", "even", "odd", "mark", "space"), "none"),
                stopbits=stopbits,
                flow=table.choice("flow", ("none", "rtscts", "xonxoff"), "none"),
                silence=silence or None,
            )
            table.done()
        if not links:
            self._root.fail("[link.NAME] is missing: at least one link is needed")
        return links

    def _one_link(self, table: TomlTable) -> str:
        if len(self._links) == 1 and not table.has("link"):
            return next(iter(self._links))
        return table.choice("link", self._links)

    def _some_links(self, table: TomlTable, key: str) -> tuple[str, ...]:
        names = table.strings(key, tuple(self._links))
        for name in names:
            if name not in self._links:
                table.fail(f'no link "{plain(name, 120)}"{nearest(name, list(self._links))}', key)
        return names

    def _read_framing(self) -> Framing:
        table = self._root.table("framing")
        if table is None:
            self._root.fail("[framing] is missing")
        kind = table.choice("kind", ("line", "fixed", "sync-bit"))
        max_bytes = table.integer("max_bytes", 80, low=1, high=MAX_RECORD_BYTES)
        gap = table.number("gap", 0.0, low=0.0, high=10.0) or None
        joined = table.choice("joined", ("start", "middle"), "start")
        terminator, length, lines = b"", 0, 1
        if kind == "line":
            terminator = table.octets("terminator", limit=4)
            if not terminator:
                table.fail("must not be empty", "terminator")
            lines = table.integer("lines", 1, low=1, high=8)
            if lines > 1 and gap is None:
                table.fail("records of several lines need a gap that tells them apart")
        else:
            length = table.integer("length", low=1, high=max_bytes)
            if kind == "fixed" and gap is None:
                table.fail("fixed records need a gap that tells them apart")
        table.done()
        return Framing(
            kind=cast(Literal["line", "fixed", "sync-bit"], kind),
            terminator=terminator,
            max_bytes=max_bytes,
            gap=gap,
            length=length,
            lines=lines,
            joined=cast(Literal["start", "middle"], joined),
        )

    def _read_checksum(self) -> Checksum | None:
        table = self._root.table("checksum")
        if table is None:
            return None
        if self._framing.kind != "line":
            table.fail("belongs to line framing")
        kind = table.choice("kind", ("xor8", "sum8", "crc8", "crc16"))
        marker = table.octets("marker", "*", limit=1)
        if len(marker) != 1:
            table.fail("must be one character", "marker")
        required = table.flag("required", False)
        host = table.flag("host", True)
        table.done()
        kinds = cast(Literal["xor8", "sum8", "crc8", "crc16"], kind)
        return Checksum(kinds, marker, required, host)

    def _read_poll(self) -> Poll | None:
        table = self._root.table("poll")
        if table is None:
            return None
        request = table.octets("request", limit=80)
        if not request:
            table.fail("must not be empty", "request")
        timeout = table.number("timeout", 0.5, low=0.001, high=60.0)
        poll = Poll(
            request=request,
            links=self._some_links(table, "links"),
            timeout=timeout,
            period=table.number("period", 0.04, low=0.001, high=60.0),
            latency=table.number("latency", max(5.0, 2 * timeout), low=timeout, high=600.0),
        )
        table.done()
        return poll

    def _read_records(self) -> dict[str, RecordFormat]:
        records: dict[str, RecordFormat] = {}
        for name, table in self._root.named_tables("record").items():
            records[name] = self._read_record(name, table)
        if not records:
            self._root.fail("[record.NAME] is missing: at least one record is needed")
        return records

    def _read_record(self, name: str, table: TomlTable) -> RecordFormat:
        kind = table.choice("kind", ("position", "record", "in-position", "fault", "ignore"))
        text = table.string("pattern", limit=1000)
        try:
            pattern = compile_pattern(text)
        except PatternError as error:
            table.fail(plain(str(error), 120), "pattern")
        groups = set(pattern.groupindex)
        send = self._template(table, "send", groups) if table.has("send") else None
        faults: dict[str, dict[bytes, str]] = {}
        if fault_table := table.table("faults"):
            for group in fault_table.keys():  # noqa: SIM118 - a method of its own, not a dict
                inner = fault_table.table(group)
                if inner is None or group not in groups:
                    fault_table.fail(f"the pattern has no such group{_among(group, groups)}", group)
                faults[group] = {
                    self._bytes_key(inner, key): plain(inner.string(key), 120)
                    for key in inner.keys()  # noqa: SIM118
                }
            fault_table.done()
        unit_group, units = "", None
        if unit_table := table.table("units"):
            unit_group = unit_table.string("group")
            if unit_group not in groups:
                unit_table.fail(f"the pattern has no such group{_among(unit_group, groups)}")
            values = unit_table.table("mm")
            if values is None or not values.keys():
                unit_table.fail('"mm" is missing: millimetres by unit')
            units = {
                self._bytes_key(values, key): values.number(key, low=1e-9, high=1e6)
                for key in values.keys()  # noqa: SIM118
            }
            unit_table.done()
        constants: dict[str, bytes] = {}
        if constant_table := table.table("constants"):
            for key in constant_table.keys():  # noqa: SIM118
                if key not in groups:
                    constant_table.fail(f"the pattern has no such group{_among(key, groups)}", key)
                constants[key] = constant_table.octets(key)
        confirm = table.integer("confirm", 1, low=1, high=9)
        record = RecordFormat(
            name=name,
            kind=cast(Literal["position", "record", "in-position", "fault", "ignore"], kind),
            links=self._some_links(table, "link"),
            pattern=pattern,
            max_bytes=table.integer(
                "max_bytes", self._framing.max_bytes, low=1, high=self._framing.max_bytes
            ),
            faults=faults,
            unit_group=unit_group,
            units=units,
            send=send,
            constants=constants,
            confirm=confirm,
            confirm_within=table.number("confirm_within", 2.0, low=0.01, high=60.0),
        )
        table.done()
        return record

    @staticmethod
    def _bytes_key(table: TomlTable, key: str) -> bytes:
        try:
            return key.encode("latin-1")
        except UnicodeEncodeError:
            table.fail("holds a character that is not a single byte", key)

    @staticmethod
    def _template(table: TomlTable, key: str, names: set[str]) -> Template:
        try:
            template = parse_template(table.string(key, limit=300))
        except TemplateError as error:
            table.fail(plain(str(error), 120), key)
        for name in sorted(template.names - names):
            table.fail(f"{{{name}}} is unknown{nearest(name, sorted(names))}", key)
        return template

    def _read_axes(self) -> dict[str, AxisFormat]:
        axes: dict[str, AxisFormat] = {}
        taken: dict[tuple[str, str, str], str] = {}
        for name, table in self._root.named_tables("axis").items():
            axis = self._read_axis(name, table)
            for record in axis.records:
                key = (axis.link, record, axis.group)
                if key in taken:
                    table.fail(f'reads the same value as axis "{taken[key]}"', "group")
                taken[key] = name
            axes[name] = axis
        if not axes:
            self._root.fail("[axis.NAME] is missing: two or four axes are needed")
        return axes

    def _read_axis(self, name: str, table: TomlTable) -> AxisFormat:
        if name == "offset" or not re.fullmatch(r"[a-z][a-z0-9_]{0,30}", name):
            table.fail("an axis is named by lower case letters, digits and _, not offset")
        link = self._one_link(table)
        group = table.string("group", name)
        holding = [
            record.name
            for record in self._records.values()
            if link in record.links and group in record.groups
        ]
        records = table.strings("record", tuple(holding))
        for record_name in records:
            if record_name not in self._records:
                near = nearest(record_name, list(self._records))
                table.fail(f'no record "{plain(record_name, 120)}"{near}', "record")
            if record_name not in holding:
                table.fail(f'record "{record_name}" has no group "{plain(group, 120)}"', "group")
        if not records:
            every = set().union(*(record.groups for record in self._records.values()))
            near = nearest(group, sorted(every))
            table.fail(f'no record has the group "{plain(group, 120)}"{near}', "group")
        direction = table.integer("direction", 1, low=-1, high=1)
        if direction == 0:
            table.fail("must be 1 or -1", "direction")
        low, high = table.numbers("range", (2,))
        if low >= high:
            table.fail("must go from the smaller to the larger value", "range")
        encodings = ("decimal", "integer", "hex", "bits6", "bits7", "int-le", "int-be")
        encoding = table.choice("encoding", encodings, "decimal")
        scale = table.number("scale", 1.0, low=1e-9, high=1e6)
        count = _MICROMETRE if encoding == "decimal" else scale
        fastest = table.number("fastest", 0.0, low=0.0, high=1e6)
        axis = AxisFormat(
            name=name,
            link=link,
            records=records,
            group=group,
            encoding=cast(Encoding, encoding),
            scale=scale,
            direction=direction,
            low=low,
            high=high,
            incremental=table.flag("incremental", False),
            still=table.number("still", _COUNTS * count, low=0.0, high=10.0),
            fastest=fastest or None,
        )
        table.done()
        return axis

    def _check_records(self) -> None:
        """Check that a footswitch's message carries all axes or none, a position at least one."""
        for record in self._records.values():
            table = self._root.table("record")
            inner = table.table(record.name) if table else None
            if inner is None:
                continue
            carried = [axis.name for axis in self._axes.values() if record.name in axis.records]
            if record.kind == "position" and not carried:
                inner.fail("a position must carry at least one axis")
            if record.kind in ("record", "in-position") and 0 < len(carried) < len(self._axes):
                inner.fail("must carry all axes or none")
            if record.send is not None:
                known = {self._axes[name].group for name in carried}
                known |= _SPECIAL_GROUPS | set(record.constants or ())
                for name in sorted(record.send.names - known):
                    inner.fail(f"{{{name}}} is no axis and has no value in constants", "send")

    def _read_stage(self) -> Stage:
        names = tuple(self._axes)
        table = self._root.table("stage")
        if table is None:
            return self._straight_stage(1.0)
        mono = table.has("x") or table.has("y")
        straight = not (mono or any(table.has(key) for key in _LEFT_RIGHT))
        within = table.number("within", 1.0, low=0.001, high=60.0)
        if straight:
            table.done()
            return self._straight_stage(within)
        rows: list[dict[str, float]] = []
        for key in ("x", "y") if mono else _LEFT_RIGHT:
            row = table.table(key)
            if row is None:
                table.fail(f'"{key}" is missing')
            factors: dict[str, float] = {}
            for name in row.keys():  # noqa: SIM118
                if name != "offset" and name not in self._axes:
                    row.fail(f"no such axis{nearest(name, [*names, 'offset'])}", name)
                factors[name] = row.number(name, low=-1e6, high=1e6)
            rows.append(factors)
        table.done()
        if len(names) != len(rows):
            table.fail(f"needs {len(rows)} axes, there are {len(names)}")
        try:
            return _stage(mono, names, rows, within)
        except SingularError:
            table.fail("cannot be inverted: two coordinates depend on the same axes")

    def _straight_stage(self, within: float) -> Stage:
        names = tuple(self._axes)
        if set(names) == set(_LEFT_RIGHT):
            return _stage(False, names, [{name: 1.0} for name in _LEFT_RIGHT], within)
        if set(names) != {"x", "y"}:
            self._root.fail("[stage] has no map: the axes are neither xl, yl, xr, yr nor x, y")
        return _stage(True, names, [{"x": 1.0}, {"y": 1.0}], within)

    def _read_footswitches(self) -> dict[str, Footswitch]:
        switches: dict[str, Footswitch] = {}
        for name, table in self._root.named_tables("footswitch").items():
            source = table.choice("source", ("record", "every", "modem", "key"))
            record = group = line = link = ""
            value, edge, active, debounce = b"", False, True, 0.05
            release = 0.0
            if source == "record":
                record = table.choice("record", self._records)
                format_ = self._records[record]
                if format_.kind not in ("record", "position"):
                    table.fail("must be a record of kind record or position", "record")
                if table.has("group"):
                    group = table.choice("group", sorted(format_.groups))
                    value = table.octets("value")
                elif format_.kind == "position":
                    table.fail('"group" is missing: the position\'s group that tells the key')
                edge = table.flag("edge", False)
                release = table.number("release", 0.0, low=0.0, high=10.0)
            elif source == "modem":
                link = self._one_link(table)
                line = table.choice("line", ("cts", "dsr", "cd", "ri"))
                active = table.flag("active", True)
                debounce = table.number("debounce", 0.05, low=0.0, high=5.0)
            switches[name] = Footswitch(
                name=name,
                source=cast(Literal["record", "every", "modem", "key"], source),
                record=record,
                group=group,
                value=value,
                edge=edge,
                release=release or None,
                link=link,
                line=line,
                active=active,
                debounce=debounce,
            )
            table.done()
        return switches

    def _check_switched(self, switches: Mapping[str, Footswitch]) -> None:
        """Check that every footswitch's message has its footswitch."""
        named = {switch.record for switch in switches.values()}
        for record in self._records.values():
            if record.kind == "record" and record.name not in named:
                self._root.fail(
                    f'no [footswitch.NAME] names the record "{record.name}": nothing would record'
                )

    def _read_confirm(self, checksum: Checksum | None, switches: Mapping[str, Footswitch]) -> bool:
        """Read whether read-outs confirm a measurement: by default, where no checksum does."""
        safe = checksum is not None and checksum.required
        confirm = self._root.flag("confirm", not safe)
        if not confirm:
            return False
        positions = [r for r in self._records.values() if r.kind == "position"]
        if not positions:
            self._root.fail(
                "a measurement cannot be confirmed: no record tells positions besides", "confirm"
            )
        once = [record.name for record in positions if record.confirm == 1]
        if once and any(switch.source == "every" for switch in switches.values()):
            self._root.fail(
                f'every position is a measurement, none confirms it: "{once[0]}" needs confirm = 2',
                "confirm",
            )
        return True

    def _read_drive(self) -> Drive | None:
        table = self._root.table("drive")
        if table is None:
            return None
        link = self._one_link(table)
        command = self._template(table, "command", set(self._axes))
        if missing := sorted(set(self._axes) - command.names):
            table.fail(f"does not tell the axis {missing[0]}", "command")
        stop = self._template(table, "stop", set())
        in_position = table.choice("in_position", self._records)
        if self._records[in_position].kind != "in-position":
            table.fail("must be a record of kind in-position", "in_position")
        limits = {name: (axis.low, axis.high) for name, axis in self._axes.items()}
        if inner := table.table("limits"):
            for name in inner.keys():  # noqa: SIM118
                if name not in limits:
                    inner.fail(f"no such axis{nearest(name, list(limits))}", name)
                low, high = inner.numbers(name, (2,))
                axis = self._axes[name]
                if not axis.low <= low < high <= axis.high:
                    inner.fail("must lie within the axis' range", name)
                limits[name] = (low, high)
        terminator = table.octets("terminator", self._framing.terminator.decode("latin-1"), limit=4)
        table.done()
        return Drive(link, command, stop, terminator, in_position, limits)

    def _read_simulate(self, poll: Poll | None, switches: Mapping[str, Footswitch]) -> Simulate:
        pressed = any(
            switch.source == "every" or self._is_position(switch) for switch in switches.values()
        )
        usual = 0.0 if poll or pressed else 0.04
        table = self._root.table("simulate")
        if table is None:
            return Simulate(stream=usual or None)
        stream = table.number("stream", usual, low=0.0, high=60.0) or None
        simulate = Simulate(
            latency=table.number("latency", 0.0, low=0.0, high=60.0),
            byte_timing=table.flag("byte_timing", False),
            resolution_um=table.number("resolution_um", 1.0, low=1e-4, high=1000.0),
            noise_um=table.number("noise_um", 0.0, low=0.0, high=1000.0),
            backlash_um=table.number("backlash_um", 0.0, low=0.0, high=1000.0),
            speed=table.number("speed", 60.0, low=0.001, high=10000.0),
            stream=stream,
            hold=table.integer("hold", 3, low=1, high=100),
            hold_period=table.number("hold_period", 0.02, low=0.0, high=10.0),
            tells_release=table.flag("tells_release", True),
        )
        table.done()
        return simulate

    def _is_position(self, switch: Footswitch) -> bool:
        return switch.source == "record" and self._records[switch.record].kind == "position"

    def _read_examples(self, stage: Stage) -> tuple[Example, ...]:
        tables = self._root.tables("example")
        if not tables:
            self._root.fail("[[example]] is missing: at least one example is needed")
        if len(tables) > 100:
            self._root.fail("more than 100 tables", "example")
        return tuple(self._read_example(table, stage) for table in tables)

    def _read_example(self, table: TomlTable, stage: Stage) -> Example:
        link = self._one_link(table)
        if table.has("hex"):
            text = table.string("hex", limit=4096)
            try:
                data = bytes.fromhex(text)
            except ValueError:
                table.fail("must be pairs of hexadecimal digits", "hex")
        else:
            data = table.octets("bytes", limit=4096)
        meanings = []
        for inner in table.tables("means"):
            meanings.append(self._read_meaning(inner, 2 if stage.mono else 4))
        table.done()
        if not meanings:
            table.fail('"means" is missing: what the bytes mean')
        return Example(link, data, tuple(meanings))

    def _read_meaning(self, table: TomlTable, count: int) -> Meaning:
        kinds = ("position", "record", "in_position", "fault", "refused", "axes")
        given = [kind for kind in kinds if table.has(kind)]
        if not given:
            table.done()
        if len(given) != 1:
            table.fail(f"must be one of {', '.join(kinds)}")
        kind = given[0]
        meaning: Meaning
        if kind == "axes":
            values = table.table("axes")
            found: dict[str, float] = {}
            for name in values.keys() if values else ():
                if name not in self._axes:
                    table.fail(f"no such axis{nearest(name, list(self._axes))}", name)
                found[name] = values.number(name) if values else 0.0
            meaning = Meaning("axes", axes=found)
        elif kind in ("fault", "refused"):
            meaning = Meaning("fault" if kind == "fault" else "refused", text=table.string(kind))
        elif kind == "in_position" and table.raw(kind) is True:
            meaning = Meaning("in-position")
        else:
            position = table.numbers(kind, (count,))
            if kind == "record":
                number = table.integer("number", -1, low=-1, high=10**9)
                meaning = Meaning(
                    "record",
                    position=position,
                    switch=table.string("switch"),
                    number=None if number < 0 else number,
                )
            else:
                meaning = Meaning("position" if kind == "position" else "in-position", position)
        table.done()
        return meaning


def _among(word: str, groups: set[str]) -> str:
    return nearest(word, sorted(groups))


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
