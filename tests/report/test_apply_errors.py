"""`anaplot adjust --errors NAME --apply` and `--apply-undo`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from commandbench import run, written
from hypothesis import given
from hypothesis import strategies as st
from test_adjust_errors import make

from anaplot import cli
from anaplot.adjustment.strategies import STRATEGIES
from anaplot.errors import InputError
from anaplot.exchange import blockfolder
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.imagepointscsv import format_image_points
from anaplot.exchange.lockfile import FolderLock
from anaplot.photogrammetry.block import ImagePoint
from anaplot.report.applyerrors import applied, taken_back


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(make(), tmp_path / "block")


def test_what_is_rejected_is_switched_off_and_taken_back(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = read_block(folder).image_points
    clean = run(capsys, folder, "--errors", "search", "--apply")
    assert clean["applied"] == 1
    rows = read_block(folder).image_points
    changed = [(row, was) for row, was in zip(rows, before, strict=True) if row != was]
    [(row, was)] = changed
    assert (row.photo, row.point, row.use, row.reason) == ("11", "p8", "x", "search")
    assert replace(row, use="xy", reason=None) == was
    # from now on nobody has to ask for it
    again = run(capsys, folder)
    for key in ("observations", "redundancy", "sigma0"):
        assert again[key] == pytest.approx(clean[key], rel=1e-9)
    # a second time there is nothing more
    assert run(capsys, folder, "--errors", "search", "--apply")["applied"] == 0
    assert read_block(folder).image_points == rows
    # another strategy's decisions are not this one's
    run(capsys, folder, "--errors", "l1", "--apply-undo")
    assert read_block(folder).image_points == rows
    undone = run(capsys, folder, "--apply-undo")
    assert read_block(folder).image_points == before
    assert "use" not in undone["image_points"][0]  # type: ignore[index]
    assert undone["taken_back"] == 1


def test_what_is_taken_back_is_told_also_where_nothing_can_be_adjusted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    free = ["adjust", str(folder), "--datum", "free"]
    assert cli.main([*free, "--errors", "search", "--apply"]) == 0
    assert "; --datum free --apply-undo takes that back" in capsys.readouterr().out
    (folder / "control.csv").unlink()
    assert cli.main(["adjust", str(folder), "--apply-undo"]) == 4
    said = capsys.readouterr().err
    assert "; 1 image point is as before --apply: only the adjustment was not possible" in said
    assert all(row.use == "xy" for row in read_block(folder).image_points)
    assert cli.main([*free, "--apply-undo"]) == 0
    assert capsys.readouterr().out.startswith(
        "0 image points are as before --apply in image_points"
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_what_is_done_is_told_also_where_the_answer_cannot_be_written(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    full = ["--csv", "/dev/full"]
    assert cli.main(["adjust", str(folder), "--errors", "search", "--apply", *full]) == 2
    said = capsys.readouterr().err
    assert "/dev/full" in said
    assert "; 1 image point is switched off in image_points.csv all the same" in said
    assert [row.use for row in read_block(folder).image_points].count("x") == 1
    with Path("/dev/full").open("w") as stream, monkeypatch.context() as there:
        there.setattr("sys.stdout", stream)
        assert cli.main(["adjust", str(folder), "--apply-undo"]) == 2
        there.setattr("sys.stdout", open(stream.fileno(), "w", closefd=False))  # noqa: SIM115
    said = capsys.readouterr().err
    assert "standard output: No space left on device; 1 image point is as before" in said
    assert all(row.use == "xy" for row in read_block(folder).image_points)


def test_a_long_reason_is_kept_behind_the_strategies(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = read_block(folder).image_points
    at = next(k for k, row in enumerate(rows) if (row.photo, row.point) == ("11", "p8"))
    whole = (*rows[:at], replace(rows[at], reason="w" * 400), *rows[at + 1 :])
    (folder / "image_points.csv").write_text(format_image_points(whole))
    run(capsys, folder, "--errors", "search", "--apply")
    row = read_block(folder).image_points[at]
    assert (row.use, row.reason) == ("x", "search; before: xy, " + "w" * 400)
    run(capsys, folder, "--apply-undo")
    assert read_block(folder).image_points == whole


def test_the_text_says_so(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["adjust", str(folder), "--errors", "search", "--apply"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("1 image point is switched off in image_points.csv")


def test_what_has_no_row_among_the_image_points_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = make()
    first, *others = block.control
    x, y, z = first.xyz
    wrong = replace(first, xyz=(x, y, z + 30.0), sigma=(0.05,) * 3)
    whole = replace(block, control=(wrong, *(replace(c, sigma=(0.05,) * 3) for c in others)))
    folder = written(whole, tmp_path / "block")
    answer = run(capsys, folder, "--errors", "search", "--apply")
    kinds = [row["kind"] for row in answer["errors"]["rejected"]]  # type: ignore[index]
    assert kinds.count("control") == answer["not_applied"] == 1
    assert answer["applied"] == 1
    run(capsys, folder, "--apply-undo")
    assert cli.main(["adjust", str(folder), "--errors", "search", "--apply"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("1 rejected row is of control, priors or conditions: nothing is written")
    assert read_block(folder).control == whole.control


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--apply"], "--apply goes with --errors"),
        (["--errors", "search", "--apply", "--apply-undo"], "one of them"),
    ],
)
def test_options_that_do_not_go_together(
    folder: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["adjust", str(folder), *words]) == 2
    assert message in capsys.readouterr().err


def test_a_folder_that_cannot_be_written_stays_as_it_is(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (folder / "image_points.csv").read_bytes()

    def refused(path: Path, data: bytes) -> None:
        raise InputError(f"{path}: cannot be written: Read-only file system")

    monkeypatch.setattr(blockfolder, "replace_whole", refused)
    assert cli.main(["adjust", str(folder), "--errors", "search", "--apply"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1].endswith("cannot be written: Read-only file system")
    assert (folder / "image_points.csv").read_bytes() == before


def test_a_block_that_is_being_measured_is_left_alone(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "sessions").mkdir()
    lock = FolderLock(folder / "sessions" / "lock")
    before = (folder / "image_points.csv").read_bytes()
    try:
        for words in (["--errors", "search", "--apply"], ["--apply-undo"]):
            assert cli.main(["adjust", str(folder), *words]) == 2
    finally:
        lock.release()
    assert capsys.readouterr().out == ""
    assert (folder / "image_points.csv").read_bytes() == before
    # and can be had again afterwards
    assert cli.main(["adjust", str(folder), "--apply-undo"]) == 0


def test_only_what_was_applied_last_is_taken_back(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "image_points.csv"
    rows = list(read_block(folder).image_points)
    assert (rows[-1].photo, rows[-1].point) != ("11", "p8")
    rows[-1] = replace(rows[-1], use="off", reason="search")
    path.write_bytes(format_image_points(rows).encode())
    before = path.read_bytes()
    assert run(capsys, folder, "--errors", "search", "--apply")["applied"] == 1
    row = next(row for row in read_block(folder).image_points if row.point == "p8" and row.reason)
    assert (row.use, row.reason) == ("x", "search; apply: 2")
    assert cli.main(["adjust", str(folder), "--apply-undo"]) == 0
    said = "1 image point is as before --apply (1 of an earlier one stay off) in image_points.csv"
    assert capsys.readouterr().out.splitlines()[0] == said
    assert path.read_bytes() == before
    # the earlier one goes, too, when it is asked for again
    assert run(capsys, folder, "--apply-undo")["taken_back"] == 1
    assert all(row.use == "xy" for row in read_block(folder).image_points)


def switched(folder: Path, said: dict[str, tuple[str, str]]) -> None:
    """Write rows of photo 11 with other uses and reasons."""
    rows = [
        replace(row, use=said[row.point][0], reason=said[row.point][1])  # type: ignore[arg-type]
        if row.photo == "11" and row.point in said
        else row
        for row in read_block(folder).image_points
    ]
    (folder / "image_points.csv").write_bytes(format_image_points(rows).encode())


def uses(folder: Path) -> dict[str, tuple[str, str | None]]:
    rows = read_block(folder).image_points
    return {row.point: (row.use, row.reason) for row in rows if row.use != "xy"}


def test_what_lies_beneath_another_strategy_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    above = ("off", "huber; before: y, search; apply: 2")
    switched(folder, {"p6": above, "p7": ("off", "search")})
    undo = ["adjust", str(folder), "--errors", "search", "--apply-undo"]
    for count in ("1 image point is", "0 image points are"):
        assert cli.main(undo) == 0
        said = "as before --apply (1 lies beneath huber: take that back first) in image_points.csv"
        assert capsys.readouterr().out.splitlines()[0] == f"{count} {said}"
        assert uses(folder) == {"p6": above}
    assert cli.main(["adjust", str(folder), "--errors", "huber", "--apply-undo"]) == 0
    assert uses(folder) == {"p6": ("y", "search; apply: 2")}
    capsys.readouterr()
    assert run(capsys, folder, "--apply-undo")["taken_back"] == 1
    assert uses(folder) == {}


def test_a_time_that_is_too_high_is_a_persons_own_text(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = {"p6": ("off", "search; apply: 10000"), "p7": ("off", "tau; apply: 9999")}
    switched(folder, own)
    before = (folder / "image_points.csv").read_bytes()
    assert run(capsys, folder, "--errors", "search", "--apply")["applied"] == 1
    assert uses(folder) == {**own, "p8": ("x", "search")}
    assert run(capsys, folder, "--errors", "search", "--apply-undo")["taken_back"] == 1
    assert (folder / "image_points.csv").read_bytes() == before
    # none could be written after the last
    assert cli.main(["adjust", str(folder), "--errors", "tau", "--apply"]) == 2
    assert "reason 'tau; apply: 9999' is the last: no row goes" in capsys.readouterr().err
    assert (folder / "image_points.csv").read_bytes() == before


@pytest.mark.parametrize(
    "said",
    [
        {"p6": ("off", "search; before: y, search; apply: 2")},
        {
            "p6": ("off", "tau; before: x, l1; apply: 2"),
            "p7": ("off", "l1; before: y, tau; apply: 2"),
        },
    ],
)
def test_times_that_no_program_wrote_are_taken_back_one_by_one(
    folder: Path, said: dict[str, tuple[str, str]]
) -> None:
    switched(folder, said)
    rows = read_block(folder).image_points
    for _ in range(4):
        rows = taken_back(rows, STRATEGIES)
    assert all(row.use == "xy" and row.reason is None for row in rows)


@pytest.mark.parametrize("columns", [("model",), ("use",), ("reason", "model"), ("use", "reason")])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_a_file_is_taken_back_to_the_byte(
    folder: Path, mark: bytes, columns: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "image_points.csv"
    ends, lines = ("\r\n", "\n", "\r\n", "\r"), [f"y, x ,photo,point,{','.join(columns)}"]
    for k, row in enumerate(read_block(folder).image_points):
        use = " " if mark else '"xy"'
        said = {"use": use, "reason": '""' if mark else "", "model": ""}
        beside = ",".join(said[name] for name in columns)
        lines.append(f'{row.y!r}0,  {row.x:+.17e} ,{row.photo},"{row.point}",{beside}')
        lines += [" "] * (k == 7)
    text = "".join(line + ends[k % 4] for k, line in enumerate(lines)).rstrip("\r\n")
    before = mark + text.encode()
    path.write_bytes(before)
    assert run(capsys, folder, "--errors", "search", "--apply")["applied"] == 1
    after = path.read_bytes()
    assert after != before
    assert after.count(b"\r\n") == before.count(b"\r\n")
    [row] = [row for row in read_block(folder).image_points if row.use != "xy"]
    assert (row.photo, row.point, row.reason) == ("11", "p8", "search")
    assert run(capsys, folder, "--apply-undo")["taken_back"] == 1
    assert path.read_bytes() == before


USES = st.sampled_from(["xy", "x", "y", "off"])
REASONS = st.sampled_from(
    [None, "a lorry", "search it again", "x; before: y", "dust, or a hair", "tau", "l1; apply: 7"]
)
NAMES = st.lists(
    st.tuples(
        st.sampled_from(STRATEGIES), st.sets(st.tuples(st.integers(0, 4), st.sampled_from("xy")))
    ),
    max_size=4,
)


@given(st.lists(st.tuples(USES, REASONS), min_size=5, max_size=5), NAMES)
def test_everything_comes_back(decided: list[tuple[str, str | None]], steps: list) -> None:  # type: ignore[type-arg]
    before = tuple(
        ImagePoint("1", str(k), 1.0, 2.0, use=use, reason=reason)  # type: ignore[arg-type]
        for k, (use, reason) in enumerate(decided)
    )
    rows, history = before, []
    for strategy, rejected in steps:
        names = [("image", "1", str(k), None, axis) for k, axis in sorted(rejected)]
        names.append(("control", "0", "X"))  # type: ignore[arg-type]
        old, rows = rows, applied(rows, names, strategy)
        for k, (row, was) in enumerate(zip(rows, old, strict=True)):
            for axis in "xy":
                assert row.counts(axis) == (was.counts(axis) and (k, axis) not in rejected)
        if rows != old:
            history.append((strategy, old))
    # step by step, also where a name stood there before
    for strategy, old in reversed(history):
        rows = taken_back(rows, [strategy])
        assert rows == old


def test_nothing_is_applied_to_a_file_that_contradicts_its_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # it was written, and nobody could open it any more
    session = Path(__file__).parents[1] / "sessions" / "changes.jsonl"
    block = tmp_path / "b"
    assert cli.main(["replay", str(session), "--to", str(block)]) == 0
    (block / "sessions").mkdir()
    (block / "sessions" / "0001.jsonl").write_bytes(session.read_bytes())
    command = ["adjust", str(block), "--datum", "free", "--errors", "rms", "--apply"]
    file = block / "image_points.csv"
    header, first, *rows = file.read_text().splitlines(keepends=True)
    photo, point, x, *rest = first.split(",")
    file.write_text(
        "".join([header, ",".join([photo, point, f"{float(x) + 0.05:.4f}", *rest]), *rows])
    )
    before = file.read_bytes()
    capsys.readouterr()
    assert cli.main(command) == 2
    said = capsys.readouterr().err
    assert point in said
    assert said.endswith("nothing is written\n")
    assert file.read_bytes() == before
