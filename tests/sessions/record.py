"""Record the corpus: sessions of the automatic operator, and the tables that they must give.

    python tests/sessions/record.py [NAME ...]

Without names, those that are not there yet. What is recorded stays what a program of its day
wrote: an old session is not recorded again because the program has changed.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "station"))

from faultyjobs import Scene, run_job, scene  # noqa: E402

from anaplot.cli import main as command  # noqa: E402
from anaplot.plotter.device.faults import FAULTS, FRAME_FAULTS  # noqa: E402
from anaplot.plotter.device.hand import Offsets  # noqa: E402
from anaplot.plotter.profile import find_profiles  # noqa: E402
from anaplot.simulation.automatic import AutomaticOperator  # noqa: E402
from anaplot.simulation.demo import Demo  # noqa: E402
from anaplot.station.station import Station  # noqa: E402

CONFIRMED = ("anaplot-ascii", "heidenhain-nd281b", "summagraphics-mm1201")
TABLET = "summagraphics-mm1103"
PARALLAX = {("102", "103", "103-2"): Offsets(dyr=0.2)}
WRONG = {("101", "102", "102-2"): Offsets(dyr=0.15)}

Recorder = Callable[[Path], str]


def on_a_profile(profile: str) -> Recorder:
    """A strip of two models, with one gross parallax, measured on an instrument."""

    def record(folder: Path) -> str:
        story = (
            f"Two models on {profile}; the y-parallax at 103-2 was set wrong once, was flagged, "
            "and was measured again."
        )
        made = scene(image_um=130.0 if profile == TABLET else 5.0)
        mistakes = {key: Offsets(dyr=1.5) for key in PARALLAX} if profile == TABLET else PARALLAX
        # a tablet of so coarse steps, and few points of it
        pattern = "6" if profile == TABLET else "9"
        run_job(folder, made, profile, mistakes=mistakes, pattern=pattern, story=story)
        return story

    return record


def through_a_fault(fault: str) -> Recorder:
    """Two models over a line that a fault strikes twice."""

    def record(folder: Path) -> str:
        story = (
            f"Two models; the line was struck by '{fault}' after 2 and after 11 measurements. "
            "What was lost or refused was measured again."
        )
        profile = "simulated" if fault in FRAME_FAULTS else "anaplot-ascii"
        run_job(folder, scene(), profile, fault=fault, mistakes=PARALLAX, story=story)
        return story

    return record


def with_fiducials(folder: Path) -> str:
    """Inner orientation of every photograph, one fiducial missed."""
    story = (
        "One model of photographs with eight fiducials, shifted, turned and shrunk in their "
        "carriages; one fiducial was missed, named, and measured again."
    )
    demo = Demo.make(1, 3, fiducials=True)
    demo.write(folder)
    with Station(
        folder,
        plotter=demo.simulation(1000.0),
        operator="tester",
        candidates=demo.candidates,
        story=story,
    ) as station:
        AutomaticOperator(station).run()
    return story


def with_changes(folder: Path) -> str:
    """Rows switched off and on, a step taken back, a model left unfinished, another day."""
    story = (
        "Two models; after the first a row was switched off and a step taken back; then the "
        "session was closed within the second model and opened again."
    )
    made: Scene = scene()
    run_job(
        folder,
        made,
        "simulated",
        mistakes=WRONG,
        story=story,
        limit=lambda picture: bool(picture.accepted) and sum(p.times for p in picture.points) > 3,
    )
    with Station(folder, operator="tester", story=story) as station:
        measured = [p.point for p in station.snapshot().points if p.times]
        station.switch(measured[0], None, False)
        station.switch(measured[1], "y", False)
        station.undo()
    run_job(folder, made, "simulated", story=story)
    return story


def torn(folder: Path) -> str:
    """The tail of a journal whose machine lost its power in the middle of a record."""
    story = "One model and the beginning of another; the last record is torn off in its middle."
    run_job(
        folder,
        scene(),
        "simulated",
        story=story,
        limit=lambda picture: bool(picture.accepted) and sum(p.times for p in picture.points) > 3,
    )
    path = folder / "sessions" / "0001.jsonl"
    data = path.read_bytes()
    path.write_bytes(data[: data.rstrip(b"\n").rfind(b"\n") + 40])
    return story


def recorders() -> dict[str, Recorder]:
    """Return all recordings by name."""
    out: dict[str, Recorder] = {f"profile-{p}": on_a_profile(p) for p in find_profiles()}
    # measured by the rules of today, which the first of these sessions were not
    out |= {f"confirmed-{p}": on_a_profile(p) for p in CONFIRMED}
    out |= {f"fault-{fault}": through_a_fault(fault) for fault in FAULTS}
    out |= {"fiducials": with_fiducials, "changes": with_changes, "torn-tail": torn}
    return out


def tables(session: Path) -> str:
    """Return what `anaplot replay SESSION --json` prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        code = command(["replay", str(session), "--json"])
    assert code == 0
    return out.getvalue()


def main() -> None:
    """Record what was asked for."""
    known = recorders()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("names", nargs="*", choices=[*known, []], metavar="NAME")
    names = parser.parse_args().names or [
        name for name in known if not (HERE / f"{name}.jsonl").exists()
    ]
    for name in names:
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made) / "block"
            story = known[name](folder)
            files = sorted((folder / "sessions").glob("*.jsonl"))
            target = HERE / f"{name}.jsonl"
            target.write_bytes(b"".join(file.read_bytes() for file in files))
        (HERE / f"{name}.tables.json").write_text(tables(target))
        print(f"{name}: {target.stat().st_size} bytes: {story}")


if __name__ == "__main__":
    main()
