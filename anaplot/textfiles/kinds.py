"""What a key of a TOML table or a column of a CSV file may hold: declared once, checked alike.

A kind knows nothing of files. What is wrong with a value it says in a few words ("must be greater
than 0, not -1"); the reader puts file, line, table and key before them.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Generic, TypeVar

from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import describe_type, hint, plain, quoted

__all__ = [
    "FLAG",
    "FRACTION",
    "METRES",
    "NAME",
    "NUMBER",
    "PHOTO",
    "POSITIVE",
    "SIGMA",
    "SIGMA_OR_FREE",
    "TABLE",
    "Among",
    "AnyTable",
    "Blank",
    "Fields",
    "Flag",
    "Items",
    "Keys",
    "Kind",
    "KnownName",
    "ListOf",
    "Made",
    "MapOf",
    "Name",
    "Number",
    "Numbers",
    "Octets",
    "OneOrMore",
    "Text",
    "Whole",
    "Word",
    "WrongValueError",
]

T = TypeVar("T")
S = TypeVar("S")


_NOT_ZERO = re.compile(r"[-+]?[0.]*[1-9]")  # of which nothing is left


class WrongValueError(ValueError):
    """A value is not of its kind.

    Parameters
    ----------
    message
        What is wrong, without where.
    at
        Keys and indices that lead to it inside the value.
    """

    def __init__(self, message: str, *at: str | int) -> None:
        super().__init__(message)
        self.at = at

    def placed(self) -> str:
        """Return what is wrong, behind the keys and indices that lead to it: `items[3]: ...`."""
        where = "".join(f"[{at}]" if isinstance(at, int) else f".{at}" for at in self.at)
        return ": ".join(part for part in (where.removeprefix("."), str(self)) if part)


class Kind(Generic[T]):
    """One kind of value; every method raises WrongValueError."""

    def of(self, value: Any) -> T:
        """Return what a TOML value stands for."""
        raise NotImplementedError

    def of_text(self, text: str) -> T:
        """Return what a field of a CSV file stands for."""
        return self.of(text)

    @property
    def numeric(self) -> bool:
        """Whether it stands for a number, and `numbers` takes a whole column."""
        return False

    def numbers(self, texts: Sequence[str]) -> array[float]:
        """Return the numbers of a column, where they are; NaN for what may be blank and is."""
        raise NotImplementedError


Fields = Mapping[str, Kind[Any]]
"""The kind of every key of a table, or column of a file."""


class Number(Kind[float]):
    """A finite number within bounds, which count in unless `inside` says otherwise."""

    def __init__(
        self, low: float = -math.inf, high: float = math.inf, *, inside: bool = False
    ) -> None:
        self._low, self._high, self._inside = low, high, inside
        self._unbounded = math.isinf(low) and math.isinf(high)

    def of(self, value: Any) -> float:
        """Return a whole number or one with a point."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise WrongValueError(f"must be a number, not {describe_type(value)}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise WrongValueError("must be a finite number")
        if not self._holds(number):
            raise WrongValueError(f"must {self._bounds()}, not {number:g}")
        return number

    def of_text(self, text: str) -> float:
        """Return a decimal number."""
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        # float() also takes 1_000, other scripts' digits, "nan" and what overflows.
        if math.isfinite(number) and text.isascii() and "_" not in text:
            if number == 0.0 and _NOT_ZERO.match(text):
                raise WrongValueError(f"is too small a number: {quoted(text)}")
            return self.of(number)
        raise WrongValueError(
            f"must be a finite number, not {quoted(text)}" if text else "is empty"
        )

    @property
    def numeric(self) -> bool:
        """It does."""
        return True

    def numbers(self, texts: Sequence[str]) -> array[float]:
        """Return the numbers of a column, at the speed of their parsing."""
        try:
            numbers = array("d", map(float, texts))
        except ValueError:
            return array("d", map(self.of_text, texts))
        if not numbers:
            return numbers
        joined = "".join(texts)
        # a sum is finite only where all of them are
        good = joined.isascii() and "_" not in joined and math.isfinite(sum(numbers))
        good = good and not (0.0 in numbers and "e-" in joined.lower())
        if good and (self._unbounded or all(map(self._holds, (min(numbers), max(numbers))))):
            return numbers
        return array("d", map(self.of_text, texts))

    def _holds(self, number: float) -> bool:
        if self._inside:
            return self._low < number < self._high
        return self._low <= number <= self._high

    def _bounds(self) -> str:
        if self._low == 0.0 and math.isinf(self._high):
            return "be greater than 0" if self._inside else "be 0 or greater"
        if math.isinf(self._high):
            return f"be {'greater than' if self._inside else 'at least'} {self._low:g}"
        return f"lie between {self._low:g} and {self._high:g}"


class Sigma(Number):
    """A standard deviation: the squares of what is divided by it are numbers.

    Parameters
    ----------
    zero
        Whether it may be 0: free of error.
    """

    _SMALLEST, _LARGEST = 1e-100, 1e100

    def __init__(self, *, zero: bool = False) -> None:
        super().__init__(0.0, inside=not zero)

    def of(self, value: Any) -> float:
        """Return a number; 0 is not negative."""
        number = abs(super().of(value))
        if not self._weighed(number):
            size = "small" if number < 1.0 else "large"
            raise WrongValueError(
                f"{number:g} is too {size} for a standard deviation "
                f"({self._SMALLEST:g} to {self._LARGEST:g})"
            )
        return number

    def numbers(self, texts: Sequence[str]) -> array[float]:
        """Return the numbers of a column, at the speed of their parsing."""
        numbers = super().numbers(texts)
        if all(map(self._weighed, numbers)):
            return array("d", map(abs, numbers))
        return array("d", map(self.of_text, texts))

    def _weighed(self, number: float) -> bool:
        return number == 0.0 or self._SMALLEST <= number <= self._LARGEST


class Whole(Kind[int]):
    """A whole number from `low` to `high`."""

    def __init__(self, low: int, high: int) -> None:
        self._low, self._high = low, high

    def of(self, value: Any) -> int:
        """Return a whole number."""
        if isinstance(value, bool) or not isinstance(value, int):
            raise WrongValueError(f"must be a whole number, not {describe_type(value)}")
        if not self._low <= value <= self._high:
            # not shown: it may have thousands of digits
            raise WrongValueError(f"must be a whole number from {self._low} to {self._high}")
        return value


class Among(Kind[float]):
    """One of some numbers."""

    def __init__(self, *numbers: float) -> None:
        self._numbers = numbers

    def of(self, value: Any) -> float:
        """Return the number."""
        if isinstance(value, bool) or value not in self._numbers:
            raise WrongValueError(f"must be {' or '.join(f'{n:g}' for n in self._numbers)}")
        return self._numbers[self._numbers.index(value)]


class Flag(Kind[bool]):
    """True or false; in a CSV file yes, no or blank for no."""

    def of(self, value: Any) -> bool:
        """Return true or false."""
        if not isinstance(value, bool):
            raise WrongValueError(f"must be true or false, not {describe_type(value)}")
        return value

    def of_text(self, text: str) -> bool:
        """Return whether a field says yes."""
        if text not in ("yes", "no", ""):
            raise WrongValueError(f"must be yes, no or blank, not {quoted(text)}")
        return text == "yes"


class Text(Kind[str]):
    """Text of bounded length."""

    def __init__(self, limit: int = 400, *, empty: bool = True) -> None:
        self._limit, self._empty = limit, empty

    def of(self, value: Any) -> str:
        """Return the text."""
        if not isinstance(value, str):
            raise WrongValueError(f"must be text, not {describe_type(value)}")
        if len(value) > self._limit:
            raise WrongValueError(f"is longer than {self._limit} characters")
        if not value and not self._empty:
            raise WrongValueError("is empty")
        return value


class Octets(Kind[bytes]):
    """Text that stands for bytes, one for each character."""

    def __init__(self, limit: int = 200, *, empty: bool = True) -> None:
        self._text = Text(limit, empty=empty)

    def of(self, value: Any) -> bytes:
        """Return the bytes."""
        try:
            return self._text.of(value).encode("latin-1")
        except UnicodeEncodeError:
            raise WrongValueError("holds a character that is not a single byte") from None


class Word(Kind[str]):
    """One of a few words."""

    def __init__(self, *words: str) -> None:
        self._words = words

    def of(self, value: Any) -> str:
        """Return the word."""
        if value in self._words:
            return str(value)
        near, what = "", describe_type(value)
        if isinstance(value, str):
            near, what = hint(value, self._words, listing=False), quoted(value)
        words = " or ".join(f'"{word}"' for word in self._words)
        raise WrongValueError(f"must be {words}, not {what}{near}")


def _name(value: Any) -> str:
    if isinstance(value, int | float) and not isinstance(value, bool):
        raise WrongValueError("a name stands in quotes, also one of digits")
    if not isinstance(value, str):
        raise WrongValueError(f"must be a name, not {describe_type(value)}")
    if not value:
        raise WrongValueError("is empty")
    return value


class KnownName(Kind[str]):
    """The name of something that is stated elsewhere.

    Parameters
    ----------
    what
        What it is called ("photo").
    known
        The names there are.
    """

    def __init__(self, what: str, known: Collection[str]) -> None:
        self._what, self._known = what, known

    def of(self, value: Any) -> str:
        """Return the name."""
        name = _name(value)
        if name not in self._known:
            near = hint(name, self._known)
            raise WrongValueError(f"unknown {self._what} {quoted(name)}{near}")
        return name


class Name(Kind[str]):
    """A name, see `anaplot.textfiles.names`."""

    def of(self, value: Any) -> str:
        """Return the name."""
        name = _name(value)
        fault = name_fault(name)
        if fault is not None:
            raise WrongValueError(f"the name {quoted(name)} {fault}")
        return name


class AnyTable(Kind[dict[str, Any]]):
    """A table, whatever it holds."""

    def of(self, value: Any) -> dict[str, Any]:
        """Return the table."""
        if not isinstance(value, dict):
            raise WrongValueError(f"must be a table, not {describe_type(value)}")
        return value


def _inside(at: str | int, kind: Kind[T], value: Any) -> T:
    """Return the value of what stands at a key or index of another value."""
    try:
        return kind.of(value)
    except WrongValueError as error:
        raise WrongValueError(str(error), at, *error.at) from None


def _all_inside(kinds: Sequence[Kind[T]], items: Sequence[Any]) -> tuple[T, ...]:
    """Return the values of as many items as kinds."""
    try:
        return tuple([kind.of(item) for kind, item in zip(kinds, items, strict=True)])
    except WrongValueError:
        # once more, to say where
        pairs = enumerate(zip(kinds, items, strict=True))
        return tuple([_inside(index, kind, item) for index, (kind, item) in pairs])


class ListOf(Kind[tuple[T, ...]], Generic[T]):
    """A list, of one of the given lengths where there are any.

    Parameters
    ----------
    kind
        Of its items.
    what
        What the items are called ("numbers").
    lengths, most
        The lengths that it may have; its largest length.
    """

    def __init__(self, kind: Kind[T], what: str, *lengths: int, most: int | None = None) -> None:
        self._kind, self._lengths, self._most = kind, lengths, most
        self._what = f"{' or '.join(map(str, lengths))} {what}".lstrip()

    def of(self, value: Any) -> tuple[T, ...]:
        """Return the items."""
        if not isinstance(value, list):
            raise WrongValueError(f"must be a list of {self._what}, not {describe_type(value)}")
        if self._lengths and len(value) not in self._lengths:
            raise WrongValueError(f"must hold {self._what}, not {len(value)}")
        if self._most is not None and len(value) > self._most:
            raise WrongValueError(f"holds {len(value)} {self._what}, more than {self._most}")
        return _all_inside([self._kind] * len(value), value)


class Numbers(ListOf[float]):
    """A list of `length` numbers, each of a kind."""

    def __init__(self, length: int, kind: Kind[float] | None = None) -> None:
        super().__init__(kind or NUMBER, "numbers", length)


class OneOrMore(Kind[tuple[T, ...]], Generic[T]):
    """One value of a kind, or a list of up to fifty such values."""

    def __init__(self, kind: Kind[T]) -> None:
        self._kind = kind

    def of(self, value: Any) -> tuple[T, ...]:
        """Return the values."""
        if not isinstance(value, list):
            return (self._kind.of(value),)
        if not 1 <= len(value) <= 50:
            raise WrongValueError("must be one, or a list of 1 to 50")
        return tuple(_inside(index, self._kind, item) for index, item in enumerate(value))


class Items(Kind[tuple[Any, ...]]):
    """A list with an item of each of some kinds."""

    def __init__(self, *kinds: Kind[Any]) -> None:
        self._kinds = kinds

    def of(self, value: Any) -> tuple[Any, ...]:
        """Return the items."""
        if not isinstance(value, list):
            raise WrongValueError(f"must be a list, not {describe_type(value)}")
        if len(value) != len(self._kinds):
            raise WrongValueError(f"must hold {len(self._kinds)} items, not {len(value)}")
        return _all_inside(self._kinds, value)


class MapOf(Kind[dict[S, T]], Generic[S, T]):
    """A table of which the keys are data: each of one kind, their values of another."""

    def __init__(self, key: Kind[S], value: Kind[T]) -> None:
        self._key, self._value = key, value

    def of(self, value: Any) -> dict[S, T]:
        """Return keys and values in file order."""
        return {
            _inside(key, self._key, key): _inside(key, self._value, item)
            for key, item in TABLE.of(value).items()
        }


class Keys(Kind[dict[str, Any]]):
    """A table of declared keys.

    Parameters
    ----------
    required, optional
        Kind of every key that must be there, and that may be.
    also
        Further keys that may be there and are read otherwise.
    """

    def __init__(
        self,
        required: Fields,
        optional: Fields | None = None,
        also: Collection[str] = (),
    ) -> None:
        self._required = required
        self._kinds = {**required, **(optional or {})}
        self._also = also

    def of(self, value: Any) -> dict[str, Any]:
        """Return the values that are there, by key, in the order of the declaration."""
        for key in TABLE.of(value):
            if key not in self._kinds and key not in self._also:
                what = "table" if isinstance(value[key], dict) else "key"
                near = hint(key, (*self._kinds, *self._also))
                raise WrongValueError(f"unknown {what}{near}", key)
        found = {}
        for key, kind in self._kinds.items():
            if key in value:
                found[key] = _inside(key, kind, value[key])
            elif key in self._required:
                raise WrongValueError(f"no key {quoted(key)}")
        return found


class Made(Kind[T], Generic[T]):
    """What a function makes of a value of another kind; its ValueError says what is wrong."""

    def __init__(self, kind: Kind[Any], make: Callable[[Any], T]) -> None:
        self._kind, self._make = kind, make

    def of(self, value: Any) -> T:
        """Return what the function makes of a TOML value."""
        return self._made(self._kind.of(value))

    def of_text(self, text: str) -> T:
        """Return what the function makes of a field."""
        return self._made(self._kind.of_text(text))

    def _made(self, value: Any) -> T:
        try:
            return self._make(value)
        except WrongValueError:
            raise
        except ValueError as error:
            raise WrongValueError(plain(str(error), 200)) from None


class Blank(Kind[T | None], Generic[T]):
    """A field that may be blank, or null in JSON: None, or the value of another kind."""

    def __init__(self, kind: Kind[T]) -> None:
        self._kind = kind

    def of(self, value: Any) -> T | None:
        """Return None for null."""
        return None if value is None else self._kind.of(value)

    def of_text(self, text: str) -> T | None:
        """Return None for a blank field."""
        return self._kind.of_text(text) if text else None

    @property
    def numeric(self) -> bool:
        """As the other kind."""
        return self._kind.numeric

    def numbers(self, texts: Sequence[str]) -> array[float]:
        """Return the numbers of a column, at the speed of the other kind; NaN for a blank field."""
        if not any(texts):
            return array("d", [math.nan]) * len(texts)
        filled = iter(self._kind.numbers([text for text in texts if text]))
        return array("d", [next(filled) if text else math.nan for text in texts])


NUMBER = Number()
POSITIVE = Number(0.0, inside=True)
SIGMA = Sigma()
SIGMA_OR_FREE = Sigma(zero=True)
METRES = Number(-1e12, 1e12)
"""A coordinate or length in an object: its square beside any standard deviation is a number."""
FRACTION = Number(0.0, 1.0, inside=True)
FLAG = Flag()
NAME = Name()
PHOTO = Name()
TABLE = AnyTable()
