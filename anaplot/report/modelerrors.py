"""A model without its gross errors: what was rejected and why, as a part of its document."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from anaplot.adjustment.advice import hard_to_tell_apart
from anaplot.adjustment.findings import Rejection
from anaplot.aliases import Array, RowKey
from anaplot.orientation.grosserrors import CleanedModel
from anaplot.report.document import (
    Answer,
    Block,
    Document,
    Line,
    Names,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    stacked,
    table,
    whole,
)
from anaplot.report.groundchange import change_json, change_lines
from anaplot.report.modeldocument import OF_MODEL
from anaplot.report.modelvalues import model_values_json, model_values_line
from anaplot.report.searchoptions import sigma0_in_words

__all__ = ["model_errors_document", "rejected_table"]

_SHOWN_ODDS = 0.01  # smallest probability in the text
_REJECTED = (
    name("point", "POINT", 5),
    name("axis", gap=1),
    number("w", "w", 2, 8),
    number("parx_um", "PARX", 1, 8, unit="um"),
    number("redn", "RED-N", 3, 8),
    whole("order", "ORDER", 6),
    number("statistic", "statistic", 2, 10),
    number("critical", "critical", 2, 9),
    number("error_um", "ERROR", 1, 9, unit="um"),
)
_EVIDENCE = for_programs(
    *("pass", "point", "axis", "order", "statistic", "critical", "redundancy_number")
)
_PROBABILITY = for_programs("point", "axis", "probability")


def rejected_table(parts: Iterable[tuple[Sequence[Any], Table]]) -> Table:
    """Return the rejected rows of several models: of each strip, left and right, and its table."""
    return stacked("rejected", OF_MODEL, _REJECTED, parts)


def model_errors_document(cleaned: CleanedModel) -> Document:
    """Return the document of the rejected rows of a model."""
    found, change = cleaned.findings, cleaned.point_change
    page: list[Block] = [say("  GROSS ERRORS ({})", found.strategy).of("heading")]
    if cleaned.begun_without:
        rows = _named(cleaned.begun_without)
        page.append(say("    far off, the search began without: {}", rows))
    page += [_rejected_line(row, found.strategy) for row in cleaned.rejected]
    if cleaned.came_back:
        page.append(say("    left out on the way, came back: {}", _named(cleaned.came_back)))
    if cleaned.rejected:
        page += change_lines(change, "in the model", "mm", indent=4)
    else:
        page.append(say("    nothing is rejected"))
    page += [say("    {}", hard_to_tell_apart(*pair)) for pair in cleaned.hard_to_tell]
    page += [
        say("    {} cannot be left out: {}", _key(key), reason) for key, reason in cleaned.refused
    ]
    untestable = [row.key for row in cleaned.solution.table if row.w is None]
    if untestable:
        page.append(say("    cannot be tested: {}", _named(untestable)))
    if found.model_values is not None:
        page.append(say("    {}", model_values_line(found.model_values)))
    page += _odds_lines(cleaned)
    page += [say("    note: {}", remark).of("remark") for remark in cleaned.remarks]
    rows_out = (
        (*row.name, row.w, row.residual, row.r_back, row.order, row.statistic, row.critical,
         row.error)
        for row in cleaned.rejected
    )  # fmt: skip
    rejected = table("rejected", _REJECTED, rows_out)
    answer = {
        "strategy": found.strategy,
        "begun_without": _keys_json(cleaned.begun_without),
        "rejected": rejected,
        "ground": change_json(change, "mm"),
        "came_back": _keys_json(cleaned.came_back),
        "hard_to_tell": [
            {"rejected": a, "kept": b, "correlation": rho} for a, b, rho in cleaned.hard_to_tell
        ],
        "refused": [{**_key_json(key), "reason": reason} for key, reason in cleaned.refused],
        "untestable": _keys_json(untestable),
        "passes": len(cleaned.passes),
        "evidence": _evidence(cleaned),
        "held": _keys_json(sorted(cleaned.held)),
        "odds": {
            "sigma0": sigma0_in_words(found.strategy),
            "none": found.odds.none,
            "single": _probabilities(cleaned, found.odds.rows),
        },
        "pair_odds": _pair_odds_json(cleaned),
        "remarks": list(cleaned.remarks),
    }
    if found.model_values is not None:
        keys = cleaned.names
        answer["model_values"] = model_values_json(
            found.model_values, lambda row: _key_json(keys[row])
        )
    return Document(answer, tuple(page), (rejected,))


def _key(key: RowKey) -> Line:
    return say("{} {}", *key)


def _named(keys: Iterable[RowKey]) -> Names:
    return named(map(_key, keys))


def _key_json(key: RowKey) -> Answer:
    return {"point": key[0], "axis": key[1]}


def _keys_json(keys: Iterable[RowKey]) -> list[Answer]:
    return [_key_json(key) for key in keys]


def _rejected_line(row: Rejection[RowKey], strategy: str) -> Line:
    """Return what a row shows, when it went and what decided."""
    line = say("    {} {}  rejected", *row.name)
    if row.w is None:
        line += ": with it the orientation goes astray, and the others cannot test it"
    else:
        line += say(
            "  RED-N {:.3f}  PARX {:.1f} um  w {:.2f} with it in", row.r_back, row.residual, row.w
        )
    if row.order == 0:
        return line if row.w is None else line + "; with it the orientation goes astray"
    line += say("; step {}", row.order)
    if row.statistic is None or row.critical is None:
        return line
    if strategy == "search":
        return line + say(", the sum falls by {:.1f}", -row.statistic)
    return line + say(", {:.2f} above {:.2f}", row.statistic, row.critical)


def _odds_lines(cleaned: CleanedModel) -> list[Line]:
    """Return the odds over single errors, all rows in, and over pairs where asked for."""
    found, keys = cleaned.findings, cleaned.names
    single, odds = found.odds, found.pair_odds
    but = " but those far off" if cleaned.held else ""
    weighed = f"all rows in{but}, by the {sigma0_in_words(found.strategy)} sigma0"
    lines = [
        say("    if there is one gross error at most, {}: none {:.1f} %", weighed,
            100.0 * single.none)
    ]  # fmt: skip
    lines += [
        say("      {:5.1f} %  {}", 100.0 * single.rows[row], _key(keys[row]))
        for row in np.argsort(-single.rows, kind="stable").tolist()
        if single.rows[row] >= _SHOWN_ODDS
    ]
    if odds is None:
        return lines
    lines.append(
        say(
            "    odds over none, one and two, {}: none {:.1f} %, one {:.1f} %, two {:.1f} %",
            weighed,
            *(100.0 * odds.none, 100.0 * float(odds.single.sum()), 100.0 * odds.pairs),
        )
    )
    lines += [
        say("      {:5.1f} %  {} and {}", 100.0 * chance, _key(keys[a]), _key(keys[b]))
        for a, b, chance in zip(
            odds.rows.tolist(), odds.others.tolist(), odds.probability.tolist(), strict=True
        )
        if chance >= _SHOWN_ODDS
    ]
    return lines


def _evidence(cleaned: CleanedModel) -> Table:
    keys = cleaned.names
    rows = (
        (number, *keys[row], gone.order, gone.statistic, gone.critical, gone.r)
        for number, one in enumerate(cleaned.passes, 1)
        for row, gone in zip(one.rows, one.rejected, strict=True)
    )
    return table("evidence", _EVIDENCE, rows)


def _probabilities(cleaned: CleanedModel, values: Array) -> Table:
    """Return the probability of every row that was weighed."""
    rows = (
        (*key, value)
        for key, value in zip(cleaned.names, values.tolist(), strict=True)
        if key not in cleaned.held
    )
    return table("odds", _PROBABILITY, rows)


def _pair_odds_json(cleaned: CleanedModel) -> Answer | None:
    odds, keys = cleaned.findings.pair_odds, cleaned.names
    if odds is None:
        return None
    pairs = zip(odds.rows.tolist(), odds.others.tolist(), odds.probability.tolist(), strict=True)
    return {
        "sigma0": sigma0_in_words(cleaned.findings.strategy),
        "none": odds.none,
        "single": _probabilities(cleaned, odds.single),
        "pairs": [{"first": keys[a], "second": keys[b], "probability": p} for a, b, p in pairs],
    }
