"""`adjust --posterior`, `--given`: from one campaign to the next, as a user does it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import anaplot
from anaplot.cli import main
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.planning.blockplan import BlockPlan, plan_block
from anaplot.report.posteriorfile import read_posterior


def flown(path: Path, seed: int, *, control: bool, prefix: str) -> Path:
    """Write a block of the same ground as it is measured in a campaign."""
    made = plan_block(BlockPlan(2, 4, 0.60, 0.60, 5, control_m=0.05)).block
    rng = np.random.default_rng(seed)
    names = {photo.id: f"{prefix}{photo.id}" for photo in made.photos}
    rows = [
        replace(
            row,
            photo=names[row.photo],
            model=row.model and "/".join(names[one] for one in row.model.split("/")),
            x=row.x + dx,
            y=row.y + dy,
        )
        for row, (dx, dy) in zip(
            made.image_points,
            (rng.normal(size=(len(made.image_points), 2)) * 0.005).tolist(),
            strict=True,
        )
    ]
    block = replace(
        made,
        name=path.name,
        photos=tuple(replace(photo, id=names[photo.id]) for photo in made.photos),
        strips=tuple(
            replace(strip, photos=tuple(names[one] for one in strip.photos))
            for strip in made.strips
        ),
    )
    write_new_block(path, block)
    write_image_points(path, rows)
    write_control(path, list(made.control) if control else [])
    return path


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("campaigns")
    spring = flown(folder / "spring", 1, control=True, prefix="s")
    autumn = flown(folder / "autumn", 2, control=False, prefix="a")
    return spring, autumn


@pytest.fixture(scope="module")
def left(campaigns) -> Path:
    path = campaigns[0].parent / "spring.npz"
    assert main(["adjust", str(campaigns[0]), "--posterior", str(path)]) == 0
    return path


def answer(capsys, *words: str) -> dict:
    capsys.readouterr()
    assert main(["adjust", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_block_without_control_stands_on_the_last_campaign(campaigns, left, capsys) -> None:
    _, autumn = campaigns
    capsys.readouterr()
    assert main(["adjust", str(autumn)]) == 4
    assert "not determined" in capsys.readouterr().err
    found = answer(capsys, str(autumn), "--given", str(left))
    given = found["given"]
    assert given["coordinates"] == len(read_posterior(left).names)
    assert given["unknown"] == given["exact"] == 0
    # what only it holds is not tested
    assert given["conditions"] == given["coordinates"] - 7
    assert given["verdict"]["known"]["dimension"] == given["conditions"]
    assert not given["verdict"]["rejected"]
    r = sum(row["r"] for row in given["rows"])
    rays = sum(row[r] for row in found["image_points"] for r in ("rx", "ry"))
    assert r + rays == pytest.approx(found["redundancy"], abs=1e-6)
    assert main(["adjust", str(autumn), "--given", str(left)]) == 0
    text = capsys.readouterr().out
    assert f"GIVEN  {given['coordinates']} coordinates of " in text
    assert "no point and no photo by itself contradicts the prior" in text


def test_a_campaign_with_control_free_of_error_is_carried_on(campaigns, tmp_path, capsys) -> None:
    """All control of the next block is free of error by what is given: none of it is tested."""
    spring, autumn = campaigns
    firm, path = tmp_path / "firm", tmp_path / "firm.npz"
    shutil.copytree(spring, firm)
    rows = (firm / "control.csv").read_text(encoding="utf-8").splitlines()
    head = rows[0].split(",")
    sigmas = [k for k, name in enumerate(head) if name in ("sX", "sY", "sZ")]
    assert sigmas

    def written(folder: Path, use: str) -> None:
        out = [",".join(head if "use" in head else [*head, "use"])]
        for row in rows[1:]:
            cells = row.split(",")
            for k in sigmas:
                cells[k] = "0"
            if "use" in head:
                cells[head.index("use")] = use
            else:
                cells.append(use)
            out.append(",".join(cells))
        (folder / "control.csv").write_text("\n".join(out) + "\n", encoding="utf-8")

    written(firm, "control")
    left = answer(capsys, str(firm), "--posterior", str(path))["posterior"]
    assert left["exact"] > 0
    found = answer(capsys, str(autumn), "--given", str(path))
    assert found["given"]["exact"] == left["exact"]
    assert found["hypotheses"]["control"] is None
    # check points of the next block that what is given holds are no control either
    checked = tmp_path / "checked"
    shutil.copytree(autumn, checked)
    written(checked, "check")
    assert answer(capsys, str(checked), "--given", str(path))["hypotheses"]["control"] is None
    # only what is free of error is given
    of = read_posterior(path)
    exact = np.diag(of.covariance) == 0.0
    np.savez(path, names=[n.text for n, one in zip(of.names, exact, strict=True) if one],
             x=of.x[exact], C=np.zeros((exact.sum(), exact.sum())))  # fmt: skip
    given = answer(capsys, str(autumn), "--given", str(path))["given"]
    assert (given["exact"], given["coordinates"], given["verdict"]) == (left["exact"], 0, None)
    assert main(["adjust", str(autumn), "--given", str(path)]) == 0
    assert f"GIVEN  {left['exact']} coordinates free of error, held so" in capsys.readouterr().out


def test_control_of_both_campaigns_is_told_of(campaigns, left, capsys) -> None:
    spring, _ = campaigns
    given = answer(capsys, str(spring), "--given", str(left))["given"]
    assert len(given["control_as_well"]) > 3
    assert main(["adjust", str(spring), "--given", str(left)]) == 0
    assert "weighted control here and given as well" in capsys.readouterr().out


def test_photos_and_single_points_can_be_chosen(campaigns, tmp_path, capsys) -> None:
    spring, autumn = campaigns
    path = tmp_path / "some.npz"
    found = answer(
        capsys, str(spring), "--posterior", str(path), "--posterior-of", "photos,01-01,point:02-02"
    )
    assert found["posterior"] == {
        "coordinates": 54,
        "points": 2,
        "photos": 8,
        "exact": 0,
        "singular": False,
    }
    names = read_posterior(path).names
    assert names[0].text == "photo:s101:X"
    assert names[-1].text == "point:02-02:Z"
    # autumn knows the points, and no photo; seven need more
    assert main(["adjust", str(autumn), "--given", str(path)]) == 4
    # each value and its standard deviation, as the report has them
    photo = next(row for row in found["photos"] if row["photo"] == "s101")
    of = read_posterior(path)
    values = dict(zip((name.text for name in of.names), of.x.tolist(), strict=True))
    spread = dict(zip(values, np.sqrt(np.diag(of.covariance)).tolist(), strict=True))
    for unknown in ("X", "Y", "Z", "omega", "phi", "kappa"):
        assert values[f"photo:s101:{unknown}"] == pytest.approx(photo[unknown], abs=1e-12)
        # the block's test is that of the a-priori sigma0
        assert spread[f"photo:s101:{unknown}"] == pytest.approx(photo[f"s{unknown}"], rel=1e-9)


def test_a_contradiction_is_told(campaigns, left, tmp_path, capsys) -> None:
    _, autumn = campaigns
    of = read_posterior(left)
    x = of.x.copy()
    x[[name.text for name in of.names].index("point:02-02:X")] += 1.0
    path = tmp_path / "moved.npz"
    np.savez(path, names=[name.text for name in of.names], x=x, C=of.covariance)
    call = [str(autumn), "--given", str(path)]
    found = answer(capsys, *call)["given"]
    assert found["verdict"]["rejected"]
    assert found["contradicted"][0] == {"kind": "point", "name": "02-02"}
    assert main(["adjust", *call, "--fail-on-flag"]) == 1
    text = capsys.readouterr().out
    assert "<< REJECTED" in text
    assert "worst first (it may pull the others along): point 02-02" in text
    found = answer(capsys, *call, "--given-without", "02-02")["given"]
    assert not found["verdict"]["rejected"]
    assert main(["adjust", *call, "--errors", "tau"]) == 0
    assert "what is given is never rejected" in " ".join(capsys.readouterr().out.split())


def test_what_goes_together_and_what_does_not(campaigns, left, tmp_path, capsys) -> None:
    spring, autumn = map(str, campaigns)
    given = ["--given", str(left)]
    both = answer(
        capsys, spring, *given, "--components", "kinds", "--function", "height 01-01 02-02"
    )
    assert both["given"]["conditions"] == both["given"]["coordinates"]
    assert answer(capsys, spring, *given, "--errors", "search", "--control-last")["given"]

    def refused(*words: str) -> str:
        capsys.readouterr()
        assert main(["adjust", *words]) == 2
        said = capsys.readouterr().err
        assert len(said.splitlines()) == 1
        return said

    assert "--given goes with the datum of control" in refused(autumn, *given, "--datum", "free")
    assert "--given and --prior: C is for" in refused(spring, *given, "--prior", "common")
    assert "--posterior-of goes with" in refused(spring, "--posterior-of", "points")
    assert "--given-without goes with --given" in refused(spring, "--given-without", "01-01")
    npz = str(tmp_path / "left.npz")
    assert "--posterior goes with the datum" in refused(
        spring, "--posterior", npz, "--datum", "minimal"
    )
    assert "writes a file that ends in .npz" in refused(
        spring, "--posterior", str(campaigns[0] / "control.csv")
    )
    assert "no point and no photo '99'" in refused(
        spring, "--posterior", npz, "--posterior-of", "99"
    )
    assert not Path(npz).exists()
    (tmp_path / "text.npz").write_text("point,X\n", encoding="utf-8")
    assert "no archive" in refused(autumn, "--given", str(tmp_path / "text.npz"))


def test_the_library_carries_it_without_a_file(campaigns, left) -> None:
    spring, autumn = campaigns
    path = spring.parent / "again.npz"
    first = anaplot.adjust(spring, posterior=path, posterior_of=["points"]).result.posterior
    assert first is not None
    after = anaplot.adjust(autumn, given=first).result
    from_file = anaplot.adjust(autumn, given=left).result
    assert after.block.vtpv == pytest.approx(from_file.block.vtpv, rel=1e-12)
    assert after.given is not None
    assert after.given.verdict is not None
    found = anaplot.find_gross_errors(autumn, "tau", given=first).result
    assert found.block.problem.given is not None


def test_what_conditions_free_of_error_tie_is_told_where_it_is_written(
    campaigns, tmp_path, capsys
) -> None:
    spring, autumn = campaigns
    firm = tmp_path / "firm"
    shutil.copytree(spring, firm)
    at = {row["point"]: row for row in answer(capsys, str(spring))["points"]}
    apart = [at["02-03"][axis] - at["02-02"][axis] for axis in "XYZ"]
    (firm / "distances.csv").write_text(
        f"from,to,distance,sigma\n02-02,02-03,{np.linalg.norm(apart):.3f},0\n", encoding="utf-8"
    )
    path = tmp_path / "firm.npz"
    assert answer(capsys, str(firm), "--posterior", str(path))["posterior"]["singular"]
    assert main(["adjust", str(autumn), "--given", str(path)]) == 2
    said = capsys.readouterr().err
    assert "C is singular: a combination of coordinates (point:02-0" in said
    assert len(said.splitlines()) == 1
    call = [str(autumn), "--given", str(path), "--given-without", "02-03"]
    assert not answer(capsys, *call)["given"]["verdict"]["rejected"]
