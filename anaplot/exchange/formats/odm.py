"""OpenDroneMap: a project with its OpenSfM model in `opensfm/`, and gcp_list.txt."""

from __future__ import annotations

from pathlib import Path

from anaplot.exchange.formats import opensfm
from anaplot.exchange.formats.door import Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.gcplist import GCP_LIST
from anaplot.textfiles.inputfile import real_path

__all__ = ["read", "recognises", "write"]

_MODEL = "opensfm"
_TOPOCENTRIC = "reconstruction.topocentric.json"


def recognises(source: Path) -> bool:
    """Return whether this is a project with a reconstruction."""
    return opensfm.recognises(source / _MODEL)


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a project; raises InputError that names file and line, or place in the file."""
    model = source / _MODEL
    files = opensfm.files_of(model, options)
    gcp = source / GCP_LIST
    if "gcp" not in options.files and gcp.exists():
        files = files._replace(gcp=gcp)
    # georeferenced projects have the map's coordinates in reconstruction.json in the end, turned
    # and bent; what was adjusted is kept beside it
    if (model / _TOPOCENTRIC).exists():
        text = f"{_TOPOCENTRIC} is read: reconstruction.json has been laid onto a map"
        files = files._replace(
            reconstruction=model / _TOPOCENTRIC, notes=(Note("assumed", None, text),)
        )
    return opensfm.read_files(files, options, real_path(source).name or "odm")


def write(exporting: Exporting, target: Path) -> Exported:
    """Write the project that the block was imported from without what does not count."""
    return opensfm.write_files(exporting, target / _MODEL, target)
