"""Every named fault against every profile, a whole strip measured through it.

The plates hold the noise, so that every pointing at a point gives the same and the final tables
can be compared to the last digit.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import pytest
from faultyjobs import Job, Scene, Tables, run_job, scene

from anaplot.plotter.device.faults import FAULTS, FRAME_FAULTS
from anaplot.plotter.device.hand import Offsets
from anaplot.plotter.profile import find_profiles, load_profile
from anaplot.simulation import automatic
from anaplot.station.replay import replay_session

TABLET = "summagraphics-mm1103"
PROFILES = sorted(find_profiles())
MISTAKE = {("102", "103", "103-2"): Offsets(dyr=1.5)}


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    # a lost record is waited for in real time
    monkeypatch.setattr(automatic, "_PATIENCE", 0.3)


@pytest.fixture(scope="session")
def quick_profile(tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    """Profiles whose answers are not waited for as long as at a real instrument."""
    folder = tmp_path_factory.mktemp("profiles")

    def path(profile: str) -> str:
        text = load_profile(profile).text
        file = folder / f"{profile}.toml"
        if "latency =" not in text.partition("[simulate]")[0]:
            text = text.replace("[poll]\n", "[poll]\nlatency = 0.6\n")
        file.write_text(text)
        return str(file)

    return path


def the_scene(profile: str) -> Scene:
    # the tablet's steps are coarse
    return scene(image_um=130.0 if profile == TABLET else 5.0)


def the_pattern(profile: str) -> str:
    # its key counts as released after 0.3 s of real time: fewer points
    return "6" if profile == TABLET else "9"


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, quick_profile):  # type: ignore[no-untyped-def]
    @lru_cache
    def tables(profile: str) -> Tables:
        folder = tmp_path_factory.mktemp("calm") / "block"
        job = run_job(
            folder,
            the_scene(profile),
            quick_profile(profile),
            pattern=the_pattern(profile),
            mistakes=MISTAKE,
        )
        told = [text for severity, text in job.notices if severity in ("warning", "error")]
        # a stream is joined in the middle of a record; patterns are small here, to be quick
        expected = "flagged", "line: the start was missed", "not suitable for on-line"
        assert all(any(words in text for words in expected) for text in told), told
        return job.tables

    return tables


def faultless_apart_from_what_was_told(job: Job, expected: Tables, folder: Path) -> None:
    assert job.tables == expected
    assert [len(rows) for _, rows in expected] in ([9, 12], [6, 9])
    replayed = replay_session(folder)
    assert replayed.differences == ()
    assert replayed.tables > 0


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_strip_measured_through_a_fault(
    fault: str, profile: str, tmp_path: Path, undisturbed, quick_profile
) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "block"
    job = run_job(
        folder,
        the_scene(profile),
        quick_profile(profile),
        fault=fault,
        pattern=the_pattern(profile),
        mistakes=MISTAKE,
    )
    assert job.injected == 2
    faultless_apart_from_what_was_told(job, undisturbed(profile), folder)
    told = " ".join(text for severity, text in job.notices if severity in ("warning", "error"))
    if fault == "disconnect":
        assert "link lost" in told
    elif fault in ("drop", "flip", "partial", "wrong-baud"):
        # refused, with the reason, before the eyes of the operator
        assert "line: " in told


@pytest.mark.parametrize("profile", PROFILES)
def test_a_strip_over_a_bad_line(profile: str, tmp_path: Path, undisturbed, quick_profile) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "block"
    rates = dict.fromkeys(FRAME_FAULTS, 0.02)
    if any(record.confirm > 1 for record in load_profile(profile).records.values()):
        # a record damaged and doubled at once looks like two presses: no line without a checksum
        # can tell them apart
        del rates["duplicate"]
    job = run_job(
        folder,
        the_scene(profile),
        quick_profile(profile),
        rates=rates,
        pattern=the_pattern(profile),
        mistakes=MISTAKE,
    )
    faultless_apart_from_what_was_told(job, undisturbed(profile), folder)
