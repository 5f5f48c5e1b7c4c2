"""Reading drawings back."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np

from anaplot.drawing.drawing import Drawing
from anaplot.drawing.textwidth import SMALL, TEXT, TINY, text_width

SVG = "{http://www.w3.org/2000/svg}"
ALLOWED = {"svg", "title", "desc", "g", "path", "rect", "text", "style"}
_TOKEN = re.compile(r"[a-zA-Z]|-?\d*\.?\d+")


def parsed(text: str) -> ET.Element:
    return ET.fromstring(text)


def sound(drawing: Drawing) -> ET.Element:
    """Return a drawing's root, having checked what holds of every drawing."""
    root = parsed(drawing.svg)
    assert root.tag == f"{SVG}svg"
    assert root.get("role") == "img"
    title, desc = root[0], root[1]
    assert (title.tag, desc.tag) == (f"{SVG}title", f"{SVG}desc")
    assert title.text
    assert desc.text
    assert re.search(r"\d", desc.text), "a description states numbers"
    for one in root.iter():
        assert one.tag.removeprefix(SVG) in ALLOWED
        for name, value in one.attrib.items():
            assert not name.startswith("on")
            assert "href" not in name
            assert "url(" not in value
            assert "nan" not in value
            assert "inf" not in value.split()
    for low_x, low_y, high_x, high_y in boxes(root):
        assert low_x >= -1.0
        assert low_y >= -1.0
        assert high_x <= float(root.get("viewBox", "").split()[2]) + 1.0
        assert high_y <= float(root.get("viewBox", "").split()[3]) + 1.0
    return root


def boxes(root: ET.Element) -> list[tuple[float, float, float, float]]:
    """Return left, upper, right and lower side of every text, about."""
    out = []
    for one, shown in zip(root.iter(f"{SVG}text"), texts(root), strict=True):
        classes = (one.get("class") or "").split()
        size = SMALL if "t-small" in classes else TINY if "t-tiny" in classes else TEXT
        size = 15.0 if "t-title" in classes else size
        wide = text_width(shown, size) / 1.06  # which is rather too much
        x, y = float(one.get("x", "0")), float(one.get("y", "0"))
        before = wide if "t-end" in classes else wide / 2 if "t-mid" in classes else 0.0
        if one.get("transform"):  # read from the right: along it is upwards
            out.append((x - 0.8 * size, y + before - wide, x + 0.2 * size, y + before))
        else:
            out.append((x - before, y - 0.8 * size, x - before + wide, y + 0.2 * size))
    return out


def texts(root: ET.Element) -> list[str]:
    """Return what is written in a drawing, without what is shown when a pointer rests on it."""
    out = []
    for one in root.iter(f"{SVG}text"):
        out.append((one.text or "") + "".join(child.tail or "" for child in one))
    return out


def paths(root: ET.Element, word: str) -> list[str]:
    """Return the data of the paths that have a class."""
    return [
        one.get("d") or ""
        for one in root.iter(f"{SVG}path")
        if word in (one.get("class") or "").split()
    ]


def runs(d: str) -> list[np.ndarray]:
    """Return the (k, 2) places of every run of M, m, l, L, h in path data; no arcs."""
    tokens = _TOKEN.findall(d)
    out: list[list[tuple[float, float]]] = []
    at = (0.0, 0.0)
    command = ""
    k = 0
    while k < len(tokens):
        if tokens[k].isalpha():
            command = tokens[k]
            k += 1
            if command == "z":
                continue
        if command == "h":
            at = (at[0] + float(tokens[k]), at[1])
            k += 1
        else:
            x, y = float(tokens[k]), float(tokens[k + 1])
            k += 2
            at = (x, y) if command in "ML" else (at[0] + x, at[1] + y)
        if command in "Mm":
            out.append([at])
            command = "l" if command == "m" else "L"
        else:
            out[-1].append(at)
    return [np.array(one) for one in out]
