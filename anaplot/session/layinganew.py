"""What follows when photographs are laid in anew: of a model returned to, or of one that waited.

Where the camera has fiducials, they are measured anew. Where it has none, two points of the model
are recorded again and compared with what is on record; a disagreement asks for the counters'
reference.
"""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.photogrammetry.readings import Position
from anaplot.session.checkpoints import check_points, gaps
from anaplot.session.draft import Draft
from anaplot.session.events import ModelReopened
from anaplot.session.plates import image_of, plates_of
from anaplot.session.referencing import Referencing
from anaplot.session.requests import ReadAnew
from anaplot.session.tolerances import tolerance_of_check_mm

__all__ = ["check_recorded", "laid_anew", "return_to"]


def return_to(draft: Draft, left: str, right: str, point: str, photo: str) -> None:
    """Return to an accepted model."""
    model = draft.desk.state.accepted(left, right)
    if model is None:
        raise InputError(f"model {left}/{right} is not accepted: there is nothing to return to")
    draft.check_kind(model)
    draft.happen(ModelReopened(left, right, point or None, photo or None))
    draft.tell("info", f"model {model.name} is open again: lay photos {left} and {right}")
    laid_anew(draft)


def laid_anew(draft: Draft) -> None:
    """Have the photos of the model in work laid in, and what has to be checked of them."""
    draft.go_nowhere()
    draft.lay()
    draft.begin_checks(check_points(draft.desk.state))
    draft.advance()


def check_recorded(draft: Draft, point: str, position: Position) -> None:
    """Compare a point recorded again with what is on record; its measurement stays what it is."""
    model, state = draft.model(), draft.desk.state
    found = gaps(model, point, image_of(position, plates_of(state)))
    tolerance = tolerance_of_check_mm(state.block.precision.image_um)
    draft.note(
        "point-checked",
        {"point": point, **{f"{side}_mm": round(gap, 7) for side, gap in found.items()}},
    )
    side, gap = max(found.items(), key=lambda item: item[1])
    if gap > tolerance:
        draft.change(referencing=Referencing())
        draft.ask(ReadAnew())
        draft.go_nowhere()
        draft.tell(
            "error",
            f"point {point} is {gap:.3f} mm from where it is on record in photo "
            f"{model.photo(side)}, more than {tolerance:.3f} mm: refer the counters",
        )
        return
    rest = tuple(name for name in draft.desk.checks if name != point)
    draft.redirect(target=None, last_measured=point, checks=rest)
    draft.tell("record", f"{point} is where it is on record, within {tolerance:.3f} mm")
    draft.advance()
