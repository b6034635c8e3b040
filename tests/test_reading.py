"""Angles as they are read, against turns of a circle counted by hand and against Python's own conversion."""

import math
import re
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.units import (
    AngleUnit,
    convert_to_display,
    format_angles,
    format_count,
    format_percent,
    format_quantity,
    parse_quantity,
)

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
def test_what_is_converted_hangs_on_the_unit(value: float, unit: str, degrees: str, radians: str) -> None:
    """Angles and their rates are converted, gains per radian stay as the paper has them."""
    assert format_quantity(value, unit, DEG) == degrees
    assert format_quantity(value, unit, RAD) == radians


@given(st.decimals(min_value=-1000, max_value=1000, places=6))
def test_what_was_typed_in_degrees_is_read_again(parse_quantity: Fraction) -> None:
    """Sent as the nearest double of the conversion, any angle comes back as it was typed."""
    sent = math.radians(float(parse_quantity))
    assert round(convert_to_display(sent, "rad", DEG), 9) == round(float(parse_quantity), 9)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        (
            "q = 1.602 rad; the bound is 1.571 rad to either side",
            "q = 91.79°; the bound is 90.01° to either side",
        ),
        ("outside -1.4 to 1.4 rad; choose another", "outside -80.21 to 80.21°; choose another"),
        ("q_ref 0.5236 rad, S_ref 10.00 N·m/rad", "q_ref 30°, S_ref 10.00 N·m/rad"),
        ("theta_A turned by −0.9 rad", "theta_A turned by −51.57°"),
        (
            "60 rad/s, K_m 1.06 rad/(V·s), K_S 2 N·m/rad per rad",
            "3438°/s, K_m 1.06 rad/(V·s), K_S 2 N·m/rad per rad",
        ),
        ("a grade of 3 radishes, 2 rad²", "a grade of 3 radishes, 2 rad²"),
        ("30 deg already", "30° already"),
        ("a push of 7.019e-05 N, 3.357e-06 V off, 2e-09 N·m/rad", "a push of 70.19 µN, 3.357 µV off, 2e-09 N·m/rad"),
        ("“turned 1.0 rad, 3e-06 V” was 0.5236 rad", "“turned 1.0 rad, 3e-06 V” was 30°"),
    ],
)
def test_angles_in_a_text_are_turned_and_nothing_else(text: str, degrees: str) -> None:
    """Marks, faults and ends of runs are kept in SI; whoever reads radians reads them as they are kept."""
    assert format_angles(text, DEG) == degrees
    if not re.search(r"deg|e-", text):
        assert format_angles(text, RAD) == text


def test_a_text_in_degrees_can_be_read_in_radians() -> None:
    """Somebody who changes the unit while a refusal stands reads it in the new one."""
    assert format_angles("120 deg is outside -100 to 100 deg", RAD) == "2.094 rad is outside -1.745 to 1.745 rad"


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
def test_a_word_of_the_command_line_may_say_its_unit(word: str, unit: str, value: float) -> None:
    """A plain number is in SI, as it ever was: 1.0 that came to mean a degree would move the joint by a 57th."""
    assert parse_quantity(word, unit) == value


@pytest.mark.parametrize(("word", "unit"), [("60deg", "N"), ("deg", "rad"), ("60 turns", "rad"), ("6rad", "s")])
def test_a_unit_that_is_not_the_quantitys_is_no_number(word: str, unit: str) -> None:
    with pytest.raises(ValueError, match="could not convert"):
        parse_quantity(word, unit)


@pytest.mark.parametrize("unit", ["rad", "rad/s", "N", "1"])
def test_a_whole_number_beyond_any_float_is_told_by_its_length(unit: str) -> None:
    for angles in AngleUnit:
        assert format_quantity(10**399, unit, angles).startswith("a number of 400 digits")


@pytest.mark.parametrize(
    ("value", "text"), [(99.96, "99.96"), (99.9996, "99.9996"), (99.94, "99.9"), (100.0, "100.0"), (-3.2, "-3.2")]
)
def test_nothing_less_than_the_whole_reads_100(value: float, text: str) -> None:
    assert format_percent(value) == text


def test_one_is_one_day_and_all_else_are_days() -> None:
    assert [format_count(days, "day") for days in (1, 1.0, 0, 30.0, 0.5)] == [
        "1 day",
        "1 day",
        "0 days",
        "30 days",
        "0.5 days",
    ]
