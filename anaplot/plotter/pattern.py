"""Record patterns: a small, anchored regular language that matches in linear time.

A profile is data from anywhere, so its patterns must not be able to stall the reader. The
language is a subset of Python's: literals, escapes, character classes, ``.``, named groups
``(?P<name>...)``, ``(?:...)``, alternatives, and the quantifiers ``?``, ``*``, ``+``, ``{n}``,
``{m,n}`` on single characters; a group may be optional (``?``) and no more. Matching never goes
back: a quantifier takes all it can and an alternative once taken stays. That makes the time
proportional to the length of the record.
"""

from __future__ import annotations

import re

__all__ = ["MAX_PATTERN", "PatternError", "compile_pattern"]

MAX_PATTERN = 500
_MAX_REPEAT = 256
_MAX_DEPTH = 8
_MAX_BRANCHES = 64
_CLASS_ESCAPES = "dDsSwW"
_CHARACTER_ESCAPES = "trnfv"
_QUANTIFIER = re.compile(r"\{(\d{1,3})(?:,(\d{1,3}))?\}")
_NAME = re.compile(r"\(\?P<([a-z][a-z0-9_]{0,30})>")


class PatternError(ValueError):
    """The pattern is not in the language; the message says where and why."""


def compile_pattern(text: str) -> re.Pattern[bytes]:
    """Compile a record pattern.

    Parameters
    ----------
    text
        The pattern, from ``^`` to ``$``, at most `MAX_PATTERN` characters of Latin-1.

    Returns
    -------
    re.Pattern
        To be used with ``fullmatch`` on the bytes of one record.

    Raises
    ------
    PatternError
        When the pattern is too long, not anchored or outside the language.
    """
    if len(text) > MAX_PATTERN:
        raise PatternError(f"longer than {MAX_PATTERN} characters")
    if not text.startswith("^") or not text.endswith("$") or text.endswith("\\$"):
        raise PatternError("not anchored: it must begin with ^ and end with $")
    try:
        text.encode("latin-1")
    except UnicodeEncodeError as error:
        raise PatternError(f"character {error.start + 1} is not a single byte") from None
    source = _PatternParser(text[1:-1]).parse()
    try:
        return re.compile(source.encode("latin-1"), re.DOTALL)
    except (re.error, OverflowError) as error:
        raise PatternError(str(error)) from None


class _PatternParser:
    """Recursive descent over the pattern; writes the pattern that never goes back."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._names: set[str] = set()
        self._branches = 1

    def parse(self) -> str:
        source, _ = self._alternatives(0)
        if self._at < len(self._text):
            raise self._error("unmatched )")
        return source

    def _error(self, reason: str) -> PatternError:
        return PatternError(f"character {self._at + 2}: {reason}")

    def _peek(self) -> str:
        return self._text[self._at : self._at + 1]

    def _alternatives(self, depth: int) -> tuple[str, bool]:
        """Return the source and whether it holds named groups."""
        if depth > _MAX_DEPTH:
            raise self._error("groups nested too deeply")
        branches: list[str] = []
        captures = False
        while True:
            source, holds = self._sequence(depth)
            branches.append(source)
            captures = captures or holds
            if self._peek() != "|":
                break
            self._at += 1
        if len(branches) == 1:
            return branches[0], captures
        joined = "|".join(branches)
        if not captures:
            return f"(?>{joined})", False
        # Atomic groups around captures are not reliable in every 3.11; a bound serves as well.
        self._branches *= len(branches)
        if self._branches > _MAX_BRANCHES:
            raise self._error("too many alternatives around named groups")
        return f"(?:{joined})", True

    def _sequence(self, depth: int) -> tuple[str, bool]:
        parts: list[str] = []
        captures = False
        while (character := self._peek()) and character not in "|)":
            if character == "(":
                source, holds = self._group(depth)
                captures = captures or holds
                parts.append(source)
            else:
                parts.append(self._atom(character) + self._quantifier())
        return "".join(parts), captures

    def _group(self, depth: int) -> tuple[str, bool]:
        if self._text.startswith("(?:", self._at):
            self._at += 3
            head = ""
        elif match := _NAME.match(self._text, self._at):
            head = match.group(0)
            if match.group(1) in self._names:
                raise self._error(f"group {match.group(1)} twice")
            self._names.add(match.group(1))
            self._at = match.end()
        else:
            raise self._error("only (?:...) and (?P<name>...) groups are allowed")
        inner, captures = self._alternatives(depth + 1)
        if self._peek() != ")":
            raise self._error("group not closed")
        self._at += 1
        optional = False
        if self._peek() == "?":
            optional = True
            self._at += 1
        if self._peek() and self._peek() in "?*+{":
            raise self._error("a group may be optional (?), not repeated")
        holds = captures or bool(head)
        source = f"{head}{inner})" if head else f"(?:{inner})"
        if not optional:
            return source, holds
        if not holds:
            return f"(?>{source}?)", False
        self._branches *= 2
        if self._branches > _MAX_BRANCHES:
            raise self._error("too many optional named groups")
        return f"(?:{source})?", True

    def _atom(self, character: str) -> str:
        if character == "[":
            return self._class()
        if character == "\\":
            return self._escape()
        if character in "^$":
            raise self._error(f"{character} inside the pattern")
        if character in "?*+{":
            raise self._error(f"{character} without anything to repeat")
        self._at += 1
        return character if character == "." else re.escape(character)

    def _escape(self) -> str:
        following = self._text[self._at + 1 : self._at + 2]
        if following == "x":
            source = self._text[self._at : self._at + 4]
            if not re.fullmatch(r"\\x[0-9a-fA-F]{2}", source):
                raise self._error("\\x needs two hexadecimal digits")
        elif following and (
            following in _CLASS_ESCAPES
            or following in _CHARACTER_ESCAPES
            or not following.isalnum()
        ):
            source = "\\" + following
        else:
            raise self._error("escape not allowed")
        self._at += len(source)
        return source

    def _class(self) -> str:
        start = self._at
        self._at += 1
        parts = ["["]
        if self._peek() == "^":
            parts.append("^")
            self._at += 1
        first = True
        while True:
            character = self._peek()
            if not character:
                self._at = start
                raise self._error("[ not closed")
            if character == "]" and not first:
                break
            first = False
            if character == "\\":
                parts.append(self._escape())
                continue
            self._at += 1
            if character == "-" and self._peek() == "-" and parts[-1] not in ("[", "^"):
                raise self._error("-- inside a class, write one of them \\-")
            # "[" and doubled "&", "~", "|" may get a meaning of their own in later Pythons
            parts.append("\\" + character if character in "[]&~|" else character)
        self._at += 1
        return "".join(parts) + "]"

    def _quantifier(self) -> str:
        character = self._peek()
        if not character or character not in "?*+{":
            return ""
        if character == "{":
            match = _QUANTIFIER.match(self._text, self._at)
            if match is None:
                raise self._error("a repetition is written {n} or {m,n}")
            low = int(match.group(1))
            high = int(match.group(2) or low)
            if high > _MAX_REPEAT or low > high:
                raise self._error(f"repetition outside 0..{_MAX_REPEAT} or reversed")
            source = match.group(0)
            fixed = low == high
        else:
            source = character
            fixed = False
        self._at += len(source)
        if self._peek() and self._peek() in "?*+{":
            raise self._error("one quantifier only")
        return source if fixed else source + "+"
