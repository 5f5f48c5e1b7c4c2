"""Inner orientation for a person: the table, how the plate lies, what to do."""

from __future__ import annotations

from math import degrees

from anaplot.adjustment.tested import Observation
from anaplot.photogrammetry.camera import CameraCalibration, RadialTable
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.photogrammetry.inneradvice import inner_advice
from anaplot.photogrammetry.innerresults import Fiducial
from anaplot.photogrammetry.platetransformation import TITLES
from anaplot.report.columns import cell
from anaplot.textfiles.wording import plain

__all__ = ["camera_remarks", "inner_printout", "inner_table_lines"]


def inner_table_lines(inner: InnerOrientation) -> list[str]:
    """Return the table of a photograph's fiducials, a line each, with a heading.

    RED-N redundancy number, RESID residual (adjusted minus measured), EXPD its expected standard
    deviation, SIGF their ratio, MDB smallest detectable error; all but RED-N and SIGF in um.
    """
    accused = inner.flagged[0].key if inner.flagged and inner.locatable else None
    width = max([8, *(len(plain(row.point)) for row in inner.rows)])
    lines = [
        f"  {'FIDUCIAL':<{width}}     RED-N   RESID    EXPD    SIGF     MDB",
        f"  {'':<{width}}{'um':>18}{'um':>8}{'um':>16}",
    ]
    for row in inner.rows:
        line = (
            f"  {plain(row.point):<{width}}  {row.axis}  {row.r:6.3f}"
            f"{_um(row.residual)}{_um(row.expected)}{cell(row.size, 2, 8)}{_um(row.mdb)}"
            f"  {_verdict(row, accused)}"
        )
        lines.append(line.rstrip())
    return lines


def inner_printout(photo: str, inner: InnerOrientation) -> str:
    """Return the printout of one photograph's inner orientation."""
    place = inner.placement
    shrunk_x, shrunk_y = place.shrinkage_ppm
    sigma0 = "none" if inner.sigma0_um is None else f"{inner.sigma0_um:.2f} um"
    critical = "none" if inner.test.critical is None else f"{inner.test.critical:.2f}"
    limit = "" if inner.overall is None else f", sigma0 at most {inner.overall:.2f} um"
    lines = [
        f"PHOTO {plain(photo)}  camera {plain(inner.camera)}",
        f"  found     {TITLES[inner.kind]}",
        f"  sigma0    {sigma0}, a priori {inner.apriori_um:g} um, redundancy {inner.redundancy}",
        f"  test      {inner.test.kind}, alpha {inner.test.alpha:g}, critical value {critical}"
        + limit
        + ("" if inner.tested.power is None else f", power {inner.tested.power:.2f} at MDB"),
        f"  origin    x {place.x:.4f}  y {place.y:.4f} mm on the plate",
        f"  rotation  {degrees(place.rotation):.5f} deg"
        + (f", shear {degrees(place.shear):.5f} deg" if inner.kind in _SHEARED else "")
        + (", seen from behind" if place.mirrored else ""),
        f"  scale     x {place.scale_x:.6f}  y {place.scale_y:.6f}, "
        + (
            f"film shrinkage x {shrunk_x:.0f}  y {shrunk_y:.0f} ppm"
            if inner.kind in _TWO_SCALES
            else f"film shrinkage {shrunk_x:.0f} ppm"
        ),
        "",
        *inner_table_lines(inner),
        "",
    ]
    if inner.distances:
        lines.append("  DISTANCES [mm], transformed minus calibrated [um]")
        lines += [
            f"  {plain(d.first)} - {plain(d.second)}  {d.mm:.3f}{_um(d.difference_um)}"
            for d in inner.distances
        ]
        lines.append("")
    lines += [f"  {plain(sentence)}" for sentence in inner_advice(inner)]
    return "\n".join(lines)


def camera_remarks(camera: CameraCalibration) -> list[str]:
    """Return sentences on what a camera's calibration leaves open."""
    if not isinstance(camera.radial, RadialTable):
        return []
    end = camera.radial.radius[-1]
    corner = None if camera.format is None else 0.5 * sum(side**2 for side in camera.format) ** 0.5
    if corner is not None and end >= corner:
        return []
    return [
        f"camera {camera.id}: the distortion is calibrated up to radius {end:g} mm; beyond it, "
        "its last value is held"
    ]


_TWO_SCALES = ("scales", "affine", "bilinear", "projective")
_SHEARED = ("affine", "bilinear", "projective")


def _verdict(row: Observation[Fiducial], accused: tuple[str, str] | None) -> str:
    if row.flagged:
        return "<< REMEASURE" if row.key == accused else "< flagged"
    return "not testable" if row.mdb is None else ""


def _um(value: float | None) -> str:
    return cell(value, 1, 8)
