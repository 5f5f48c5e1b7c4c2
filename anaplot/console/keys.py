"""The keys: one list of what the operator can do, for bindings, key bar, help and palette."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from textual.binding import Binding

from anaplot.console.inwork import in_work
from anaplot.console.keybar import KeyHint, show_keys
from anaplot.console.now import Entered
from anaplot.console.situation import Situation
from anaplot.station.snapshot import Snapshot

__all__ = ["ACTIONS", "Action", "bindings", "is_live", "key_hints", "label_now"]

_PROPOSED = 5  # weight of a key that does what the program proposes


@dataclass(frozen=True, slots=True)
class Action:
    """Something a key does on the orientation screen.

    Attributes
    ----------
    id
        Name in a keymap file.
    keys
        Default keys, separated by commas; the first is the one shown.
    label
        Short name in the key bar, or "" when it is not shown there.
    help
        One sentence for help and palette.
    weight
        Place in the key bar when there is not room for all: the smaller, the sooner.
    group
        Actions of one group stand together in key bar and help, under the first one's words.
    """

    id: str
    keys: str
    label: str
    help: str
    weight: int = 50
    group: str = ""


ACTIONS: tuple[Action, ...] = (
    Action("record", "space,f1", "Record", "Record the point under the mark (A1).", 1),
    Action("drive", "enter", "Drive", "Do what NOW says; on a row chosen by hand: drive to it.", 2),
    Action("next_point", "n", "Next", "Drive to the point expected next.", 3),
    Action("next_flag", "f", "Flag", "Select the next flagged row, the most probable first.", 6),
    Action(
        "accept", "a,f4", "Accept", "Accept the model, or the inner orientation in work (A4).", 4
    ),
    Action("next_model", "g", "Model", "Go on to the next photo, or to the next model.", 5),
    Action("other_photo", "L", "", "The other photo lies in the mono comparator now."),
    Action(
        "reference",
        "R",
        "Reference",
        "Refer lost counters to the point on which the mark is.",
        1,
    ),
    Action("keep_counters", "K", "Keep", "Keep lost counters as they are.", 2),
    Action("left", "left", "x y", "Move the mark. Without stereo view ↑ ↓ select rows.", 3, "xy"),
    Action("up", "up", "", "Move the mark up, or select the row above.", 50, "xy"),
    Action("down", "down", "", "Move the mark down, or select the row below.", 50, "xy"),
    Action("right", "right", "", "Move the mark to the right.", 50, "xy"),
    Action("page_up", "pageup", "px", "Change px. Without stereo view: a page of rows.", 3, "px"),
    Action("page_down", "pagedown", "", "Make px smaller, or select a page below.", 50, "px"),
    Action("py_less", "comma", "py", "Change py.", 3, "py"),
    Action("py_more", "full_stop", "", "Make py larger.", 50, "py"),
    Action("far_left", "shift+left", "", "The same with coarse steps.", 50, "far"),
    Action("far_up", "shift+up", "", "Move the mark far up.", 50, "far"),
    Action("far_down", "shift+down", "", "Move the mark far down.", 50, "far"),
    Action("far_right", "shift+right", "", "Move the mark far to the right.", 50, "far"),
    Action("far_px_more", "shift+pageup", "", "Make px much larger.", 50, "far"),
    Action("far_px_less", "shift+pagedown", "", "Make px much smaller.", 50, "far"),
    Action("far_py_less", "less_than_sign", "", "Make py much smaller.", 50, "far"),
    Action("far_py_more", "greater_than_sign", "", "Make py much larger.", 50, "far"),
    Action("zoom_in", "z", "Zoom", "A smaller or a wider field; steps go with it.", 5, "zoom"),
    Action("zoom_out", "Z", "", "Show a wider field.", 50, "zoom"),
    Action("coarse", "c", "Coarse", "Take coarse steps (ten fine ones), or fine ones.", 5),
    Action("hand", "h", "Hand", "Let the simulated hand set the mark, or set it yourself.", 4),
    Action("undo", "u", "Undo", "Take the last record, switch or acceptance back.", 7),
    Action("switch_row", "x", "Row off", "Switch the selected row off, or on again.", 8),
    Action(
        "why_pointing",
        "1",
        "",
        "Why the last change of a measurement was made.",
        50,
        "why",
    ),
    Action("why_identification", "2", "", "The point was another one.", 50, "why"),
    Action("why_transfer", "3", "", "The point was transferred wrongly.", 50, "why"),
    Action("why_instrument", "4", "", "It was the instrument.", 50, "why"),
    Action("switch_point", "X", "Point off", "Switch the whole point off, or on again.", 9),
    Action("rename", "N", "Name", "Rename the selected point, or exchange it with another.", 20),
    Action("sort", "s", "Sort", "Sort: table order, significance, redundancy, point.", 12),
    Action("transfers", "t", "Arrows", "Show all critical transfers, or the selected row's.", 13),
    Action("layout", "m", "Map", "Show table and map, the map alone, the table alone.", 11),
    Action("stereo", "v", "Stereo", "The stereo view in place of the map, or the map again.", 6),
    Action("overview", "w", "Where", "Where the block stands: all models; or the table again.", 8),
    Action("block", "b", "Block", "What the block as one bundle says of all its points.", 9),
    Action("ties", "T", "Ties", "The strip against its neighbours and against the control.", 17),
    Action("fit", "F", "Fit", "The strips on the control measured so far.", 18),
    Action(
        "pointing", "P", "Pointing", "How precise the pointing is; from there, point again.", 19
    ),
    Action("report", "W", "Report", "Write the report of the block; it says where.", 20),
    Action("errors", "e", "Errors", "Gross errors of the model, by the strategy chosen there.", 16),
    Action("details", "d", "More", "All that is known of the selected row.", 10),
    Action("add_point", "+", "Add", "Add a point beyond the plan.", 16),
    Action("automatic", "o", "Auto", "Let the simulated operator work, or stop him.", 14),
    Action("suspend", "p", "Pause", "Suspend the work, or resume it.", 15),
    Action("stop", "escape", "Stop", "Stop the plates, and give up where they go to.", 17),
    Action("orientation", "f2", "", "Show the model's orientation (A2)."),
    Action("messages", "l", "", "All messages so far, the newest first."),
    Action("log", "H", "", "Who changed what and why, the newest first."),
    Action("redraw", "r", "", "Draw the whole screen again."),
    Action("row_up", "k", "", "Select the row above, or below.", 50, "row"),
    Action("row_down", "j", "", "Select the row below.", 50, "row"),
    Action("first", "home", "", "Select the first row."),
    Action("last", "end", "", "Select the last row."),
    Action("help", "?", "Help", "Explain this screen.", 0),
    Action("leave", "q", "Quit", "Leave; everything recorded is on disk.", 0),
)


def bindings() -> list[Binding]:
    """Return the bindings of the orientation screen, each with the action's id."""
    return [
        Binding(
            action.keys,
            f"press({action.id!r})",
            action.help,
            show=bool(action.label),
            id=action.id,
        )
        for action in ACTIONS
    ]


def is_live(
    action: str,
    snapshot: Snapshot,
    *,
    rows: int,
    wheels: bool = False,
    entered: Entered = "drive",
) -> bool:
    """Return whether a key makes sense now.

    `rows` is the number of rows in the table, `wheels` whether the stereo view with its handwheels
    is shown, `entered` what Enter does. This decides what the key bar shows; the station has the
    last word on what may be done.
    """
    model = bool(snapshot.left) and not snapshot.finished
    working = model and not snapshot.suspended
    accepted = (snapshot.left, snapshot.right) in snapshot.accepted
    live = {
        **dict.fromkeys(("left", "zoom_in", "coarse", "hand"), wheels),
        **dict.fromkeys(("page_up", "py_less"), wheels and not snapshot.mono),
        "record": working and not snapshot.unreferenced,
        "reference": snapshot.unreferenced,
        "keep_counters": snapshot.unreferenced and snapshot.reference_point is None,
        "drive": entered != "drive" or (working and rows > 0),
        "next_point": working and snapshot.next_point is not None,
        "next_flag": bool(in_work(snapshot).flagged),
        "accept": snapshot.may_accept,
        "next_model": not snapshot.finished
        and (accepted or not snapshot.left or snapshot.next_photo is not None),
        "undo": snapshot.may_undo,
        "switch_row": working and rows > 0,
        "switch_point": working and rows > 0,
        "rename": working and rows > 0 and snapshot.inner is None,
        "sort": rows > 0,
        "transfers": snapshot.diagnosis is not None and bool(snapshot.diagnosis.transfers),
        "overview": snapshot.status is not None,
        **dict.fromkeys(("block", "report"), snapshot.block_view is not None),
        "errors": snapshot.solution is not None and snapshot.inner is None,
        "details": rows > 0,
        "add_point": working and snapshot.inner is None,
        "automatic": snapshot.link.simulated,
        "suspend": not snapshot.finished,
        "stop": working and snapshot.drives and snapshot.link.state == "live",
    }
    return live.get(action, True)


def label_now(
    action: Action,
    snapshot: Snapshot,
    *,
    row_off: bool,
    point_off: bool,
    stereo: bool = False,
    coarse: bool = False,
    hand: bool = True,
    entered: Entered = "drive",
    overview: bool = False,
    aimed: bool = False,
    exchange: bool = False,
) -> str:
    """Return the label that says what the key would do now.

    `row_off`, `point_off`: the selected row, its point is switched off. `stereo`: the stereo view
    is shown. `coarse`: the handwheels take coarse steps. `hand`: the simulated hand sets the mark.
    `entered`: what Enter does. `overview`: it stands in place of the table. `aimed`: Enter goes
    to a model there. `exchange`: the selected row's point is probably taken for another one of the
    model.
    """
    if action.id == "drive":
        if aimed:
            return "Go there"
        drive = "Drive" if snapshot.drives else "Choose"
        laid = "Photo" if snapshot.next_photo is not None else "Model"
        other = {
            "next_model": laid,
            "accept": "Accept",
            "suspend": "Resume",
            "add_point": "Add",
            "return_to": "Return",
        }
        return other.get(entered, drive)
    if overview and action.id == "overview":
        return "Table"
    if action.id == "hand":
        return "Hand off" if hand else "Hand on"
    if action.id == "coarse" and coarse:
        return "Fine"
    if stereo and action.id in ("stereo", "layout"):
        return "Map" if action.id == "stereo" else "Size"
    if action.id == "next_model" and snapshot.next_photo is not None:
        return "Photo"
    if action.id == "suspend" and snapshot.suspended:
        return "Resume"
    if action.id == "rename" and exchange:
        return "Exchange"
    if action.id == "switch_row" and row_off:
        return "Row on"
    if action.id == "switch_point" and point_off:
        return "Point on"
    return action.label


def key_hints(now: Situation, keys: Mapping[str, tuple[str, ...]]) -> tuple[KeyHint, ...]:
    """Return what the key bar shows, for the keys in force: the first of each action.

    Those of an action's group stand beside it.
    """
    label = partial(
        label_now,
        snapshot=now.snapshot,
        row_off=now.row_off,
        point_off=now.point_off,
        stereo=now.choices.stereo,
        coarse=now.choices.wheels.coarse,
        hand=now.hand,
        entered=now.now.action,
        overview=now.overview,
        aimed=now.aim is not None,
        exchange=now.exchange,
    )
    return tuple(
        KeyHint(
            action.id,
            show_keys(
                keys[each.id][0]
                for each in ACTIONS
                if each is action or (action.group and each.group == action.group)
            ),
            label(action),
            _PROPOSED if action.id == "rename" and now.other_name else action.weight,
        )
        for action in ACTIONS
        if action.label
        and (
            is_live(
                action.id,
                now.snapshot,
                rows=now.rows,
                wheels=now.at_wheels,
                entered=now.now.action,
            )
            or (action.id == "drive" and now.aim is not None)
        )
    )
