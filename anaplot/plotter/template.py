"""Templates for what is sent: literal bytes with fields, and nothing that could run.

``{name}``, ``{name:spec}``, ``{name.sign}`` and ``{name.abs:spec}`` are replaced; ``{{`` and
``}}`` stand for braces. A spec is a flag (``+``, blank, ``0``), a width, decimals and one of
``f d x X s``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

__all__ = [
    "Field",
    "Template",
    "TemplateError",
    "Value",
    "parse_template",
]

MAX_TEMPLATE = 300
_FIELD = re.compile(
    r"\{([a-z][a-z0-9_]{0,30})(?:\.(sign|abs))?(?::([+ ]?0?\d{0,2}(?:\.\d{1,2})?)([fdxXs]))?\}"
)
Value = float | int | str | bytes


class TemplateError(ValueError):
    """The template cannot be read or filled; the message says why."""


@dataclass(frozen=True, slots=True)
class Field:
    """One place to fill.

    Attributes
    ----------
    name
        Whose value.
    part
        ``""`` the value, ``"sign"`` its sign as one character, ``"abs"`` its magnitude.
    layout
        Flags, width and decimals of the format specification.
    kind
        ``f d x X s``, or ``""`` for the value as it is.
    """

    name: str
    part: str
    layout: str
    kind: str

    def render(self, value: Value) -> bytes:
        """Return the value's bytes."""
        if self.kind in ("", "s"):
            raw = value if isinstance(value, bytes) else _latin(str(value))
            if not self.kind:
                return raw
            return _latin(format(raw.decode("latin-1"), self.layout.lstrip("+ ")))
        if isinstance(value, str | bytes) or not math.isfinite(value):
            raise TemplateError(f"{{{self.name}}} needs a number")
        if self.kind != "f":
            return _latin(format(round(value), self.layout + self.kind))
        text = format(value, self.layout + "f")
        if float(text.replace(" ", "")) == 0.0:
            text = format(0.0, self.layout + "f")
        return _latin(text)


@dataclass(frozen=True, slots=True)
class Template:
    """A parsed template.

    Attributes
    ----------
    text
        As it stands in the profile.
    parts
        Literal bytes and fields in order.
    """

    text: str
    parts: tuple[bytes | Field, ...]

    @property
    def names(self) -> frozenset[str]:
        """Names of all fields."""
        return frozenset(part.name for part in self.parts if isinstance(part, Field))

    @property
    def told(self) -> frozenset[str]:
        """Names whose value can be read back, not its sign alone."""
        fields = (part for part in self.parts if isinstance(part, Field))
        return frozenset(field.name for field in fields if field.part != "sign")

    def number(self, match: re.Match[bytes], name: str) -> float:
        """Return the number that a field told.

        Parameters
        ----------
        match
            Of the `matcher`.
        name
            One of `told`.

        Raises
        ------
        ValueError
            It is no number.
        """
        mine = {p.part: p for p in self.parts if isinstance(p, Field) and p.name == name}
        field = mine.get("") or mine["abs"]
        text = match.group(_group(field)).decode("latin-1")
        value = float(int(text, 16)) if field.kind in ("x", "X") else float(text)
        negative = field.part == "abs" and "sign" in mine
        return -value if negative and match.group(_group(mine["sign"])) == b"-" else value

    def render(self, values: Mapping[str, Value]) -> bytes:
        """Fill the template.

        Parameters
        ----------
        values
            One value for every name.

        Returns
        -------
        bytes
            What goes onto the line, without terminator and checksum.

        Raises
        ------
        TemplateError
            When a value is missing or is not a finite number where one is needed.
        """
        signs = self._signs(values)
        out = bytearray()
        for part in self.parts:
            if isinstance(part, bytes):
                out += part
                continue
            if part.name not in values:
                raise TemplateError(f"no value for {{{part.name}}}")
            value = values[part.name]
            if part.part == "sign":
                out += signs[part.name]
            elif part.part == "abs" and not isinstance(value, str | bytes):
                out += part.render(abs(value))
            else:
                out += part.render(value)
        return bytes(out)

    def _signs(self, values: Mapping[str, Value]) -> dict[str, bytes]:
        """Return the signs; a value that is rounded to zero has a plus."""
        signs: dict[str, bytes] = {}
        for part in self.parts:
            if not isinstance(part, Field) or part.part == "":
                continue
            value = values.get(part.name)
            if not isinstance(value, int | float):
                raise TemplateError(f"{{{part.name}}} needs a number")
            signs.setdefault(part.name, b"-" if value < 0 else b"+")
            if part.part == "abs" and part.kind and not part.render(abs(value)).strip(b" 0.+"):
                signs[part.name] = b"+"
        return signs

    def matcher(self) -> re.Pattern[bytes]:
        """Return a pattern that reads the fields back from what `render` wrote."""
        source = bytearray()
        seen: set[str] = set()
        for part in self.parts:
            if isinstance(part, bytes):
                source += re.escape(part)
                continue
            name = _group(part)
            if name in seen:
                raise TemplateError(f"{{{part.name}}} twice")
            seen.add(name)
            if part.part == "sign":
                body = rb"[-+ ]"
            elif part.kind in ("f", "d"):
                body = rb" {0,32}+[-+]?\d{1,12}+(?:\.\d{1,12}+)?+"
            elif part.kind in ("x", "X"):
                body = rb" {0,32}+[-+]?[0-9A-Fa-f]{1,12}+"
            else:
                body = rb"[^\r\n]{1,32}+"
            source += b"(?P<" + name.encode() + b">" + body + b")"
        return re.compile(bytes(source))


def _group(field: Field) -> str:
    """Name of a field's group in a matcher."""
    return field.name + ("_" + field.part if field.part else "")


def parse_template(text: str) -> Template:
    """Read a template.

    Parameters
    ----------
    text
        Literal Latin-1 text with fields.

    Raises
    ------
    TemplateError
        When it is too long or a brace does not belong to a field.
    """
    if len(text) > MAX_TEMPLATE:
        raise TemplateError(f"longer than {MAX_TEMPLATE} characters")
    parts: list[bytes | Field] = []
    literal: list[str] = []
    at = 0
    while at < len(text):
        character = text[at]
        if character in "{}" and text[at : at + 2] == character * 2:
            literal.append(character)
            at += 2
        elif character == "{":
            match = _FIELD.match(text, at)
            if match is None:
                raise TemplateError(f"character {at + 1}: not a field like {{name:+.4f}}")
            if literal:
                parts.append(_latin("".join(literal)))
                literal = []
            layout, kind = match.group(3) or "", match.group(4) or ""
            if "." in layout and kind != "f":
                raise TemplateError(f"character {at + 1}: decimals belong to f")
            parts.append(Field(match.group(1), match.group(2) or "", layout, kind))
            at = match.end()
        elif character == "}":
            raise TemplateError(f"character {at + 1}: }} without {{")
        else:
            literal.append(character)
            at += 1
    if literal:
        parts.append(_latin("".join(literal)))
    return Template(text, tuple(parts))


def _latin(text: str) -> bytes:
    try:
        return text.encode("latin-1")
    except UnicodeEncodeError as error:
        raise TemplateError(f"character {error.start + 1} is not a single byte") from None
