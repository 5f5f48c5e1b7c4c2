"""Additional parameters laid out for a bundle: what they do at every ray, and whose they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.additional import AdditionalParameters, ParameterSet, Scope, lens_units
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.lens import LENS_PARAMETERS
from anaplot.textfiles.wording import hint, quoted

__all__ = ["LaidParameters", "groups_of_photos", "lay_out_parameters"]


_NO_STRIP = "(no strip)"


class LaidParameters(NamedTuple):
    """The additional parameters of a bundle.

    Attributes
    ----------
    basis
        (m, 2, q) what they do at the rays to first order; q = 0 without any.
    lens_units
        (groups, q) parameters of a lens for 1 mm of effect; None for sets that are linear.
    group, groups
        (m,) group of each ray, and the names of the groups.
    given, sigma
        (groups, q) a-priori values and standard deviations [mm], infinite where there is none;
        no rows of sigmas when all are free.
    shift
        (m, 2) what the parameters do that are held at their values [mm]; None: none is, or they
        belong to a lens.
    lens_held
        (groups, 10) parameters of a lens that are held; None: none is.
    reference
        (cameras,) lengths b [mm] in which image coordinates are measured for the parameters, of
        every camera of the block; 0 without rays. None without parameters.
    still
        (groups, q) which of the parameters are held at their a-priori values; None: none is.
    """

    basis: Array
    lens_units: Array | None
    group: Index
    groups: tuple[str, ...]
    given: Array
    sigma: Array
    shift: Array | None = None
    lens_held: Array | None = None
    reference: Array | None = None
    still: Bools | None = None


def groups_of_photos(block: Block, scope: Scope, photos: Sequence[str]) -> list[str]:
    """Return the group that the parameters of each photo belong to; of two strips the first.

    Raises
    ------
    InputError
        A strip is called as are the photos that are in none.
    """
    if scope == "block":
        return ["block"] * len(photos)
    if scope == "photo":
        return list(photos)
    if scope == "camera":
        cameras = {photo.id: photo.camera for photo in block.photos}
        return [cameras[name] for name in photos]
    strips: dict[str, str] = {}
    for strip in block.strips:
        for name in strip.photos:
            strips.setdefault(name, strip.id)
    alone = next((name for name in photos if name not in strips), None)
    if alone is not None and any(strip.id == _NO_STRIP for strip in block.strips):
        raise InputError(
            f"block {block.name}: a strip is called {quoted(_NO_STRIP)}, as are photos in none "
            f"({quoted(alone)}): rename the strip"
        )
    return [strips.get(name, _NO_STRIP) for name in photos]


def lay_out_parameters(
    block: Block,
    additional: AdditionalParameters | None,
    photos: list[str],
    cameras: Index,
    c: Array,
    photo: Index,
    xy: Array,
    count: int,
) -> LaidParameters:
    """Lay out the additional parameters of a bundle.

    Parameters
    ----------
    block
        The block.
    additional
        Which parameters; None: none.
    photos, cameras, c
        (photos,) names, index of the camera in block.cameras, camera constants [mm].
    photo, xy
        (m,) photo of each ray and (m, 2) where it is measured [mm].
    count
        Units and standard deviations are those of the first `count` rays.

    Raises
    ------
    InputError
        A prior of a group that there is not, or a parameter that is held in some groups only.
    """
    n = len(photo)
    if additional is None:
        empty = np.zeros(n, dtype=np.intp)
        nothing = np.empty((0, 0))
        return LaidParameters(np.empty((n, 2, 0)), None, empty, (), nothing, nothing)
    labels = groups_of_photos(block, additional.scope, photos)
    names = tuple(dict.fromkeys(labels))
    if additional.scope == "camera":
        names = tuple(camera.id for camera in block.cameras if camera.id in names)
    numbers = {name: k for k, name in enumerate(names)}
    of_photo = np.array([numbers[label] for label in labels], dtype=np.intp)
    # a lens is one thing for its group, whatever the cameras; other terms belong to the format
    of_ray = of_photo[photo] if additional.set.lens else cameras[photo]
    reference = _reference(block, additional, cameras[photo[:count]], xy[:count])
    basis = np.empty((n, 2, len(additional.set.names)))
    held = None if additional.held is None else np.empty((n, 2, len(additional.held.names)))
    units = []
    for part in np.unique(of_ray):
        mine = of_ray == part
        b = float(reference[cameras[photo[mine]]].max()) or 1.0
        cs = c[photo[mine]]
        basis[mine] = additional.set.terms(xy[mine, 0], xy[mine, 1], b, cs)
        if held is not None and additional.held is not None:
            held[mine] = additional.held.terms(xy[mine, 0], xy[mine, 1], b, cs)
        if additional.set.lens:
            unit = lens_units(b, float(np.mean(c[photo[:count][mine[:count]]])))
            units.append(unit[list(additional.set.columns)])
    lens = np.array(units) if additional.set.lens else None
    sigma = np.full((len(names), basis.shape[2]), np.inf)
    if additional.sigma_um is not None:
        largest = np.abs(basis[:count]).max(axis=(0, 1), initial=0.0)
        sigma[:] = additional.sigma_um * 1e-3 / np.where(largest > 0.0, largest, 1.0)
    given = _known(additional, names, lens, sigma)
    group = of_photo[photo]
    weights = sigma if np.isfinite(sigma).any() else sigma[:0]
    still = np.array(
        [[(name, one) in additional.still for one in additional.set.names] for name in names]
    )
    laid = LaidParameters(
        basis, lens, group, names, given, weights, None, None, reference,
        still if still.any() else None,
    )  # fmt: skip
    if held is None or additional.held is None:
        return laid
    values = _held(additional, additional.held, names)
    if not additional.held.lens:
        return laid._replace(shift=np.einsum("mij,mj->mi", held, values[group] * 1e-3))
    whole = np.zeros((len(names), len(LENS_PARAMETERS)))
    whole[:, list(additional.held.columns)] = values
    return laid._replace(lens_held=whole)


def _reference(block: Block, additional: AdditionalParameters, camera: Index, xy: Array) -> Array:
    """Return (cameras,) reference lengths [mm], from (m,) cameras and (m, 2) places of rays.

    What is stated, else half the longer side of the format: both are the same for every block of
    the camera. Only without a format it is the largest coordinate measured in this one.
    """
    out = np.zeros(len(block.cameras))
    np.maximum.at(out, camera, np.abs(xy).max(axis=1))
    for k in np.unique(camera).tolist():
        if additional.reference_mm is not None:
            out[k] = additional.reference_mm
        elif block.cameras[k].format is not None:
            out[k] = max(block.cameras[k].reach())
    return out


def _known(
    additional: AdditionalParameters, groups: tuple[str, ...], lens: Array | None, sigma: Array
) -> Array:
    """Return (groups, q) a-priori values [mm]; standard deviations are written into `sigma`."""
    given = np.zeros(sigma.shape)
    # what is said of one group counts more than what is said of all
    for prior in sorted(additional.priors, key=lambda one: one.group is not None):
        if prior.group is not None and prior.group not in groups:
            near = hint(prior.group, groups)
            raise InputError(
                f"the prior of {quoted(prior.parameter)}: no {additional.scope} "
                f"{quoted(prior.group)} has such parameters{near}"
            )
        if prior.parameter not in additional.set.names:
            continue
        column = additional.set.names.index(prior.parameter)
        rows = range(len(groups)) if prior.group is None else [groups.index(prior.group)]
        for row in rows:
            unit = 1e-3 if lens is None else 1.0 / float(lens[row, column])
            given[row, column] = prior.value * unit
            # without a sigma of its own it has no weight: neither the sigma of all nor of its group
            sigma[row, column] = np.inf if prior.sigma is None else prior.sigma * unit
    return given


def _held(additional: AdditionalParameters, held: ParameterSet, groups: tuple[str, ...]) -> Array:
    """Return (groups, k) values of the parameters that are held, in their units."""
    values = np.full((len(groups), len(held.names)), np.nan)
    for prior in sorted(additional.priors, key=lambda one: one.group is not None):
        if prior.parameter not in held.names:
            continue
        rows = slice(None) if prior.group is None else groups.index(prior.group)
        column = held.names.index(prior.parameter)
        values[rows, column] = prior.value if prior.sigma == 0.0 else np.nan
    for row, column in np.argwhere(np.isnan(values)).tolist():
        raise InputError(
            f"the parameter {held.names[column]} is held (sigma 0), but not for "
            f"{quoted(groups[row])}: hold it for all, or give it a small sigma"
        )
    return values
