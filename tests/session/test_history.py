"""What an undo brings back: as a tuple of which the end is kept, and every version for itself."""

from __future__ import annotations

import copy
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.session.history import History


@pytest.mark.slow
@given(
    st.integers(1, 4),
    st.lists(st.tuples(st.integers(0, 40), st.none() | st.integers(0, 9)), max_size=40),
)
def test_it_is_a_tuple_of_which_the_youngest_are_kept(
    most: int, steps: list[tuple[int, int | None]]
) -> None:
    """From any version there was: None takes one away, a number is added."""
    found: list[tuple[History[int], tuple[int, ...]]] = [(History(), ())]
    for at, step in steps:
        history, kept = found[at % len(found)]
        if step is not None:
            found.append((history.pushed(step, most), (*kept, step)[-most:]))
        elif kept:
            youngest, before = history.popped()
            assert youngest == kept[-1]
            found.append((before, kept[:-1]))
        else:
            with pytest.raises(IndexError):
                history.popped()
    for history, kept in found:
        assert tuple(history) == kept
        assert len(history) == len(kept)
        assert bool(history) == bool(kept)
        assert history == History(kept)
        assert hash(history) == hash(History(kept))
    assert len({history for history, _ in found}) == len({kept for _, kept in found})


def test_a_long_one_holds_no_more_than_twice_what_it_remembers() -> None:
    history: History[object] = History()
    moments = [object() for _ in range(500)]
    for moment in moments:
        history = history.pushed(moment, 50)
    held, link = 0, history._last
    while link is not None:
        held, link = held + 1, link[1]
    assert 50 <= held <= 100
    assert list(history) == moments[-50:]


def test_the_longest_can_be_copied() -> None:
    history = History(range(5000))
    for again in (pickle.loads(pickle.dumps(history)), copy.deepcopy(history)):
        assert again == history
        assert list(again) == list(range(5000))
    assert history != tuple(history)
    assert repr(History([1, 2])) == "History([1, 2])"
