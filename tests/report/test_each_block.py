"""One computation for many blocks: the same as one by one, kept, and a failing one alone fails."""

from __future__ import annotations

import errno
import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import anaplot
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange import keptlines
from anaplot.exchange.answersfile import AnswersFile
from anaplot.photogrammetry.posterior import Posterior, coordinate_name
from anaplot.report.sameasked import digest_of
from anaplot.shares.cluster import Cluster
from anaplot.shares.local import GivenExecutor


@pytest.fixture
def blocks(tmp_path: Path) -> list[anaplot.Block]:
    made = anaplot.plan.block(strips=2, photos=3, control_m=0.02, sidelap=60).result.made.block
    return [replace(made, name=f"b{k}", image_points=made.image_points[k:]) for k in range(4)]


def test_many_are_what_each_is(blocks: list[anaplot.Block]) -> None:
    alone = [anaplot.adjust(block, hypothesis_alpha=0.01).to_dict() for block in blocks]
    with ThreadPoolExecutor(3) as executor:
        found = anaplot.each(anaplot.adjust, blocks, executor=executor, hypothesis_alpha=0.01)
    assert [one.block for one in found] == ["b0", "b1", "b2", "b3"]
    assert [one.answer for one in found] == alone
    assert all(one.error is None for one in found)


def test_one_that_fails_does_not_end_the_others(
    tmp_path: Path, blocks: list[anaplot.Block]
) -> None:
    nothing = replace(blocks[0], name="nothing", image_points=())
    found = anaplot.each(
        anaplot.adjust, [blocks[0], nothing, tmp_path / "none", blocks[1]], processes=1
    )
    assert [one.error is None for one in found] == [True, False, False, True]
    assert found[1].answer is None
    assert "none" in str(found[2].error)
    assert "\n" not in f"{found[1].error}{found[2].error}"


def test_what_is_kept_is_not_done_again(tmp_path: Path, blocks: list[anaplot.Block]) -> None:
    kept = tmp_path / "kept.jsonl"
    told: list[float] = []

    class EnoughError(Exception):
        pass

    def interrupted(_: str, fraction: float) -> None:
        told.append(fraction)
        if len(told) == 2:
            raise EnoughError

    with pytest.raises(EnoughError):
        anaplot.each(anaplot.adjust, blocks, processes=1, to=kept, progress=interrupted)
    before = kept.read_bytes()
    assert before.count(b"\n") == 3
    found = anaplot.each(anaplot.adjust, blocks, processes=1, to=kept)
    assert found == anaplot.each(anaplot.adjust, blocks, processes=1)
    after = kept.read_bytes()
    assert after.startswith(before)
    assert after.count(b"\n") == 5
    # a block that has changed is another one
    rows = blocks[0].image_points
    changed = replace(blocks[0], image_points=(replace(rows[0], x=rows[0].x + 0.001), *rows[1:]))
    (one,) = anaplot.each(anaplot.adjust, [changed], processes=1, to=kept)
    assert one.answer != found[0].answer
    assert kept.read_bytes().count(b"\n") == 6


def test_a_full_disk_is_told_with_the_file_and_leaves_no_half_of_a_line(
    tmp_path: Path, blocks: list[anaplot.Block], monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "kept.jsonl"
    (one,) = anaplot.each(anaplot.adjust, blocks[:1], processes=1, to=kept)
    before = kept.read_bytes()

    def half(descriptor: int, data: bytes) -> None:
        os.write(descriptor, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(keptlines, "write_all", half)
    with pytest.raises(InputError, match=r"kept\.jsonl: No space left on device"):
        anaplot.each(anaplot.adjust, blocks[:2], processes=1, to=kept)
    assert kept.read_bytes() == before
    monkeypatch.undo()
    assert anaplot.each(anaplot.adjust, blocks[:2], processes=1, to=kept)[0] == one


def test_a_file_of_something_else_is_refused(tmp_path: Path, blocks: list[anaplot.Block]) -> None:
    kept = tmp_path / "kept.jsonl"
    anaplot.each(anaplot.adjust, blocks[:1], processes=1, to=kept)
    with pytest.raises(InputError, match="line 1: belongs to another computation: options is"):
        anaplot.each(anaplot.adjust, blocks[:1], processes=1, to=kept, datum="free")
    whole = kept.read_bytes()
    for line in (b"{}", b'{"digest":"a","flagged":1,"answer":{}}', b"[1]", b"\xff"):
        kept.write_bytes(whole + line + b"\n")
        with pytest.raises(InputError, match=r"kept\.jsonl line 3: "):
            anaplot.each(anaplot.adjust, blocks[:1], processes=1, to=kept)
        assert kept.read_bytes() == whole + line + b"\n"
    kept.write_bytes(whole + b'{"digest":"a","fla')  # torn off: cut
    assert anaplot.each(anaplot.adjust, blocks[:1], processes=1, to=kept)[0].error is None
    assert kept.read_bytes() == whole
    with pytest.raises(InputError, match=r"--on: .*must be local, or dask"):
        anaplot.each(anaplot.adjust, blocks, on="dask:/x")


@pytest.mark.parametrize("kind", [str, Path])
def test_what_is_in_files_and_objects_is_asked_too(
    tmp_path: Path, blocks: list[anaplot.Block], kind: type
) -> None:
    kept, given = tmp_path / "kept.jsonl", tmp_path / "given.npz"
    anaplot.adjust(blocks[0], posterior=given)
    alone = anaplot.adjust(blocks[1], given=given).to_dict()
    call = partial(anaplot.each, anaplot.adjust, blocks[1:2], processes=1, to=kept)
    assert call(given=kind(given))[0].answer == alone
    before = kept.read_bytes()
    assert call(given=kind(given))[0].answer == alone
    assert kept.read_bytes() == before
    given.write_bytes(given.read_bytes() + b"\n")
    with pytest.raises(InputError, match="belongs to another computation: content is"):
        call(given=kind(given))
    assert kept.read_bytes() == before


def odd(block: anaplot.Block, *, errors: dict[str, Exception]) -> object:
    if block.name in errors:
        raise errors[block.name]
    return anaplot.adjust(block)


def test_what_a_block_cannot_help_is_its_own_error(blocks: list[anaplot.Block]) -> None:
    errors = {"b0": MemoryError(), "b2": np.linalg.LinAlgError("Singular matrix")}
    found = anaplot.each(odd, blocks[:3], processes=1, errors=errors)  # type: ignore[arg-type]
    assert [one.error for one in found] == [
        "this needs more memory than there is", None, "no solution: Singular matrix"
    ]  # fmt: skip
    with pytest.raises(ArithmeticError, match="a fault"):
        anaplot.each(odd, blocks, processes=1, errors={"b1": ArithmeticError("a fault")})  # type: ignore[arg-type]


@pytest.mark.parametrize("option", ["covariance_to", "posterior", "write_camera"])
@pytest.mark.parametrize("kept", [False, True])
def test_no_block_writes_over_what_another_has_written(
    tmp_path: Path, blocks: list[anaplot.Block], option: str, kept: bool
) -> None:
    written = {option: str(tmp_path / "one.npz")}
    to = tmp_path / "kept.jsonl" if kept else None
    for compute, options in ((anaplot.adjust, written), (partial(anaplot.adjust, **written), {})):
        with pytest.raises(InputError, match=f"^{option}: every block would write .* over"):
            anaplot.each(compute, blocks[:2], processes=1, to=to, **options)
    assert list(tmp_path.iterdir()) == []


def test_functions_in_part_are_kept_by_what_they_are_given(
    tmp_path: Path, blocks: list[anaplot.Block]
) -> None:
    kept = tmp_path / "kept.jsonl"
    call = partial(anaplot.each, blocks=blocks[:1], processes=1, to=kept)
    found = call(partial(anaplot.adjust, hypothesis_alpha=0.01))
    assert found == call(partial(anaplot.adjust, hypothesis_alpha=0.01))
    with pytest.raises(InputError, match="belongs to another computation: content"):
        call(partial(anaplot.adjust, hypothesis_alpha=0.02))


def test_what_could_not_be_read_is_not_written(
    tmp_path: Path, blocks: list[anaplot.Block], monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "kept.jsonl"
    call = partial(anaplot.each, anaplot.adjust, processes=1, to=kept)
    first = call(blocks[:1])
    before = kept.read_bytes()
    monkeypatch.setattr(AnswersFile, "longest", 1000)
    kept.unlink()
    with pytest.raises(
        InputError, match=r"the answer of 'b0' has [0-9]+ bytes, a line has at most"
    ):
        call(blocks[:1])
    assert kept.read_bytes() == before.splitlines(keepends=True)[0]
    monkeypatch.undo()
    monkeypatch.setattr(AnswersFile, "largest", len(before))
    assert call(blocks[:1]) == first
    with pytest.raises(InputError, match="is full before the answer of 'b1', at most"):
        call(blocks[1:2])
    assert kept.read_bytes() == before
    assert call(blocks[:1]) == first


def test_one_at_a_time_writes_into_a_file(tmp_path: Path, blocks: list[anaplot.Block]) -> None:
    kept = tmp_path / "kept.jsonl"
    call = partial(anaplot.each, anaplot.adjust, processes=1, to=kept)
    told: list[str] = []

    def again(_: str, fraction: float) -> None:
        with pytest.raises(InputError, match="another anaplot writes into it") as error:
            call(blocks[2:])
        told.append(str(error.value))

    found = call(blocks[:2], progress=again)
    assert len(told) == 2
    assert call(blocks[:2]) == found
    assert kept.read_bytes().count(b"\n") == 3


@pytest.mark.parametrize("processes", [-1, 0, 257, True, 1.0, "2"])
def test_processes_are_a_number_of_them(processes: object) -> None:
    with pytest.raises(InputError, match=r"--processes: .* is no whole number from 1 to 256"):
        anaplot.each(anaplot.adjust, [], processes=processes)  # type: ignore[arg-type]


def test_one_block_is_not_several(blocks: list[anaplot.Block]) -> None:
    for one in ("dense", Path("dense"), blocks[0], b"dense"):
        with pytest.raises(InputError, match="blocks: one block, not several"):
            anaplot.each(anaplot.adjust, one, processes=1)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="blocks: number 2 is a int, no block and no folder"):
        anaplot.each(anaplot.adjust, [blocks[0], 3], processes=1)  # type: ignore[list-item]


def test_digests_tell_apart_what_differs() -> None:
    name = (coordinate_name("point:1:X"),)
    rows = np.arange(3000.0)
    off = rows.copy()
    off[1500] += 1e-12
    different: list[object] = [
        Posterior(name, np.array([1.0]), np.eye(1)),
        Posterior(name, np.array([1.0 + 1e-15]), np.eye(1)),
        Posterior(name, np.array([1.0]), 2.0 * np.eye(1)),
        rows, off, rows.reshape(2, -1), rows.astype(np.float32), rows.view(np.int64),
        1, 1.0, "1", None, True, [1], {1}, {1, 2}, b"1", np.float64(1), float("nan"),
        anaplot.adjust, partial(anaplot.adjust, datum="free"), partial(anaplot.adjust),
    ]  # fmt: skip
    assert len({digest_of("it", one) for one in different}) == len(different)
    assert digest_of("it", "pyproject.toml" * 900, names_files=True)
    assert digest_of("it", {1, 2, 9}) == digest_of("it", {9, 2, 1})
    assert digest_of("it", rows) == digest_of("it", np.arange(6000.0)[:3000])
    for odd in (object(), np.array([object()]), iter([1]), lambda: 1, rows.sum, Path("missing")):
        with pytest.raises(InputError) as error:
            digest_of("it", [odd])
        assert "\n" not in str(error.value)


def test_a_series_is_done_elsewhere(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    call = ["plan", "block", "--strips", "2", "--photos", "4", "--json", "--bridging"]
    assert main([*call, "2,3"]) == 0
    here = capsys.readouterr().out
    assert len(json.loads(here)["bridging"]) == 2
    assert main([*call, "2", "--on", "dask://127.0.0.1:1"]) == 2
    assert "--on goes with several bridging distances" in capsys.readouterr().err
    with ThreadPoolExecutor(2) as executor:
        asked: list[str] = []

        def there(cluster: Cluster, *of: object) -> object:
            asked.append(cluster.named())
            return GivenExecutor(executor, 2).workers(*of)  # type: ignore[arg-type]

        monkeypatch.setattr(Cluster, "workers", there)
        assert main([*call, "2,3", "--on", "dask://127.0.0.1:1"]) == 0
    assert asked == ["dask://127.0.0.1:1"]
    assert capsys.readouterr().out == here
