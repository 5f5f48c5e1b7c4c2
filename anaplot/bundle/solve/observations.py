"""All observations of a bundle as one vector: which there are, how they are called and weighted.

Image coordinates first (ray by ray, x and y), then weighted control, priors of points, priors on
orientations, priors on additional parameters, conditions between points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.linearised import Linearised
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.pointcolumns import Coded

__all__ = [
    "GROUND_KINDS",
    "ORIENTATION",
    "ObservationName",
    "Observations",
    "Unit",
    "observations_at",
    "observations_of",
]

ObservationName = tuple[str | None, ...]
"""("image", photo, point, model, axis), ("control", point, axis), ("point prior", point, axis),
("prior", owner, unknown) or ("condition", id, what, axis)."""
Unit = Literal["um", "m", "rad", "mm", "m/s", "m/photo"]

GROUND_KINDS = ("control", "point prior")
"""What `Problem.ground` states."""
ORIENTATION = ("X", "Y", "Z", "omega", "phi", "kappa")


class _Names(Sequence[ObservationName]):
    """The names of the observations, made when they are asked for."""

    def __init__(self, of: Observations) -> None:
        self._of = of

    def __len__(self) -> int:
        return self._of.count

    @overload
    def __getitem__(self, at: int) -> ObservationName: ...
    @overload
    def __getitem__(self, at: slice) -> list[ObservationName]: ...
    def __getitem__(self, at: int | slice) -> ObservationName | list[ObservationName]:
        found = range(self._of.count)[at]
        return self._of.name(found) if isinstance(found, int) else [*map(self._of.name, found)]

    def index(self, value: Any, start: int = 0, stop: int | None = None) -> int:
        """Return the row of a name, without making the others."""
        try:
            row = self._of.row_of(value)
        except KeyError:
            row = -1
        if row not in range(self._of.count)[start:stop]:
            raise ValueError(f"no observation {value!r}")
        return row


@dataclass(frozen=True, eq=False)
class Observations:
    """The observations of a bundle.

    Attributes
    ----------
    problem
        The bundle.
    ground, priors, additional
        (k, 3) of control (0) or priors of points (1), point and axis, (k, 2) photo and unknown, and
        (k,) numbers of parameters, of the rows that follow the image coordinates. After the
        additional parameters come the numbers of the offsets that the photos' priors share.
    """

    problem: Problem = field(repr=False)
    ground: Index
    priors: Index
    additional: Index
    _condition_sigma: Array = field(repr=False)

    @property
    def conditions(self) -> int:
        """Number of rows of conditions, the last ones."""
        return len(self.problem.conditions.rows) if self.problem.conditions else 0

    @cached_property
    def image(self) -> int:
        """Number of image coordinates, the first rows."""
        return 2 * len(self.problem.photo)

    @cached_property
    def starts(self) -> tuple[int, int, int, int]:
        """First rows of what is stated of points, orientations and parameters, and of conditions.

        Of points: control, then priors.
        """
        first = self.image
        second = first + len(self.ground)
        third = second + len(self.priors)
        return first, second, third, third + len(self.additional)

    @cached_property
    def parameters(self) -> int:
        """Number of additional parameters: from here on `additional` counts offsets."""
        return int(self.problem.additional_given.size)

    @cached_property
    def offsets(self) -> Index:
        """(k,) offsets that are observed, the last ones of `additional`."""
        found: Index = self.additional[self.additional >= self.parameters] - self.parameters
        return found

    @cached_property
    def control(self) -> int:
        """Number of control coordinates, the rows after the image coordinates."""
        return int((self.ground[:, 0] == 0).sum())

    @cached_property
    def first_offset(self) -> int:
        """First row of what is known of offsets; they end where the conditions begin."""
        return self.starts[3] - len(self.offsets)

    def in_file_order(self, kind: int) -> Index:
        """Return the rows of a kind, counted after the image coordinates, in the order of the file.

        Parameters
        ----------
        kind
            Of `GROUND_KINDS`: 0 control, 1 priors of points.
        """
        problem, first = self.problem, (0, self.control)[kind]
        mine = self.ground[self.ground[:, 0] == kind, 1].tolist()
        file = problem.control_rows if kind == 0 else [row.point for row in problem.block.priors]
        order = {name: k for k, name in enumerate(file)}
        at = [order[problem.points[point]] for point in mine]
        return first + np.argsort(np.array(at, dtype=np.intp), kind="stable")

    @cached_property
    def count(self) -> int:
        """Number of rows."""
        return self.starts[3] + self.conditions

    @property
    def names(self) -> Sequence[ObservationName]:
        """Identities of the rows."""
        return _Names(self)

    def name(self, row: int) -> ObservationName:
        """Return the identity of a row."""
        problem = self.problem
        first, second, third, fourth = self.starts
        if row < first:
            ray, axis = divmod(row, 2)
            photo = problem.photos[int(problem.photo[ray])]
            return ("image", photo, problem.points[int(problem.point[ray])], self._model(ray),
                    "xy"[axis])  # fmt: skip
        if row < second:
            kind, point, axis = self.ground[row - first].tolist()
            return (GROUND_KINDS[kind], problem.points[point], "XYZ"[axis])
        if row < third:
            photo, unknown = self.priors[row - second].tolist()
            return ("prior", problem.photos[photo], ORIENTATION[unknown])
        if row >= fourth and problem.conditions is not None:
            return ("condition", *problem.conditions.rows[row - fourth])
        number = int(self.additional[row - third])
        if number >= self.parameters and problem.offsets is not None:
            offset = problem.offsets.names[number - self.parameters]
            return ("prior", offset.group, f"{offset.kind} {offset.axis}")
        if problem.additional is None:
            raise IndexError(row)
        labels = problem.additional.set.names
        group, index = divmod(number, len(labels))
        return ("prior", problem.additional_groups[group], labels[index])

    def row_of(self, name: ObservationName) -> int:
        """Return the row of an identity.

        Raises
        ------
        KeyError
            There is none.
        """
        if name[0] != "image":
            return self._others[name]
        _, photo, point, model, axis = name
        at, photo_at = self._points[str(point)], self._photos[str(photo)]
        first, end = self._starts_of_points[at], self._starts_of_points[at + 1]
        for ray, other in enumerate(self.problem.photo[first:end].tolist(), first):
            if other == photo_at and self._model(ray) == model:
                return 2 * ray + "xy".index(str(axis))
        raise KeyError(name)

    def _model(self, ray: int) -> str | None:
        """Return the model that a ray was measured in; no row is made for it."""
        return self._models.at(int(self.problem.source[ray]))

    @cached_property
    def _models(self) -> Coded[str | None]:
        return columns_of(self.problem.block.image_points).model

    @cached_property
    def _photos(self) -> dict[str, int]:
        return {photo: k for k, photo in enumerate(self.problem.photos)}

    @cached_property
    def _points(self) -> dict[str, int]:
        return {point: k for k, point in enumerate(self.problem.points)}

    @cached_property
    def _starts_of_points(self) -> list[int]:
        """First rays of the points, and the end of the last one's."""
        problem = self.problem
        found: list[int] = np.searchsorted(
            problem.point, np.arange(len(problem.points) + 1)
        ).tolist()
        return found

    @cached_property
    def _others(self) -> dict[ObservationName, int]:
        """Rows of what is no image coordinate."""
        return {self.name(row): row for row in range(self.image, self.count)}

    @cached_property
    def sigma(self) -> Array:
        """(n,) a-priori standard deviations in the units."""
        problem = self.problem
        return np.concatenate(
            (
                problem.sigma_xy.reshape(-1) * 1e3,
                problem.ground_sigma[tuple(self.ground.T)],
                problem.prior_sigma[tuple(self.priors.T)],
                self._parameter_sigma[self.additional],
                self._condition_sigma,
            )
        )

    @cached_property
    def _parameter_sigma(self) -> Array:
        problem = self.problem
        sigma = np.full(self.parameters, np.inf)
        if len(problem.additional_sigma):
            sigma = problem.additional_sigma.ravel()
        return sigma if problem.offsets is None else np.append(sigma, problem.offsets.sigma)

    @cached_property
    def units(self) -> list[Unit]:
        """Units of the rows."""
        out: list[Unit] = ["um"] * self.image
        out += ["m"] * len(self.ground)
        out += ["m" if k < 3 else "rad" for k in self.priors[:, 1].tolist()]
        out += ["mm"] * (len(self.additional) - len(self.offsets))
        if self.problem.offsets is not None:
            out += [self.problem.offsets.names[k].unit for k in self.offsets.tolist()]
        if self.problem.conditions is not None:
            out += ["rad" if angular else "m" for angular in self.problem.conditions.angular]
        return out

    def gather(
        self,
        image: NDArray[Any],
        ground: NDArray[Any],
        photos: NDArray[Any],
        parameters: NDArray[Any],
        conditions: NDArray[Any],
        offsets: NDArray[Any] | None = None,
    ) -> NDArray[Any]:
        """Return (n, ...) of (m, 2, ...), (2, points, 3, ...), (photos, 6, ...), others."""
        shape = image.shape[2:]
        parameters = parameters.reshape(-1, *shape)
        if offsets is not None:
            missing = np.zeros((self.parameters - len(parameters), *shape), parameters.dtype)
            parameters = np.concatenate((parameters, missing, offsets))
        return np.concatenate(
            (
                image.reshape(self.image, *shape),
                ground[tuple(self.ground.T)],
                photos[tuple(self.priors.T)],
                parameters[self.additional],
                conditions.reshape(-1, *shape),
            )
        )

    def gathered(self, misclosures: Linearised, conditions: Array | None = None) -> Array:
        """Return (n,) misclosures of the rows, those of the conditions apart; None: zeros."""
        own = self.problem.photo_invariant
        return self.gather(
            misclosures.e,
            misclosures.point_e,
            misclosures.photo_e,
            misclosures.own_e if own else misclosures.shared_e,
            np.zeros(self.conditions) if conditions is None else conditions,
            None if misclosures.offsets is None else misclosures.offsets.e,
        )


def observations_of(cofactors: Cofactors) -> Observations:
    """Return the observations whose cofactors are known."""
    return observations_at(cofactors.normal.problem, cofactors.normal.linear)


def observations_at(problem: Problem, linear: Linearised) -> Observations:
    """Return the observations of a bundle that is linearised somewhere."""
    weighted = np.flatnonzero(np.isfinite(problem.additional_sigma))
    if problem.offsets is not None:
        after = problem.additional_given.size + np.flatnonzero(problem.offsets.weighted)
        weighted = np.concatenate((weighted, after))
    return Observations(
        problem,
        np.argwhere(linear.point_weight > 0.0),
        np.argwhere(np.any(linear.photo_rows != 0.0, axis=2)),
        weighted,
        np.zeros(0) if linear.conditions is None else linear.conditions.sigma,
    )
