from dataclasses import replace

from consolefake import picture, solution
from testedrows import observation, with_rows

from anaplot.adjustment.tested import AppliedTest, Observation
from anaplot.console.describe import advice_of, describe_model, describe_row
from anaplot.console.rows import shown_rows, sort_rows
from anaplot.orientation.results import Diagnosis
from anaplot.session.othernames import OtherName


def keys(rows):
    return [f"{row.point}{row.axis}" for row in rows]


def test_every_row_has_its_place_before_anything_is_measured():
    before = shown_rows(picture(measured=0))
    after = shown_rows(picture())
    assert keys(before) == keys(after)
    assert len(before) == 18
    assert [row.verdict for row in before[:2]] == ["next", "pending"]
    assert all(row.row is None for row in before)


def test_verdicts_in_words():
    rows = {row.key: row for row in shown_rows(picture())}
    assert rows["103", "y"].verdict == "<< REMEASURE"
    assert rows["104", "y"].verdict == "ok"
    assert shown_rows(picture(measured=5))[0].verdict == "measured"


def test_rows_of_an_interchanged_pair_name_the_other_point():
    names = (OtherName("103", "104"), OtherName("104", "103"))
    rows = {row.key: row for row in shown_rows(picture(other_names=names))}
    assert rows["103", "y"].verdict == "<< is 104?"
    assert rows["104", "y"].verdict == "<< is 103?"
    assert rows["102", "y"].verdict == "ok"


def test_a_row_that_cannot_be_tested_says_so():
    blind = observation("102", "y", 0.0, 0.0, 0.0, None)
    bare = observation("103", "y", 1.0, 0.3, None, None)
    rows = shown_rows(picture(solution=with_rows(solution(), (blind, bare, *solution().table[2:]))))
    assert [row.verdict for row in rows[:2]] == ["not testable", "no check"]


def test_rows_switched_off_are_off_singly_or_with_their_point():
    points = picture().points
    single = replace(points[0], off_axes=("x",))
    whole = replace(points[1], status="off")
    rows = {r.key: r for r in shown_rows(picture(points=(single, whole, *points[2:])))}
    assert rows["102", "x"].verdict == "off"
    assert rows["102", "y"].verdict == "ok"
    assert rows["103", "x"].verdict == rows["103", "y"].verdict == "off"
    assert rows["102", "x"].off_um is None


def test_a_row_switched_off_shows_the_parallax_that_it_would_have():
    points = picture().points
    off = replace(solution(), off_rows=(Observation.off(("102", "x"), "um", -31.4),))
    single = (replace(points[0], off_axes=("x",)), *points[1:])
    shot = picture(points=single, solution=off)
    row = next(row for row in shown_rows(shot) if row.key == ("102", "x"))
    assert (row.verdict, row.row, row.off_um, row.flagged) == ("off", None, -31.4, False)
    told = dict(describe_row(row, shot))
    assert "31.4" in told["PARX"]
    assert (told["verdict"], told["switched off"]) == ("off", "x")


def test_sorting():
    rows = shown_rows(picture())
    assert keys(sort_rows(rows, "significance"))[:2] == ["103y", "107y"]
    assert keys(sort_rows(rows, "redundancy"))[0] == "111y"
    assert keys(sort_rows(rows, "point"))[:4] == ["102y", "102x", "103y", "103x"]
    assert sort_rows(rows, "table") == rows


def test_rows_without_value_come_last():
    points = picture().points
    rows = shown_rows(picture(points=(replace(points[0], status="off"), *points[1:])))
    for order in ("significance", "redundancy"):
        assert {row.point for row in sort_rows(rows, order)[-2:]} == {"102"}


def test_names_are_sorted_as_people_count():
    points = tuple(
        replace(picture().points[5], point=name) for name in ("10", "9", "9a", "b2", "", "²", "b10")
    )
    rows = sort_rows(shown_rows(picture(points=points, solution=None, diagnosis=None)), "point")
    assert [row.point for row in rows] == ["", "9", "9a", "10", "b2", "b10", "²"]


def test_details_hold_odds_partners_and_transfers():
    rows = {row.key: row for row in shown_rows(picture())}
    text = dict(describe_row(rows["103", "y"], picture()))
    assert text["finds errors from"] == "37.7 µm"
    assert text["holds the error"] == "probability 84.0 %"
    assert text["hard to tell from"] == "102 y (+0.93)"
    assert text["shows as large in"] == "107 y"
    assert ("", "12 to 1 over 102 y") in describe_row(rows["103", "y"], picture())
    assert dict(describe_row(rows["107", "y"], picture()))["may come from"] == "103 y"


def test_odds_are_shown_as_the_advice_weighs_them():
    shown = picture()
    chances = tuple(0.9 if row.key == ("102", "y") else 0.001 for row in shown.solution.table)
    advised = replace(shown.diagnosis, chances=chances, none=0.09)
    shown = replace(shown, diagnosis=advised)
    rows = {row.key: row for row in shown_rows(shown)}
    assert rows["102", "y"].row.probability == 0.9
    told = describe_row(rows["103", "y"], shown)
    assert dict(told)["holds the error"] == "probability 0.1 %"
    assert ("", "1 to 900 over 102 y") in told
    assert ("", "1 to 90 over no error") in told


def test_the_model_in_words():
    text = dict(describe_model(picture()))
    assert text["base"] == "bx 91.8734, by 0.4121, bz -1.0932 mm"
    assert text["rotation"] == "omega 0.70703, phi -0.49905, kappa 1.34359 deg"
    assert text["sigma0"] == "9.31 µm, a priori 5.00 µm"
    assert text["redundancy"] == "12"
    assert text["test"] == "tau 0.001, critical 2.66"
    assert text["flagged"] == "103 y"
    assert text["advice"].startswith("remeasure 103 (y)")


def test_the_model_in_words_without_check_or_solution():
    test = AppliedTest("tau", 0.001, None)
    bare = replace(with_rows(solution(), solution().table, sigma0=None, test=test), ties=())
    text = dict(describe_model(picture(solution=bare)))
    assert text["sigma0"].startswith("–")
    assert text["test"] == "tau 0.001, no critical value"
    assert text["ties"] == "none: first model"
    assert "six points" in dict(describe_model(picture(measured=5)))["orientation"]
    assert describe_model(picture(left="", right="")) == [("model", "none is chosen yet")]


def test_the_problem_is_said_first():
    remarks = replace(solution(), remarks=("points badly spread",))
    assert advice_of(picture(solution=remarks, problem="no ties"))[0] == "no ties"
    assert advice_of(picture(solution=remarks))[-1] == "points badly spread"


def test_a_remark_that_the_advice_begins_with_is_said_once():
    remark = "no redundancy: an orientation without any check"
    shown = picture(
        solution=replace(picture().solution, remarks=(remark,)),
        diagnosis=Diagnosis((), (), (remark, "nothing is flagged"), ()),
    )
    assert [said for said in advice_of(shown) if said == remark] == [remark]
