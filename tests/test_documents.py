"""The documents name what is there, and what they say is so: every command and example is run.

How a page is written that it can be run: `tests/documentpages.py`. What is not run is counted here.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from documentpages import RUN, SHELL, commands, fences, parsed, prose, run_page, stands_for_many
from extras import needed

from anaplot.plotter.profile import find_profiles, load_profile

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
FILE = re.compile(r"`((?:[\w-]+/)*[\w-]+\.(?:py|toml|md)|(?:[\w-]+/)+)`")
LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)")
INLINE = re.compile(r"`(anaplot [a-z][^`]*)`")

# what another test runs, by page and language
ELSEWHERE = {
    ("library.md", "python"): "tests/test_library.py",
    ("formats.md", "python"): "tests/exchange/formats/test_formats_page.py",
    ("papers.md", "inline"): "tests/test_papers.py",
}
# blocks that cannot be run, each with its reason on the line above it
NOT_RUN = {
    "README.md": 1,
    "cluster.md": 1,
    "documents.md": 2,
    "errors.md": 1,
    "handbook.md": 1,
    "instruments.md": 1,
    "teaching.md": 2,
}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


def test_the_house_stands_as_it_is_described() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = FILE.findall(page)
    assert len(named) > 40
    missing = [n for n in named if not any((at / n).exists() for at in (ROOT, ROOT / "anaplot"))]
    assert missing == []
    rooms = {p.name for p in (ROOT / "anaplot").iterdir() if (p / "__init__.py").is_file()}
    assert rooms == {n.rstrip("/") for n in re.findall(r"^\| `(\w+/)`", page, re.MULTILINE)}


def language_runs(page: Path, language: str) -> bool:
    return language in RUN and (page.name, language) not in ELSEWHERE


@pytest.mark.slow
def test_the_verdicts_of_the_handbook_are_said() -> None:
    """Their words, without names and numbers, stand in the program."""
    page = (ROOT / "docs" / "handbook.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (\"[^|]*) \|", page.split("## What to do with each verdict")[1], re.MULTILINE
    )
    said = [words for row in rows for words in re.findall(r'"([^"]+)"', row)]
    assert len(said) > 10
    source = "".join(
        re.sub(r'"\s*f?"', "", path.read_text(encoding="utf-8"))
        for path in sorted((ROOT / "anaplot").rglob("*.py"))
    )
    source = re.sub(r"\s+", " ", source)
    parts = {
        part.strip()
        for words in said
        for part in re.split(r"\b(?:P|Q|[xy]|[\d./]+)\b|[():]", words)
        if len(part.strip()) > 4
    }
    assert {part for part in parts if part not in source} == set()


def test_the_instruments_are_those_that_ship() -> None:
    page = (ROOT / "docs" / "instruments.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([\w-]+)` \|[^|]*\| (two|one) \| (yes|) *\|", page, re.MULTILINE)
    shipped = {name: load_profile(name) for name in find_profiles()}
    assert {(name, "two" if len(of.axes) == 4 else "one", "yes" if of.drive else "")
            for name, of in shipped.items()} == set(rows)  # fmt: skip


def test_what_is_run_elsewhere_is() -> None:
    for (page, _), test in ELSEWHERE.items():
        assert page in (ROOT / test).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_is_known(page: Path) -> None:
    """Also those that stand for many, and those within a sentence."""
    text = page.read_text(encoding="utf-8")
    wrong = []
    for fence in fences(text):
        shell = fence.language in SHELL
        if shell or fence.language in ("", "indented"):
            calls = [one for one in commands(fence) if one.words.startswith("anaplot ")]
            many = all(stands_for_many(one.words) for one in calls)
            assert shell or many, f"line {fence.line}: a block of bash, or console"
            # what is shown to be refused is run, and the answer compared
            right = [one.words for one in calls if one.ends != 2]
            told = [(words, parsed(shlex.split(words.removesuffix(" &"))[1:])) for words in right]
            wrong += [(fence.line, *one) for one in told if one[1] is not None]
    if (page.name, "inline") not in ELSEWHERE:
        for words in sorted(set(INLINE.findall(prose(text)))):
            said = parsed(shlex.split(words.split(" ...")[0])[1:])
            # in a sentence a command may stand without what it is about
            if said is not None and not re.search(
                r"required| what\? |expected (one|at least one)", said
            ):
                wrong.append((0, words, said))
    assert wrong == []


def test_what_is_not_run_is_counted() -> None:
    found: dict[str, int] = {}
    for page in PAGES:
        for fence in fences(page.read_text(encoding="utf-8")):
            if fence.not_run is not None:
                assert fence.language in RUN
                assert len(fence.not_run) > 10
                found[page.name] = found.get(page.name, 0) + 1
    assert found == NOT_RUN


def runs(page: Path) -> bool:
    found = fences(page.read_text(encoding="utf-8"))
    return any(f.not_run is None and language_runs(page, f.language) for f in found)


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if runs(p)], ids=lambda page: page.name)
def test_every_command_and_example_does_what_the_page_says(page: Path, tmp_path: Path) -> None:
    left = {language for of, language in ELSEWHERE if of == page.name}
    text = page.read_text(encoding="utf-8")
    wrong = [
        f"{page.name}:{ran.command.line}: $ {ran.command.words}\n"
        f"ends with {ran.code}, and says\n{ran.output}"
        for ran in run_page(text, page.name, tmp_path, left=left)
        if not ran.as_said
    ]
    assert wrong == [], "\n".join(wrong)


# --- the runner -----------------------------------------------------------------------------

PAGE = """
# A page

<!-- file: there/note.txt -->
```text
seven
```

```console
$ cat there/note.txt
seven
$ anaplot adjust nowhere   # ends with 2
anaplot: nowhere...
$ printf 'a\\nb\\nc\\n'
a
...
c
```

<!-- not run: it would take a day -->
```bash
false
```

    anaplot adjust BLOCK --errors NAME
"""


def test_a_page_is_run_and_compared(tmp_path: Path) -> None:
    ran = list(run_page(PAGE, "page", tmp_path))
    assert [one.as_said for one in ran] == [True, True, True]
    for k, said in ((0, ("eight",)), (2, ("a", "...", "d")), (2, ("a", "c")), (2, ("a", "b"))):
        changed = ran[k].command._replace(said=said)
        assert not ran[k]._replace(command=changed).as_said
    assert not ran[1]._replace(command=ran[1].command._replace(ends=0)).as_said
    many = [one for f in fences(PAGE) for one in commands(f) if stands_for_many(one.words)]
    assert [one.words for one in many] == ["anaplot adjust BLOCK --errors NAME"]
    assert parsed(["adjust", "b", "--errors", "odds"]) is None
    assert "--erors" in (parsed(["adjust", "b", "--erors", "odds"]) or "")
    [shown] = run_page("```bash\nanaplot plotter nosuch &\n```\n", "page", tmp_path)
    assert not shown.as_said
    [refused] = run_page("```bash\nanaplot adjust b --prior XY\n```\n", "page", tmp_path)
    assert not refused.as_said
    printed = "```python\nprint(7)  # -> 7\nprint('a 8')  # -> ... {}\n```\n"
    assert list(run_page(printed.format("8"), "page", tmp_path)) == []
    with pytest.raises(AssertionError, match=r"not printed: \[.\.\.\. 9"):
        list(run_page(printed.format("9"), "page", tmp_path))
    with pytest.raises(ZeroDivisionError):
        list(run_page("```python\n1 / 0\n```\n", "page", tmp_path))


@pytest.mark.parametrize(
    "page",
    [
        "```sh\nfalse\n```\n",
        "~~~bash\nfalse\n~~~\n",
        "- one\n\n  ```bash\n  false\n  ```\n",
        "```\n$ false\n```\n",
        "    $ false\n",
        "<!-- file: a -->\n```console\n$ false\n```\n",
    ],
)
def test_what_would_be_run_by_nobody_is_refused(page: str) -> None:
    with pytest.raises(AssertionError, match=r"line [1-6]:"):
        fences(page)


def test_a_missing_extra_is_an_error_where_it_has_to_be_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("ANAPLOT_EXTRAS", raising=False)
    with pytest.raises(pytest.skip.Exception, match="the extra docs is not installed"):
        needed("no_such_module", "docs")
    monkeypatch.setenv("ANAPLOT_EXTRAS", "1")
    with pytest.raises(ModuleNotFoundError):
        needed("no_such_module", "docs")
