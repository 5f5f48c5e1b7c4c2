"""A place of work without threads, files and real time, at a simulated plotter.

The plotter's bytes go through the decoder, what the desk asks for goes to the plotter as bytes, and
the automatic operator works as at any station. While he waits, simulated time passes.
"""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
from syntheticblocks import SyntheticBlock

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.bundle.solve.namedpoints import point_places
from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block, write_control
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Block
from anaplot.plotter.conversation import Conversation
from anaplot.plotter.device.hand import Hand, HandSettled, Offsets
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.profile import load_profile
from anaplot.session.commanding import decide
from anaplot.session.commands import Command
from anaplot.session.desk import DEFAULT_PATTERN, Desk
from anaplot.session.draft import Decision
from anaplot.session.heard import Abilities, DriveBegun, MarkSet, Seen
from anaplot.session.hearing import hear
from anaplot.session.requests import DriveTo, Lay
from anaplot.session.state import SessionState, start
from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.demo import rough
from anaplot.simulation.laidplates import laid_photographs, random_placements
from anaplot.station.blockwatch import BlockWatch
from anaplot.station.commanded import Commanded
from anaplot.station.livestatus import LiveStatus
from anaplot.station.snapshot import LinkView, Snapshot, snapshot_of

__all__ = ["Workplace", "block_of_options", "misfit"]

_LINK = "main"


class Workplace(Commanded):
    """A desk at a simulated plotter, where one thing happens after the other.

    Parameters
    ----------
    block
        As declared.
    truth
        True ideal image coordinates [mm] by photo and point.
    seed
        Of the simulated pointing, and of how the photographs lie.
    mistakes
        As `SimulatedPlotter` has them.
    watched
        Whether the block is adjusted whenever a model is complete, and its verdict waited for.
    """

    instrument = None
    standing = False  # the hand presses the pedal by itself: nobody waits for the key
    settled = False

    def __init__(
        self,
        block: Block,
        truth,
        *,
        seed: int,
        mistakes: dict[tuple[str, str, str], Offsets] | None = None,
        watched: bool = True,
    ) -> None:
        super().__init__(Path("no folder"))
        self._block = block
        profile = load_profile("simulated")
        left, right = laid_photographs(block, truth, random_placements(block, seed))
        self.plotter = SimulatedPlotter(
            profile,
            left,
            in_right=right,
            seed=seed,
            noise_um=block.precision.image_um,
            hand=Hand(auto_pedal=True),
            mistakes=mistakes,
            on_settled=self._settled,
        )
        self.conversation = Conversation(
            profile,
            threading.RLock(),
            on_reading=self._hear,
            on_traffic=None,
            on_decoder=None,
            clock=lambda: self.plotter.now,
            speed_limits=False,
        )
        self.conversation.begin(referenced=True)
        self.desk = Desk.at(
            start(block),
            Abilities(),
            point_pattern=pattern(DEFAULT_PATTERN),
            candidates=rough(truth),
            control=block.control,
        )
        self._ever: set[str] = set()
        self._serial = 0
        self._status = LiveStatus("block")
        self._watch: BlockWatch | None = None
        self._adjusted = threading.Event()
        if watched:
            self._watch = BlockWatch(self._adjusted.set, rest=0.0)

    # -- as a station is looked at ---------------------------------------------------------------

    @property
    def block(self) -> Block:
        return self._block

    @property
    def state(self) -> SessionState:
        return self.desk.state

    def close(self) -> None:
        if self._watch is not None:
            self._watch.close()

    def snapshot(self) -> Snapshot:
        status = None
        if self._watch is not None:
            status = self._status.now(self._block, self.desk, *self._verdict(self._watch))
        self._serial += 1
        return snapshot_of(self.desk, self._serial, LinkView("live", simulated=True), status)

    def _verdict(self, watch: BlockWatch):
        watch.tell(self._block, self.state, self.desk.outlook, self._ever)
        while True:
            self._adjusted.clear()
            view = watch.view
            if view is None or not view.busy:
                return view, watch.tables
            assert self._adjusted.wait(60.0)

    # -- the one way in --------------------------------------------------------------------------

    def give(self, command: Command) -> None:
        decision = self._follow(decide(self.desk, command, self._seen))
        if decision.refusal is not None:
            raise decision.refusal

    def _hear(self, heard) -> None:
        self._follow(hear(self.desk, heard, self._seen))

    @property
    def _seen(self) -> Seen:
        latest = self.conversation.latest()
        position = None if latest is None else latest[0]
        return Seen(self.plotter.now, "the simulated hand", "live", position=position)

    def _follow(self, decision: Decision) -> Decision:
        self.desk = decision.after
        self._ever |= {model.name for model in self.state.models}
        for request in decision.requests:
            if isinstance(request, Lay):
                self.plotter.lay(request.left, request.right, request.side, request.placed)
            elif isinstance(request, DriveTo):
                self._drive(request)
        return decision

    def _drive(self, request: DriveTo) -> None:
        self.plotter.attend(request.side)
        self._hear(DriveBegun(self.plotter.drives))
        command = self.conversation.decoder.drive_command(request.position)
        self.conversation.sent(_LINK, command)
        self.plotter.receive(command, _LINK)

    def _settled(self, settled: HandSettled) -> None:
        assert settled.point is not None
        self._hear(MarkSet(settled.drive))

    def passes(self, _seconds: float) -> None:
        """Let simulated time pass until the plotter has said something."""
        while True:
            until = self.plotter.next_event()
            assert until is not None, "the plotter stands, and nobody has anything to do"
            self.plotter.advance(until)
            data = self.plotter.take(_LINK)
            if data:
                self.conversation.received(_LINK, data)
                return

    def measured(self) -> AutomaticOperator:
        """Have the automatic operator measure the whole block, and return him."""
        operator = AutomaticOperator(self, wait=self.passes)
        operator.run()
        return operator


def block_of_options(made: SyntheticBlock, folder: Path, camera: str) -> Path:
    """Make a block folder of a synthetic block by the options of `anaplot new`, and return it.

    Parameters
    ----------
    made
        The block.
    folder
        Takes the list of control, too.
    camera
        As `--camera` has it.
    """
    folder.mkdir(exist_ok=True)
    write_control(folder, made.block.control)
    out = folder / "block"
    options = ["--camera", camera, "--control", str(folder / "control.csv")]
    for strip in made.block.strips:
        options += ["--strip", f"{strip.photos[0]}-{strip.photos[-1]}"]
    assert main(["new", str(out), *options]) == 0
    assert [strip.photos for strip in read_block(out).strips] == [
        strip.photos for strip in made.block.strips
    ]
    return out


def misfit(adjusted: AdjustedBlock, made: SyntheticBlock) -> tuple[float, int]:
    """Return d' C^-1 d of the errors d of all ground coordinates, and how many they are.

    C is their whole covariance matrix with the a-priori sigma0: a chi-square, if it is right.
    """
    names = adjusted.problem.points
    true = np.array([made.ground[name] for name in names])
    errors = (point_places(adjusted, names) - true).ravel()
    at = [(k, axis) for k in range(len(names)) for axis in range(3)]
    covariance = coordinate_cofactors(adjusted, at)
    return float(errors @ np.linalg.solve(covariance, errors)), len(at)
