"""What can be read of a damaged session comes into a new block, and what is missing is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from journaltools import append_event, events_of

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.journal import Journal, read_journal
from anaplot.exchange.recordline import encode_line
from anaplot.session.events import (
    DecidedRow,
    DecisionsTakenOver,
    ModelAccepted,
    ModelChosen,
    ModelReopened,
    MonoMeasured,
    PhotoLaid,
    PlannedPoint,
    PointAdded,
    PointMeasured,
    PointRenamed,
    ReasonGiven,
    Resumed,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.state import fold, start
from anaplot.station.replay import replay_session
from anaplot.station.salvage import salvage
from anaplot.station.station import Station

CORPUS = Path(__file__).parents[1] / "sessions"
SESSIONS = sorted(path.stem for path in CORPUS.glob("*.jsonl"))

BLOCK = """\
format = 1
name = "b"
[precision]
image_um = 5.0
[[camera]]
id = "c"
c = 150.0
format = [230.0, 230.0]
[[strip]]
id = "1"
photos = ["101", "102", "103"]
base = 92.0
[[photo]]
id = "101"
camera = "c"
[[photo]]
id = "102"
camera = "c"
[[photo]]
id = "103"
camera = "c"
"""


def planned(name: str, role: str = "new") -> PlannedPoint:
    return PlannedPoint(name, role, 1.0, 2.0, -91.0, 2.0)  # type: ignore[arg-type]


def measured(left: str, right: str, name: str) -> PointMeasured:
    return PointMeasured(left, right, name, 1.0, 2.0, -91.0, 2.0, "key")


def chosen(left: str, right: str, *points: PlannedPoint) -> ModelChosen:
    return ModelChosen("1", left, right, points, False)


def rejected(name: str) -> DecidedRow:
    return DecidedRow("101", "102", name, "y", False, "tau")


FIRST = chosen("101", "102", planned("1"), planned("2"), planned("3"))
SECOND = chosen("102", "103", planned("2", "tie"), planned("3", "tie"), planned("4"))
ACCEPTED = ModelAccepted("101", "102")


class Session:
    """A block whose journal holds given events, one a line behind the header."""

    def __init__(self, tmp_path: Path, *events) -> None:
        self.folder = tmp_path / "block"
        self.folder.mkdir()
        (self.folder / "block.toml").write_text(BLOCK)
        with Journal.open(self.folder, {"block_toml": BLOCK})[0] as journal:
            for event in events:
                append_event(journal, event)
        self.path = self.folder / "sessions" / "0001.jsonl"
        self.new = tmp_path / "new"

    def damage(self, *events: int) -> None:
        """Change a letter in the lines of these events, from 0."""
        lines = self.path.read_bytes().splitlines(keepends=True)
        for event in events:
            lines[event + 1] = lines[event + 1].replace(b'"t":"20', b'"t":"19')
        self.path.write_bytes(b"".join(lines))

    def salvaged(self):
        before = self.path.read_bytes()
        with pytest.raises(InputError, match=r"damaged: .*--salvage"):
            read_journal(self.folder)
        out = salvage(self.folder, self.new)
        assert self.path.read_bytes() == before
        events = events_of(read_journal(self.new).records)
        assert fold(start(read_block(self.new)), events) == out.state
        return out


@pytest.mark.parametrize("name", SESSIONS)
def test_a_session_without_damage_comes_over_whole(name, tmp_path, capsys):
    session, new = CORPUS / f"{name}.jsonl", tmp_path / "new"
    assert main(["replay", str(session), "--salvage", str(new)]) == 0
    said = capsys.readouterr().out.splitlines()
    if name == "torn-tail":
        assert [line.partition(":")[0] for line in said[1:]] == ["missing"]
    else:
        assert said[1:] == ["nothing is missing"]
    old, brought = read_journal(session).records, read_journal(new).records
    assert [(r.seq, r.time, r.kind, r.payload) for r in brought] == [
        (r.seq, r.time, r.kind, r.payload) for r in old
    ]
    was, now = replay_session(session), replay_session(new)
    assert now.differences == ()
    assert (now.state, now.tables, now.measurements) == (was.state, was.tables, was.measurements)


def test_a_lost_measurement_is_told_and_the_rest_is_there(tmp_path, capsys):
    points = [measured("101", "102", name) for name in "123"]
    session = Session(tmp_path, FIRST, *points)
    session.damage(2)
    out = session.salvaged()
    assert out.state.current is not None
    assert [m.point for m in out.state.current.measured] == ["1", "3"]
    assert [str(gap) for gap in out.gaps] == [
        f"{session.path} line 4: the checksum does not agree: record 4 missing"
    ]
    assert (out.records, out.left_out, out.assumed) == (4, (), ())
    # the session goes on there
    station = Station(session.new)
    station.close()
    assert station.state.current == out.state.current
    other = tmp_path / "other"
    assert main(["replay", str(session.folder), "--salvage", str(other), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said == {
        "records": 4,
        "models": [],
        "in_work": "101/102",
        "missing": [
            {
                "file": str(session.path),
                "first_line": 4,
                "last_line": 4,
                "first_seq": 4,
                "last_seq": 4,
                "why": "the checksum does not agree",
            }
        ],
        "left_out": [],
        "assumed": [],
        "lacking": None,
    }


def test_a_model_that_is_not_known_to_be_accepted_was_when_the_next_was_begun(tmp_path):
    first = [measured("101", "102", name) for name in "123"]
    second = [measured("102", "103", name) for name in "24"]
    session = Session(tmp_path, FIRST, *first, ACCEPTED, SECOND, *second)
    session.damage(2, 4)  # point 2 and the acceptance
    out = session.salvaged()
    assert [m.name for m in out.state.models] == ["101/102"]
    assert out.state.current is not None
    assert [(p.point, p.role) for p in out.state.current.plan] == [
        ("2", "new"),
        ("3", "tie"),
        ("4", "new"),
    ]
    assert [m.point for m in out.state.current.measured] == ["2", "4"]
    assert [words.partition("line 7: ")[2] for words in out.assumed] == [
        "model 101/102 was accepted",
        "model 102/103: no ties, but new points: 2",
    ]
    assert [row.point for row in read_block(session.new).image_points if row.photo == "101"] == [
        "1",
        "3",
    ]


RETURN = ModelReopened("101", "102", point="1")
AGAIN = PointMeasured("101", "102", "1", 1.5, 2.0, -91.0, 2.0, "key")
HALF = [FIRST, *(measured("101", "102", name) for name in "123"), ACCEPTED, SECOND]


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        (6, ["model 101/102 was returned to"]),
        (8, ["model 101/102 was accepted"]),
    ],
)
def test_a_return_of_which_one_end_is_lost_is_assumed(tmp_path, lost, words):
    after = measured("102", "103", "2")
    session = Session(tmp_path, *HALF, RETURN, AGAIN, ACCEPTED, after)
    session.damage(lost)
    out = session.salvaged()
    assert [one.partition(": ")[2] for one in out.assumed] == words
    assert out.left_out == ()
    assert [m.name for m in out.state.models] == ["101/102"]
    assert out.state.models[0].measured[0].xl == 1.5
    assert out.state.current is not None
    assert [m.point for m in out.state.current.measured] == ["2"]


def test_a_model_that_was_returned_to_had_been_accepted(tmp_path):
    session = Session(tmp_path, *HALF[:5], RETURN, AGAIN, ACCEPTED)
    session.damage(4)
    out = session.salvaged()
    assert [one.partition(": ")[2] for one in out.assumed] == ["model 101/102 was accepted"]
    assert [m.name for m in out.state.models] == ["101/102"]
    assert out.state.models[0].measured[0].times == 2


def test_an_undo_takes_back_nothing_that_may_be_another_thing(tmp_path):
    one, two = measured("101", "102", "1"), measured("101", "102", "2")
    session = Session(tmp_path, FIRST, one, two, Undone(), one, Undone())
    session.damage(2)
    out = session.salvaged()
    assert out.state.current is not None
    assert [m.point for m in out.state.current.measured] == ["1"]
    assert out.state.current.measured[0].times == 1
    assert [words.partition("line 5: ")[2] for words in out.left_out] == [
        "an undo, of what is missing perhaps"
    ]


def test_a_reason_for_something_lost_is_given_for_nothing_else(tmp_path):
    points = [measured("101", "102", name) for name in "12"]
    off = [RowSwitched(name, "y", False) for name in "12"]
    given = ReasonGiven("pointing")
    session = Session(tmp_path, FIRST, *points, off[0], off[1], given, off[0], given)
    session.damage(4)
    out = session.salvaged()
    assert [(r.point, r.reason) for r in out.state.reasons] == [("1", "pointing")]
    assert [words.partition("line 7: ")[2] for words in out.left_out] == [
        "a reason, for what is missing perhaps"
    ]


def test_what_rests_on_something_lost_is_left_out_or_assumed(tmp_path):
    session = Session(
        tmp_path,
        FIRST,
        measured("101", "102", "1"),
        RowSwitched("1", None, False),
        PointAdded(planned("9")),
        RowSwitched("9", None, False),
        Suspended(),
        Resumed(),
        measured("101", "102", "2"),
        measured("101", "102", "3"),
    )
    session.damage(1, 3, 6)
    out = session.salvaged()
    assert out.state.current is not None
    assert [m.point for m in out.state.current.measured] == ["2", "3"]
    # nobody is to measure again what was off
    assert out.state.current.pending == ()
    assert not out.state.suspended
    assert [words.partition("line 6: ")[2] for words in out.left_out] == [
        "row-switched: point 9 is not measured in model 101/102"
    ]
    assert [words.partition("line 9: ")[2] for words in out.assumed] == ["work was resumed"]


def mono_day() -> list[object]:
    """Two models in a comparator; the right photo of the first stays for the second."""
    first = ModelChosen("1", "101", "102", (planned("1"), planned("2")), mono=True)
    second = ModelChosen("1", "102", "103", (planned("1", "tie"), planned("3")), mono=True)

    def seen(left: str, right: str, side: str, *names: str) -> list[object]:
        return [MonoMeasured(left, right, side, name, 3.0, 4.0, "key") for name in names]

    return [
        first,
        PhotoLaid("101"),
        *seen("101", "102", "left", "1", "2"),
        PhotoLaid("102"),
        *seen("101", "102", "right", "1", "2"),
        ModelAccepted("101", "102"),
        second,
        *seen("102", "103", "left", "3"),
        PhotoLaid("103"),
        *seen("102", "103", "right", "1", "3"),
    ]


@pytest.mark.parametrize(
    ("lost", "assumed"),
    [
        (1, ["photo 101 was laid in"]),
        (4, ["photo 102 was laid in"]),
        (
            8,
            [
                "model 102/103 was begun",
                "point 3 was added to model 102/103",
                "point 1 was added to model 102/103",
            ],
        ),
    ],
)
def test_what_is_lost_of_a_comparators_session_costs_no_measurement(tmp_path, lost, assumed):
    session = Session(tmp_path, *mono_day())
    session.damage(lost)
    out = session.salvaged()
    first, second = out.state.models[0], out.state.current
    assert [(s.side, s.point) for s in first.seen] == [
        ("left", "1"), ("left", "2"), ("right", "1"), ("right", "2"),
    ]  # fmt: skip
    assert {(s.side, s.point) for s in second.seen} >= {
        ("left", "3"),
        ("right", "1"),
        ("right", "3"),
    }
    assert [words.partition(": ")[2] for words in out.assumed] == assumed
    assert out.left_out == ()


def test_a_name_given_after_something_lost_is_given_still(tmp_path):
    points = [measured("101", "102", name) for name in "123"]
    tie = PointRenamed("102", "103", "5", "3", None, "tie")
    second = chosen("102", "103", planned("2", "tie"), planned("5"))
    five = measured("102", "103", "5")
    session = Session(
        tmp_path, FIRST, *points, PointRenamed("101", "102", "1", "9"), ACCEPTED, second, five, tie
    )
    # that the model was accepted, and the point that was a tie
    session.damage(3, 5)
    out = session.salvaged()
    assert [m.point for m in out.state.models[0].measured] == ["9", "2"]
    assert out.state.current is not None
    assert [(p.point, p.role) for p in out.state.current.plan] == [("2", "tie"), ("3", "new")]
    assert out.left_out == ()
    assert [words.partition("line ")[2] for words in out.assumed] == [
        "8: model 101/102 was accepted",
        "10: model 102/103: no ties, but new points: 3",
    ]


def test_a_name_that_is_a_tie_since_something_is_lost_is_told_so(tmp_path):
    points = [measured("101", "102", name) for name in "123"]
    off = RowSwitched("3", None, False)
    second = chosen("102", "103", planned("2", "tie"), planned("5"), planned("6"))
    five, six = (measured("102", "103", name) for name in "56")
    session = Session(
        tmp_path,
        FIRST,
        *points,
        off,
        ACCEPTED,
        second,
        five,
        PointRenamed("102", "103", "5", "3", None, "new"),
        six,
        PointRenamed("102", "103", "6", "3", None, "new"),
    )
    session.damage(4)
    out = session.salvaged()
    assert out.state.current is not None
    assert [(p.point, p.role) for p in out.state.current.plan] == [
        ("2", "tie"),
        ("3", "tie"),
        ("6", "new"),
    ]
    # exchanged then with what has a role there already
    assert [words.partition("line ")[2] for words in out.assumed] == [
        "10: model 102/103: ties, of the model before: 3"
    ]


def test_decisions_taken_over_while_work_is_suspended_resume_nothing(tmp_path):
    points = [measured("101", "102", name) for name in "123"]
    taken = DecisionsTakenOver((rejected("2"),))
    session = Session(tmp_path, FIRST, *points, ACCEPTED, Suspended(), taken, Resumed())
    session.damage(1)
    out = session.salvaged()
    assert (out.left_out, out.assumed) == ((), ())
    assert out.state.models[0].off == {("2", "y")}
    assert not out.state.suspended


@pytest.mark.parametrize("lost", [(), (4,)])
def test_decisions_taken_over_that_fit_still_come_over(tmp_path, lost):
    points = [measured("101", "102", name) for name in "123"]
    taken = DecisionsTakenOver((rejected("1"), rejected("2"), rejected("3")))
    session = Session(tmp_path, FIRST, *points, ACCEPTED, taken, Undone(), taken)
    session.damage(1, *lost)
    out = session.salvaged()
    assert out.state.models[0].off == {("2", "y"), ("3", "y")}
    assert {row.point for row in out.state.reasons} == {"2", "3"}
    assert [words.partition("jsonl ")[2] for words in out.left_out] == [
        f"line {line}: decisions-taken-over: what does not fit: 101/102 1 y" for line in (7, 9)
    ]
    assert [words.partition("jsonl ")[2] for words in out.assumed] == [
        "line 7: model 101/102 was accepted" for _ in lost
    ]


def test_decisions_of_which_none_fits_are_left_out(tmp_path):
    points = [measured("101", "102", name) for name in "123"]
    taken = DecisionsTakenOver((rejected("1"),))
    session = Session(tmp_path, FIRST, *points, ACCEPTED, taken)
    session.damage(1)
    out = session.salvaged()
    assert out.state.models[0].off == frozenset()
    assert [words.partition("line 7: ")[2] for words in out.left_out] == [
        "decisions-taken-over: model 101/102 has no row y of point 1"
    ]


def test_a_point_whose_plan_is_lost_was_planned(tmp_path):
    session = Session(tmp_path, FIRST)
    with Journal.open(session.folder, {})[0] as journal:  # line 3: opened
        journal.append("point-added", {"planned": {"lost": True}}, durable=True)
        append_event(journal, measured("101", "102", "7"))
    out = salvage(session.folder, session.new)
    assert out.state.current is not None
    assert [m.point for m in out.state.current.measured] == []
    assert len(out.left_out) == 2
    session.new = tmp_path / "newer"
    session.damage(2)
    out = session.salvaged()
    assert out.state.current is not None
    assert [m.point for m in out.state.current.measured] == ["7"]
    assert out.assumed[0].endswith("line 5: point 7 was added to model 101/102")


@pytest.mark.parametrize("line", [0, 1, 20, 55])
@pytest.mark.parametrize("damage", ["zeros", "cut", "letters"])
def test_damage_anywhere_in_a_recorded_session(tmp_path, line, damage):
    lines = (CORPUS / "changes.jsonl").read_bytes().splitlines(keepends=True)
    block = tmp_path / "old"
    sessions = block / "sessions"
    sessions.mkdir(parents=True)
    whole = salvage(CORPUS / "changes.jsonl", tmp_path / "whole")
    (block / "block.toml").write_bytes((tmp_path / "whole" / "block.toml").read_bytes())
    for camera in (tmp_path / "whole").glob("*.toml"):
        (block / camera.name).write_bytes(camera.read_bytes())
    lines[line] = {
        "zeros": b"\0" * len(lines[line]),
        "cut": b"",
        "letters": lines[line][:40] + b"\x1b[2J\xff" + lines[line][40:],
    }[damage]
    (sessions / "0001.jsonl").write_bytes(b"".join(lines))
    out = salvage(block, tmp_path / "new")
    assert len(out.gaps) == 1
    assert (out.gaps[0].first_seq, out.gaps[0].last_seq) == (line + 1, line + 1)
    assert str(out.gaps[0]).isprintable()
    # what is not brought over is told: line by line
    assert out.records == len(lines) - 1 - len(out.left_out)
    assert whole.records >= out.records
    assert fold(
        start(read_block(tmp_path / "new")), events_of(read_journal(tmp_path / "new").records)
    )
    Station(tmp_path / "new").close()


def test_a_missing_file_and_a_second_one_that_is_damaged(tmp_path):
    folder = tmp_path / "block"
    folder.mkdir()
    (folder / "block.toml").write_text(BLOCK)
    with Journal.open(folder, {"block_toml": BLOCK}, roll_bytes=1)[0] as journal:
        for event in (FIRST, *(measured("101", "102", name) for name in "123")):
            append_event(journal, event)
    sessions = folder / "sessions"
    (sessions / "0003.jsonl").unlink()
    damaged = sessions / "0004.jsonl"
    damaged.write_bytes(damaged.read_bytes().replace(b'"kind":"header"', b'"kind":"headex"'))
    out = salvage(folder, tmp_path / "new")
    assert [str(gap).removeprefix(f"{sessions}/") for gap in out.gaps] == [
        "0003.jsonl: the file is missing",
        "0004.jsonl line 1: the checksum does not agree: records 4 to 6 missing",
    ]
    assert out.state.current is not None
    assert [m.point for m in out.state.current.measured] == ["2", "3"]
    new = read_journal(tmp_path / "new").records
    assert [r.seq for r in new] == list(range(1, len(new) + 1))


def test_records_that_come_twice_are_taken_once(tmp_path):
    session = Session(tmp_path, FIRST, measured("101", "102", "1"))
    session.path.write_bytes(session.path.read_bytes() * 2)
    out = salvage(session.folder, session.new)
    assert out.records == 3
    assert [gap.why for gap in out.gaps] == ["record 1 where 4 should follow"]


def test_what_cannot_be_salvaged(tmp_path, capsys):
    with pytest.raises(InputError, match="no such journal"):
        salvage(tmp_path / "nowhere", tmp_path / "new")
    (tmp_path / "junk.jsonl").write_bytes(b"\0" * 3_000_000 + b"\nmore\n")
    with pytest.raises(InputError, match="no record of a journal can be read"):
        salvage(tmp_path / "junk.jsonl", tmp_path / "new")
    line = encode_line(1, "2026-01-01T00:00:00.000Z", "header", {"format": 2})
    (tmp_path / "newer.jsonl").write_bytes(line + b"junk\n")
    with pytest.raises(InputError, match="written by a newer version"):
        salvage(tmp_path / "newer.jsonl", tmp_path / "new")
    assert not (tmp_path / "new").exists()
    session = Session(tmp_path, FIRST)
    with pytest.raises(InputError, match="there is a session already"):
        salvage(session.folder, session.folder)
    old, new = str(session.folder), str(session.new)
    assert main(["replay", old, "--salvage", new, "--check"]) == 2
    assert "--salvage and --check exclude each other" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["fiducials", "changes"])
def test_no_lost_record_takes_measurements_with_it(name, tmp_path):
    """Every measurement says where it belongs: no other record is worth more than itself."""

    def places(path, without=None):
        return [
            (r.kind, r.payload)
            for r in read_journal(path).records
            if r.kind.endswith("-measured") and r.line != without
        ]

    lines = (CORPUS / f"{name}.jsonl").read_bytes().splitlines(keepends=True)
    structure = "model-chosen", "model-accepted", "model-reopened", "inner-accepted"
    kinds = [f'"kind":"{kind}"'.encode() for kind in structure]
    hit = [k for k, line in enumerate(lines) if any(kind in line for kind in kinds)]
    assert len(hit) > 3
    hit += [k for k, line in enumerate(lines) if b'-measured"' in line][::7]
    for k in hit:
        old, new = tmp_path / f"old{k}.jsonl", tmp_path / f"new{k}"
        old.write_bytes(b"".join([*lines[:k], b"#" + lines[k][1:], *lines[k + 1 :]]))
        out = salvage(old, new)
        assert places(new) == places(CORPUS / f"{name}.jsonl", without=k + 1), out.left_out


def test_rows_of_the_old_file_that_are_not_brought_over_are_told(tmp_path, capsys):
    session = Session(tmp_path, FIRST, measured("101", "102", "1"), measured("101", "102", "2"))
    session.damage(2)
    old = "photo,point,x,y\n101,1,1,2\n101,9,1,2\n102,9,1,2\n"  # that of 1 is in work
    (session.folder / "image_points.csv").write_text(old)
    assert main(["replay", str(session.folder), "--salvage", str(session.new)]) == 0
    assert "image_points.csv: 2 of its 3 rows are not in the new block" in capsys.readouterr().out
