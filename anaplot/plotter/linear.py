"""The inverse of a small matrix: two or four axes need no linear algebra package."""

from __future__ import annotations

__all__ = ["SingularError", "inverse"]


class SingularError(ValueError):
    """The matrix has no usable inverse."""


def inverse(matrix: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """Invert a square matrix by Gauss-Jordan elimination with partial pivoting.

    Parameters
    ----------
    matrix
        Rows, shape (n, n).

    Returns
    -------
    tuple of tuple of float
        The inverse, shape (n, n).

    Raises
    ------
    SingularError
        When a pivot falls below 1e-9 of the largest element.
    """
    size = len(matrix)
    work = [
        [*row, *(1.0 if at == column else 0.0 for column in range(size))]
        for at, row in enumerate(matrix)
    ]
    largest = max((abs(value) for row in matrix for value in row), default=0.0)
    for column in range(size):
        pivot = max(range(column, size), key=lambda row: abs(work[row][column]))
        if abs(work[pivot][column]) <= 1e-9 * largest:
            raise SingularError("singular")
        work[column], work[pivot] = work[pivot], work[column]
        divisor = work[column][column]
        work[column] = [value / divisor for value in work[column]]
        for row in range(size):
            factor = work[row][column]
            if row != column and factor:
                work[row] = [
                    value - factor * other
                    for value, other in zip(work[row], work[column], strict=True)
                ]
    return tuple(tuple(row[size:]) for row in work)
