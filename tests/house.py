"""What the house looks like: lines by room, classes for a tested row, circles, what is largest.

python tests/house.py [FOLDER] - the folder in which `anaplot` stands, this project's by default.
Needs nothing but Python, and reads the code without running it.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

# what a tested row says, whatever its class calls it
_RESIDUAL = {"residual", "residual_um", "v", "v_um", "parx_um", "misclosure"}
_REDUNDANCY = {"r", "redn", "redundancy_number"}
_TEST = {"w", "sigf", "flagged", "statistic"}


def modules(root: Path) -> dict[str, tuple[Path, ast.Module]]:
    """Return every module of the package by its full name."""
    out = {}
    for file in sorted((root / "anaplot").rglob("*.py")):
        parts = list(file.relative_to(root).with_suffix("").parts)
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        out[name] = file, ast.parse(file.read_text(encoding="utf-8"))
    return out


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield every statement, however deep, and what holds statements: no expression imports."""
    todo: list[ast.AST] = [tree]
    while todo:
        node = todo.pop()
        yield node
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            inside = getattr(node, name, ())
            if isinstance(inside, list):  # that of a lambda or a conditional expression is none
                todo += inside


def imports(house: Mapping[str, tuple[Path, ast.Module]]) -> dict[str, set[str]]:
    """Return what each module imports of the package, inside functions and for types, too."""
    out: dict[str, set[str]] = {}
    for name, (file, tree) in house.items():
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        out[name] = set()
        for node in _statements(tree):
            wanted: list[str] = []
            if isinstance(node, ast.Import):
                wanted = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                base = node.module or ""
                if node.level:
                    above = package.split(".")[: len(package.split(".")) - node.level + 1]
                    base = ".".join([*above, *([base] if base else [])])
                for alias in node.names:
                    inside = f"{base}.{alias.name}"
                    wanted.append(inside if inside in house else base)
            out[name] |= {each for each in wanted if each in house} - {name}
    return out


def circles(graph: Mapping[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules or rooms that import each other, directly or not."""
    reached: dict[str, set[str]] = {}
    for start in graph:
        seen: set[str] = set()
        todo = list(graph[start])
        while todo:
            one = todo.pop()
            if one not in seen:
                seen.add(one)
                todo += graph.get(one, ())
        reached[start] = seen
    found = {
        tuple(sorted(other for other in reached[name] if name in reached.get(other, ())))
        for name in graph
        if name in reached[name]
    }
    return [list(group) for group in sorted(found)]


def room_of(name: str) -> str:
    """Return the room of a module: the package below `anaplot`, or the module that stands alone."""
    return ".".join(name.split(".")[:2])


def rooms(graph: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return which room imports which."""
    out: dict[str, set[str]] = {}
    for name, others in graph.items():
        if name != "anaplot":  # offers what is in the rooms, lazily
            out.setdefault(room_of(name), set()).update(
                room_of(other) for other in others if room_of(other) != room_of(name)
            )
    return out


def classes(house: Mapping[str, tuple[Path, ast.Module]]) -> Iterator[tuple[str, ast.ClassDef]]:
    """Yield every class with its module."""
    for name, (_, tree) in house.items():
        for node in _statements(tree):
            if isinstance(node, ast.ClassDef):
                yield name, node


def says_tested_row(node: ast.ClassDef) -> bool:
    """Whether the fields of a class are residual, redundancy number and test of single rows."""
    fields = {
        each.target.id
        for each in node.body
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
    }
    return all(fields & some for some in (_RESIDUAL, _REDUNDANCY, _TEST))


def length(node: ast.ClassDef) -> int:
    """Return the number of lines of a class."""
    return (node.end_lineno or node.lineno) - node.lineno + 1


def lines(file: Path) -> int:
    """Return the number of lines of a file."""
    return len(file.read_text(encoding="utf-8").splitlines())


def main() -> None:
    """Print it."""
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    house = modules(root)
    by_room: Counter[str] = Counter()
    for name, (file, _) in house.items():
        by_room[room_of(name)] += lines(file)
    print("LINES BY ROOM")
    for room, count in by_room.most_common():
        print(f"  {room:<28}{count:>7}")
    tests = sum(lines(file) for file in (root / "tests").rglob("*.py"))
    print(f"  {'in all':<28}{by_room.total():>7}   tests {tests}")
    tested = [f"{name}.{node.name}" for name, node in classes(house) if says_tested_row(node)]
    print(f"CLASSES FOR A TESTED ROW: {len(tested)}")
    for each in tested:
        print(f"  {each}")
    graph = imports(house)
    for what, found in (("MODULES", circles(graph)), ("ROOMS", circles(rooms(graph)))):
        print(f"IMPORT CIRCLES OF {what}: {len(found)}")
        for group in found:
            print(f"  {' <-> '.join(group)}")
    print("LARGEST CLASSES")
    for name, node in sorted(classes(house), key=lambda each: -length(each[1]))[:5]:
        print(f"  {length(node):>5}  {name}.{node.name}")
    print("LARGEST MODULES")
    for name in sorted(house, key=lambda each: -lines(house[each][0]))[:5]:
        print(f"  {lines(house[name][0]):>5}  {name}")


if __name__ == "__main__":
    main()
