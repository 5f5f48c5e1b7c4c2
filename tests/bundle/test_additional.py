"""Additional parameters: orthogonality on the grids of Ebner and of Gruen 1978, eq. (7)."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.bundle.solve.additional import (
    additional_parameters,
    ebner,
    gruen,
    gruen50,
    physical,
)
from anaplot.errors import InputError


def exterior_effects(x, y, c):
    """(n, 2, 6): what X0, Y0, Z0, omega, phi, kappa of a vertical photo over flat ground do."""
    one, zero = np.ones_like(x), np.zeros_like(x)
    dx = [one, zero, x, x * y / c, c + x * x / c, -y]
    dy = [zero, one, y, c + y * y / c, x * y / c, x]
    return np.stack((np.stack(dx, axis=1), np.stack(dy, axis=1)), axis=1)


def gram(parameter_set, side: int):
    b = 90.0
    line = np.linspace(-b, b, side)
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    columns = np.concatenate(
        (parameter_set.basis(x, y, b, np.full(x.shape, 150.0)), exterior_effects(x, y, 150.0)),
        axis=2,
    ).reshape(2 * side * side, -1)
    columns = columns / np.linalg.norm(columns, axis=0)
    return columns.T @ columns


@pytest.mark.parametrize(("parameter_set", "side"), [(ebner, 3), (gruen, 5)])
def test_orthogonal_to_each_other_and_to_the_exterior_orientation(parameter_set, side) -> None:
    product = gram(parameter_set, side)
    count = len(parameter_set.names)
    assert count + 6 == 2 * side * side
    inner = product[:count, :count]
    np.testing.assert_allclose(inner, np.eye(count), atol=1e-12)
    np.testing.assert_allclose(product[:count, count:], 0.0, atol=1e-12)
    # together with the six effects they span every possible image error of the grid
    assert np.linalg.matrix_rank(product, tol=1e-6) == 2 * side * side


def test_the_complete_set_is_all_that_can_happen_on_the_5_x_5_grid() -> None:
    line = np.linspace(-90.0, 90.0, 5)
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    basis = gruen50.basis(x, y, 90.0, np.full(x.shape, 150.0)).reshape(50, 50)
    basis = basis / np.linalg.norm(basis, axis=0)
    np.testing.assert_allclose(basis.T @ basis, np.eye(50), atol=1e-12)
    assert gruen50.names[:44] == gruen.names
    # the six more are what the exterior orientation of a vertical photo does over flat ground
    effects = exterior_effects(x, y, 150.0).reshape(50, 6)
    left = effects - basis[:, 44:] @ (basis[:, 44:].T @ effects)
    np.testing.assert_allclose(left, 0.0, atol=1e-10)
    turned = basis[:, gruen50.names.index("b12")]
    np.testing.assert_allclose(turned, effects[:, 5] / np.linalg.norm(effects[:, 5]), atol=1e-12)


def test_the_misprint_of_1978_is_not_orthogonal() -> None:
    line = np.linspace(-1.0, 1.0, 5)
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    q = y * y - 17.0 / 20.0
    printed = y * q
    a41 = gruen.basis(x, y, 1.0, np.ones_like(x))[:, 0, gruen.names.index("a41")]
    assert abs(printed @ a41) > 0.1


def test_names_are_unique_and_physical_terms_have_their_meaning() -> None:
    for parameter_set in (ebner, gruen, gruen50, physical):
        assert len(set(parameter_set.names)) == len(parameter_set.names)
    x, y, c = np.array([30.0, -40.0]), np.array([20.0, 10.0]), np.full(2, 120.0)
    basis = physical.basis(x, y, 50.0, c)
    # a longer camera constant stretches the image
    np.testing.assert_allclose(basis[:, :, 0], np.column_stack((x, y)) / 120.0)
    radial = basis[:, :, physical.names.index("k1")]
    np.testing.assert_allclose(radial[:, 0] * y, radial[:, 1] * x, atol=1e-12)
    # on an axis, at the reach, each is its effect in mm
    edge = physical.basis(np.array([50.0]), np.array([0.0]), 50.0, np.array([120.0]))[0]
    for name in ("k1", "k2", "k3", "b1"):
        np.testing.assert_allclose(edge[:, physical.names.index(name)], [1.0, 0.0], atol=1e-12)


def test_names_of_sets_and_scopes() -> None:
    assert additional_parameters("ebner").scope == "block"
    assert additional_parameters("physical:camera", 10.0).sigma_um == 10.0
    for text in ("brown", "ebner:model", ""):
        with pytest.raises(InputError):
            additional_parameters(text)
    with pytest.raises(InputError):
        additional_parameters("ebner", 0.0)
    with pytest.raises(InputError, match="too large for a weight"):
        additional_parameters("ebner", 1e200)


def test_some_parameters_of_a_set() -> None:
    some = additional_parameters("ebner:b7, b2:camera", 3.0)
    assert (some.set.names, some.scope, some.sigma_um) == (("b2", "b7"), "camera", 3.0)
    assert additional_parameters("ebner:camera:b2,b7", 3.0) == some
    less = additional_parameters("gruen:-a43,-b55").set
    assert less.names == tuple(n for n in gruen.names if n not in ("a43", "b55"))
    x, y, c = np.array([30.0, -40.0]), np.array([20.0, 10.0]), np.full(2, 120.0)
    for one, whole in ((some.set, ebner), (less, gruen), (less.only(["b45", "a12"]), gruen)):
        at = [whole.names.index(name) for name in one.names]
        np.testing.assert_array_equal(one.terms(x, y, 50.0, c), whole.basis(x, y, 50.0, c)[..., at])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ebnr", "no set 'ebnr' (did you mean 'ebner'?)"),
        ("gruen:a34,a443", "no parameter 'a443' (did you mean 'a44'?)"),
        ("gruen:-a433", "no parameter 'a433' (did you mean 'a43'?)"),
        ("gruen:camra", "no scope or parameter 'camra' (did you mean 'camera'?)"),
        ("physical:q", "parameters c, x0, y0, k1"),
        ("ebner:b1,-b2", "each with -"),
        ("ebner:b1:b2", "a second choice of parameters"),
        ("ebner:block:photo", "a second scope"),
        ("ebner:", "no scope or parameter ''"),
        ("ebner:" + ",".join(f"-b{k}" for k in range(1, 13)), "none is left"),
    ],
)
def test_a_wrong_choice_is_told_with_the_nearest_name(text: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        additional_parameters(text)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
