"""Coordinates of points and photos with their full covariance: what one adjustment leaves another.

The state |X, C| of the parameters before and after an experiment (Figure 1 of the Bayesian paper):
what one adjustment leaves is what the next begins with. A block may name one without having any:
NumPy is loaded where there are numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.textfiles.wording import hint, quoted

__all__ = ["MOST_COORDINATES", "CoordinateName", "Posterior", "coordinate_name"]


_FARTHEST = 1e12  # m, as of any coordinate in a file
MOST_COORDINATES = 6000
"""Of one covariance: it has 288 MB then."""

_UNKNOWNS = {"point": ("X", "Y", "Z"), "photo": ("X", "Y", "Z", "omega", "phi", "kappa")}
_ROUNDING = 1e-6  # of the standard deviations: asymmetry and correlations beyond one


class CoordinateName(NamedTuple):
    """Which coordinate; as text "point:7:X" or "photo:101:omega".

    Attributes
    ----------
    kind, owner
        "point" or "photo", and its name.
    unknown
        X, Y, Z; of photos also omega, phi, kappa.
    """

    kind: Literal["point", "photo"]
    owner: str
    unknown: str

    @property
    def text(self) -> str:
        """As it stands in a file."""
        return ":".join(self)

    @property
    def axis(self) -> int:
        """Number of the unknown among its owner's."""
        return _UNKNOWNS[self.kind].index(self.unknown)

    @property
    def unit(self) -> str:
        """Unit of the coordinate, "m" or "rad"."""
        return "m" if self.axis < 3 else "rad"


def coordinate_name(text: str) -> CoordinateName:
    """Read a name as it stands in a file; a name of a point may hold colons.

    Raises
    ------
    InputError
        It is none.
    """
    kind, _, rest = text.partition(":")
    owner, _, unknown = rest.rpartition(":")
    if owner and unknown in _UNKNOWNS.get(kind, ()):
        return CoordinateName("point" if kind == "point" else "photo", owner, unknown)
    raise InputError(
        f"{quoted(text)} names no coordinate: point:NAME:X (or Y, Z) or photo:NAME:X (or Y, Z, "
        "omega, phi, kappa)"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Coordinates with their covariance.

    Attributes
    ----------
    names
        Of q coordinates.
    x
        (q,) their values [m, rad].
    covariance
        (q, q) for the a-priori sigma0; zeros in the rows of what is free of error.
    source
        What messages call it.

    Raises
    ------
    InputError
        Shapes that do not fit, a name twice, what is not finite or no covariance.
    """

    names: tuple[CoordinateName, ...] = field(repr=False)
    x: Array = field(repr=False)
    covariance: Array = field(repr=False)
    source: str = "what is given"

    def __post_init__(self) -> None:
        import numpy as np

        q, c = len(self.names), self.covariance
        if self.x.shape != (q,) or c.shape != (q, q):
            raise InputError(
                f"{self.source}: {q} names with x of shape {self.x.shape} and C of shape {c.shape}"
            )
        if q == 0:
            raise InputError(f"{self.source}: there are no coordinates in it")
        if q > MOST_COORDINATES:
            raise InputError(f"{self.source}: {q} coordinates: at most {MOST_COORDINATES}")
        seen: set[CoordinateName] = set()
        for name in self.names:
            if name in seen:
                raise InputError(f"{self.source}: {quoted(name.text)} stands twice")
            seen.add(name)
        if not (np.isfinite(self.x).all() and np.isfinite(c).all()):
            raise InputError(f"{self.source}: a number in x or C is not finite")
        if (np.abs(self.x) > _FARTHEST).any():
            worst = self.names[int(np.argmax(np.abs(self.x)))].text
            raise InputError(f"{self.source}: {quoted(worst)} lies farther than {_FARTHEST:g} m")
        diagonal = np.diag(c)
        if (diagonal < 0.0).any():
            worst = self.names[int(np.argmin(diagonal))].text
            raise InputError(f"{self.source}: the variance of {quoted(worst)} is negative")
        with np.errstate(over="ignore"):
            size = np.sqrt(diagonal)[:, None] * np.sqrt(diagonal)
            if (np.abs(c - c.T) > _ROUNDING * size).any():
                raise InputError(f"{self.source}: C is not symmetric")
            if (np.abs(c) > (1.0 + _ROUNDING) * size).any():
                raise InputError(f"{self.source}: C has a correlation beyond one: no covariance")

    def without(self, owners: Sequence[str]) -> Posterior:
        """Return it without some points and photos, which are left out of x and C.

        Parameters
        ----------
        owners
            Their names; "point:NAME" and "photo:NAME" where a name is both.

        Raises
        ------
        InputError
            There is none of that name, or nothing else.
        """
        import numpy as np

        known = [
            owner for name in self.names for owner in (name.owner, f"{name.kind}:{name.owner}")
        ]
        stray = next((one for one in owners if one not in set(known)), None)
        if stray is not None:
            raise InputError(f"{self.source}: nothing of {quoted(stray)}{hint(stray, known)}")
        gone = set(owners)
        left = [
            k
            for k, name in enumerate(self.names)
            if not {name.owner, f"{name.kind}:{name.owner}"} & gone
        ]
        names = tuple(self.names[k] for k in left)
        return Posterior(names, self.x[left], self.covariance[np.ix_(left, left)], self.source)
