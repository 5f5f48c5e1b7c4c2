"""The polling policy by itself: no ports, no threads, times as they are written down."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.plotter.poller import Poller
from anaplot.plotter.schema import Poll

ONE = Poll(b"?", ("main",), timeout=0.5, period=0.04, latency=5.0)
TWO = Poll(b"?", ("x", "y"), timeout=0.5, period=0.1, latency=5.0)


def ask(poller: Poller, poll: Poll, now: float) -> int:
    assert poller.wait(now) == 0.0
    poller.begin(now)
    for link in poll.links:
        poller.sent(link, now)
    return poller.cycle


def test_answers_belong_to_requests_first_in_first_out():
    poller = Poller(ONE)
    assert ask(poller, ONE, 0.0) == 1
    assert poller.wait(0.01) == pytest.approx(0.49)
    # no answer in time: asked again, and the first one is owed all the same
    assert ask(poller, ONE, 0.51) == 2
    assert poller.owed("main") == 2
    assert poller.answered("main", 0.60).cycle == 1
    assert poller.answered("main", 0.61).cycle == 2
    assert poller.answered("main", 0.62) is None


def test_a_device_that_answers_is_asked_at_its_period_or_at_once():
    poller = Poller(ONE)
    ask(poller, ONE, 0.0)
    assert poller.answered("main", 0.01).cycle == 1
    assert poller.wait(0.01) == pytest.approx(0.03)
    poller.urge()
    assert poller.wait(0.01) == 0.0
    # not into bytes that are still coming: what comes twice is noticed before the next request
    poller.bytes_came(0.01)
    assert poller.wait(0.015) == pytest.approx(0.015)
    assert poller.wait(0.04) == 0.0


def test_behind_a_record_that_nobody_asked_for_the_line_need_not_be_quiet():
    poller = Poller(ONE)
    ask(poller, ONE, 0.0)
    poller.bytes_came(0.01)
    poller.answered("main", 0.01)
    poller.records_came(unasked=False)
    poller.urge()
    assert poller.wait(0.012) == pytest.approx(0.018)
    # begun, and not known what it is
    poller.bytes_came(0.013)
    assert poller.wait(0.013) == pytest.approx(0.02)
    poller.bytes_came(0.014)
    poller.records_came(unasked=True)
    assert poller.wait(0.014) == 0.0


def test_of_several_lines_another_one_may_still_repeat_an_answer():
    poller = Poller(TWO)
    ask(poller, TWO, 0.0)
    for link in TWO.links:
        poller.bytes_came(0.1)
        poller.answered(link, 0.1)
        poller.records_came(unasked=False)
    poller.bytes_came(0.115)
    poller.records_came(unasked=True)
    poller.urge()
    assert poller.wait(0.115) == pytest.approx(0.005)


def test_late_answers_are_waited_for_before_more_is_asked():
    poller = Poller(ONE)
    now = 0.0
    for _ in range(4):
        ask(poller, ONE, now)
        now += 0.5
    assert poller.answered("main", now).cycle == 1
    # three are owed: no further request until they have come, or cannot come any more
    assert poller.wait(now) == pytest.approx(1.5 + 5.0 - now)
    for cycle in (2, 3, 4):
        assert poller.answered("main", now).cycle == cycle
    assert poller.wait(now) == 0.0


def test_what_was_lost_is_owed_until_it_cannot_come_any_more():
    poller = Poller(ONE)
    ask(poller, ONE, 0.0)
    ask(poller, ONE, 0.5)
    # the answer to the first is lost; the one to the second looks older than it is
    assert poller.answered("main", 0.6).cycle == 1
    assert poller.owed("main") == 1
    # which costs one request more, and no pause
    ask(poller, ONE, 0.6)
    assert poller.answered("main", 0.61).cycle == 2
    poller.wait(5.7)
    assert poller.owed("main") == 0


def test_where_much_was_lost_the_line_is_left_alone_until_it_is_known_what():
    poller = Poller(ONE)
    for at in range(4):
        ask(poller, ONE, 0.5 * at)
    assert poller.answered("main", 1.6).cycle == 1
    assert poller.settling
    assert poller.wait(1.6) == pytest.approx(4.9)
    # whoever waits for an answer is served meanwhile, one behind the other
    poller.urge()
    assert ask(poller, ONE, 1.7) == 5
    assert poller.answered("main", 1.8).cycle == 2
    assert poller.wait(6.71) == 0.0
    assert poller.owed("main") == 0
    assert not poller.settling


def test_a_cycle_is_answered_when_every_link_has_answered():
    poller = Poller(TWO)
    ask(poller, TWO, 0.0)
    assert poller.answered("x", 0.01).cycle == 1
    assert poller.wait(0.2) == pytest.approx(0.3)
    assert poller.answered("y", 0.2).cycle == 1
    assert poller.wait(0.3) == 0.0


def test_what_is_owed_survives_a_new_opening_of_the_line():
    poller = Poller(ONE)
    ask(poller, ONE, 0.0)
    poller.restart()
    assert ask(poller, ONE, 0.1) == 2
    assert poller.answered("main", 0.2).cycle == 1


def test_a_line_that_is_never_quiet_is_asked_all_the_same():
    poller = Poller(ONE)
    ask(poller, ONE, 0.0)
    for at in range(1, 300):
        poller.bytes_came(at / 100)
        if poller.wait(at / 100) == 0.0:
            break
    assert at / 100 == pytest.approx(4 * ONE.timeout)


@pytest.mark.slow
@given(
    seed=st.integers(0, 10**6),
    lost=st.floats(0.0, 0.5),
    slow=st.floats(0.0, 4.9),
    hiccup=st.floats(0.0, 0.3),
)
def test_no_answer_ever_looks_younger_than_it_is(seed, lost, slow, hiccup):
    """Answers in order, none later than the latency, any of them lost."""
    rng = random.Random(seed)
    poller = Poller(ONE)
    coming: list[tuple[float, int]] = []  # when, and which
    now, last = 0.0, 0.0
    while now < 30.0:
        while coming and coming[0][0] <= now:
            when, cycle = coming.pop(0)
            taken = poller.answered("main", when)
            assert taken is not None
            assert taken.cycle <= cycle
        if poller.wait(now) == 0.0:
            poller.begin(now)
            poller.sent("main", now)
            if rng.random() >= lost:
                delay = slow if rng.random() < hiccup else 0.003
                last = max(last, min(now + delay, now + ONE.latency))
                coming.append((last, poller.cycle))
        now += 0.01
    assert poller.cycle > 4


def test_who_waits_is_served_until_too_many_answers_are_owed():
    poller = Poller(ONE)
    for at in range(12):
        poller.begin(0.1 * at)
        poller.sent("main", 0.1 * at)
    for owed in range(11, 7, -1):
        assert poller.answered("main", 1.2).cycle == 12 - owed
        poller.urge()
        # more than eight behind, whoever waits has to wait
        assert poller.settling == (owed > 8)


def test_a_line_opened_anew_is_asked_at_once_whatever_is_owed():
    poller = Poller(ONE)
    for at in range(4):
        ask(poller, ONE, 0.5 * at)
    poller.answered("main", 1.6)
    assert poller.settling
    poller.restart()
    assert not poller.settling
    assert ask(poller, ONE, 1.61) == 5
    assert poller.wait(1.7) == pytest.approx(1.61 + 0.5 - 1.7)


def test_an_answer_may_come_as_late_as_the_latency():
    poller = Poller(ONE)
    ask(poller, ONE, 0.0)
    assert poller.answered("main", 5.0).cycle == 1
    ask(poller, ONE, 6.0)
    assert poller.answered("main", 11.1) is None
