"""Identical polls in the journal: one entry a run, whole where anything happens."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.station.idlepolls import SAME, Item, folded, recent_part
from anaplot.station.journaling import Recorder


def poll(at: float, answer: str = "1", links: tuple[str, ...] = ("a",)) -> list[Item]:
    asked = [("out", link, "?", at) for link in links]
    # answers come in pieces
    return [*asked, *(("in", link, p, at + 0.01) for link in links for p in (answer, "\n"))]


def polls(answers: str, step: float = 0.1, links: tuple[str, ...] = ("a",)) -> list[Item]:
    return [item for k, answer in enumerate(answers) for item in poll(k * step, answer, links)]


def told(items: list[Item]) -> str:
    """Return what was answered poll by poll, runs written out."""
    out = ""
    for kind, link, text, _ in items:
        if kind == SAME:
            out += out[-1] * int(link)
        elif kind == "in" and text != "\n":
            out += text
    return out


def test_a_run_is_one_entry() -> None:
    items = polls("1" * 100)
    found = folded(items, 8.0)
    kinds = [item[0] for item in found]
    assert kinds[:4] == ["out", "in", "in", SAME]
    assert kinds.count(SAME) == 1
    assert told(found) == "1" * 100
    # the first is whole, and all that came later
    _, count, times, when = found[3]
    assert int(count) == 79
    assert [float(time) for time in times.split()] == pytest.approx([0.1, 0.11, 7.9, 7.91])
    assert when == pytest.approx(0.1)
    assert found[4:] == items[3 * 80 :]


def test_folding_may_go_on() -> None:
    items = polls("1" * 40)
    once = folded(items, 4.0)
    step = folded(folded(items[:60], 1.5) + items[60:], 4.0)
    assert once == step


@given(st.text("123", max_size=60), st.floats(0.0, 7.0), st.sampled_from([("a",), ("a", "b")]))
def test_nothing_is_lost(answers: str, before: float, links: tuple[str, ...]) -> None:
    items = polls(answers, links=links)
    found = folded(items, before)
    assert told([i for i in found if i[1] == "a" or i[0] == SAME]) == answers
    assert [i for i in found if i[3] >= before] == [i for i in items if i[3] >= before]
    assert found[: len(poll(0.0, links=links))] == items[: len(poll(0.0, links=links))]
    # with nothing in between the same again
    assert folded(found, before) == found
    at = recent_part(found, before)
    assert all(item[3] < before for item in found[:at])


def test_what_is_no_whole_poll_stays() -> None:
    press: Item = ("decoder", "press", "key", 0.55)
    items = polls("11111")
    for strange in (
        [press],
        [("in", "a", "1", 0.55)],  # unasked
        [("out", "a", "?", 0.55)],  # unanswered
        [("out", "a", "?", 0.55), ("in", "b", "1", 0.56)],  # answered by another
        [("lost", "a", "5 bytes", 0.55)],
    ):
        after = [(k, link, text, when + 1.0) for k, link, text, when in polls("11111")]
        found = folded([*items, *strange, *after], 9.0)
        assert [item for item in found if item in strange] == strange
        at = found.index(strange[0])
        # an answer that nobody asked for may belong to the poll before it
        assert SAME in [item[0] for item in found[at - 4 : at]]
        # the poll after it is whole
        assert found[at + len(strange)][0] == "out"


def test_the_last_poll_may_not_be_answered_yet() -> None:
    items = polls("1111")
    assert folded(items, 9.0)[-3:] == items[-3:]


class _Journal:
    def __init__(self) -> None:
        self.written: list[tuple[str, dict]] = []

    def append_many(self, records, *, durable: bool) -> None:  # type: ignore[no-untyped-def]
        self.written += json.loads(json.dumps(list(records)))


class _Clock:
    now = 1000.0

    def __call__(self) -> float:
        return self.now


def idle(recorder: Recorder, clock: _Clock, seconds: float, answer: bytes = b"+1.0\r\n") -> None:
    for _ in range(int(seconds / 0.04)):
        clock.now += 0.04
        recorder.traffic("out", "main", b"\x02", clock.now)
        recorder.traffic("in", "main", answer, clock.now)


def test_an_idle_line_takes_a_hundredth() -> None:
    clock, journal = _Clock(), _Journal()
    recorder = Recorder(journal, clock)  # type: ignore[arg-type]
    idle(recorder, clock, 600.0)
    size = sum(len(json.dumps(record)) for record in journal.written)
    assert size < 600 * 20  # bytes; whole it is 1.2 million
    counts = [
        1 if item[0] == "out" else int(item[1])
        for _, payload in journal.written
        for item in payload["items"]
        if item[0] in ("out", SAME)
    ]
    # all but those of the last moments, which wait
    assert 15_000 - 25 * 65 <= sum(counts) <= 15_000
    recorder.flush()
    items = [item for _, payload in journal.written for item in payload["items"]]
    assert sum(1 if i[0] == "out" else int(i[1]) for i in items if i[0] in ("out", SAME)) == 15_000


def test_before_and_after_a_press_everything_is_whole() -> None:
    clock, journal = _Clock(), _Journal()
    recorder = Recorder(journal, clock)  # type: ignore[arg-type]
    idle(recorder, clock, 30.0)
    recorder.told("press", "key", clock.now)
    idle(recorder, clock, 0.5)
    recorder.note("table", {})
    items = [item for kind, said in journal.written if kind == "traffic" for item in said["items"]]
    at = items.index(["decoder", "press", "key", pytest.approx(30.0)])
    before = [item for item in items[:at] if item[0] == "out" and item[3] >= 30.0 - 2.0]
    assert len(before) >= 45
    assert all(item[0] != SAME for item in items[at:])
    assert len([item for item in items[at:] if item[0] == "out"]) == 12


def test_a_line_that_says_something_is_written_every_second() -> None:
    clock, journal = _Clock(), _Journal()
    recorder = Recorder(journal, clock)  # type: ignore[arg-type]
    for k in range(100):
        idle(recorder, clock, 0.04, f"+{k}.0\r\n".encode())
    assert len(journal.written) >= 2
    assert all(item[0] != SAME for _, payload in journal.written for item in payload["items"])
