"""What a robust adjustment leaves far off, rejected place by place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from test_strategies import random_system, system_of

from anaplot.adjustment import strategies
from anaplot.adjustment.doubts import Touching
from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import SearchSettings, SearchStep
from anaplot.adjustment.foundapart import Apart
from anaplot.adjustment.leftout import ReducedSystem
from anaplot.adjustment.places import Places
from anaplot.adjustment.residualsystem import ResidualSystem
from anaplot.adjustment.reweighting import Reweighting, reweight, weighted_misclosures
from anaplot.adjustment.robustapart import far_off
from anaplot.adjustment.strategies import find_gross_errors
from anaplot.aliases import Array, Index
from anaplot.errors import NotComputableError

ALPHA = 0.001
ERRORS = {3: 25.0, 20: -18.0, 31: 12.0, 32: 9.0}


class OnePlace:
    """A system that is a single place, without some of its rows."""

    exact = True

    def __init__(self, system: ResidualSystem, out: Sequence[int]) -> None:
        self._system, state = system, Elimination(system)
        for row in out:
            state.add(row)
        self.e, self.r, self.vtpv = state.e, state.r, state.vtpv
        error, sigma = state.estimates()
        self.e[list(state.rows)], self.r[list(state.rows)] = error, sigma**-2.0

    def back(self, row: int) -> float:
        return float(self.r[row])

    def places_of(self, rows: Index) -> Index:
        return np.zeros(len(rows), dtype=np.intp)

    def places(self, numbers: Index) -> Iterator[Places]:
        system, every = self._system, np.arange(len(self.e))
        for _ in numbers.tolist():
            matrix = system.columns(every)
            yield Places(
                np.zeros(1, dtype=np.intp), every[None], system.e[None], system.r[None],
                matrix[None], np.zeros((1, len(every))), np.array([system.vtpv]),
                system.redundancy, system.names,
            )  # fmt: skip

    def reach(self, numbers: Index) -> Array:
        return np.zeros(len(numbers))

    def touching(self, numbers: Index) -> Touching:
        return Touching(csr_array((len(numbers), 1)), np.zeros(len(numbers), dtype=bool))


class Whole:
    """A system, adjusted without some of its rows."""

    def __init__(self, system: ResidualSystem, begun: tuple[int, ...] = ()) -> None:
        self._system, self.begun = system, begun

    def adjusted(self, out: Sequence[int]) -> OnePlace:
        return OnePlace(self._system, out)

    drafted = adjusted


def parted(steps: Sequence[SearchStep]) -> tuple[list[SearchStep], list[SearchStep]]:
    """Re-weightings, and what comes after."""
    count = sum(step.action == "reweight" for step in steps)
    return list(steps[:count]), list(steps[count:])


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["huber", "danish"])
@pytest.mark.parametrize("held", [(), (5, 20)])
@given(st.integers(0, 10**6))
def test_in_a_single_place_it_is_what_it_is_as_one(
    strategy: str, held: tuple[int, ...], seed: int
) -> None:
    system = random_system(seed, errors=ERRORS)[2]
    one = find_gross_errors(system, strategy, left_out=held)
    apart = find_gross_errors(system, strategy, left_out=held, apart=Apart(Whole(system)))
    assert apart.rows == one.rows
    for mine, other in zip(apart.rejected, one.rejected, strict=True):
        assert mine.name == other.name
        assert mine[4:8] == pytest.approx(other[4:8], rel=1e-6)
        assert mine.weight == pytest.approx(other.weight, rel=1e-6)
    assert apart.at_end.vtpv == pytest.approx(one.at_end.vtpv, rel=1e-9)
    there = np.setdiff1d(np.arange(len(system.e)), held)
    assert apart.at_end.weights[there] == pytest.approx(one.at_end.weights[there], abs=1e-6)
    # the same steps; what v'Pv they begin with, nobody knows place by place
    weighted, went = parted(apart.steps)
    others, went_as_one = parted(one.steps)
    assert [step[:2] for step in went] == [step[:2] for step in went_as_one]
    # rows are named once
    assert not any(step.rows for step in weighted[:-1])
    assert weighted[-1].rows == others[-1].rows
    assert [step[2:] for step in weighted] == [
        pytest.approx(step[2:], rel=1e-6, abs=1e-6) for step in others
    ]
    assert went[-1].after == pytest.approx(apart.at_end.vtpv, rel=1e-6)


@given(st.integers(0, 10**6))
def test_misclosures_at_full_weight_follow_from_weighted_ones(seed: int) -> None:
    """With all rows in one place they are those of the adjustment itself."""
    system = random_system(seed, errors=ERRORS)[2]
    weights = np.random.default_rng(seed).uniform(0.01, 1.0, len(system.e))
    v = weighted_misclosures(system, weights)
    matrix = system.columns(np.arange(len(v)))
    assert v - (1 - weights) * v + matrix @ ((1 - weights) * v) == pytest.approx(system.e, abs=1e-8)


def test_no_more_rows_go_than_may() -> None:
    system = random_system(2, errors=ERRORS)[2]
    settings = SearchSettings(most=2)
    for strategy in ("huber", "danish"):
        apart = find_gross_errors(system, strategy, settings, apart=Apart(Whole(system)))
        assert len(apart.rows) == 2
        assert any("stopped at 2" in remark for remark in apart.remarks)


def test_danish_begins_without_what_the_place_was_found_without() -> None:
    system = random_system(4, errors=ERRORS)[2]
    rows = find_gross_errors(system, "danish").rows
    begun = find_gross_errors(system, "danish", apart=Apart(Whole(system, rows)))
    from_ones = find_gross_errors(system, "danish", apart=Apart(Whole(system)))
    assert begun.rows == from_ones.rows
    first = next(step for step in begun.steps if step.action == "reweight")
    slow = next(step for step in from_ones.steps if step.action == "reweight")
    assert first.statistic < 1e-3 < 0.9 < slow.statistic


@pytest.mark.parametrize("strategy", ["huber", "danish"])
def test_where_not_all_of_it_can_go_together_it_goes_one_after_another(
    strategy: str, monkeypatch
) -> None:
    system = random_system(4, errors=ERRORS)[2]

    class Open(Whole):
        def adjusted(self, out: Sequence[int]) -> OnePlace:
            if out:
                raise NotSeparableError("a point is left open")
            return super().adjusted(out)

        drafted = adjusted

    one = find_gross_errors(system, strategy)
    apart = find_gross_errors(system, strategy, apart=Apart(Open(system)))
    assert apart.rows == one.rows
    assert apart.steps == one.steps
    # apart no column is held; as one they are
    monkeypatch.setattr(strategies, "MOST_IN_COLUMNS", 1)
    assert find_gross_errors(system, strategy, apart=Apart(Whole(system))).rows == one.rows
    with pytest.raises(NotComputableError, match="memory"):
        find_gross_errors(system, strategy, apart=Apart(Open(system)))


def test_rows_that_nothing_checks_without_others_stay() -> None:
    """Rows 0 and 1 check each other alone; the second stays, whatever it is off."""
    design = np.zeros((8, 3))
    design[:2, 0] = 1.0
    design[2:, 1], design[2:, 2] = 1.0, np.arange(6.0)
    misclosures = np.array([30.0, -30.0, 0.5, -0.4, 40.0, 0.3, 0.2, -0.6])
    system = system_of(design, misclosures)
    robust = Reweighting(np.ones(8), system.e, (), (), True)
    suspects = np.ones(8, dtype=bool)
    found = far_off(Whole(system), robust, ALPHA, suspects, 8, ())
    gone = {row for there in found for step in there.steps for row in there.gone(step)}
    assert len(gone & {0, 1}) == 1


@pytest.mark.parametrize("method", ["huber", "danish"])
def test_rows_without_weight_for_good_are_rows_left_out(method: str) -> None:
    system = random_system(7, errors=ERRORS)[2]
    suspects, held = np.ones(len(system.e), dtype=bool), (3, 31)
    one = reweight(ReducedSystem(system, held), method, suspects)
    other = reweight(system, method, suspects, left_out=held)
    there = np.setdiff1d(np.arange(len(suspects)), held)
    assert other.misclosures[there] == pytest.approx(one.misclosures[there], abs=1e-7)
    assert other.weights[there] == pytest.approx(one.weights[there], abs=1e-7)
    assert not other.weights[list(held)].any()
    assert [step.rows for step in other.steps] == [step.rows for step in one.steps]
