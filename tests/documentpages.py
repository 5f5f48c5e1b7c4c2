"""The documents as a program reads them: their fences, what is run of these, and what came of it.

- A `console` block holds commands behind `$ ` and below each what it says, trailing blanks aside. A
  line of three dots alone stands for any lines, three dots in a line for anything in it. Where
  nothing stands below a command, its output is not compared. `# ends with 2` behind a command is
  its exit code.
- A `bash` block holds commands alone, which end with 0. One with ` &` at its end goes on until the
  page does; the next waits for its first line, and it has to have one.
- A `python` block is run; the blocks of a page share their names. `# -> TEXT` behind a line is one
  that the block prints, in the order of the page; three dots stand for anything there too.
- `<!-- file: NAME -->` on the line before a block of another language writes it into the page's
  folder.
- `<!-- not run: REASON -->` there leaves a block out.
- `<!-- first:` on a line, commands, and `-->`: these are run there and not shown.

All of a page is run from top to bottom in one empty folder. In blocks without a language commands
with a word in capitals (`anaplot adjust BLOCK`) stand for many: they are parsed and not run. Other
languages than those of `LANGUAGES`, and other fences, are refused.

    python tests/documentpages.py docs/table.md    # the page as its commands would have it now
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

from processes import running

ROOT = Path(__file__).parents[1]
SHELL = ("console", "bash", "first")
RUN = ("console", "bash", "python")
LANGUAGES = (*RUN, "first", "indented", "", "toml", "csv", "text", "cpp", "{eval-rst}", "{toctree}")
PLACES = frozenset(
    [
        "BLOCK",
        "NEWBLOCK",
        "FOLDER",
        "FILE",
        "PROJECT",
        "MODEL",
        "SOURCE",
        "TARGET",
        "NAME",
        "KIND",
        "SET",
        "PROFILE",
        "PORT",
        "SESSION",
        "EPOCH1",
        "EPOCH2",
        "EPOCH3",
        "E1",
        "E2",
        "E3",
        "NEXT",
    ]
)

_MARK = re.compile(r"<!-- (file|not run): (.+) -->")
_PLACE = re.compile(r"(?<![\w$:-])[A-Z][A-Z0-9]+(?![\w:-])")
_ENDS = re.compile(r"\s+# ends with (\d+)$")
_SAID = re.compile(r"  # -> (.+)$", re.MULTILINE)
_OTHER = re.compile(r"\s+(?:```|~~~)|~~~")
_SHELL = re.compile(r"[|<>;&$*?`(]")


class Fence(NamedTuple):
    """A block of a page, or hidden commands ("first")."""

    line: int  # of its first line
    language: str
    lines: tuple[str, ...]
    file: str | None = None
    not_run: str | None = None


class Command(NamedTuple):
    """A command with what the page says of it."""

    line: int
    words: str
    said: tuple[str, ...] | None  # not compared
    ends: int = 0


def fences(text: str) -> list[Fence]:
    """Find the blocks of a page, indented ones too (language "indented")."""
    found: list[Fence] = []
    lines = text.splitlines()
    k = 0
    while k < len(lines):
        start = lines[k]
        begin = k + 1
        assert not _OTHER.match(start), f"line {begin}: a fence of another kind"
        if start.startswith("```"):
            closing = re.compile(rf"`{{{len(start) - len(start.lstrip('`'))},}}\s*$")
            k = next(i for i in range(begin, len(lines)) if closing.match(lines[i]))
            mark = _MARK.fullmatch(lines[begin - 2]) if begin > 1 else None
            given = {mark[1].replace(" ", "_"): mark[2]} if mark else {}
            inside = tuple(lines[begin:k])
            fence = Fence(begin + 1, start.strip("` "), inside, **given)
            assert fence.language in LANGUAGES, f"line {begin}: {fence.language!r} is not known"
            assert fence.file is None or fence.language not in RUN, f"line {begin}: file, or run?"
            found.append(fence)
        elif start == "<!-- first:":
            k = lines.index("-->", begin)
            found.append(Fence(begin + 1, "first", tuple(lines[begin:k])))
        elif start.startswith("    ") and (k == 0 or not lines[k - 1].strip()):
            while k + 1 < len(lines) and lines[k + 1].startswith("    "):
                k += 1
            inside = tuple(line[4:] for line in lines[begin - 1 : k + 1])
            found.append(Fence(begin, "indented", inside))
        k += 1
    for fence in found:
        if fence.language in ("", "indented"):
            shown = any(line.startswith("$ ") for line in fence.lines)
            assert not shown, f"line {fence.line}: commands with output are a block of console"
    return found


def prose(text: str) -> str:
    """Return a page without its blocks, in one line."""
    lines: list[str] = text.splitlines()
    for fence in fences(text):
        begin = fence.line - 1
        lines[begin : begin + len(fence.lines)] = [""] * len(fence.lines)
    return " ".join(" ".join(line for line in lines if not line.startswith("```")).split())


def commands(fence: Fence) -> Iterator[Command]:
    """Return the commands of a block, with lines that go on joined."""
    if fence.language == "console":
        at, words, said = 0, "", []
        for line, text in enumerate(fence.lines, fence.line):
            if text.startswith("$ "):
                if words:
                    yield _command(at, words, said)
                at, words, said = line, text[2:], []
            elif words.endswith("\\"):
                words = f"{words[:-1]} {text.strip()}"
            else:
                assert words, f"line {line}: output without a command"
                said.append(text)
        if words:
            yield _command(at, words, said)
    else:
        text = "\n".join(fence.lines).replace("\\\n", " ")
        for line, words in enumerate(text.splitlines(), fence.line):
            if words.strip() and not words.startswith("#"):
                yield _command(line, words, [])


def _command(line: int, words: str, said: list[str]) -> Command:
    ends = _ENDS.search(words)
    words = re.sub(r"\s{2,}# .*$", "", words[: ends.start()] if ends else words)
    return Command(line, words.strip(), tuple(said) or None, int(ends[1]) if ends else 0)


def stands_for_many(command: str) -> bool:
    """Whether a command has a word in capitals that the reader replaces."""
    words = command.split()[1:]
    return any(place in PLACES for word in words for place in _PLACE.findall(word))


def parsed(words: list[str]) -> str | None:
    """Return what the command line says against these words; nothing is computed."""
    from anaplot.cli import main

    parse = argparse.ArgumentParser.parse_args

    def only(self: Any, *given: Any, **more: Any) -> argparse.Namespace:
        options = parse(self, *given, **more)
        options.run = lambda _options: 0
        return options

    told = io.StringIO()
    argparse.ArgumentParser.parse_args = only  # type: ignore[assignment, method-assign]
    try:
        with contextlib.redirect_stderr(told), contextlib.redirect_stdout(told):
            # what the shell does with the output is no word of it
            code = main(list(takewhile(lambda word: word not in (">", "|"), words)))
    except SystemExit as end:  # --help, --version
        code = end.code
    finally:
        argparse.ArgumentParser.parse_args = parse  # type: ignore[method-assign]
    said = told.getvalue()
    chosen = re.search(r": no '([^']*)' \((?:known|see)", said)
    return said if code and not (chosen and _PLACE.fullmatch(chosen[1])) else None


def run(command: str) -> tuple[int, str]:
    """Run a command in the folder where we are; return its exit code and what it wrote."""
    from anaplot.cli import main

    words = shlex.split(command)
    if words[0] == "cd":
        os.chdir(words[1])
        return 0, ""
    if words[0] == "anaplot" and not _SHELL.search(command):
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = main(words[1:])
            except SystemExit as end:
                code = int(end.code or 0)
        return code, out.getvalue() + err.getvalue()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHON": sys.executable}
    shell = f'anaplot() {{ "$PYTHON" -m anaplot "$@"; }}\n{command}'
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", shell],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
    )
    return done.returncode, done.stdout + done.stderr


def agrees(said: tuple[str, ...], output: str) -> bool:
    """Whether an output is what a page says."""
    parts = []
    for line in said:
        if line.strip() == "...":
            parts.append(r"(?:.*\n)*?")
        else:
            parts.append(re.escape(line.rstrip()).replace(r"\.\.\.", ".*?") + r"\n")
    text = "".join(f"{line.rstrip()}\n" for line in output.rstrip("\n").splitlines())
    return re.fullmatch("".join(parts), text) is not None


def not_printed(code: str, output: str) -> list[str]:
    """Return what comments (`# -> TEXT`) say that code prints, and it does not, in this order."""
    lines = iter(output.splitlines())
    return [said for said in _SAID.findall(code) if not any(agrees((said,), one) for one in lines)]


class Ran(NamedTuple):
    """What a command of a page did."""

    command: Command
    code: int
    output: str

    @property
    def as_said(self) -> bool:
        """Whether the page tells the truth."""
        said = self.command.said
        return self.code == self.command.ends and (said is None or agrees(said, self.output))


def run_page(text: str, name: str, folder: Path, *, left: Collection[str] = ()) -> Iterator[Ran]:
    """Run a page from top to bottom, without the languages `left`.

    What its Python raises is raised.
    """
    names: dict[str, Any] = {"__name__": name}
    with contextlib.chdir(folder), contextlib.ExitStack() as going_on:
        for fence in fences(text):
            if fence.file is not None:
                Path(fence.file).parent.mkdir(parents=True, exist_ok=True)
                Path(fence.file).write_text("".join(f"{line}\n" for line in fence.lines))
            elif fence.not_run is not None or fence.language in left:
                continue
            elif fence.language in SHELL:
                for command in commands(fence):
                    if command.words.endswith(" &"):
                        words = [sys.executable, "-m", *shlex.split(command.words[:-2])]
                        process = going_on.enter_context(
                            running(words, stdin=subprocess.DEVNULL, stderr=subprocess.STDOUT)
                        )
                        assert process.stdout is not None
                        first = process.stdout.readline()
                        # what goes on says SIMULATED; what says something else has failed
                        works = first.startswith("SIMULATED") and process.poll() is None
                        yield Ran(command, 0 if works else 1, first)
                    else:
                        yield Ran(command, *run(command.words))
            elif fence.language == "python":
                code = "\n" * (fence.line - 1) + "\n".join(fence.lines)
                with contextlib.redirect_stdout(io.StringIO()) as printed:
                    exec(compile(code, name, "exec"), names)
                missing = not_printed(code, printed.getvalue())
                assert missing == [], f"{name}:{fence.line}: not printed: {missing}"


def _now(page: Path) -> str:
    """Return a page with the output that its commands have now."""
    text = page.read_text(encoding="utf-8")
    lines: list[str | None] = list(text.splitlines())
    with tempfile.TemporaryDirectory() as folder:
        for ran in run_page(text, str(page), Path(folder)):
            if not ran.as_said:
                print(f"{page}:{ran.command.line}: ends with {ran.code}", file=sys.stderr)
                k = ran.command.line - 1
                while str(lines[k]).endswith("\\"):
                    k += 1
                for i in range(k + 1, k + 1 + len(ran.command.said or ())):
                    lines[i] = None
                if ran.command.said or ran.code != ran.command.ends:
                    now = [line.rstrip() for line in ran.output.rstrip("\n").splitlines()]
                    lines[k] = "\n".join([str(lines[k]), *now])
    return "".join(f"{line}\n" for line in lines if line is not None)


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    for argument in sys.argv[1:]:
        print(_now(Path(argument).resolve()), end="")
