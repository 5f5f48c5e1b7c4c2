"""A desk with an instrument that is no more than numbers: nothing waits, nothing runs beside it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from anaplot.errors import AnaplotError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.readings import InPosition, Position, Record
from anaplot.session.changes import Change, ChangeLog, Happened
from anaplot.session.commanding import decide
from anaplot.session.commands import Accept, Command, Drive, NextModel
from anaplot.session.desk import Desk
from anaplot.session.draft import Decision
from anaplot.session.events import Event
from anaplot.session.heard import Abilities, DriveBegun, Heard, MarkSet, Seen
from anaplot.session.hearing import hear
from anaplot.session.requests import DriveTo, Request, SetMark, Tell
from anaplot.session.state import fold, start

__all__ = ["DRIVEN", "DRIVEN_MONO", "MONO", "UNDRIVEN", "Bench", "changes", "refusal", "told"]

DRIVEN = Abilities()
UNDRIVEN = Abilities(drives=False, moves=False)
MONO = Abilities(mono=True, drives=False, moves=False)
DRIVEN_MONO = Abilities(mono=True)
ORIGIN = Position(0.0, 0.0, 0.0, 0.0)


@dataclass
class Bench:
    """A desk, and whoever carries out what it decides.

    Attributes
    ----------
    desk
        As it stands.
    seen
        What is seen of the instrument.
    events, requests, notes
        Everything so far, in order.
    """

    desk: Desk
    seen: Seen = field(default_factory=lambda: Seen(line="live"))
    events: list[Event] = field(default_factory=list)
    requests: list[Request] = field(default_factory=list)
    notes: list[tuple[str, dict]] = field(default_factory=list)
    stands: Position = ORIGIN
    begun: int = 0

    @classmethod
    def of(
        cls, block: Block, abilities: Abilities | None = DRIVEN, *, truth=None, auto_drive=True
    ) -> Bench:
        """A bench before anything has happened."""
        return cls(Desk.at(start(block), abilities, candidates=truth, auto_drive=auto_drive))

    @property
    def told(self) -> list[str]:
        """The notices."""
        return [request.text for request in self.requests if isinstance(request, Tell)]

    def give(self, command: Command) -> Decision:
        """Give a command, and do what is asked for."""
        decision = self._follow(decide(self.desk, command, self.seen))
        if decision.refusal is not None:
            raise decision.refusal
        return decision

    def hear(self, heard: Heard) -> Decision:
        """Let the desk hear something."""
        return self._follow(hear(self.desk, heard, self.seen))

    def _follow(self, decision: Decision) -> Decision:
        before, self.desk = self.desk, decision.after
        assert fold(before.state, decision.events) == self.desk.state
        self.events += decision.events
        self.requests += decision.requests
        self.notes += [(kind, dict(payload)) for kind, payload in decision.notes]
        for request in decision.requests:
            if isinstance(request, DriveTo):
                self.stands = request.position
            if isinstance(request, DriveTo | SetMark):
                self.desk = hear(self.desk, DriveBegun(self.begun), self.seen).after
                self.begun += 1
        return decision

    def arrive(self) -> None:
        """The drive ends, and the mark is set where somebody does."""
        self.hear(InPosition(self.stands))
        if self.desk.setting:
            self.hear(MarkSet(self.begun))

    def press(self, dyr: float = 0.0) -> Decision:
        """The pedal is pressed where the plates stand, or beside."""
        at = self.stands
        # a few micrometres, always the same ones at a place
        noise = np.random.default_rng(int(abs(at.xl * at.yl) * 1e3)).normal(0.0, 0.003, 4)
        place = np.array([at.xl, at.yl, at.xr, at.yr]) + noise
        return self.hear(Record(Position(*place[:3].tolist(), float(place[3]) + dyr), "pedal"))

    def measure(self, name: str) -> None:
        """Drive to a point or fiducial, and record it."""
        if self.desk.target != name:
            self.give(Drive(name))
        self.arrive()
        decision = self.press()
        assert decision.events, decision.requests

    def measure_all(self) -> None:
        """Measure what is pending with what lies in the instrument."""
        while self.desk.mode is not None and (pending := self.desk.mode.pending):
            unit = self.desk.mode.unit
            self.measure(pending[0])
            mode = self.desk.mode
            if unit == "fiducial" and mode is not None and not mode.pending:
                self.give(Accept())

    def whole_model(self) -> None:
        """Choose the next model, and measure all of it."""
        self.give(NextModel())
        self.measure_all()
        while self.desk.outlook.next_photo is not None:
            self.give(NextModel())
            self.measure_all()

    def at_hand(self, operator: str = "the hand") -> None:
        """Have the instrument's own operator set the mark after drives."""
        self.seen = replace(self.seen, own_operator=operator)


def refusal(desk: Desk, command: Command, seen: Seen) -> str | None:
    """Return why a command cannot be given now, or None when it can."""
    try:
        refused = decide(desk, command, seen).refusal
    except AnaplotError as error:
        refused = error
    return None if refused is None else str(refused)


def changes(block: Block, history: Iterable[Happened]) -> tuple[Change, ...]:
    """What changed, in order."""
    log = ChangeLog(block)
    for happened in history:
        log.add(happened)
    return log.changes


def told(bench: Bench) -> tuple[Change, ...]:
    """What a bench's events say to a person."""
    block = bench.desk.state.block
    return changes(block, (Happened("2026-01-01T10:00:00Z", "me", e) for e in bench.events))
