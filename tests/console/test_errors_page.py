"""The page of strategies for gross errors, over a model with one planted error."""

import pytest
from consolefake import FakeStation, console, picture
from screenreading import text, until
from testedrows import with_rows

from anaplot.adjustment.strategies import STRATEGIES
from anaplot.console.errorspage import CHOICES, errors_line, errors_lines, model_findings
from anaplot.orientation.patterns import pattern
from anaplot.orientation.results import ModelSolution
from anaplot.planning.patternplan import from_pattern, solve


def model(name: str = "13/5", wrong: str | None = "8", size_um: float = 200.0) -> ModelSolution:
    """Return an ideal model, with an error of one y row planted to first order."""
    solution = solve(from_pattern(pattern(name), 90.0, 100.0, 152.0), "propagated")
    table = list(solution.table)
    if wrong is not None:
        row = [r.key for r in table].index((wrong, "y"))
        parallax = solution.q_vv[:, row] / solution.q_l[row] * size_um
        table = [
            replace_row(r, v, solution.apriori_um, q)
            for r, v, q in zip(table, parallax, solution.q_l, strict=True)
        ]
    return with_rows(solution, table)


def replace_row(row, parallax, apriori, q):
    w = parallax / (apriori * (q * row.r) ** 0.5) if row.r > 1e-9 else None
    return row._replace(residual=float(parallax), w=w)


def page(solution: ModelSolution | None, strategy: str, width: int = 72) -> str:
    return "\n".join(line.plain for line in errors_lines(solution, strategy, width))


@pytest.mark.parametrize("strategy", ["baarda", "modified", "huber", "danish", "search", "odds"])
def test_the_planted_row_is_named_with_its_size(strategy: str) -> None:
    solution = model()
    text = page(solution, strategy)
    row = next(line for line in text.splitlines() if line.startswith("8 y"))
    assert "200.0" in row
    assert "Nothing is switched off by this page" in text
    assert errors_line(solution, strategy).startswith(f"{strategy} rejects: 8 y")
    assert max(len(line) for line in text.splitlines()) <= 72


def test_columns_never_touch() -> None:
    usual, large = (page(model(size_um=size), "search") for size in (200.0, -2.1e9))
    rows = [next(line for line in text.splitlines() if line.startswith("8 y"))
            for text in (usual, large)]  # fmt: skip
    assert len(rows[0].split()) == len(rows[1].split()) == 6


@pytest.mark.parametrize("strategy", ["huber", "danish"])
def test_reweighting_is_one_line_and_what_decided_is_shown(strategy: str) -> None:
    lines = page(model(), strategy).splitlines()
    weighted = [line for line in lines if "all rows weighted again" in line]
    assert len(weighted) == 1
    assert " times; v'Pv " in weighted[0]
    (first,) = [line for line in lines if line.split()[:1] == ["1"]]
    assert first.split()[1:4] == ["8", "y", "out"]


def test_the_page_has_every_strategy_in_the_order_of_the_options() -> None:
    assert CHOICES == STRATEGIES


def test_nothing_wrong_nothing_said() -> None:
    solution = model(wrong=None)
    for strategy in CHOICES:
        assert "No row is rejected." in page(solution, strategy)
        assert errors_line(solution, strategy) == ""
    assert errors_line(solution, None) == ""
    assert errors_line(None, "search") == ""


def test_a_model_without_redundancy_says_so() -> None:
    assert "No row of this model can be tested yet." in page(None, "search")
    solution = model(wrong=None)
    assert model_findings(with_rows(solution, solution.table, redundancy=0), "search") is None


@pytest.mark.parametrize("size", [(80, 24), (160, 50)])
async def test_strategies_by_key_and_the_line_of_advice(size: tuple[int, int]) -> None:
    station = FakeStation(picture(solution=model()))
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        assert "rejects" not in text(app)
        await pilot.press("e")
        await until(pilot, lambda: "[search]" in text(app))
        assert "8 y" in text(app)
        await pilot.press("e")
        await until(pilot, lambda: "[odds]" in text(app))
        assert "8 y" in text(app)
        await pilot.press("e")
        await until(pilot, lambda: "[baarda]" in text(app))
        assert "against 3.29" in text(app)
        station.tell(picture(serial=2, solution=model(wrong=None)))
        await until(pilot, lambda: "No row is rejected." in text(app))
        station.tell(picture(serial=3, solution=model(wrong="2")))
        await until(pilot, lambda: "2 y" in text(app))
        await pilot.press("left", "left", "escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        await until(pilot, lambda: "search rejects: 2 y" in text(app))


async def test_the_palette_chooses_a_strategy() -> None:
    app = console(FakeStation(picture(solution=model())))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("ctrl+p")
        await pilot.press(*"errors", "space", *"danish")
        await until(pilot, lambda: "Errors: danish" in text(app))
        await pilot.press("enter")
        await until(pilot, lambda: "[danish]" in text(app))
