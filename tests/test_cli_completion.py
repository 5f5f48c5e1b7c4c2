"""`anaplot completion` in the shells themselves, and `anaplot manual` in roff."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from clibench import TIMEOUT, here

from anaplot.cli import command_parser
from anaplot.report.commandparser import CommandParser, Commands, commands_of
from anaplot.report.completion import completion_script
from anaplot.report.manualpage import manual_page

# where the words end, and what the shell proposes
CASES = [
    (("anaplot", "ad"), {"adjust"}),
    (("anaplot", "plan", "ne"), {"network"}),
    (("anaplot", "adjust", ""), {"myblock", "my other", "sub"}),
    (("anaplot", "adjust", "myblock", "--da"), {"--datum"}),
    (("anaplot", "adjust", "myblock", "--datum", ""), {"control", "minimal", "free"}),
    (("anaplot", "export", "geo"), {"geojson"}),
    (("anaplot", "export", "colmap", "myb"), {"myblock"}),
    (("anaplot", "import", "colm"), {"colmap"}),
    (("anaplot", "import", "r"), {"rays.csv"}),
    (("anaplot", "inner", "fid"), {"fid ucials.toml"}),
    (("anaplot", "new", "x", "--camera", "rmk1"), {"rmk15"}),
    (("anaplot", "open", "myblock", "--profile", "heidenhain-nd7"), {"heidenhain-nd720"}),
    (("anaplot", "plan", "pattern", "13", "13/"), {"13/3", "13/5"}),
    (("anaplot", "plan", "simulate", "strategies-til"), {"strategies-tilted"}),
    (("anaplot", "adjust", "myblock", "--additional", "eb"), {"ebner"}),
    (("anaplot", "completion", ""), {"bash", "zsh", "fish"}),
]


def run(shell: str, script: str, folder: Path) -> list[str]:
    done = subprocess.run(
        [*shell.split(), "-c", script],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
        env={"PATH": "/usr/bin:/bin", "HOME": str(folder), "LC_ALL": "C.UTF-8"},
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("here")
    for name in ("myblock", "my other", "sub"):
        (folder / name).mkdir()
    for name in ("rays.csv", "fid ucials.toml"):
        (folder / name).write_text("")
    return folder


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The script of each shell, in files named after it."""
    scripts = tmp_path_factory.mktemp("scripts")
    for shell in ("bash", "zsh", "fish"):
        text = completion_script(command_parser(), shell)
        (scripts / shell).write_text(text, encoding="utf-8")
    return scripts


def needs(shell: str) -> None:
    if shutil.which(shell, path="/usr/bin:/bin") is None:
        pytest.skip(f"there is no {shell}")


def test_bash_completes(folder: Path, scripts: Path) -> None:
    needs("bash")
    calls = []
    for words, _ in CASES:
        given = " ".join(f"'{word}'" for word in words)
        calls.append(f"COMP_WORDS=({given}); COMP_CWORD={len(words) - 1}; _shtab_anaplot")
        calls.append("printf '%s\\t' \"${COMPREPLY[@]}\"; echo")
    lines = run("bash --norc", "\n".join((f"source '{scripts / 'bash'}'", *calls)), folder)
    found = [set(filter(None, line.split("\t"))) for line in lines]
    assert found == [expected for _, expected in CASES]
    needs_quotes = f"source '{scripts / 'bash'}'; COMP_CWORD=2; _shtab_anaplot; printf '%s\\n' "
    words = "COMP_WORDS=(anaplot adjust 'my o'); "
    assert run("bash --norc", f'{words}{needs_quotes}"${{COMPREPLY[@]}}"', folder) == ["my other"]


def test_fish_completes(folder: Path, scripts: Path) -> None:
    needs("fish")
    calls = [
        f"complete -C '{' '.join(words)}' | string split -f1 \\t | string join \\t; echo ."
        for words, _ in CASES
    ]
    text = "\n".join((f"source '{scripts / 'fish'}'", *calls))
    lines = "\n".join(run("fish --no-config", text, folder)).split("\n.")[: len(CASES)]
    found = [{one.strip().rstrip("/") for one in line.split("\t")} - {""} for line in lines]
    assert found == [expected for _, expected in CASES]
    for line in ("anaplot adjust my\\ o", "anaplot import colmap my\\ o", "anaplot inner 'my o"):
        text = f"source '{scripts / 'fish'}'; complete -C {shlex.quote(line)}"
        assert run("fish --no-config", text, folder)[0].startswith("my other/")


def test_zsh_reads_it_as_a_completion(folder: Path, scripts: Path) -> None:
    needs("zsh")
    text = (scripts / "zsh").read_text(encoding="utf-8")
    assert text.startswith("#compdef anaplot\n")
    (folder / "_anaplot").write_text(text)
    script = "fpath=($PWD $fpath); autoload -U compinit; compinit -u; echo ${_comps[anaplot]}"
    assert run("zsh -f", script, folder) == ["_anaplot"]
    assert run("zsh -f -n", text, folder) == []
    (folder / "_anaplot").unlink()


def test_a_profile_cannot_command_a_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    mine = tmp_path / "anaplot" / "device_profiles"
    mine.mkdir(parents=True)
    hostile = ["$(touch gone)", "`touch gone`", "a b", "x';touch gone;'", "\x1b]0;y\x07", "--raw"]
    for name in ("my-counter", *hostile):
        (mine / f"{name}.toml").write_text("")
    for shell in ("bash", "zsh", "fish"):
        text = completion_script(command_parser(), shell)
        assert "my-counter" in text
        assert "touch" not in text
        assert "\x1b" not in text


def test_completion_and_manual_print_what_they_make(capsys: pytest.CaptureFixture[str]) -> None:
    for words, first in (
        (("completion", "zsh"), "#compdef anaplot\n"),
        (("manual",), '.TH ANAPLOT 1 "" "anaplot '),
    ):
        result = here(capsys, *words)
        assert (result.returncode, result.stderr) == (0, "")
        assert result.stdout.startswith(first)


# -- the manual page -----------------------------------------------------------------------------


def every_parser(parser: CommandParser) -> list[CommandParser]:
    below = (one for part in commands_of(parser).values() for one in every_parser(part))
    return [parser, *below]


def test_every_command_and_option_is_in_the_manual() -> None:
    parser = command_parser()
    page = manual_page(parser)
    assert page == manual_page(command_parser())
    plain = page.replace("\\-", "-")
    for one in every_parser(parser)[1:]:
        begin = plain.index(f'.SH "{one.prog.upper()}"\n')
        section = plain[begin : plain.index("\n.SH", begin)]
        for action in one._actions:
            for option in set(action.option_strings) - {"-h", "--help"}:
                assert f"\\fB{option}\\fR" in section
        assert all(example in section.replace("\\(aq", "'") for example in one.examples)


def test_roff_sees_its_own_commands_only() -> None:
    parser = CommandParser(prog="anaplot", description=".so /etc/passwd")
    commands = Commands(parser, "command")
    commands.group("'first\"")
    one = commands.add("x", None, "'so x", "anaplot x", "anaplot x --y")
    one.add_argument("--y", help="'br \\fBnot\\fR ^~`\" \u00e9\u202e 100%% of it")
    mine = manual_page(parser).splitlines()
    assert r"\&.so /etc/passwd" in mine
    assert mine.count(r"\&\(aqso x") == 2
    assert r"\&\(aqbr \efBnot\efR \(ha\(ti\(ga\(dq \[u00E9]\eu202e 100% of it" in mine
    for line in (*mine, *manual_page(command_parser()).splitlines()):
        assert line.isascii()
        if line.startswith("."):
            assert re.match(r"\.(TH|SH|SS|TP|PP|B|I|nf|fi)( |$)", line)
        assert not line.startswith("'")


@pytest.mark.parametrize("checker", ["groff -man -ww -z -Tutf8", "mandoc -Tlint -Werror"])
def test_roff_is_valid(checker: str, tmp_path: Path) -> None:
    needs(checker.split()[0])
    path = tmp_path / "anaplot.1"
    path.write_text(manual_page(command_parser()), encoding="utf-8")
    done = subprocess.run(
        [*checker.split(), str(path)],
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
