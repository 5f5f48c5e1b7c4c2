"""Additional parameters laid out for a bundle: what they do at every ray, and whose they are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.additional import AdditionalParameters, lens_units
from anaplot.photogrammetry.block import Block

__all__ = ["LaidParameters", "lay_out_parameters"]


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
    sigma
        (q,) a-priori standard deviations [mm]; empty when free.
    """

    basis: Array
    lens_units: Array | None
    group: Index
    groups: tuple[str, ...]
    sigma: Array


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
    """
    n = len(photo)
    if additional is None:
        empty = np.zeros(n, dtype=np.intp)
        return LaidParameters(np.empty((n, 2, 0)), None, empty, (), np.empty(0))
    if additional.scope == "block":
        names: tuple[str, ...] = ("block",)
        of_photo = np.zeros(len(photos), dtype=np.intp)
    elif additional.scope == "photo":
        names, of_photo = tuple(photos), np.arange(len(photos))
    elif additional.scope == "camera":
        used, of_photo = np.unique(cameras, return_inverse=True)
        names = tuple(block.cameras[k].id for k in used)
    else:
        strips = {name: strip.id for strip in block.strips for name in strip.photos}
        labels = [strips.get(name, "(no strip)") for name in photos]
        names = tuple(dict.fromkeys(labels))
        of_photo = np.array([names.index(label) for label in labels], dtype=np.intp)
    # a lens is one thing for its group, whatever the cameras; other terms belong to the format
    of_ray = of_photo[photo] if additional.set.lens else cameras[photo]
    reach = np.zeros(len(block.cameras))
    np.maximum.at(reach, cameras[photo[:count]], np.abs(xy[:count]).max(axis=1))
    basis = np.empty((n, 2, len(additional.set.names)))
    units = []
    for part in np.unique(of_ray):
        mine = of_ray == part
        b = float(reach[cameras[photo[mine]]].max()) or 1.0
        cs = c[photo[mine]]
        basis[mine] = additional.set.terms(xy[mine, 0], xy[mine, 1], b, cs)
        if additional.set.lens:
            unit = lens_units(b, float(np.mean(c[photo[:count][mine[:count]]])))
            units.append(unit[list(additional.set.columns)])
    sigma = np.empty(0)
    if additional.sigma_um is not None:
        largest = np.abs(basis[:count]).max(axis=(0, 1))
        sigma = additional.sigma_um * 1e-3 / np.where(largest > 0.0, largest, 1.0)
    lens = np.array(units) if additional.set.lens else None
    return LaidParameters(basis, lens, of_photo[photo].astype(np.intp), names, sigma)
