"""The desk: where a session stands, and where the instrument is thought to be.

A pure value, without threads, files, ports and a clock of its own. `commanding.decide` and
`hearing.hear` say what follows from a command or from something heard: events for the journal,
requests, and the desk as it stands after. Whoever has a journal writes the events first; a desk
that was not replaced by the one after has decided nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from anaplot.aliases import Side
from anaplot.orientation.ownpattern import PointPattern
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import ControlPoint
from anaplot.photogrammetry.readings import Position
from anaplot.planning.modelplan import Candidates
from anaplot.session.accidents import Accident, accidents
from anaplot.session.arrival import NO_REPLIES, Replies
from anaplot.session.checkpoints import check_points, points_due
from anaplot.session.events import Event
from anaplot.session.heard import Abilities
from anaplot.session.modes import Fiducials, Mode, mode_of
from anaplot.session.nextstep import Agenda, Step
from anaplot.session.othernames import OtherName, other_names
from anaplot.session.recomputed import Recomputed, recomputed_models
from anaplot.session.referencing import KnownPlace, Referencing, asked_for, references
from anaplot.session.repeating import Repeating
from anaplot.session.requests import Lay
from anaplot.session.state import SessionState, fold
from anaplot.session.tiecheck import NOTHING_KNOWN, Known
from anaplot.session.transfer import Offer, Transfer, transfer
from anaplot.session.workflow import Outlook, outlook

__all__ = ["DEFAULT_PATTERN", "NO_ERRAND", "Desk"]

DEFAULT_PATTERN = "13"
NO_ERRAND = -1
"""What is neither the errand of today nor one to come."""


@dataclass(frozen=True, slots=True, eq=False)
class Desk:
    """What stands on the desk: the session's state, and where the instrument is thought to be.

    Attributes
    ----------
    state, outlook
        The session's state, and what follows from it.
    pattern
        The point pattern of new models.
    abilities
        What the instrument can do, or None when one looks on without an instrument.
    known
        What is known from elsewhere: control, and marked points.
    auto_drive
        Whether the plates drive to the next point by themselves after a record.
    target
        The point or fiducial that the plates are at or drive to, or None.
    drive_target
        Where the plates are driving [mm]; None when they stand.
    replies
        Which replies to drives may still come.
    setting
        Who is still setting the mark after a drive, or "".
    settles_after
        The mark that counts is the one set after this many drives; None before the drive begins.
    referencing
        How far re-measuring the counters' reference has come; None while they have it.
    last_measured
        The point or fiducial measured last.
    checks
        Points still to be recorded again, since photos without fiducials were laid in anew: they
        must be where they are on record.
    recomputed
        Accepted models that are others than when they were accepted, and what has changed.
    repeating
        How far pointing again at something measured has come, or None.
    errand
        Counts every change of where the plates are to go, and every measurement: what was asked
        of the instrument before the last of them is not done any more.
    pressed
        The errand during which the key was pressed; None once its record has come or cannot come,
        `NO_ERRAND` when it was pressed in two of them meanwhile.
    refusal_told
        When bytes that are no reading were last told of [s].
    """

    state: SessionState
    outlook: Outlook
    pattern: PointPattern
    abilities: Abilities | None = None
    known: Known = NOTHING_KNOWN
    auto_drive: bool = True
    target: str | None = None
    drive_target: Position | None = None
    replies: Replies = NO_REPLIES
    setting: str = ""
    settles_after: int | None = None
    referencing: Referencing | None = None
    last_measured: str | None = None
    checks: tuple[str, ...] = ()
    recomputed: tuple[Recomputed, ...] = ()
    repeating: Repeating | None = None
    errand: int = 0
    pressed: int | None = None
    refusal_told: float = float("-inf")

    @classmethod
    def at(
        cls,
        state: SessionState,
        abilities: Abilities | None = None,
        *,
        point_pattern: PointPattern | None = None,
        candidates: Candidates | None = None,
        control: tuple[ControlPoint, ...] = (),
        auto_drive: bool = True,
    ) -> Desk:
        """Return the desk at a session's state, with the plates nowhere.

        Parameters
        ----------
        state, abilities, auto_drive
            As its attributes.
        point_pattern
            The point pattern of new models; None for the usual one.
        candidates, control
            See `anaplot.session.transfer.Known`.
        """
        chosen = pattern(DEFAULT_PATTERN) if point_pattern is None else point_pattern
        due: tuple[str, ...] = ()
        if abilities is not None:
            due = points_due(state) if state.returned is None else check_points(state)
        return cls(
            state,
            outlook(state),
            chosen,
            abilities,
            Known.of(control, candidates),
            auto_drive,
            checks=due,
            recomputed=recomputed_models(state),
        )

    # -- what stands ---------------------------------------------------------------------------

    @property
    def mono(self) -> bool:
        """Whether the instrument holds one photo at a time."""
        return self.abilities is not None and self.abilities.mono

    @property
    def mode(self) -> Mode | None:
        """What is measured now; None between models."""
        return mode_of(self.state, self.known)

    @property
    def candidates(self) -> Candidates | None:
        """Approximate image coordinates of known points by photo, or None."""
        return self.known.candidates

    @property
    def transfer(self) -> Transfer:
        """What follows for the model in work from what is known from elsewhere."""
        return transfer(self.state, self.known)

    @property
    def accidents(self) -> tuple[Accident, ...]:
        """What is wrong with the numbers of points, and with ties."""
        return accidents(self.state, self.transfer)

    @property
    def other_names(self) -> tuple[OtherName, ...]:
        """What points of the model in work are probably called instead."""
        model = self.state.current
        if model is None or model.open_inner is not None:
            return ()
        return other_names(model, self.outlook.interchange, self.accidents)

    @property
    def _beyond(self) -> Accident | Offer | None:
        """What there is to do when the model is complete and nothing in it is suspected."""
        view, model = self.outlook, self.state.current
        if model is None or view.next_point is not None or not view.may_accept or model.pending:
            return None
        if view.inner is not None or view.next_photo is not None or self.state.returned is not None:
            return None
        wrong = (a for a in self.accidents if a.certain and not model.is_off(a.point))
        return next(wrong, None) or next(iter(self.transfer.offers), None)

    @property
    def standing(self) -> bool:
        """Whether the plates stand, and the mark is set."""
        return self.drive_target is None and not self.setting

    @property
    def expected(self) -> str:
        """What the operator is expected to do now, one sentence."""
        return self.agenda.sentence

    @property
    def agenda(self) -> Agenda:
        """What the operator may do now, the most urgent first."""
        if self.referencing is not None:
            needed, known = self.references
            at = self.referencing.proposed(needed, known)
            return Agenda((), asked_for(self.referencing, at, needed))
        if self.check is not None:
            step = Step("measure", f"check point {self.check}", self.check)
            return Agenda((step,), f"the photos lie anew, {len(self.checks)} to go")
        following = self.outlook.next_model
        if self.repeating is not None and not self.state.suspended:
            moves = self.abilities is not None and self.abilities.moves
            return self.repeating.agenda(moves=moves)
        between = self.state.current is None and not self.state.suspended
        if self.mono and between and following is not None:
            _, left, right = following
            lay = Step("lay", f"lay photo {left} into the comparator")
            return Agenda((lay,), f"next model, {left} / {right}")
        beyond, accept = self._beyond, Step("accept", "accept")
        if isinstance(beyond, Accident):
            again = Step("remeasure", f"remeasure {beyond.point}", beyond.point)
            off = Step("switch off", "switch it off", beyond.point)
            if not beyond.other:
                return Agenda((again, off, accept), beyond.text)
            if beyond.first:
                there = f"named so first in {beyond.first}: return to it"
                return Agenda((again, off, accept), f"{beyond.text} ({there})")
            named = Step("rename", f"name it {beyond.other}", beyond.point)
            return Agenda((again, named, off, accept), beyond.text)
        if isinstance(beyond, Offer):
            name = beyond.planned.point
            offered = Step("measure", f"measure {name} ({beyond.words})", name)
            return Agenda((offered, Step("accept", "accept the model")))
        return self.outlook.agenda

    @property
    def next_name(self) -> str | None:
        """What the operator is expected to point at next, or None."""
        if self.referencing is None:
            repeated = None if self.repeating is None else self.repeating.name
            beyond = self._beyond
            further = beyond.planned.point if isinstance(beyond, Offer) else None
            if isinstance(beyond, Accident):
                further = beyond.point
            return self.check or repeated or self.outlook.next_point or further
        return None if self.reference is None else self.reference.name

    @property
    def check(self) -> str | None:
        """The point to be recorded again now, so that it is known how the photos lie, or None."""
        ready = self.mode is not None and not isinstance(self.mode, Fiducials)
        return self.checks[0] if self.checks and ready and not self.state.suspended else None

    @property
    def due(self) -> str | None:
        """What comes next by itself: a check, a point planned or offered, what one returned for."""
        mode, returned = self.mode, self.state.returned
        if mode is None or self.check is not None:
            return self.check
        if mode.pending:
            return mode.pending[0]
        beyond = self._beyond
        if isinstance(beyond, Offer) and not self.mono:
            return beyond.planned.point
        if returned is None or returned.point is None or self.outlook.next_photo is not None:
            return None
        return returned.point if mode.has(returned.point) else None

    @property
    def reference(self) -> KnownPlace | None:
        """What counters without reference are to be referred to now, or None."""
        if self.referencing is None:
            return None
        return self.referencing.proposed(*self.references)

    @property
    def references(self) -> tuple[tuple[Side, ...], tuple[KnownPlace, ...]]:
        """`referencing.references`: what the model in work flags, or suspects, comes last."""
        solution, diagnosis = self.outlook.solution, self.outlook.diagnosis
        flagged = () if solution is None else solution.flagged
        suspects = () if diagnosis is None else diagnosis.suspects
        doubted = {*(row.point for row in flagged), *(point for point, _ in suspects)}
        return references(self.state, self.last_measured, doubted)

    @property
    def laid(self) -> Lay | None:
        """How the photographs of the model in work lie in the instrument, or None."""
        model = self.state.current
        if self.abilities is None or model is None:
            return None
        if not model.mono:
            return Lay(model.left, model.right)
        if model.laid is None:
            return None
        before = self.state.preceding(model.strip, model.left)
        # the right photo of the model before, never taken out since
        still = before is not None and before.laying == model.laying and model.laid == "left"
        return Lay(model.left, model.right, model.laid, "right" if still else model.laid)

    def folded(self, *events: Event) -> Desk:
        """Return the desk after events of a journal, one after another.

        Raises
        ------
        EventRefusedError
            One of them cannot happen then.
        """
        return self.moved_to(fold(self.state, events))

    def moved_to(self, state: SessionState) -> Desk:
        """Return the desk at another state of its session, to which events have led."""
        before = self.state
        same = (state.models, state.recomputed, state.block) == (
            before.models,
            before.recomputed,
            before.block,
        )
        return replace(
            self,
            state=state,
            outlook=outlook(state),
            recomputed=self.recomputed if same else recomputed_models(state),
        )
