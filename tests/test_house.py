"""What holds of the house as a whole; `python tests/house.py` prints the rest."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from house import circles, classes, imports, length, lines, modules, rooms

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def house() -> dict[str, tuple[Path, ast.Module]]:
    return modules(ROOT)


@pytest.mark.slow
def test_nothing_imports_itself_by_way_of_others(house: dict[str, tuple[Path, ast.Module]]) -> None:
    graph = imports(house)
    assert len(graph) > 100
    assert circles(graph) == []
    assert circles(rooms(graph)) == []


def test_circles_are_found_wherever_an_import_stands(tmp_path: Path) -> None:
    room = tmp_path / "anaplot" / "room"
    room.mkdir(parents=True)
    (tmp_path / "anaplot" / "__init__.py").write_text("")
    (room / "__init__.py").write_text("")
    (room / "a.py").write_text("def f():\n    from anaplot.room import b\n")
    (room / "b.py").write_text("if True:\n    from .c import d\n")
    (room / "c.py").write_text("import anaplot.room.a\n")
    (room / "e.py").write_text("import anaplot.room.a\n")
    names = ["anaplot.room.a", "anaplot.room.b", "anaplot.room.c"]
    assert circles(imports(modules(tmp_path))) == [names]


@pytest.mark.slow
def test_no_class_and_no_module_is_larger_than_one_can_hold(
    house: dict[str, tuple[Path, ast.Module]],
) -> None:
    assert [node.name for _, node in classes(house) if length(node) >= 400] == []
    assert [name for name, (file, _) in house.items() if lines(file) >= 600] == []


@pytest.mark.slow
def test_what_others_import_is_public(house: dict[str, tuple[Path, ast.Module]]) -> None:
    public = {
        name: {
            word
            for node in tree.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
            for word in ast.literal_eval(node.value)
        }
        for name, (_, tree) in house.items()
        if name != "anaplot"  # whose names are those of its rooms
    }
    hidden = {
        f"{node.module}.{each.name}"
        for _, tree in house.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module in public
        for each in node.names
        if f"{node.module}.{each.name}" not in house and each.name not in public[node.module]
    }
    assert len(public) > 40
    assert not hidden
