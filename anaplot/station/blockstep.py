"""What is to be done next with a block, where, and by which command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from anaplot.session.state import SessionState
    from anaplot.session.workflow import Outlook
    from anaplot.station.blockview import BlockView

__all__ = ["NextStep", "Untied", "following"]


class Untied(NamedTuple):
    """A strip that hangs together with no other, and the model of it to return to."""

    strip: str
    model: str


class NextStep(NamedTuple):
    """What is to be done next, where, and by which command; "" where it is not one.

    inner: the photo whose inner orientation is in work; the point is a fiducial then.
    why: what keeps the block that is to be adjusted from a solution.
    strip: the one that is to be tied to the others.
    """

    do: Literal["measure", "return", "accept", "tie", "adjust", "report"]
    command: str
    model: str = ""
    photo: str = ""
    point: str = ""
    inner: str = ""
    why: str = ""
    strip: str = ""

    @property
    def opens(self) -> bool:
        """Whether it is done in the console, whose command is `open`."""
        return self.do not in ("adjust", "report")

    @property
    def words(self) -> str:
        """What it is, without the command."""
        if self.why:
            return "see why the block has no solution"
        if self.inner and self.do == "accept":
            return f"accept the inner orientation of photo {self.inner}"
        if self.inner:
            what = f"fiducial {self.point}" if self.point else "the fiducials"
            return f"measure {what} of photo {self.inner}"
        what = {
            "measure": "measure",
            "accept": "accept",
            "return": "return to",
            "tie": f"tie strip {self.strip} to the others in",
            "adjust": "adjust the block",
            "report": "write the report",
        }[self.do]
        where = f" model {self.model}" if self.model else ""
        if self.point:
            return f"{what}{where}, point {self.point}"
        return f"{what}{where}" + (f", photo {self.photo}" if self.photo else "")


def following(
    opened: str,
    measured: bool,
    view: BlockView | None,
    folder: str,
    state: SessionState | None = None,
    ahead: Outlook | None = None,
    *,
    held: bool = True,
    untied: Untied | None = None,
) -> NextStep:
    """Return what is to be done next: the model in work, what is surely wrong, the next model.

    When all models are measured: strips are tied, the block is adjusted until no more in it is
    flagged than by chance, and its report is written.

    Parameters
    ----------
    opened
        The model to measure next, "" when all are measured.
    measured
        Whether there is anything to adjust.
    view
        What the block as one bundle says, or None.
    folder
        How the command line names the block.
    state, ahead
        The session, and what follows from its model in work; None without one.
    held
        Whether anything ties the block to the ground.
    untied
        A strip that was measured and hangs together with no other, or None.
    """
    opening = f"anaplot open {folder}"
    if state is not None and state.current is not None and ahead is not None:
        model, lay = state.current, ahead.next_photo
        inner = "" if ahead.inner is None else ahead.inner.state.photo
        photo = "" if lay is None else model.photo(lay)
        if ahead.complete:
            return NextStep("accept", opening, model.name, inner=inner)
        point = ahead.next_point or ""
        return NextStep("measure", opening, model.name, photo, point, inner=inner)
    if view is not None:
        from anaplot.station.returnadvice import surely_wrong

        suspect = surely_wrong(view, () if state is None else state.models)
        if suspect is not None and suspect.accused.model is not None:
            accused = suspect.accused
            return NextStep("return", opening, accused.model or "", accused.photo, suspect.point)
    if opened:
        return NextStep("measure", opening, opened)
    if untied is not None:
        return NextStep("tie", opening, untied.model, strip=untied.strip)
    if measured:
        # what was measured elsewhere is to be adjusted in the first place
        if state is not None and view is not None and view.clean:
            return NextStep("report", f"anaplot report {folder} -o report.html")
        # what the control does not determine yet needs a free datum
        free = not held or (view is not None and view.datum == "free")
        command = f"anaplot adjust {folder}" + (" --datum free" if free else "")
        return NextStep("adjust", command, why="" if view is None else view.remark)
    return NextStep("measure", opening)
