"""Large tables are written in portions: the same text and JSON as at once."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest

from anaplot.report import asjson, astext
from anaplot.report.asjson import json_parts, json_text
from anaplot.report.astext import page_parts, page_text
from anaplot.report.document import Column, Document, Table, name, number, say, whole
from anaplot.report.output import Output

COLUMNS = (
    name("photo", "PHOTO", 5),
    number("x", "X", 3, 9),
    Column("at", "AT", 9, 2, parts=("X", "Y")),
    whole("rays", "RAYS", 6),
    name("word", look=bool),
    name("both"),
)
N = 23


def _table(group: str = "") -> Table:
    x = np.linspace(-1e7, 1e7, N)
    x[[3, 11]] = np.nan
    at = np.column_stack([x, x + 1.0])
    names = [f"p{k // 4}%s" + "w" * (k == 17) for k in range(N)]
    both = [None if k % 5 else "a" for k in range(N)]
    words = ["<<" if k == 20 else "" for k in range(N)]
    return Table("t", COLUMNS, (names, x, at, list(range(N)), words, both), group=group)


@pytest.mark.parametrize("rows", [1, 4, 22, 23, 24])
@pytest.mark.parametrize("group", ["", "photo"])
def test_portions_make_the_same_text_and_json(
    monkeypatch: pytest.MonkeyPatch, rows: int, group: str
) -> None:
    table = _table(group)
    page = (say("one"), table, say("two"))
    answer = {"a": 1, "t": table, "empty": {}, "inner": {"t": table, "none": [table, None]}}
    text, answered = page_text(page, everything=True), json_text(answer)
    monkeypatch.setattr(astext, "_AT_ONCE", rows)
    monkeypatch.setattr(asjson, "_ROWS", rows)
    assert page_text(page, everything=True) == text
    assert "".join(json_parts(answer)) == answered
    rest = table.records()
    plain = {"a": 1, "t": rest, "empty": {}, "inner": {"t": rest, "none": [rest, None]}}
    assert answered == json.dumps(plain, indent=1, allow_nan=False)
    parts = list(page_parts(page, everything=True))
    assert len(parts) == 3 + math.ceil(N / rows)
    for as_json, said in ((True, answered), (False, text)):
        stream = io.StringIO()
        Output(as_json, everything=True, stream=stream).print(Document(answer, page))
        assert stream.getvalue() == said + "\n"


@pytest.mark.parametrize("far", [np.inf, -np.inf])
@pytest.mark.parametrize("where", ["array", "list", "scalar", "vector"])
def test_nothing_is_printed_where_a_number_is_infinite(where: str, far: float) -> None:
    last = np.array([1.0, far])
    values = {
        "array": last,
        "list": [None, far],
        "scalar": [1.0, 2.0],
        "vector": [(1.0, 2.0), (0.0, far)],
    }[where]
    table = Table("t", (Column("x"),), (values,))
    answer = {"first": 1, "t": table, "last": float(far) if where == "scalar" else 0.0}
    stream = io.StringIO()
    with pytest.raises(ValueError, match="infinity"):
        Output(as_json=True, stream=stream).print(Document(answer, ()))
    assert stream.getvalue() == ""
