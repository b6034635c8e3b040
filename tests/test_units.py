"""Angles and other quantities in their display units."""

import math
import re
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.units import (
    AngleUnit,
    convert_to_display,
    format_count,
    format_percent,
    format_quantity,
    format_text,
    mark_quantities,
    parse_quantity,
)
from plant.quantity import ESCAPE, UNIT_MARK, Angle, Quantity, escape_quantities, quote

DEG, RAD = AngleUnit.DEGREES, AngleUnit.RADIANS


@pytest.mark.parametrize(
    ("value", "unit", "degrees", "radians"),
    [
        (math.pi / 3, "rad", "60°", "1.0472 rad"),
        (-2 * math.pi / 3, "rad", "-120°", "-2.0944 rad"),
        (2 * math.pi, "rad/s", "360°/s", "6.28319 rad/s"),
        (12.34567891, "N·m/rad", "12.3457 N·m/rad", "12.3457 N·m/rad"),
        (1.06, "rad/(V·s)", "1.06 rad/(V·s)", "1.06 rad/(V·s)"),
        (0.5, "1", "0.5", "0.5"),
        (3.357e-6, "V", "3.357 µV", "3.357 µV"),
        (-4.2e-8, "N", "-42 nN", "-42 nN"),
        (3.357e-9, "N·m/rad", "3.357·10⁻⁹ N·m/rad", "3.357·10⁻⁹ N·m/rad"),
        (10**400, "1", "a number of 401 digits", "a number of 401 digits"),
    ],
)
def test_only_angles_and_their_rates_are_converted(value: float, unit: str, degrees: str, radians: str) -> None:
    """Gains per radian keep the units of the paper."""
    assert format_quantity(value, unit, DEG) == degrees
    assert format_quantity(value, unit, RAD) == radians


@given(st.decimals(min_value=-1000, max_value=1000, places=6))
def test_an_angle_in_degrees_survives_the_conversion_to_radians_and_back(parse_quantity: Fraction) -> None:
    """The page sends the nearest double of the conversion."""
    sent = math.radians(float(parse_quantity))
    assert round(convert_to_display(sent, "rad", DEG), 9) == round(float(parse_quantity), 9)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        (
            "q = 1.602~rad; the limit is 1.571~rad in either direction",
            "q = 91.79°; the limit is 90.01° in either direction",
        ),
        ("outside -1.4 to 1.4~rad; choose another", "outside -80.21 to 80.21°; choose another"),
        ("q_ref 0.5236~rad, S_ref 10.00~N·m/rad", "q_ref 30°, S_ref 10.00 N·m/rad"),
        ("theta_A turned by −0.9~rad", "theta_A turned by −51.57°"),
        (
            "60~rad/s, K_m 1.06~rad/(V·s), K_S 2~N·m/rad per rad",
            "3438°/s, K_m 1.06 rad/(V·s), K_S 2 N·m/rad per rad",
        ),
        ("2~rad², 8~N, 2 to 3~V", "2 rad², 8 N, 2 to 3 V"),
        ("30~deg already, phase 47°", "30° already, phase 47°"),
        ("a push of 7.019e-05~N, 3.357e-06~V off, 2e-09~N·m/rad", "a push of 70.19 µN, 3.357 µV off, 2e-09 N·m/rad"),
    ],
)
def test_marked_quantities_in_a_text_are_converted(text: str, degrees: str) -> None:
    """Event log, faults and end states of runs are stored in SI units."""
    marked = text.replace("~", UNIT_MARK)
    assert format_text(marked, DEG) == degrees
    if not re.search(r"deg|e-", text):
        assert format_text(marked, RAD) == text.replace("~", " ")


def test_a_text_in_degrees_is_displayed_in_radians() -> None:
    """An operator may change the unit while a message is displayed."""
    marked = "120~deg is outside -100 to 100~°".replace("~", UNIT_MARK)
    assert format_text(marked, RAD) == "2.094 rad is outside -1.745 to 1.745 rad"


@given(
    st.text(alphabet=st.sampled_from("0123456789.e- “”VNs°") | st.sampled_from((UNIT_MARK, ESCAPE)) | st.characters())
    | st.sampled_from(("keep it below 1 rad", "30 deg", f"1{UNIT_MARK}rad", f"2{UNIT_MARK}{ESCAPE}deg")),
    st.sampled_from(AngleUnit),
)
def test_quoted_texts_are_displayed_unchanged(text: str, angles: AngleUnit) -> None:
    around = f"{Angle(math.pi / 6)} {quote(text)} {Angle(math.pi / 6)}"
    number = "30°" if angles is DEG else "0.523599 rad"
    assert format_text(around, angles) == f"{number} “{text}” {number}"
    assert format_text(escape_quantities(text), angles) == text


def test_quantities_are_formatted_with_their_unit() -> None:
    assert f"{Angle(0.5):.3f}" == f"0.500{UNIT_MARK}rad"
    assert f"{Angle(-1.0, 1.0):g}" == f"-1 to 1{UNIT_MARK}rad"
    assert f"{Quantity(2.0, '1')}" == "2"
    assert f"{Angle(-0.0)} {Quantity(10**400, 'N')}" == f"0{UNIT_MARK}rad a number of 401 digits N"
    assert f"{Quantity(1 / 3, 'N')}" == "0.333333 N"
    assert f"{Quantity(2e-9, 'N')}" == f"2e-09{UNIT_MARK}N"


@pytest.mark.parametrize(
    ("text", "marked"),
    [
        ("by 0.1 rad, 9 N and 1.5 rad/s", "by 0.1~rad, 9 N and 1.5~rad/s"),
        ("-1 to 2 rad, “3 rad”, 4 N·m/rad, 5 rad/(V·s)", "-1 to 2~rad, “3 rad”, 4 N·m/rad, 5 rad/(V·s)"),
        ("7e-05 N of 3 radishes", "7e-05~N of 3 radishes"),
    ],
)
def test_quantities_in_a_document_are_marked(text: str, marked: str) -> None:
    assert mark_quantities(text) == marked.replace("~", UNIT_MARK)


@pytest.mark.parametrize(
    ("word", "unit", "value"),
    [
        ("60deg", "rad", math.pi / 3),
        (" 60° ", "rad", math.pi / 3),
        ("−1.5rad", "rad", -1.5),
        ("1.5", "rad", 1.5),
        ("1e1", "N", 10.0),
    ],
)
def test_command_line_values_may_have_a_unit(word: str, unit: str, value: float) -> None:
    """A number without a unit is in SI units: 1.0 is a radian, not a degree."""
    assert parse_quantity(word, unit) == value


@pytest.mark.parametrize(("word", "unit"), [("60deg", "N"), ("deg", "rad"), ("60 turns", "rad"), ("6rad", "s")])
def test_units_of_another_quantity_are_rejected(word: str, unit: str) -> None:
    with pytest.raises(ValueError, match="could not convert"):
        parse_quantity(word, unit)


@pytest.mark.parametrize("unit", ["rad", "rad/s", "N", "1"])
def test_an_integer_larger_than_any_float_is_described_by_its_digits(unit: str) -> None:
    for angles in AngleUnit:
        assert format_quantity(10**399, unit, angles).startswith("a number of 400 digits")


@pytest.mark.parametrize(
    ("value", "text"), [(99.96, "99.96"), (99.9996, "99.9996"), (99.94, "99.9"), (100.0, "100.0"), (-3.2, "-3.2")]
)
def test_percentages_below_100_are_not_rounded_to_100(value: float, text: str) -> None:
    assert format_percent(value) == text


def test_only_the_count_one_has_a_singular_unit() -> None:
    assert [format_count(days, "day") for days in (1, 1.0, 0, 30.0, 0.5)] == [
        "1 day",
        "1 day",
        "0 days",
        "30 days",
        "0.5 days",
    ]


def test_large_counts_are_exact() -> None:
    assert format_count(1_234_567, "sample") == "1234567 samples"
    assert format_count(10**400, "sample") == f"{10**400} samples"
