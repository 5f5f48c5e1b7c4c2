"""JSON of other programs: bounded in size and depth, with finite numbers only."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import decoded, read_bytes
from anaplot.textfiles.wording import describe_type, place, plain, quoted

__all__ = ["MAX_JSON_BYTES", "JsonPlace", "read_json"]

MAX_JSON_BYTES = 500_000_000


def read_json(path: Path, max_bytes: int = MAX_JSON_BYTES) -> JsonPlace:
    """Read a JSON file.

    Raises
    ------
    InputError
        It cannot be read, is too large, nested too deeply, no JSON, or holds NaN or Infinity.
    """
    text = decoded(read_bytes(path, max_bytes), path)

    def refuse(word: str) -> NoReturn:
        raise InputError(f"{place(path)}: {word} is no number")

    try:
        return JsonPlace(path, "", json.loads(text, parse_constant=refuse))
    except json.JSONDecodeError as error:
        raise InputError(f"{place(path, error.lineno)}: no JSON: {plain(error.msg, 80)}") from None
    except ValueError:  # a whole number of thousands of digits
        raise InputError(f"{place(path)}: a number of too many digits") from None
    except (RecursionError, MemoryError):
        raise InputError(f"{place(path)}: nested too deeply, or too large") from None


class JsonPlace(NamedTuple):
    """A value of a JSON file, and where it stands.

    Attributes
    ----------
    path
        The file.
    at
        Keys and indices that lead there, for people.
    value
        The value.
    """

    path: Path
    at: str
    value: Any

    def fail(self, message: str) -> InputError:
        """Return the error about this value."""
        where = f"{plain(self.at, 160)}: " if self.at else ""
        return InputError(f"{place(self.path)}: {where}{message}")

    def items(self) -> list[tuple[str, JsonPlace]]:
        """Return the entries of a table; raises InputError for anything else."""
        table = self._table()
        return [(key, self._inside(key, value)) for key, value in table.items()]

    def names(self) -> frozenset[str]:
        """Return the keys of a table; raises InputError for anything else."""
        return frozenset(self._table())

    def elements(self) -> list[JsonPlace]:
        """Return the elements of a list; raises InputError for anything else."""
        if not isinstance(self.value, list):
            raise self.fail(f"must be a list, not {describe_type(self.value)}")
        return [self._inside(str(k), value) for k, value in enumerate(self.value)]

    def __contains__(self, key: object) -> bool:
        return isinstance(self.value, dict) and key in self.value

    def get(self, key: str) -> JsonPlace:
        """Return what stands at a key; raises InputError where there is none."""
        table = self._table()
        if key not in table:
            raise self.fail(f"no {quoted(key)}")
        return self._inside(key, table[key])

    def number(self, low: float = -math.inf, high: float = math.inf) -> float:
        """Return a finite number within limits; raises InputError for anything else."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.fail(f"must be a number, not {describe_type(value)}")
        if not abs(value) < 1e300:
            raise self.fail("is not finite")
        if not low <= value <= high:
            raise self.fail(f"must lie between {low:g} and {high:g}, not {value:g}")
        return float(value)

    def optional(self, key: str) -> float:
        """Return the number at a key, or 0 where it is left out."""
        return self.get(key).number() if key in self else 0.0

    def vector(self) -> tuple[float, ...]:
        """Return three numbers; raises InputError for anything else."""
        parts = self.elements()
        if len(parts) != 3:
            raise self.fail(f"must have 3 numbers, not {len(parts)}")
        return tuple(part.number() for part in parts)

    def checked(self, what: str, check: Callable[[str], str | None]) -> str:
        """Return a text that passes a check; raises InputError with its complaint."""
        if not isinstance(self.value, str):
            raise self.fail(f"{what} must be text, not {describe_type(self.value)}")
        fault = check(self.value)
        if fault is not None:
            raise self.fail(f"the {what} {quoted(self.value)} {fault}")
        return self.value

    def _table(self) -> Mapping[str, Any]:
        if not isinstance(self.value, dict):
            raise self.fail(f"must be a table, not {describe_type(self.value)}")
        return self.value

    def _inside(self, key: str, value: Any) -> JsonPlace:
        return JsonPlace(self.path, f"{self.at}.{key}" if self.at else key, value)
