"""The script that breaks the program on purpose."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

pytest.importorskip("resource", reason="POSIX")

from mutation import Mutant, files_testing, mutants

ROOT = Path(__file__).parents[1]
FILE = Path("anaplot/room/module.py")
SOURCE = '''\
"""Größe."""
__all__ = ["f"]

def f(a: int, b: float = -2.0) -> "float | None":
    if not (a or b) < 3 and a is not None:
        return (a + b) * 2
    return 1.0 if a else None
'''


def changes(source: str) -> set[tuple[str, str]]:
    return {(each.old.decode(), each.new.decode()) for each in mutants(FILE, source.encode())}


def test_each_mutant_is_one_change_that_is_still_a_program() -> None:
    found = list(mutants(FILE, SOURCE.encode()))
    for each in found:
        source = each.applied(SOURCE.encode())
        assert source != SOURCE.encode()
        assert ast.unparse(ast.parse(source)) != ast.unparse(ast.parse(SOURCE))
        assert str(each).startswith(f"anaplot/room/module.py:{each.line}: ")
    assert changes(SOURCE) == {
        ("-2.0", "(2.0)"),
        ("2.0", "(3.0)"),
        ("not (a or b) < 3", "((a or b) < 3)"),
        ("(a or b) < 3", "((a or b) <= (3))"),
        ("a or b", "((a) and (b))"),
        ("3", "(4)"),
        ("not (a or b) < 3 and a is not None", "((not (a or b) < 3) or (a is not None))"),
        ("a is not None", "((a) is (None))"),
        ("(a + b) * 2", "((a + b) / (2))"),
        ("(a + b) * 2", "(None)"),
        ("a + b", "((a) - (b))"),
        ("2", "(3)"),
        ("1.0 if a else None", "((None) if a else (1.0))"),
        ("1.0 if a else None", "(None)"),
        ("1.0", "(2.0)"),
    }


def test_a_mutant_says_where_it_is() -> None:
    assert str(Mutant(FILE, 7, 0, 1, b"a\n  + b", b"(a - b)")) == (
        "anaplot/room/module.py:7: a + b  ->  (a - b)"
    )


def test_the_nearest_tests_come_first() -> None:
    found = files_testing(Path("anaplot/plotter/poller.py"), ROOT)
    assert found[0] == "tests/plotter/test_plotter_poller.py"
    assert len(found) == len(set(found)) > 5
    assert set(found) >= {f"tests/plotter/{p.name}" for p in ROOT.glob("tests/plotter/test_*.py")}
