"""The block of a demonstration goes with it, unless the operator keeps it."""

from argparse import Namespace

import pytest

from anaplot.exchange.blockfolder import read_block
from anaplot.report.democommand import demo_block


@pytest.fixture
def options():
    nothing = dict.fromkeys(("json", "all", "auto", "fiducials"), False)
    return Namespace(**nothing, csv=None, tables=None, keep=None, models=2, seed=1)


def test_a_demo_is_deleted(options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with demo_block(options) as (_, folder, keeping):
        assert read_block(folder).strips
    assert keeping.folder is None
    assert not folder.parent.exists()
    assert list(tmp_path.iterdir()) == []


def test_a_demo_that_is_kept_stands_here_under_a_free_name(options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "anaplot-demo").write_text("mine")
    with demo_block(options) as (_, folder, keeping):
        block = read_block(folder)
        keeping.keep(folder)
    assert not folder.parent.exists()
    assert str(keeping.folder) == "anaplot-demo-2"
    assert read_block(tmp_path / "anaplot-demo-2") == block
    assert (tmp_path / "anaplot-demo").read_text() == "mine"


def test_where_nothing_can_be_written_it_stays_where_it_is(options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def full(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("anaplot.report.democommand.shutil.copytree", full)
    with demo_block(options) as (_, folder, keeping):
        keeping.keep(folder)
    assert keeping.folder == folder
    assert read_block(folder).strips
