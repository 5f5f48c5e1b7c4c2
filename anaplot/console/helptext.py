"""What the help screen says: the screen, its columns, the signs, the keys."""

from __future__ import annotations

from collections.abc import Mapping

from rich.cells import cell_len
from textual.content import Content

from anaplot.console.errorspage import ABOUT
from anaplot.console.keybar import show_key
from anaplot.console.keys import ACTIONS, Action
from anaplot.console.text import fit, wrap
from anaplot.textfiles.wording import plain

__all__ = ["help_lines"]

_HEAD = 14  # cells for names

_SCREEN = (
    (
        "",
        "The top lines name block, photos, model, link, the variance of ties, the test, and "
        "the model's sigma0 and redundancy r. Below them the read-out: image coordinates and "
        "parallaxes px = x' - x'', py = y' - y'' in mm, then what to do now.",
    ),
    (
        "INNER",
        "Where the camera has fiducials, every model begins with the inner orientation of its "
        "photos, left then right: the table, map and keys are those of its fiducials, RESID is "
        "adjusted minus measured, and the read-out says which coordinates are still the plate's.",
    ),
    ("SIMULATED", "No instrument is connected: the plotter is a simulated one."),
)
_COLUMNS = (
    (
        "RED-N",
        "Redundancy number: the share of an error of this row that shows in its own "
        "parallax. 0: nothing controls it; 1: everything does.",
    ),
    (
        "PARX µm",
        "Parallax left at the point, in micrometres in the image. y rows: parallax "
        "of the point; x rows: discrepancy of a tie against the preceding model.",
    ),
    (
        "EXPD µm",
        "Its expected standard deviation. Under the tau test it follows the "
        "estimated sigma0, under baarda the a-priori one.",
    ),
    (
        "SIGF",
        "PARX / EXPD without sign. Above the critical value the row is flagged: "
        "<< REMEASURE. A dash: not testable.",
    ),
    ("FINDS µm", "Smallest error of this row that the test finds with its stated power."),
    ("ODDS %", "Probability that this row holds the one gross error."),
)
_MAP = (
    ("○ ● ! x", "Open, measured, flagged, switched off. (●) is where the plates are or drive to."),
    ("lines", "Residuals: y rows upright, x rows level; the bar gives their scale in micrometres."),
    (
        "arrows",
        "Transfers: an error at the foot of a full arrow shows at least as large at its head, "
        "at that of a dotted one with at least 0.6 of it. Look at both before you remeasure.",
    ),
)
_STEREO = (
    (
        "patches",
        "What a simulated plotter's eyepieces show, left and right, the ruler below giving the "
        "width of the field. White discs are the marked points.",
    ),
    (
        "the mark",
        "The dot in the middle of both. Move it onto the point with x and y, then clear py and "
        "px: both patches must look alike around it, the disc centred in both. Zoom in and do it "
        "again; a fine step is 1/50 of the field.",
    ),
    (
        "hand",
        "On: after a drive the simulated hand sets the mark, with an operator's noise. Off: you "
        "do. A drive under way cannot be turned.",
    ),
    ("no plates", "Without a simulated plotter: the bare read-out in large digits, in mm."),
)

_INSTRUMENTS = (
    (
        "one photo",
        "In a mono comparator the photos of a model are measured one after the other, the left one "
        "first: lay in the photo that the line NOW names, then press g. What the model before "
        "measured in it is taken over. The top line says which photo lies in; after the mark was "
        "set in the one, 'left only' stands in the table. L says that the other one lies in.",
    ),
    (
        "reference",
        "Incremental counters may have lost their origin when the line was lost. Nothing they say "
        "is taken until the mark was set twice on something measured (the line NOW proposes what, "
        "a selected row that is measured goes before) and R pressed: two pointings that disagree "
        "are forgotten. K keeps the counters as they are.",
    ),
)

_ERRORS = (
    (
        "errors page",
        "What a strategy for gross errors would reject in the model as it is oriented now, in "
        "what order and on what evidence, with the size of the error where it can be told. The "
        "page chooses the strategy, and its verdict then stands among the advice.",
    ),
    *((name, f"{about[0].upper()}{about[1:]}.") for name, about in ABOUT.items()),
)

_BLOCK = (
    (
        "overview",
        "Where the block stands: between models, at the end of a strip and first of all. Every "
        "model with its state (○ open, ◆ in work, ● accepted, ~ recomputed: changed by what was "
        "done since in a model before it, ! look: flagged, or held for wrong by the block), its "
        "table's figures, the block's verdict, weak spots, and what is next with its key. ↑ ↓ "
        "select a model, Enter goes there: the next one is laid in, an accepted one returned to. "
        "All other keys do what they do elsewhere.",
    ),
    (
        "block page",
        "All accepted models, and the present one as soon as its pattern is complete and no y row "
        "is flagged, adjusted as one bundle in the background. Flagged image coordinates with "
        "their w and RED-N, and for each point which of its measurements is probably the wrong "
        "one.",
    ),
    (
        "only now",
        "Points of earlier models that nothing was held against until the newest model came in.",
    ),
)


_REPORT = (
    (
        "report",
        "What the block's files have, adjusted and written as one page for the browser and for "
        "paper, in the folder reports of the block: a new one each time, named by date and time. "
        "The model in work is in it once it is accepted. Measuring goes on meanwhile.",
    ),
)


_FIT = (
    (
        "fit page",
        "Each strip, as far as it is measured, on its control: spatial similarity, discrepancies, "
        "RMS and test. x puts a point out or in, 1 2 3 choose the degree of polynomials along the "
        "strip, b shows the bundle. Nothing of it touches the measurements.",
    ),
)


_POINTING = (
    (
        "pointing",
        "sigma0 pooled over models, strips, operators and kinds of points, and what pointing again "
        "gives: from the page Enter points again at the point under the mark, the plates moving "
        "50 µm away before each, which changes nothing measured. The result is offered as the "
        "weight; the first and last hour of a day are compared.",
    ),
)


Pairs = tuple[tuple[str, str], ...]


_KEYMAP = (
    (
        "keymap.toml",
        "In the folder anaplot of your configuration folder (~/.config): lines such as "
        'record = "f5" or accept = "f9,enter". A key means one thing; what is wrong is named '
        "when the console starts. A theme chosen in the palette is kept beside it, in "
        "console.toml.",
    ),
)


def _section(title: str, pairs: Pairs, width: int) -> list[Content]:
    if not pairs:
        return []
    lines = [Content(""), Content.styled(title, "bold")]
    for name, sentence in pairs:
        if cell_len(name) > _HEAD - 1:
            lines.append(Content.styled(name, "bold $text-accent"))
            name = ""
        for i, part in enumerate(wrap(sentence, width - _HEAD)):
            head = fit(name if i == 0 else "", _HEAD)
            lines.append(Content.assemble((head, "bold $text-accent"), part))
    return lines


def help_lines(keys: Mapping[str, tuple[str, ...]], width: int, words: str = "") -> list[Content]:
    """Return the help, the keys first.

    Parameters
    ----------
    keys
        Those in force, by action.
    width
        Cells of a line.
    words
        Only what has them in it.
    """
    grouped: dict[str, list[Action]] = {}
    for action in ACTIONS:
        grouped.setdefault(action.group or action.id, []).append(action)
    named = tuple(
        (
            " ".join(show_key(key) for action in actions for key in keys[action.id]),
            actions[0].help,
        )
        for actions in grouped.values()
    )
    palette = (
        ("^p", "The command palette: all of these by name, and points to drive to."),
        ("^q ^c", "Leave, as q does; a second time without a question."),
    )
    wanted = words.casefold().split()

    def of(pairs: Pairs) -> Pairs:
        return tuple(
            pair for pair in pairs if all(word in " ".join(pair).casefold() for word in wanted)
        )

    sections = (
        ("Keys", named + palette),
        ("The screen", _SCREEN),
        ("The table", _COLUMNS),
        ("The map", _MAP),
        ("The stereo view", _STEREO),
        ("Gross errors", _ERRORS),
        ("The block", _BLOCK),
        ("The report", _REPORT),
        ("The control", _FIT),
        ("The pointing", _POINTING),
        ("Instruments", _INSTRUMENTS),
        ("Your keys", _KEYMAP),
    )
    lines = [line for title, pairs in sections for line in _section(title, of(pairs), width)]
    return lines[1:] or [Content(f"Nothing here about {plain(words)}.")]
