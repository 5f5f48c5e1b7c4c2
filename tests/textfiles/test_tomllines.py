"""The lines of keys in TOML texts."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.textfiles.tomllines import TomlLines

TEXT = '''\
# [a] is no table here
"quoted key" = 1
text = """
[[camera]]
c = 5 ""\\" """""
other = \'\'\'
x = 1\'\'\'\'
list = [ # comment ]
  1, [2,
  3], { p = 4, q = "}" },
]
a . "b".c = 2
date = 1979-05-27 07:32:00 # c
[[camera]]
c = 1
  [camera.inner]
  deep = { very = 1 }
[[camera]]
c = 2
[[camera.lens]]
f = 1
[[camera.lens]]
f = 2
[plain.dotted]
end = 0'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("quoted key",), 2),
        (("text",), 3),
        (("other",), 6),
        (("list",), 8),
        (("list", 0), 9),
        (("list", 1), 9),
        (("list", 1, 1), 10),
        (("list", 2, "q"), 10),
        (("a", "b", "c"), 12),
        (("date",), 13),
        (("camera",), 14),
        (("camera", 0), 14),
        (("camera", 0, "c"), 15),
        (("camera", 0, "inner"), 16),
        (("camera", 0, "inner", "deep", "very"), 17),
        (("camera", 1), 18),
        (("camera", 1, "c"), 19),
        (("camera", 1, "absent"), 18),
        (("camera", 1, "lens", 1, "f"), 23),
        (("plain", "dotted", "end"), 25),
        (("nowhere",), None),
        ((), None),
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_every_key_is_found(path, line, end):
    text = TEXT.replace("\n", end)
    assert tomllib.loads(text)
    assert TomlLines(text).line(path) == line


@given(st.text(alphabet="ab=[]{}\"'.,#\n\\ 1", max_size=60))
def test_any_text_ends(text):
    TomlLines(text).line(("a",))


@given(
    st.recursive(
        st.integers() | st.text(alphabet="ab\"'\\#]}\n", max_size=5) | st.booleans(),
        lambda inner: st.lists(inner, max_size=3),
        max_leaves=8,
    ),
    st.text(alphabet="ab =\"'#.", min_size=1, max_size=6),
)
def test_values_of_all_kinds_are_passed_over(value, key):
    def toml(item: object) -> str:
        if isinstance(item, bool):
            return "true" if item else "false"
        if isinstance(item, str):
            return '"' + item.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
        if isinstance(item, list):
            return "[" + ",\n".join(toml(part) for part in item) + "]"
        return str(item)

    text = f"{toml(key)} = {toml(value)}\nlast = 1"
    if key != "last":
        assert tomllib.loads(text) == {key: value, "last": 1}
        assert TomlLines(text).line((key,)) == 1
        assert TomlLines(text).line(("last",)) == text.count("\n") + 1
