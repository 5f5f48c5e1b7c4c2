"""Session events to and from JSON."""

from __future__ import annotations

import dataclasses
import json
import typing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.aliases import Strategy
from anaplot.errors import InputError
from anaplot.exchange.eventcodec import event_from_payload, event_to_payload
from anaplot.photogrammetry.platetransformation import TRANSFORMATIONS
from anaplot.session.events import (
    EVENT_KINDS,
    DecidedRow,
    DecisionsTakenOver,
    FiducialMeasured,
    FiducialSwitched,
    InnerAccepted,
    ModelAccepted,
    ModelChosen,
    ModelReopened,
    MonoMeasured,
    PhotoLaid,
    Place,
    PlannedPoint,
    PointAdded,
    PointMeasured,
    PointRenamed,
    PointRepeated,
    Reason,
    ReasonGiven,
    Resumed,
    Role,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.textfiles.names import name_fault


def event_to_dict(event):
    return {"kind": event.kind, **event_to_payload(event)}


def event_from_dict(data):
    return event_from_payload(data["kind"], {key: data[key] for key in data if key != "kind"})


def assert_one_safe_line(error: InputError) -> None:
    assert str(error).isprintable()


numbers = st.floats(allow_nan=False, allow_infinity=False)
names = st.text(min_size=1, max_size=15).filter(lambda text: name_fault(text) is None)
photos = names.filter(lambda text: "/" not in text)
planned = st.builds(
    PlannedPoint, names, st.sampled_from(["tie", "new"]), numbers, numbers, numbers, numbers
)
sides = st.sampled_from(["left", "right"])
three = st.tuples(numbers, numbers, numbers)
four = st.tuples(numbers, numbers, numbers, numbers)
events = st.one_of(
    st.builds(FiducialMeasured, photos, sides, names, numbers, numbers, names),
    st.builds(FiducialSwitched, photos, names, st.sampled_from(["x", "y", None]), st.booleans()),
    st.builds(
        InnerAccepted,
        photos,
        sides,
        st.sampled_from(TRANSFORMATIONS),
        st.tuples(three, three),
        st.tuples(four, four),
        st.tuples(numbers, numbers),
    ),
    st.builds(
        ModelChosen,
        names,
        photos,
        photos,
        st.lists(planned, max_size=4).map(tuple),
        st.booleans(),
    ),
    st.builds(PointAdded, planned),
    st.builds(PointMeasured, photos, photos, names, numbers, numbers, numbers, numbers, names),
    st.builds(
        PointRenamed,
        photos,
        photos,
        names,
        names,
        st.none() | sides,
        st.sampled_from(typing.get_args(Role)),
    ),
    st.builds(PhotoLaid, photos),
    st.builds(
        PointRepeated,
        photos,
        photos,
        names,
        st.booleans(),
        st.lists(st.builds(Place, photos, sides, numbers, numbers), max_size=2).map(tuple),
        st.booleans(),
        names,
    ),
    st.builds(MonoMeasured, photos, photos, sides, names, numbers, numbers, names),
    st.builds(RowSwitched, names, st.sampled_from(["x", "y", None]), st.booleans()),
    st.builds(ModelAccepted, photos, photos),
    st.builds(
        DecisionsTakenOver,
        st.lists(
            st.builds(
                DecidedRow,
                photos,
                photos,
                names,
                st.sampled_from(["x", "y"]),
                st.booleans(),
                st.sampled_from(typing.get_args(Strategy)),
            ),
            max_size=3,
        ).map(tuple),
        st.none() | names,
    ),
    st.builds(ModelReopened, photos, photos, st.none() | names, st.none() | photos),
    st.builds(ReasonGiven, st.sampled_from(typing.get_args(Reason))),
    st.sampled_from([Undone(), Suspended(), Resumed()]),
)

POINT = PlannedPoint("7", "tie", 1.0, 2.0, 3.0, 4.0)
ALL = [
    ModelChosen("1", "101", "102", (POINT,)),
    PointAdded(POINT),
    PointMeasured("101", "102", "7", 0.1, -92.0, 1e-7, 4.0, "pedal"),
    RowSwitched("7", None, False),
    ModelAccepted("101", "102"),
    PointRenamed("101", "102", "7", "8", "right", "tie"),
    ModelReopened("101", "102", "7", "102"),
    ReasonGiven("identification"),
    DecisionsTakenOver((DecidedRow("101", "102", "7", "y", False, "tau"),), "0a1b 17"),
    Undone(),
    Suspended(),
    Resumed(),
    PhotoLaid("101"),
    PointRepeated(
        "101",
        "102",
        "7",
        False,
        (Place("101", "left", 0.1, -92.0), Place("102", "right", 1e-7, 4.0)),
        True,
        "pedal",
    ),
    MonoMeasured("101", "102", "right", "7", 0.1, -92.0, "puck"),
    FiducialMeasured("101", "left", "1", -105.998, 106.0021, "pedal"),
    FiducialSwitched("101", "1", "x", False),
    InnerAccepted(
        "101",
        "right",
        "bilinear",
        ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
        ((1.0, 0.1, 0.2, 0.3), (1.0, 0.1, 1.0 / 3.0, 1e-9)),
        (0.0, -1e-17),
    ),
]


@pytest.mark.slow
@given(events)
def test_every_event_comes_back_equal(event):
    data = event_to_dict(event)
    assert data["kind"] == event.kind
    again = event_from_dict(json.loads(json.dumps(data, allow_nan=False)))
    assert again == event
    assert type(again) is type(event)


def test_every_kind_with_all_its_fields_is_written():
    assert {event.kind for event in ALL} == set(EVENT_KINDS)
    for event in ALL:
        fields = {field.name for field in dataclasses.fields(event)}
        # what came later is written only where it says something
        assert set(event_to_dict(event)) == (fields - {"mono", "anew"}) | {"kind"}


def test_a_model_of_a_mono_comparator_says_so():
    chosen = ModelChosen("1", "101", "102", (POINT,), mono=True)
    assert event_to_dict(chosen)["mono"] is True
    assert event_from_dict(event_to_dict(chosen)) == chosen
    with pytest.raises(InputError, match="mono: must be true or false"):
        event_from_dict({**event_to_dict(chosen), "mono": 1})


def test_the_written_form_is_this_one():
    assert event_to_dict(ALL[1]) == {
        "kind": "point-added",
        "planned": {"point": "7", "role": "tie", "xl": 1.0, "yl": 2.0, "xr": 3.0, "yr": 4.0},
    }


MEASURED = event_to_dict(ALL[2])
SWITCHED = event_to_dict(ALL[3])
CHOSEN = event_to_dict(ALL[0])
FIDUCIAL = event_to_dict(ALL[-3])
ACCEPTED = event_to_dict(ALL[-1])


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"kind": "point-mesured"}, ["unknown kind", "did you mean 'point-measured'"]),
        ({"kind": "undone", "x": 1}, ["event 'undone': x: unknown key"]),
        ({**MEASURED, "xll": 1.0}, ["xll: unknown key", "did you mean 'xl'"]),
        ({k: v for k, v in MEASURED.items() if k != "xl"}, ["no key 'xl'"]),
        ({**MEASURED, "xl": "1.0"}, ["xl: must be a number, not text"]),
        ({**MEASURED, "xl": True}, ["xl: must be a number, not true or false"]),
        ({**MEASURED, "xl": float("nan")}, ["xl: must be a finite number"]),
        ({**MEASURED, "xl": 10**400}, ["xl: must be a finite number"]),
        ({**MEASURED, "point": 7}, ["point: a name stands in quotes"]),
        ({**MEASURED, "point": ""}, ["is empty"]),
        ({**MEASURED, "point": "p" * 256}, ["longer than 255"]),
        ({**MEASURED, "point": "\x1b[2J"}, [r"\x1b[2J", "cannot be printed"]),
        ({**SWITCHED, "axis": "z"}, ['axis: must be "x" or "y", not', "'z'"]),
        ({**SWITCHED, "axis": []}, ["axis: must be", "not a list"]),
        ({**SWITCHED, "on": 1}, ["on: must be true or false, not a number"]),
        ({**CHOSEN, "plan": {}}, ["plan: must be a list of points, not a table"]),
        ({**CHOSEN, "plan": [3]}, ["plan[0]: must be a table, not a number"]),
        ({**CHOSEN, "plan": [{}]}, ["plan[0]: no key 'point'"]),
        (
            {**CHOSEN, "plan": [{**CHOSEN["plan"][0], "role": "old"}]},
            ['plan[0].role: must be "tie" or "new"'],
        ),
        (
            {**CHOSEN, "plan": [{**CHOSEN["plan"][0], "role": None}]},
            ['role: must be "tie" or "new" or "lateral" or "control", not nothing'],
        ),
        ({**FIDUCIAL, "side": "middle"}, ['side: must be "left" or "right"']),
        ({**FIDUCIAL, "side": None}, ['side: must be "left" or "right", not nothing']),
        ({**FIDUCIAL, "x": None}, ["x: must be a number, not nothing"]),
        ({**FIDUCIAL, "point": "1"}, ["point: unknown key"]),
        ({**ACCEPTED, "transformation": "cubic"}, ['"bilinear" or "projective", not']),
        ({**ACCEPTED, "transformation": "identity"}, ["transformation: must be"]),
        ({**ACCEPTED, "frame": [[1.0, 2.0, 3.0]]}, ["frame: must hold 2 items, not 1"]),
        ({**ACCEPTED, "frame": [[1.0, 2.0, 3.0], 4.0]}, ["frame[1]: must be a list"]),
        (
            {**ACCEPTED, "frame": [[1.0, 2.0, 3.0], [1.0, "2", 3.0]]},
            ["frame[1][1]: must be a number, not text"],
        ),
        ({**ACCEPTED, "denominator": {"c1": 0.0}}, ["denominator: must be a list"]),
        ({**ACCEPTED, "denominator": [0.0] * 9}, ["denominator: must hold 2 items, not 9"]),
        ({**CHOSEN, "plan": CHOSEN["plan"] * 4001}, ["holds 4001 points, more than 4000"]),
    ],
)
def test_whatever_is_not_an_event_is_refused(data, words):
    with pytest.raises(InputError) as caught:
        event_from_dict(data)
    assert str(caught.value).isprintable()
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "event",
    [
        PointMeasured("101", "102", "a\nb", 1.0, 2.0, 3.0, 4.0, "key"),
        PointMeasured("101", "102", "1", float("inf"), 2.0, 3.0, 4.0, "key"),
        PointMeasured("1\n2", "102", "1", 1.0, 2.0, 3.0, 4.0, "key"),
        RowSwitched("1", typing.cast(typing.Any, "z"), True),
        ModelChosen("1", "a", "b", (POINT,) * 4001),
        PointAdded(typing.cast(typing.Any, None)),
        FiducialMeasured("101", typing.cast(typing.Any, "top"), "1", 1.0, 2.0, "key"),
        FiducialMeasured("101", "left", " 1", 1.0, 2.0, "key"),
        FiducialMeasured("101", "left", "1", float("nan"), 2.0, "key"),
        InnerAccepted(
            "101", "left", "affine", typing.cast(typing.Any, ()), ((0.0,) * 4,) * 2, (0, 0)
        ),
    ],
)
def test_what_could_not_be_read_again_is_not_written(event):
    with pytest.raises(InputError):
        event_to_dict(event)


@pytest.mark.slow
@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
        ),
        max_leaves=6,
    ),
    st.sampled_from(ALL),
    st.data(),
)
def test_any_value_in_any_place_is_refused_or_kept(value, event, data):
    changed = event_to_dict(event)
    changed[data.draw(st.sampled_from(sorted({*changed, "more"} - {"kind"})))] = value
    try:
        again = event_from_dict(changed)
    except InputError as error:
        assert_one_safe_line(error)
    else:
        assert event_to_dict(again) == changed
