"""A decision, and a decision in the making."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from anaplot.errors import AnaplotError, InputError
from anaplot.photogrammetry.readings import UNREFERENCED, Position
from anaplot.session.desk import Desk
from anaplot.session.events import Event
from anaplot.session.heard import Abilities, Seen
from anaplot.session.modelstate import ModelState
from anaplot.session.modes import Mode
from anaplot.session.notes import Note, NoteKind
from anaplot.session.repeating import Repeating
from anaplot.session.requests import DriveTo, Request, Severity, Tell

__all__ = ["Decision", "Draft"]


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """What follows from a command, or from something heard.

    Attributes
    ----------
    after
        The desk afterwards.
    events
        What has happened: nothing of this decision holds before they are in the journal.
    notes
        (kind, payload) that explain, for the journal.
    requests
        What is asked for, in order.
    refusal
        Why not everything that was wanted could be done; to be raised when the rest is done.
    """

    after: Desk
    events: tuple[Event, ...] = ()
    notes: tuple[Note, ...] = ()
    requests: tuple[Request, ...] = ()
    refusal: AnaplotError | None = None


class Draft:
    """A decision in the making, of one command or of one thing heard.

    Parameters
    ----------
    desk
        As it stands.
    seen
        What is seen of the instrument.
    """

    def __init__(self, desk: Desk, seen: Seen) -> None:
        self.desk = desk
        self.seen = seen
        self.refused: AnaplotError | None = None
        self._events: list[Event] = []
        self._notes: list[Note] = []
        self._requests: list[Request] = []

    def decision(self) -> Decision:
        """Return what was decided."""
        return Decision(
            self.desk,
            tuple(self._events),
            tuple(self._notes),
            tuple(self._requests),
            self.refused,
        )

    def happen(self, *events: Event) -> None:
        """Let events happen, all of them or none.

        Raises
        ------
        EventRefusedError
            One of them cannot.
        """
        self.desk = self.desk.folded(*events)
        self._events += events

    def note(self, kind: NoteKind, payload: Mapping[str, Any]) -> None:
        """Explain for the journal."""
        self._notes.append((kind, payload))

    def ask(self, request: Request) -> None:
        """Ask for something to be done."""
        self._requests.append(request)

    def tell(self, severity: Severity, text: str) -> None:
        """Have a line told."""
        self.ask(Tell(severity, text))

    def change(self, **fields: Any) -> None:
        """Change the desk."""
        self.desk = replace(self.desk, **fields)

    def redirect(self, **fields: Any) -> None:
        """Change where the plates are to go: what was asked for before leads nowhere."""
        self.change(errand=self.desk.errand + 1, **{"repeating": None, **fields})

    def model(self) -> ModelState:
        """Return the model in the instrument.

        Raises
        ------
        InputError
            There is none.
        """
        if self.desk.state.current is None:
            raise InputError("no model is in the instrument: choose the next model")
        return self.desk.state.current

    def mode(self) -> Mode:
        """Return what is measured now, unless work or instrument are not ready for it."""
        model = self.model()
        if self.desk.state.suspended:
            raise InputError("work is suspended: resume first")
        self.check_instrument(model)
        mode = self.desk.mode
        assert mode is not None
        return mode

    def check_instrument(self, model: ModelState) -> None:
        """Refuse a model that was begun in an instrument of the other kind, or lies nowhere."""
        self.check_kind(model)
        if self.desk.abilities is not None and not model.carriages:
            raise InputError("no photo lies in the comparator: lay one in first")

    def check_kind(self, model: ModelState) -> None:
        """Refuse a model that was begun in an instrument of the other kind."""
        if self.desk.abilities is None:
            return
        if model.mono and not self.desk.mono:
            raise InputError(
                f"model {model.name} was begun in a mono comparator: connect one, or undo"
            )
        if self.desk.mono and not model.mono:
            raise InputError(
                f"model {model.name} was begun in an instrument that holds both photos: connect "
                "one, or undo"
            )

    def recordable(self) -> tuple[Mode, str]:
        """Return the mode, and the name of what a record now belongs to.

        Raises
        ------
        InputError
            A record belongs to nothing now.
        """
        mode, desk = self.mode(), self.desk
        if desk.referencing is not None:
            raise InputError(UNREFERENCED)
        if desk.drive_target is not None:
            raise InputError("the plates are still under way")
        if desk.setting:
            raise InputError(f"{desk.setting} is still setting the mark")
        if desk.target is not None:
            if desk.check is not None and desk.target not in desk.checks:
                raise InputError(f"the photos lie anew: check point {desk.check} first")
            return mode, desk.target
        # Without a drive the operator finds the points in the order of the plan by hand. Plates
        # that are driven stand at the last point: a second press must not be taken for another.
        by_hand = desk.abilities is None or not desk.abilities.drives
        if by_hand and (desk.check is not None or mode.pending):
            return mode, desk.check or mode.pending[0]
        raise InputError(f"{'choose' if by_hand else 'drive to'} a {mode.unit} first")

    def aim(self, mode: Mode, name: str) -> None:
        """Make a point or fiducial the target, and drive there where the plotter can."""
        abilities, before = self.desk.abilities, self.desk
        if abilities is None or not abilities.moves:
            self.redirect(target=name)
            self._key_goes_along(before)
            return
        known = self.desk.candidates is not None
        place = mode.place(name, abilities.middle, known=known)
        self.redirect(
            target=name,
            **self._under_way(place, abilities),
        )
        self._key_goes_along(before)
        self.ask(DriveTo(place, mode.side))

    def _under_way(self, place: Position, abilities: Abilities) -> dict[str, Any]:
        """Return what the desk knows of a drive that is asked for now."""
        return {
            # undriven plates that are moved are there at once, and no reply says so
            "drive_target": place if abilities.drives else None,
            "replies": self.desk.replies.driven(place) if abilities.drives else self.desk.replies,
            "setting": self.seen.own_operator,
            # the mark that counts is the one set after this drive, not after one given up before
            "settles_after": None,
        }

    def point_away(self, repeating: Repeating) -> None:
        """Move the plates away from something measured, so that it is pointed at anew."""
        abilities = self.desk.abilities
        if abilities is None or not abilities.moves:
            self.redirect(target=repeating.name, repeating=repeating)
            return
        mode = self.mode()
        away = repeating.away(mode, abilities.middle)
        self.redirect(
            target=repeating.name,
            repeating=replace(repeating, moved=not abilities.drives),
            **self._under_way(away, abilities),
        )
        self.ask(DriveTo(away, mode.side))

    def _key_goes_along(self, before: Desk) -> None:
        """Let a press of the key count that was meant for the same point as the drive now begun."""
        if before.pressed == before.errand and before.target == self.desk.target:
            self.change(pressed=self.desk.errand)

    def advance(self) -> None:
        """Go to what is due by itself, where that is wanted."""
        mode = self.desk.mode
        if not self.desk.auto_drive or self.desk.referencing is not None or mode is None:
            return
        if self.desk.due is not None:
            try:
                self.aim(mode, self.desk.due)
            except AnaplotError as error:
                self.refused = error  # what was to be done before is done

    def go_nowhere(self) -> None:
        """Forget where the plates were to go: nothing is recorded before the next drive."""
        self.redirect(target=None, drive_target=None, setting="")

    def begin_checks(self, points: tuple[str, ...]) -> None:
        """Have points recorded again, so that it is known how the photos lie."""
        self.change(checks=points if self.desk.abilities is not None else ())

    def interrupt(self) -> None:
        """Give up the drive under way: nobody knows where the plates stand."""
        if not self.desk.standing:
            self.go_nowhere()

    def lay(self) -> None:
        """Have the photographs of the model in work laid into the instrument."""
        laid = self.desk.laid
        if laid is not None:
            self.ask(laid)
