"""Messages for rejected numbers: label, unit, bounds and remedy."""

import json
import math
import pickle
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.errors import InvalidValueError, OutOfRangeError, RequestRejectedError, check_range, format_bound
from backend.experiments.library import build_ready_plan, find_experiment
from backend.experiments.parser import ExperimentError
from backend.models.settings import SettingError
from backend.units import AngleUnit, format_text
from plant.errors import ErrorCode

DEG, RAD = AngleUnit.DEGREES, AngleUnit.RADIANS


def message_of(refused: InvalidValueError, angles: AngleUnit = DEG) -> str:
    return format_text(refused.format_message(angles), angles)


def test_messages_name_the_segment_by_its_number() -> None:
    """The message states segment, quantity and bounds in the set unit."""
    segments = [{"duration_s": 4, "q_ref": math.radians(angle), "S_ref": 10} for angle in (0, 30, 120)]
    with pytest.raises(OutOfRangeError) as refused:
        find_experiment("sequence").make_plan({"segments": json.dumps(segments)})
    assert refused.value.path == ("segments", 2, "q_ref")
    assert message_of(refused.value) == (
        "segment 3, position reference: 120° is outside -80.2 to 80.2°; choose a value in this range"
    )
    assert message_of(refused.value, RAD).startswith(
        "segment 3, position reference: 2.0944 rad is outside -1.4 to 1.4 rad; "
    )
    assert format_text(str(refused.value), RAD) == message_of(refused.value, RAD)


def test_messages_name_a_setting_by_its_label() -> None:
    with pytest.raises(OutOfRangeError) as refused:
        build_ready_plan("tracking", **{"q_amplitude": 2.0})
    assert message_of(refused.value).startswith(
        "joint position steps between ±q_max: 114.592° is outside 0.573 to 80.2°"
    )
    with pytest.raises(SettingError) as odd:
        build_ready_plan("tracking", **{"q_amplitude": "wide"})
    assert message_of(odd.value) == "joint position steps between ±q_max: 'wide' is refused: a number is required in °"
    assert message_of(odd.value, RAD).endswith("a number is required in rad")


@pytest.mark.parametrize(
    ("minimum", "maximum", "sentence"),
    [
        (1.0, None, "tension: 0.5 N is less than 1 N; choose 1 N at least"),
        (None, 0.25, "tension: 0.5 N is more than 0.25 N; choose 0.25 N at most"),
        (1.0, 2.0, "tension: 0.5 N is outside 1 to 2 N; choose a value in this range"),
    ],
)
def test_messages_state_the_violated_bounds(minimum: float | None, maximum: float | None, sentence: str) -> None:
    with pytest.raises(OutOfRangeError) as refused:
        check_range("tension_N", 0.5, minimum, maximum, "N")
    assert message_of(refused.value) == sentence


@given(st.floats(min_value=-4.0, max_value=4.0).filter(lambda bound: abs(bound) > 1e-6))
def test_a_displayed_bound_is_accepted_as_input(bound: float) -> None:
    """Bounds are rounded towards the inside of the range."""
    for angles, back in ((DEG, math.radians), (RAD, float)):
        least, most = (float(format_bound(bound, "rad", angles, upper=upper)) for upper in (False, True))
        assert back(most) <= bound + 1e-12 * abs(bound)
        assert back(least) >= bound - 1e-12 * abs(bound)
        assert abs(back(most) - bound) <= 1e-2 * abs(bound)
        texts = [format_bound(bound, "rad", angles, upper=upper) for upper in (False, True)]
        assert all(digits(text) <= 3 or back(float(text)) == pytest.approx(bound, rel=1e-12) for text in texts)


def digits(text: str) -> int:
    return len(re.sub(r"e.*|\D", "", text).lstrip("0"))


@pytest.mark.parametrize(
    ("low", "high", "unit", "texts"),
    [
        (0.01, 2.0, "rad", ("0.573", "114")),
        (-1.4, 1.4, "rad", ("-80.2", "80.2")),
        (math.radians(0.5), math.radians(114.25), "rad", ("0.5", "114")),
        (0.354416386, 3.0, "s", ("0.355", "3")),
        (0, 2147483647, "1", ("0", "2147483647")),
        (9999.6321, 123456.7, "1", ("10000", "123000")),
    ],
)
def test_bounds_are_displayed_with_the_fewest_digits(
    low: float, high: float, unit: str, texts: tuple[str, str]
) -> None:
    """Exact values have all digits, others three; see quantity.test.ts for the page."""
    assert (format_bound(low, unit, DEG, upper=False), format_bound(high, unit, DEG, upper=True)) == texts


def test_values_that_are_not_finite_are_rejected_without_bounds() -> None:
    for figure in (math.nan, math.inf):
        with pytest.raises(OutOfRangeError) as refused:
            check_range("F_push", figure, None, None, "N")
        assert message_of(refused.value) == f"push: {figure} N is not a finite number; choose a finite number"


def test_errors_are_pickled_without_loss() -> None:
    inner = OutOfRangeError("lam_q", 9.0, 0.01, 3.0, "s")
    for refused in (inner, ExperimentError(inner, ("axes", 0), 5), SettingError("b", "x", "a number is required")):
        restored = pickle.loads(pickle.dumps(refused))
        assert type(restored) is type(refused)
        assert (str(restored), restored.path, message_of(restored)) == (str(refused), refused.path, message_of(refused))
    late = pickle.loads(pickle.dumps(RequestRejectedError(ErrorCode.NOT_NOW, "later", retry_after_s=3)))
    assert (str(late), late.category, late.retry_after_s) == ("later", ErrorCode.NOT_NOW, 3)
