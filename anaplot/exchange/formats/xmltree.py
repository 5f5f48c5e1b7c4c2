"""XML as data: no document type, no entities, nothing fetched; bounded in size and depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wording import place, plain

__all__ = ["Node", "read_xml"]

_DEPTH = 60


@dataclass(slots=True)
class Node:
    """An element.

    Attributes
    ----------
    path, line
        Where it stands.
    name
        Its name.
    attributes, children
        What it has.
    text
        The text directly in it, without blanks at the ends.
    """

    path: Path
    line: int
    name: str
    attributes: dict[str, str]
    children: list[Node] = field(default_factory=list)
    text: str = ""

    def fail(self, message: str) -> InputError:
        """Return the error about this element."""
        return InputError(f"{place(self.path, self.line)}: {plain(self.name, 60)}: {message}")

    def all(self, name: str) -> Iterator[Node]:
        """Yield its children of a name."""
        return (child for child in self.children if child.name == name)

    def first(self, name: str) -> Node | None:
        """Return its first child of a name, or None."""
        return next(self.all(name), None)


def read_xml(path: Path, max_bytes: int) -> Node:
    """Read a file.

    Raises
    ------
    InputError
        It cannot be read, is no XML, states a document type, or nests too deeply.
    """
    data = read_bytes(path, max_bytes)
    parser = expat.ParserCreate()
    stack: list[Node] = []
    root: list[Node] = []
    texts: list[list[str]] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        node = Node(path, parser.CurrentLineNumber, name, attributes)
        if len(stack) >= _DEPTH:
            raise node.fail(f"nested more than {_DEPTH} deep")
        (stack[-1].children if stack else root).append(node)
        stack.append(node)
        texts.append([])

    def end(_: str) -> None:
        stack.pop().text = "".join(texts.pop()).strip()

    def doctype(*_: object) -> None:
        line = parser.CurrentLineNumber
        raise InputError(f"{place(path, line)}: a document type or an entity is not read")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = lambda text: texts[-1].append(text)
    parser.StartDoctypeDeclHandler = doctype
    parser.EntityDeclHandler = doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        why = plain(expat.ErrorString(error.code), 100)
        raise InputError(f"{place(path, error.lineno)}: no XML: {why}") from None
    except (LookupError, ValueError) as error:
        raise InputError(f"{place(path)}: no XML: {plain(str(error), 100)}") from None
    return root[0]
