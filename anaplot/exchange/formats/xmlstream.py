"""XML of other programs, piece by piece: no document type, no entities, nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from xml.parsers import expat

from anaplot.errors import InputError
from anaplot.exchange.formats.sourcelines import MAX_SOURCE_BYTES, SourceLine
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.wording import place, plain, quoted

__all__ = ["Element", "elements", "first_tag", "xml_text"]

_PIECE = 1 << 16  # bytes
_MAX_DEPTH = 40
_MAX_TEXT = 1_000_000  # characters of an element
_MAX_WORDS = 20_000  # characters of all its attributes
_MAX_TOKEN = 1 << 20  # bytes without anything that ends
_MAX_CHILDREN = 1_000_000
_MAX_ATTRIBUTES = 100


@dataclass(slots=True)
class Element:
    """An element with what is in it, but for elements that are handed out by themselves.

    Attributes
    ----------
    at
        Its line; what is wrong with it is said by that.
    name
        Its tag.
    attributes, text, children
        What is in it.
    """

    at: SourceLine
    name: str
    attributes: dict[str, str]
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def child(self, name: str) -> Element | None:
        """Return the first child of a name."""
        return next((one for one in self.children if one.name == name), None)

    def find(self, *names: str) -> Element | None:
        """Return what several names lead to, each the first child."""
        at: Element | None = self
        for name in names:
            at = None if at is None else at.child(name)
        return at

    def value(self, *names: str) -> str | None:
        """Return the text that names lead to, without outer blanks; None where there is none."""
        found = self.find(*names)
        return None if found is None else found.text.strip() or None

    def needed(self, *names: str) -> str:
        """Return the text that names lead to; raises InputError where there is none."""
        found = self.value(*names)
        if found is None:
            raise self.at.fail(f"<{self.name}> has no {'/'.join(names)}")
        return found

    def number(self, *names: str) -> float | None:
        """Return the number that names lead to; raises InputError for what is none."""
        found = self.find(*names)
        if found is None or not found.text.strip():
            return None
        return found.at.number_of(found.text.strip(), names[-1])

    def needed_number(self, *names: str) -> float:
        """Return the number that names lead to; raises InputError where there is none."""
        self.needed(*names)
        value = self.number(*names)
        return 0.0 if value is None else value

    def attribute(self, name: str) -> str:
        """Return an attribute; raises InputError where there is none."""
        found = self.attributes.get(name)
        if found is None:
            raise self.at.fail(f"<{self.name}> has no {name}")
        return found


def elements(path: Path, root: str, wanted: Collection[str]) -> Iterator[Element]:
    """Yield elements as they end.

    Parameters
    ----------
    path
        The file.
    root
        Tag of its outermost element.
    wanted
        Which elements are handed out: tags from the outermost on, with slashes between. What is
        in none of them is not kept, and one within another is handed out for itself, before it.

    Raises
    ------
    InputError
        No such XML, a document type or entity, or something of it is too large; with its line.
    """
    reader = _Reader(path, root, frozenset(wanted))
    with open_input(path, MAX_SOURCE_BYTES) as file:
        while piece := file.read(_PIECE):
            yield from reader.feed(piece)
    yield from reader.feed(b"", last=True)


def first_tag(path: Path) -> str | None:
    """Return the outermost element of a file's beginning; None where it is no such XML."""
    reader = _Reader(path, None, frozenset())
    try:
        with open_input(path, MAX_SOURCE_BYTES) as file:
            reader.feed(file.read(_PIECE))
    except InputError:
        pass
    return reader.root


class _Reader:
    """Takes bytes and makes elements."""

    def __init__(self, path: Path, root: str | None, wanted: frozenset[str]) -> None:
        self.root: str | None = None
        self._path, self._needed, self._wanted = path, root, wanted
        self._tags: list[str] = []
        self._open: list[Element | None] = []  # None: not kept
        self._done: list[Element] = []
        self._fed = 0
        parser = self._parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text
        parser.StartDoctypeDeclHandler = self._doctype
        parser.EntityDeclHandler = self._doctype
        parser.SetParamEntityParsing(expat.XML_PARAM_ENTITY_PARSING_NEVER)

    def feed(self, piece: bytes, *, last: bool = False) -> list[Element]:
        """Return the elements that end in a piece."""
        self._fed += len(piece)
        try:
            self._parser.Parse(piece, last)
        except expat.ExpatError as error:
            raise InputError(
                f"{place(self._path, error.lineno)}: not XML: {expat.ErrorString(error.code)}"
            ) from None
        except (LookupError, ValueError) as error:  # an encoding nobody knows
            raise InputError(f"{place(self._path)}: not XML: {plain(str(error), 100)}") from None
        if not last and self._fed - self._parser.CurrentByteIndex > _MAX_TOKEN + _PIECE:
            raise self._at().fail(f"more than {_MAX_TOKEN} bytes without an end of a tag or text")
        done, self._done = self._done, []
        return done

    def _at(self) -> SourceLine:
        return SourceLine(self._path, self._parser.CurrentLineNumber, "")

    def _doctype(self, *_: object) -> None:
        raise self._at().fail("a document type or entity declaration: not read")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if self.root is None:
            self.root = tag
            if self._needed is not None and tag != self._needed:
                raise self._at().fail(f"<{plain(tag, 60)}> is not <{self._needed}>")
        if len(self._tags) >= _MAX_DEPTH:
            raise self._at().fail(f"elements within elements, more than {_MAX_DEPTH}")
        if len(attributes) > _MAX_ATTRIBUTES:
            raise self._at().fail(f"more than {_MAX_ATTRIBUTES} attributes")
        if sum(map(len, attributes.values())) > _MAX_WORDS:
            raise self._at().fail(f"attributes of more than {_MAX_WORDS} characters")
        around = self._open[-1] if self._open else None
        self._tags.append(tag)
        chosen = "/".join(self._tags) in self._wanted
        made = Element(self._at(), tag, attributes) if chosen or around is not None else None
        if made is not None and around is not None and not chosen:
            if len(around.children) >= _MAX_CHILDREN:
                raise self._at().fail(f"{quoted(around.name)} holds more than {_MAX_CHILDREN}")
            around.children.append(made)
        self._open.append(made)

    def _end(self, tag: str) -> None:
        made = self._open.pop()
        if made is not None and "/".join(self._tags) in self._wanted:
            self._done.append(made)
        self._tags.pop()

    def _text(self, text: str) -> None:
        made = self._open[-1] if self._open else None
        if made is None or made.children:
            return
        if not text.strip():  # between elements it is nothing
            text = " " if made.text else ""
        if len(made.text) + len(text) > _MAX_TEXT:
            raise self._at().fail(f"<{made.name}> has more than {_MAX_TEXT} characters")
        made.text += text


def xml_text(text: str) -> str:
    """Return text as it stands between tags; what may be a name has no sign that XML has not."""
    return escape(text, quote=False)
