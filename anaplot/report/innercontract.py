"""Inner orientations as the JSON that other programs read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.photogrammetry.inneradvice import inner_advice

__all__ = ["inner_json", "photo_json", "transformation_json"]

Json = dict[str, Any]


def inner_json(
    camera: CameraCalibration, photos: Iterable[tuple[str, InnerOrientation | str]]
) -> Json:
    """Return the inner orientations of photographs of one camera.

    Parameters
    ----------
    camera
        The camera.
    photos
        Name and inner orientation of each photograph, or why there is none.

    Returns
    -------
    dict
        {"camera", "photos": [...]}: each photo as in `photo_json`, or {"photo", "error"}. What
        does not exist is null, never NaN.
    """
    return {
        "camera": camera.id,
        "photos": [
            {"photo": name, "error": found} if isinstance(found, str) else photo_json(name, found)
            for name, found in photos
        ],
    }


def photo_json(photo: str, inner: InnerOrientation) -> Json:
    """Return one inner orientation: residuals in um, angles in radians, plate coordinates in mm."""
    place = inner.placement
    shrunk_x, shrunk_y = place.shrinkage_ppm
    return {
        "photo": photo,
        "transformation": inner.kind,
        "sigma0_um": inner.sigma0_um,
        "apriori_um": inner.apriori_um,
        "redundancy": inner.redundancy,
        "iterations": inner.iterations,
        "test": {
            "kind": inner.test.kind,
            "alpha": inner.test.alpha,
            "critical": inner.test.critical,
            "power": inner.tested.power,
            "sigma0_limit_um": inner.overall,
        },
        "refused": inner.refused,
        "locatable": inner.locatable,
        "table": [
            {
                "fiducial": row.point,
                "axis": row.axis,
                "redn": row.r,
                "residual_um": row.residual,
                "expd_um": row.expected,
                "sigf": row.size,
                "flagged": row.flagged,
                "mdb_um": row.mdb,
                "probability": row.probability,
            }
            for row in inner.rows
        ],
        "odds": {"none": inner.tested.odds.none},
        "partners": [
            {"first": list(p.first), "second": list(p.second), "correlation": p.correlation}
            for p in inner.partners
        ],
        "distances": [
            {"first": d.first, "second": d.second, "mm": d.mm, "difference_um": d.difference_um}
            for d in inner.distances
        ],
        "placement": {
            "x": place.x,
            "y": place.y,
            "rotation": place.rotation,
            "shear": place.shear,
            "scale_x": place.scale_x,
            "scale_y": place.scale_y,
            "mirrored": place.mirrored,
            "shrinkage_x_ppm": shrunk_x,
            "shrinkage_y_ppm": shrunk_y,
        },
        "plate_to_image": transformation_json(inner),
        "unmeasured": list(inner.unmeasured),
        "advice": list(inner_advice(inner)),
    }


def transformation_json(inner: InnerOrientation) -> Mapping[str, Any]:
    """Return the numbers of the transformation plate -> image.

    (xi, eta) = frame (1, x, y); image x and y = numerator (1, xi, eta, xi eta) divided by
    1 + denominator (xi, eta).
    """
    made = inner.transformation
    return {
        "frame": [list(row) for row in made.frame],
        "numerator": [list(row) for row in made.numerator],
        "denominator": list(made.denominator),
    }
