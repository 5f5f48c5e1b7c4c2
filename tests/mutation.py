"""Break the program on purpose, a little at a time, and see whether a test notices.

    python tests/mutation.py anaplot/adjustment --count 150 --seconds 1500 --seed 1

Each mutant is one change of one file: a comparison, an arithmetic operator, `and` and `or`, a
`not`, a number, True and False, a returned value. It is made in a copy of the project in a
temporary folder, so that no mutated file is ever left behind. The tests of a module are those that
import it, those with its name in theirs first, then all of its room. What no test notices is
printed with its line: either no change at all (an equivalent mutant), or a test is missing.

The tests run in forks of this process, which has loaded what takes time to load: POSIX only.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest
import scipy.linalg
import scipy.optimize
import scipy.sparse.linalg
import scipy.special
import scipy.stats  # noqa: F401

ROOT = Path(__file__).parents[1]

OPERATORS: dict[type, tuple[type, str]] = {
    ast.Lt: (ast.LtE, "<="),
    ast.LtE: (ast.Lt, "<"),
    ast.Gt: (ast.GtE, ">="),
    ast.GtE: (ast.Gt, ">"),
    ast.Eq: (ast.NotEq, "!="),
    ast.NotEq: (ast.Eq, "=="),
    ast.Is: (ast.IsNot, "is not"),
    ast.IsNot: (ast.Is, "is"),
    ast.In: (ast.NotIn, "not in"),
    ast.NotIn: (ast.In, "in"),
    ast.Add: (ast.Sub, "-"),
    ast.Sub: (ast.Add, "+"),
    ast.Mult: (ast.Div, "/"),
    ast.Div: (ast.Mult, "*"),
    ast.Pow: (ast.Mult, "*"),
    ast.And: (ast.Or, "or"),
    ast.Or: (ast.And, "and"),
}


class Mutant(NamedTuple):
    """One change: where it is (0-based byte offsets of the file), and what stands there then."""

    file: Path
    line: int
    start: int
    end: int
    old: bytes
    new: bytes

    def __str__(self) -> str:
        """Say where it is, and what became of what."""
        return f"{self.file}:{self.line}: {_short(self.old)}  ->  {_short(self.new)}"

    def applied(self, source: bytes) -> bytes:
        """Return the mutated file."""
        return source[: self.start] + self.new + source[self.end :]


def _short(code: bytes) -> str:
    text = re.sub(r"\s+", " ", code.decode())
    return text if len(text) <= 70 else text[:67] + "..."


def mutants(file: Path, source: bytes) -> Iterator[Mutant]:
    """Yield all mutants of a file."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(node: ast.AST) -> slice:
        assert isinstance(node, ast.expr)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        begin = starts[node.lineno - 1] + node.col_offset
        return slice(begin, starts[node.end_lineno - 1] + node.end_col_offset)

    def changed(node: ast.expr, new: str) -> Mutant:
        at = place(node)
        return Mutant(file, node.lineno, at.start, at.stop, source[at], f"({new})".encode())

    def text(node: ast.AST) -> str:
        return source[place(node)].decode()

    tree = ast.parse(source)
    skipped = {id(node) for each in _not_run(tree) for node in ast.walk(each)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        match node:
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in OPERATORS:
                yield changed(node, f"({text(left)}) {OPERATORS[type(op)][1]} ({text(right)})")
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                yield changed(node, f"({text(left)}) {OPERATORS[type(op)][1]} ({text(right)})")
            case ast.BoolOp(op=op, values=values):
                word = f" {OPERATORS[type(op)][1]} "
                yield changed(node, word.join(f"({text(value)})" for value in values))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                yield changed(node, text(operand))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                yield changed(node, text(operand))
            case ast.Constant(value=bool() as value):
                yield changed(node, str(not value))
            case ast.Constant(value=int() | float() as value):
                yield changed(node, repr(value + 1))
            case ast.IfExp(test=test, body=body, orelse=orelse):
                yield changed(node, f"({text(orelse)}) if {text(test)} else ({text(body)})")
            case ast.Return(value=ast.expr() as value) if not _is_none(value):
                yield changed(value, "None")


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _not_run(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield what says nothing at run time: annotations, `__all__`, f-strings, decorators."""
    for node in ast.walk(tree):
        match node:
            case ast.arg(annotation=ast.expr() as annotation):
                yield annotation
            case ast.AnnAssign(annotation=annotation):
                yield annotation
            case ast.Assign(targets=[ast.Name(id="__all__")]):
                yield node
            case ast.JoinedStr():  # its places are those of the string in older Pythons
                yield node
            case ast.FunctionDef(returns=returns, decorator_list=decorators):
                yield from decorators
                if returns is not None:
                    yield returns
            case ast.ClassDef(decorator_list=decorators):
                yield from decorators


def files_testing(module: Path, root: Path) -> list[str]:
    """Return the test files for a module, the likeliest to notice first.

    Those that import it, with its name in theirs first, then all of its room.
    """
    room, stem = module.parts[1], module.stem
    named = re.compile(rf"\b{re.escape('.'.join(module.with_suffix('').parts))}\b")
    files = sorted((root / "tests").rglob("test_*.py"))
    naming = [file for file in files if named.search(file.read_text(encoding="utf-8"))]
    naming.sort(key=lambda file: (stem not in file.stem, room != file.parent.name))
    naming += [file for file in files if file.is_relative_to(root / "tests" / room)]
    return [str(file.relative_to(root)) for file in dict.fromkeys(naming)]


def noticed(copy: Path, tests: Sequence[str], seconds: float) -> str:
    """Run the tests in the copy: "killed", "survived", or "too slow" (which is noticed, too)."""
    process = os.fork()
    if not process:
        code = 1
        try:
            os.setsid()
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in range(3):
                os.dup2(nowhere, stream)
            os.chdir(copy)
            sys.path.insert(0, str(copy))
            sys.dont_write_bytecode = True
            os.environ["PYTHONPATH"] = str(copy)
            code = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests]))
        finally:
            os._exit(code)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return "killed" if status else "survived"
        time.sleep(0.02)
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return "too slow"


def main() -> int:
    """Run a sample of mutants; returns 1 when one survived."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("what", type=Path, nargs="+", help="a module or a folder of anaplot/")
    parser.add_argument("--count", type=int, default=50, help="mutants, drawn at random")
    parser.add_argument("--seconds", type=float, default=600.0, help="no new mutant after this")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--skip", type=int, default=0, help="of the sample, already seen")
    parser.add_argument("--slow", action="store_true", help="with the tests marked slow")
    parser.add_argument("--tests", nargs="+", help="these tests instead of those found by name")
    arguments = parser.parse_args()
    end = time.monotonic() + arguments.seconds
    files = sorted(
        file
        for what in arguments.what
        for file in (what.rglob("*.py") if (ROOT / what).is_dir() else [what])
        if file.name != "__init__.py"
    )
    files = [file.resolve().relative_to(ROOT) for file in files]
    every = [each for file in files for each in mutants(file, (ROOT / file).read_bytes())]
    sample = random.Random(arguments.seed).sample(every, min(arguments.count, len(every)))
    print(f"{len(sample)} of {len(every)} mutants in {len(files)} files")
    counts = dict.fromkeys(("killed", "survived", "too slow"), 0)
    with tempfile.TemporaryDirectory(prefix="mutation-") as folder:
        copy = Path(folder) / "project"
        shutil.copytree(
            ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache")
        )
        calm: dict[tuple[str, ...], float] = {}
        for mutant in sample[arguments.skip :]:
            tests = tuple(arguments.tests or files_testing(mutant.file, copy))
            options = [] if arguments.slow else ["-m", "not slow"]
            if tests not in calm:  # how long they take, and that they pass
                begun = time.monotonic()
                if noticed(copy, [*tests, *options], 600.0) != "survived":
                    print(f"the tests of {mutant.file} fail without any change")
                    return 2
                calm[tests] = time.monotonic() - begun
            if time.monotonic() > end:
                break
            path = copy / mutant.file
            source = path.read_bytes()
            path.write_bytes(mutant.applied(source))
            try:
                outcome = noticed(copy, [*tests, *options], 30.0 + 5.0 * calm[tests])
            finally:
                path.write_bytes(source)
            counts[outcome] += 1
            if outcome == "survived":
                print(f"survived  {mutant}", flush=True)
    print(", ".join(f"{number} {name}" for name, number in counts.items()))
    return int(counts["survived"] > 0)


if __name__ == "__main__":
    sys.exit(main())
