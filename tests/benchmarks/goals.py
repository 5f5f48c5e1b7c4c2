"""The goals of whole commands: processor time in units, and peak memory, beside what is wanted.

    python tests/benchmarks/goals.py [row ...] [--repeat N] [--keep FOLDER] [--list]

Each row runs the real command in a process of its own. A unit is one Cholesky factor of a
2000 x 2000 matrix on one thread, measured in the same run before and after each row; the least of
all counts. Times are those of the processor, with that of processes which a command starts. Without
rows those are measured that take a minute at most; the large ones are named. `--keep` keeps the
blocks there, and takes those that are there already. The exit code is 1 where a goal is missed.
"""

from __future__ import annotations

import argparse
import compileall
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
UNIT = """
import time, numpy as np
rng = np.random.default_rng(0)
a = rng.normal(size=(2000, 2000))
a = a @ a.T + 2000.0 * np.eye(2000)
for _ in range(3):
    start = time.process_time()
    np.linalg.cholesky(a)
    print(time.process_time() - start)
"""
ANAPLOT = ("-m", "anaplot")
BLOCK = "{block}"  # where the folder of the row's block stands in a command


@dataclass(frozen=True)
class Goal:
    """What is measured, and what it may take.

    Attributes
    ----------
    title
        For people.
    command
        Arguments of Python.
    units, megabytes
        What is wanted: processor time, peak memory; or None.
    block
        What of goalblocks it works on.
    seconds
        A wanted processor time that is no multiple of the unit.
    large
        Whether it is measured only when it is named.
    tells
        Whether the command measures itself, and what it prints is shown.
    """

    title: str
    command: tuple[str, ...]
    units: float | None = None
    megabytes: float | None = None
    block: str | None = None
    seconds: float | None = None
    large: bool = False
    tells: bool = False


def _adjust(title: str, block: str, units: float, megabytes: float, *options: str) -> Goal:
    command = (*ANAPLOT, "adjust", BLOCK, *options)
    return Goal(title, command, units, megabytes, block, large=block not in ("100", "400"))


def _own(title: str, program: str, *options: str, large: bool = False) -> Goal:
    return Goal(title, (str(HERE / program), *options), large=large, tells=True)


GOALS = {
    "help": Goal("anaplot --help", (*ANAPLOT, "--help"), seconds=0.15),
    "new": Goal(
        "new", (*ANAPLOT, "new", "{new}", "--strip", "101-120", "--camera", "rmk15"), seconds=0.15
    ),
    "status": Goal(
        "status, nothing measured", (*ANAPLOT, "status", BLOCK), seconds=0.15, block="planned"
    ),
    "status-100": Goal("status, 100 photos", (*ANAPLOT, "status", BLOCK), block="100"),
    "100": _adjust("100 photos, 2 500 rays", "100", 8, 150),
    "400": _adjust("400 photos, search, 20 mismatches", "400", 50, 300, "--errors", "search"),
    "2500": _adjust("2 500 photos, 62 500 rays", "2500", 60, 500),
    "2500-all": _adjust("2 500 photos, 62 500 rays, all rows", "2500", 60, 500, "--all"),
    "2500-json": _adjust("2 500 photos, 62 500 rays, JSON", "2500", 60, 500, "--json"),
    "10000": _adjust("10 000 photos, 490 000 rays", "10000", 250, 2048),
    "drone": _adjust("drone, 992 photos, 460 000 rays, given", "drone", 130, 1536),
    "drone-baarda": _adjust(
        "drone, 992 photos, baarda, 920 mismatches",
        "drone-errors",
        600,
        4096,
        "--errors",
        "baarda",
    ),
    "drone-search": _adjust(
        "drone, 992 photos, search, 920 mismatches",
        "drone-errors",
        600,
        4096,
        "--errors",
        "search",
    ),
    "million": _adjust(
        "10^6 rays, search, 2 000 mismatches", "million", 600, 4096, "--errors", "search"
    ),
    "million-baarda": _adjust(
        "10^6 rays, baarda, 2 000 mismatches", "million", 600, 4096, "--errors", "baarda"
    ),
    "colmap": Goal(
        "import of COLMAP, 10^6 observations",
        (*ANAPLOT, "import", "colmap", BLOCK, "-o", "{new}"),
        60,
        1024,
        "colmap",
        large=True,
    ),
    "model": _own("one model, in small solves", "model_speed.py"),
    "screen": _own("record byte to table", "console_latency.py", "1000", large=True),
    "journal": _own("a long journal opened", "journal_opening.py", large=True),
}


@dataclass(frozen=True)
class Used:
    """What a process has used: seconds of the processor, megabytes at its peak; its exit code."""

    seconds: float
    megabytes: float
    code: int


def run(command: list[str], shown: bool = False) -> Used:
    """Run Python with arguments; this process stays small, or its size would be the child's."""
    out = None if shown else subprocess.DEVNULL
    child = subprocess.Popen([sys.executable, *command], stdout=out, env=os.environ | ONE_THREAD)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    return Used(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0, child.returncode)


def unit() -> float:
    """Return seconds of one Cholesky factor."""
    told = subprocess.run(
        [sys.executable, "-c", UNIT], env=os.environ | ONE_THREAD, check=True, capture_output=True
    )
    return min(map(float, told.stdout.split()))


def made(goal: Goal, folder: Path) -> Path:
    """Return the folder of a row's block, made where it is not there yet."""
    name = goal.block or "none"
    path = folder / name
    if goal.block and not path.exists():
        used = run([str(HERE / "goalblocks.py"), name, str(path)])
        if used.code:
            raise SystemExit(f"{name}: the block could not be made")
    return path


def wanted(value: float, goal: float | None, unit_of: str) -> str:
    """Return a measured value beside its goal."""
    said = "" if goal is None else f" of {goal:g}"
    mark = " " if goal is None or value <= goal else "*"
    return f"{value:10.2f}{said:>9} {unit_of}{mark}"


def main(given: list[str]) -> int:
    """Print a line a row; 0 when every goal is reached."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", choices=[[], *GOALS], metavar="row")
    parser.add_argument("--repeat", type=int, default=1, help="runs of a row; the least counts")
    parser.add_argument("--keep", type=Path, help="folder of the blocks")
    parser.add_argument("--list", action="store_true", help="print the rows")
    options = parser.parse_args(given)
    if options.list:
        for name, goal in GOALS.items():
            print(f"{name:15}{goal.title}{'   (when named)' if goal.large else ''}")
        return 0
    # whoever runs a program has its bytecode: compiling is measured nowhere
    compileall.compile_dir(HERE.parents[1] / "anaplot", quiet=1)
    rows = options.rows or [name for name, goal in GOALS.items() if not goal.large]
    reached = True
    with tempfile.TemporaryDirectory() as name:
        folder = options.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        for row in rows:
            reached &= measured(row, folder, Path(name), max(1, options.repeat))
    return 0 if reached else 1


def measured(row: str, folder: Path, scratch: Path, repeat: int) -> bool:
    """Measure one row and print it; whether its goals are reached."""
    goal = GOALS[row]
    block = made(goal, folder)
    one, runs = unit(), []
    for k in range(repeat):
        places = {BLOCK: str(block), "{new}": str(scratch / f"{row}-{k}")}
        runs.append(run([places.get(part, part) for part in goal.command], goal.tells))
    one = min(one, unit())
    least = min(runs, key=lambda used: used.seconds)
    if goal.tells:
        return least.code == 0
    if any(used.code for used in runs):
        print(f"{row:15}{goal.title}: exit code {max(used.code for used in runs)}", flush=True)
        return False
    figures = [
        wanted(least.seconds, goal.seconds, "s"),
        wanted(least.seconds / one, goal.units, "units"),
        wanted(least.megabytes, goal.megabytes, "MB"),
    ]
    print(f"{row:15}{goal.title:43}{''.join(figures)}   unit {one:.3f} s", flush=True)
    return not any(figure.endswith("*") for figure in figures)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
