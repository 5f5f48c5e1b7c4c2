"""The keys: one list of what the operator can do, for bindings, key bar, help and palette."""

from __future__ import annotations

from dataclasses import dataclass

from textual.binding import Binding

from anaplot.station.snapshot import Snapshot

__all__ = ["ACTIONS", "Action", "bindings", "is_live", "label_now"]


@dataclass(frozen=True, slots=True)
class Action:
    """Something a key does on the orientation screen.

    Attributes
    ----------
    id
        Name in a keymap file; the screen's method is `action_<id>`.
    keys
        Default keys, separated by commas; the first is the one shown.
    label
        Short name in the key bar, or "" when it is not shown there.
    help
        One sentence for help and palette.
    weight
        Place in the key bar when there is not room for all: the smaller, the sooner.
    """

    id: str
    keys: str
    label: str
    help: str
    weight: int = 50


ACTIONS: tuple[Action, ...] = (
    Action("record", "space,f1", "Record", "Record the point under the mark (A1).", 1),
    Action("drive", "enter", "Drive", "Drive the plates to the selected row's point.", 2),
    Action("next_point", "n", "Next", "Drive to the point expected next.", 3),
    Action("next_flag", "f", "Flag", "Select the next flagged row, the most probable first.", 6),
    Action("accept", "a,f4", "Accept", "Accept the model: the pattern is complete (A4).", 4),
    Action("next_model", "g", "Model", "Go on to the next model.", 5),
    Action("undo", "u", "Undo", "Take the last record, switch or acceptance back.", 7),
    Action("switch_row", "x", "Row off", "Switch the selected row off, or on again.", 8),
    Action("switch_point", "X", "Point off", "Switch the whole point off, or on again.", 9),
    Action("sort", "s", "Sort", "Sort: table order, significance, redundancy, point.", 12),
    Action("transfers", "t", "Arrows", "Show all critical transfers, or the selected row's.", 13),
    Action("layout", "m", "Map", "Show table and map, the map alone, the table alone.", 11),
    Action("details", "d", "More", "All that is known of the selected row.", 10),
    Action("add_point", "+", "Add", "Add a point beyond the plan.", 16),
    Action("automatic", "o", "Auto", "Let the simulated operator work, or stop him.", 14),
    Action("suspend", "p", "Pause", "Suspend the work, or resume it.", 15),
    Action("stop", "escape", "Stop", "Stop the plates.", 17),
    Action("orientation", "f2", "", "Show the model's orientation (A2)."),
    Action("messages", "l", "", "All messages so far, the newest first."),
    Action("redraw", "r", "", "Draw the whole screen again."),
    Action("up", "up,k", "", "Select the row above."),
    Action("down", "down,j", "", "Select the row below."),
    Action("page_up", "pageup", "", "Select a row one page above."),
    Action("page_down", "pagedown", "", "Select a row one page below."),
    Action("first", "home", "", "Select the first row."),
    Action("last", "end", "", "Select the last row."),
    Action("help", "?", "Help", "Explain this screen.", 0),
    Action("leave", "q", "Quit", "Leave; everything recorded is on disk.", 0),
)


def bindings() -> list[Binding]:
    """Return the bindings of the orientation screen, each with the action's id."""
    return [
        Binding(action.keys, action.id, action.help, show=bool(action.label), id=action.id)
        for action in ACTIONS
    ]


def is_live(action: str, snapshot: Snapshot, *, rows: int) -> bool:
    """Return whether a key makes sense now; `rows` is the number of rows in the table.

    This decides what the key bar shows. The station has the last word on what may be done.
    """
    model = bool(snapshot.left) and not snapshot.finished
    working = model and not snapshot.suspended
    accepted = (snapshot.left, snapshot.right) in snapshot.accepted
    live = {
        "record": working,
        "drive": working and rows > 0,
        "next_point": working and snapshot.next_point is not None,
        "next_flag": snapshot.solution is not None and bool(snapshot.solution.flagged),
        "accept": snapshot.may_accept,
        "next_model": not snapshot.finished and (accepted or not snapshot.left),
        "undo": snapshot.may_undo,
        "switch_row": working and rows > 0,
        "switch_point": working and rows > 0,
        "sort": rows > 0,
        "transfers": snapshot.diagnosis is not None and bool(snapshot.diagnosis.transfers),
        "details": rows > 0,
        "add_point": working,
        "automatic": snapshot.link.simulated,
        "suspend": not snapshot.finished,
        "stop": working and snapshot.link.state == "live",
    }
    return live.get(action, True)


def label_now(action: Action, snapshot: Snapshot, *, row_off: bool, point_off: bool) -> str:
    """Return the label that says what the key would do now."""
    if action.id == "suspend" and snapshot.suspended:
        return "Resume"
    if action.id == "switch_row" and row_off:
        return "Row on"
    if action.id == "switch_point" and point_off:
        return "Point on"
    return action.label
