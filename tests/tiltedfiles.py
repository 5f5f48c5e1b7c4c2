"""A tilted block as the files of other programs, written by their documents."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from tiltedblock import CX, CY, FX, FY, HEIGHT, K1, K2, P1, P2, WIDTH, TiltedBlock

LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1]]'
AXES = {"Right": (1, 0), "Left": (-1, 0), "Down": (0, 1), "Up": (0, -1)}
ORIENTATIONS = [
    f"X{x}Y{y}" for x, y in itertools.permutations(AXES, 2) if np.dot(AXES[x], AXES[y]) == 0
]


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return w, x, y, z by the eigenvector of a symmetric matrix (Bar-Itzhack)."""
    r = rotation
    matrix = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
        ]
    )
    values, vectors = np.linalg.eigh((matrix + np.tril(matrix, -1).T) / 3)
    x, y, z, w = vectors[:, np.argmax(values)]
    return np.array([w, x, y, z])


def colmap_model(scene: TiltedBlock, folder: Path) -> Path:
    """Write a text model; a blank in a name, as COLMAP cannot hold one, becomes a line below."""
    folder.mkdir()
    (folder / "cameras.txt").write_text(
        f"# cameras\n1 OPENCV {WIDTH} {HEIGHT} {FX} {FY} {CX} {CY} {K1} {K2} {P1} {P2}\n"
    )
    images = []
    tracks: dict[int, list[str]] = {}
    for k, name in enumerate(scene.names):
        rotation, centre = scene.rotations[k], scene.centres[k]
        mine = [row for row in scene.pixels if row[0] == k]
        pose = [*quaternion(rotation), *(-rotation @ centre)]
        numbers = " ".join(repr(float(v)) for v in pose)
        images.append(f"{k + 1} {numbers} 1 {name.replace(' ', '_')}")
        images.append(" ".join(f"{x!r} {y!r} {j + 1}" for _, j, x, y in mine))
        for at, (_, j, _, _) in enumerate(mine):
            tracks.setdefault(j, []).append(f"{k + 1} {at}")
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    points = [
        f"{j + 1} {' '.join(repr(float(v)) for v in scene.points[j])} 1 2 3 0.5 {' '.join(track)}"
        for j, track in tracks.items()
    ]
    (folder / "points3D.txt").write_text("\n".join(points) + "\n")
    return folder


def pixel_table(scene: TiltedBlock, file: Path) -> Path:
    """Write a table with other titles, counted from the lower left."""
    rows = [f"{scene.names[k]}\t{j + 1}\t{x!r}\t{HEIGHT - y!r}" for k, j, x, y in scene.pixels]
    file.write_text("Image\tTarget\tu\tv\n" + "\n".join(rows) + "\n")
    return file


def blocks_exchange(
    scene: TiltedBlock,
    file: Path,
    *,
    orientation: str = "XRightYDown",
    angles: bool = False,
    mm: bool = False,
    system: str = "",
    control: str = "",
    poses: bool = True,
) -> Path:
    """Write BlocksExchange; the pixel is 2.5 um where `mm` says so.

    In mm everything counts from the principal point, along the axes of the orientation.
    """
    x_word, y_word = orientation[1:].split("Y")
    axes = np.array([AXES[x_word], AXES[y_word]]).T.astype(float)  # in x right, y down
    turn = np.eye(3)
    turn[:2, :2] = axes
    turn[2, 2] = np.linalg.det(axes)
    pixel = 0.0025
    if mm:
        off = (axes.T @ (CX - WIDTH / 2, CY - HEIGHT / 2) * pixel).tolist()
        principal = f"<xmm>{off[0]!r}</xmm><ymm>{off[1]!r}</ymm>"
        focal = (
            f"<FocalLength>{FX * pixel!r}</FocalLength><SensorSize>{WIDTH * pixel!r}</SensorSize>"
        )
    else:
        principal = f"<x>{CX - 0.5!r}</x><y>{CY - 0.5!r}</y>"
        focal = f"<FocalLengthPixels>{FX!r}</FocalLengthPixels>"

    def place(x: float, y: float) -> str:
        if not mm:
            return f"<x>{x - 0.5!r}</x><y>{y - 0.5!r}</y>"
        a, b = axes.T @ (x - CX, y - CY) * pixel
        return f"<xmm>{float(a)!r}</xmm><ymm>{float(b)!r}</ymm>"

    photos = []
    for k, name in enumerate(scene.names):
        # the axes of the orientation, seen in the world
        matrix = turn.T @ scene.rotations[k]
        if angles:
            turned = matrix.T
            phi = np.arcsin(turned[0, 2])
            omega = np.arctan2(-turned[1, 2], turned[2, 2])
            kappa = np.arctan2(-turned[0, 1], turned[0, 0])
            rotation = "".join(
                f"<{key}>{float(np.degrees(v))!r}</{key}>"
                for key, v in (("Omega", omega), ("Phi", phi), ("Kappa", kappa))
            )
        else:
            rotation = "".join(
                f"<M_{i}{j}>{float(matrix[i, j])!r}</M_{i}{j}>" for i in range(3) for j in range(3)
            )
        x, y, z = scene.centres[k].tolist()
        pose = (
            f"<Pose><Rotation>{rotation}<Accurate>true</Accurate></Rotation>"
            f"<Center><x>{x!r}</x><y>{y!r}</y><z>{z!r}</z></Center></Pose>"
        )
        photos.append(
            f"<Photo><Id>{10 * k + 3}</Id><ImagePath>{name}</ImagePath>{pose * poses}</Photo>\n"
        )
    ties = []
    for j in range(len(scene.points)):
        rows = "".join(
            f"<Measurement><PhotoId>{10 * k + 3}</PhotoId>{place(x, y)}</Measurement>"
            for k, i, x, y in scene.pixels
            if i == j
        )
        ties.append(f"<TiePoint>{rows}</TiePoint>\n")
    srs = (
        f"<SpatialReferenceSystems><SRS><Id>4</Id><Name>s</Name><Definition>{system}</Definition>"
        "</SRS></SpatialReferenceSystems>"
    )
    file.write_text(
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f'<BlocksExchange version="3.2">{srs if system else ""}<Block><Name>A &amp; B</Name>'
        f"{'<SRSId>4</SRSId>' if system else ''}<Photogroups><Photogroup><Name>fc</Name>"
        f"<ImageDimensions><Width>{WIDTH}</Width><Height>{HEIGHT}</Height></ImageDimensions>"
        f"<CameraModelType>Perspective</CameraModelType>{focal}"
        f"<CameraOrientation>{orientation}</CameraOrientation>"
        f"<PrincipalPoint>{principal}</PrincipalPoint>\n"
        f"<Distortion><K1>{K1}</K1><K2>{K2}</K2><P1>{P2}</P1><P2>{P1}</P2></Distortion>"
        f"<AspectRatio>{FY / FX!r}</AspectRatio><Skew>0</Skew>\n"
        f"{''.join(photos)}</Photogroup></Photogroups>\n{control}\n"
        f"<TiePoints>{''.join(ties)}</TiePoints></Block></BlocksExchange>\n"
    )
    return file


def camera_file(
    scene: TiltedBlock, file: Path, *, k4: float = 0.0, control: int = 5, system: str = LOCAL
) -> Path:
    """Write Metashape's file; the chunk is half as large, and turned by 90 degrees about its z."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([10.0, -20.0, 5.0])
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="1.5.0"><chunk label="c">',
        '<sensors next_id="1"><sensor id="0" label="FC" type="frame">',
        f'<resolution width="{WIDTH}" height="{HEIGHT}"/>',
        '<property name="pixel_width" value="0.0025"/>',
        '<property name="pixel_height" value="0.0025"/>',
        '<calibration type="frame" class="initial"><f>1</f></calibration>',
        '<calibration type="frame" class="adjusted">',
        f"<f>{FY}</f><cx>{CX - WIDTH / 2}</cx><cy>{CY - HEIGHT / 2}</cy><b1>{FX - FY!r}</b1>",
        f"<k1>{K1}</k1><k2>{K2}</k2><k4>{k4}</k4><p1>{P2}</p1><p2>{P1}</p2></calibration>",
        "<rolling_shutter>true</rolling_shutter></sensor></sensors>",
        '<components><component id="0"><transform>',
        f"<rotation>{' '.join(map(str, turn.ravel()))}</rotation>",
        f"<translation>{' '.join(map(str, shift))}</translation><scale>2</scale>",
        "</transform><partition><camera_ids>0 1</camera_ids></partition></component></components>",
        "<cameras>",
    ]
    for k, name in enumerate(scene.names):
        pose = np.eye(4)
        pose[:3, :3] = turn.T @ scene.rotations[k].T
        pose[:3, 3] = turn.T @ (scene.centres[k] - shift) / 2.0
        cells = " ".join(repr(float(v)) for v in pose.ravel())
        lines.append(
            f'<camera id="{k}" sensor_id="0" component_id="0" label="{name}">'
            f"<transform>{cells}</transform></camera>\n"
        )
    lines.append('<camera id="99" sensor_id="0" label="unused"/></cameras>')
    lines.append(f"<reference>{system.replace(chr(34), '&quot;')}</reference><markers>")
    for j, (x, y, z) in enumerate(scene.points.tolist()):
        given = f'<reference x="{x!r}" y="{y!r}" z="{z!r}" sx="0.02" sy="0.02" sz="0.03" enabled="'
        given += f'{"true" if j < control - 1 else "false"}"/>'
        lines.append(f'<marker id="{j}" label="m {j}">{given if j < control else ""}</marker>')
    lines.append('</markers><frames><frame id="0"><markers>\n')
    for j in range(len(scene.points)):
        lines.append(f'  <marker marker_id="{j}">\n')
        lines += [
            f'    <location camera_id="{k}" pinned="true" x="{x!r}" y="{y!r}"/>\n'
            for k, i, x, y in scene.pixels
            if i == j
        ]
        lines.append("  </marker>\n")
    lines.append("</markers></frame></frames><settings>")
    lines.append('<property name="accuracy_projections" value="0.4"/>')
    lines.append("</settings></chunk></document>\n")
    file.write_text("".join(lines))
    return file


def opensfm_model(scene: TiltedBlock, folder: Path) -> Path:
    """Write reconstruction.json and tracks.csv: divided by the width, from the middle."""
    folder.mkdir()
    shots = {
        name: {
            "rotation": Rotation.from_matrix(rotation).as_rotvec().tolist(),
            "translation": (-rotation @ centre).tolist(),
            "camera": "own",
        }
        for name, rotation, centre in zip(scene.names, scene.rotations, scene.centres, strict=True)
    }
    camera = {
        "projection_type": "brown",
        "width": WIDTH,
        "height": HEIGHT,
        "focal_x": FX / WIDTH,
        "focal_y": FY / WIDTH,
        "c_x": (CX - WIDTH / 2) / WIDTH,
        "c_y": (CY - HEIGHT / 2) / WIDTH,
        "k1": K1,
        "k2": K2,
        "k3": 0.0,
        "p1": P1,
        "p2": P2,
    }
    points = {
        str(j + 1): {"coordinates": xyz, "color": [1, 2, 3]}
        for j, xyz in enumerate(scene.points.tolist())
    }
    model = [{"cameras": {"own": camera}, "shots": shots, "points": points}]
    (folder / "reconstruction.json").write_text(json.dumps(model))
    rows = [
        f"{scene.names[k]}\t{j + 1}\t{at}\t{(x - WIDTH / 2) / WIDTH!r}\t"
        f"{(y - HEIGHT / 2) / WIDTH!r}\t0.002\t1\t2\t3\t-1\t-1"
        for at, (k, j, x, y) in enumerate(scene.pixels)
    ]
    text = "\n".join(["OPENSFM_TRACKS_VERSION_v2", *rows]) + "\n"
    (folder / "tracks.csv").write_text(text)
    return folder
