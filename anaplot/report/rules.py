"""The papers' rules of thumb as verdicts of `adjust`, `plan block` and `plan network`."""

from __future__ import annotations

from anaplot.bundle.solve.rulesofthumb import LEAST_PHOTOS, LEAST_RI, RulesOfThumb
from anaplot.report.document import Answer, Line, say

__all__ = ["rules_json", "rules_lines"]


def rules_json(rules: RulesOfThumb) -> Answer:
    """Return the verdicts for programs."""
    return {
        "reliability": {
            "least_ri": LEAST_RI,
            "x": rules.ri_x,
            "y": rules.ri_y,
            "met": rules.reliable,
        },
        "cover": {
            "least_photos": LEAST_PHOTOS,
            "new_points": rules.new,
            "in_fewer": rules.in_fewer,
            "met": rules.covered,
        },
    }


def rules_lines(rules: RulesOfThumb, indent: str = "") -> list[Line]:
    """Return a line for each rule that says anything of the block."""
    which = [axis for axis, met in (("x", rules.ri_x), ("y", rules.ri_y)) if not met]
    less = f"not met by {' and '.join(which)}" if which else "met"
    lines = [say("{}rule of 1978, RI of x and of y at least {:g}: {}", indent, LEAST_RI, less)]
    if rules.covered is None:
        return lines
    rule = say("{}rule of 1980, new points in {} photos or more: ", indent, LEAST_PHOTOS)
    if rules.covered:
        return [*lines, rule + "met"]
    return [*lines, rule + say("not met, {} of {} in fewer", rules.in_fewer, rules.new)]
