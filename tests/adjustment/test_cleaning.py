"""Passes over something that is not linear: a circle through points."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.adjustment.cleaning import Cleaning, SolvedWithout, best_of
from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.residualsystem import DenseResiduals, ResidualSystem
from anaplot.adjustment.scale import AprioriSigma, ScaleError
from anaplot.adjustment.watch import Watch
from anaplot.errors import NotComputableError

SIGMA = 0.01
ALL = frozenset[int]()


class Circle:
    """Centre and radius from distances; `needed` rows cannot be left out."""

    apriori = AprioriSigma("circle", "sigma", SIGMA, "m")

    def __init__(self, errors: dict[int, float], needed: tuple[int, ...] = (), n: int = 40) -> None:
        rng = np.random.default_rng(5)
        angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
        radius = 10.0 + rng.normal(size=n) * SIGMA
        for row, error in errors.items():
            radius[row] += error
        self.xy = radius[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
        self.needed, self.solved = needed, 0

    def _rows(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        d = self.xy - at[:2]
        size = np.linalg.norm(d, axis=1)
        design = np.column_stack((-d / size[:, None], np.full(len(size), -1.0))) / SIGMA
        return design, (size - at[2]) / SIGMA

    def residuals(self, at: np.ndarray, number: int) -> DenseResiduals:
        design, misclosure = self._rows(at)
        q, _ = np.linalg.qr(design)
        matrix = np.eye(len(q)) - q @ q.T
        e = matrix @ misclosure
        names = tuple(range(len(e)))
        return DenseResiduals(names, e, np.diag(matrix), float(e @ e), len(e) - 3, matrix)

    def without(self, out: frozenset[int], near: np.ndarray) -> SolvedWithout[np.ndarray, int]:
        if out & set(self.needed):
            raise NotComputableError("needed")
        self.solved += 1
        keep = [k for k in range(len(self.xy)) if k not in out]
        at = np.array(near, dtype=float)
        for _ in range(50):
            design, misclosure = self._rows(at)
            step = np.linalg.lstsq(design[keep], -misclosure[keep], rcond=None)[0]
            at = at + step
            if np.abs(step).max() < 1e-12:
                break
        e = self._rows(at)[1][keep]
        return SolvedWithout(at, float(e @ e))

    def suspects(self, system: ResidualSystem) -> np.ndarray:
        return np.ones(len(system.names), dtype=bool)

    def model_values(self, system: ResidualSystem, at: np.ndarray) -> np.ndarray:
        return np.full(len(system.names), np.nan)

    def apart(self, system: ResidualSystem, at: np.ndarray) -> None:
        return None

    def price(self, out: frozenset[int], at: np.ndarray, each: float) -> float:
        return each * len(out)

    def astray(self, error: NotComputableError) -> bool:
        return False


START = np.array([0.3, -0.2, 9.0])


def cleaning(subject: Circle, strategy: str = "search", **more) -> Cleaning:
    settings = SearchSettings(alpha=0.001)
    return Cleaning(subject, strategy, settings, more.pop("watch", Watch()), **more)


@pytest.mark.parametrize("strategy", ["baarda", "tau", "search", "odds", "modified"])
def test_large_errors_go_and_the_last_pass_has_found_what_the_one_before_had(strategy) -> None:
    subject = Circle({3: 2.0, 11: -1.5, 12: 1.0})
    end = cleaning(subject, strategy).run(START, None)
    assert end.settled
    assert end.out == {3, 11, 12}
    assert set(end.passes[-1].rows) == set(end.passes[-2].rows) == end.out
    alone = subject.without(end.out, START)
    np.testing.assert_allclose(end.solved.solution, alone.solution, atol=1e-9)
    assert end.score == pytest.approx(alone.vtpv + 3 * 10.8276, rel=1e-4)
    errors = {row.row: row.error * SIGMA for row in end.passes[-1].rejected}
    assert errors[3] == pytest.approx(2.0, abs=0.05)


def test_a_start_that_is_the_solution_is_not_solved_again() -> None:
    subject = Circle({})
    known = subject.without(ALL, START)
    end = cleaning(subject, "baarda").run(known.solution, known)
    assert (end.out, end.solved, subject.solved) == (ALL, known, 1)


class Swaying(Circle):
    """A circle of which one row may be rejected in every pass, now this and now that."""

    one = (3, 11, 3, 3)
    number = 0

    def residuals(self, at: np.ndarray, number: int) -> DenseResiduals:
        self.number = number
        return super().residuals(at, number)

    def suspects(self, system: ResidualSystem) -> np.ndarray:
        return np.arange(len(system.names)) == self.one[self.number - 1]


def test_rows_that_come_again_are_no_circle_where_the_weights_have_begun_otherwise() -> None:
    errors = {3: 2.0, 11: -1.5}
    end = cleaning(Swaying(errors), "danish", as_given=True).run(START, None)
    assert end.settled
    assert (end.out, len(end.passes)) == ({3}, 4)
    end = cleaning(Swaying(errors), "baarda", as_given=True).run(START, None)
    assert not end.settled
    assert end.remarks[0].startswith("the rejected observations did not settle in 3 passes")


def test_what_cannot_be_left_out_stays_and_is_named() -> None:
    subject = Circle({11: -0.08}, needed=(11,))
    end = cleaning(subject, "baarda").run(START, None)
    assert [(refused.name, refused.reason) for refused in end.refused] == [(11, "needed")]
    assert 11 not in end.out


def test_rows_held_out_are_not_looked_at() -> None:
    subject = Circle({3: 2.0, 11: -1.5})
    held = frozenset({3})
    end = cleaning(subject, "baarda").run(START, None, held)
    assert end.out == {3, 11}
    assert end.passes[-1].rows == (11,)


def test_rows_held_out_that_nothing_checks_are_named() -> None:
    # ended with "row 1 cannot be left out as well", and a traceback
    with pytest.raises(NotComputableError, match="circle: 1 cannot be left out beside what is out"):
        cleaning(Circle({}, n=4), "baarda").run(START, None, frozenset({0, 1}))


def test_an_interrupt_leaves_the_best_so_far() -> None:
    subject, watch = Circle({3: 2.0, 11: -1.5, 12: 1.0}), Watch()
    real = subject.without

    def without(out: frozenset[int], near: np.ndarray) -> SolvedWithout[np.ndarray, int]:
        watch.stop()  # while the first set is solved for
        return real(out, near)

    subject.without = without  # type: ignore[method-assign]
    end = cleaning(subject, "baarda", watch=watch).run(START, None)
    assert end.out == {3, 11, 12}
    assert not end.settled
    assert any("interrupted" in remark for remark in end.remarks)


def test_an_interrupt_within_a_strategy_keeps_what_has_gone() -> None:
    class Impatient(Watch):
        calls = 0

        def __call__(self, what: str, fraction: float) -> None:
            self.calls += 1
            if self.calls == 2:
                self.stop()

    end = cleaning(Circle({3: 2.0, 11: -1.5, 12: 1.0}), "baarda", watch=Impatient()).run(
        START, None
    )
    assert len(end.out) == 2
    assert any("interrupted" in remark for remark in end.remarks)


def test_a_wrong_sigma_cleans_nothing_unless_told_to() -> None:
    subject = Circle({row: 0.5 * (-1) ** row * (1 + row % 3) for row in range(40)})
    known = subject.without(ALL, START)
    with pytest.raises(ScaleError, match="circle: most residuals"):
        cleaning(subject, "baarda").run(known.solution, known)
    end = cleaning(subject, "baarda", as_given=True).run(known.solution, known)
    assert 0 < len(end.out) <= 18  # half of the redundancy of 37
    assert any("half of the redundancy" in r for r in end.passes[-1].remarks)
    assert cleaning(subject, "tau").run(known.solution, known).out == ALL


def test_the_best_end_is_that_of_the_smallest_score() -> None:
    subject = Circle({3: 2.0})
    without = cleaning(subject, "baarda").run(START, None)
    worse = cleaning(subject, "baarda").run(START, None, frozenset({7}))
    assert best_of([worse, without]) is without
