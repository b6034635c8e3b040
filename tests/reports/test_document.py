import math

import pytest

from backend.reports.model import exact, format_measured


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1.6789, "1.68"),
        (9.996, "10.0"),
        (-0.0051, "−0.00510"),
        (123456.0, "1.23·10^5"),
        (4321.0, "4321"),
        (-2.5e-7, "−2.50·10^−7"),
        (None, "–"),
        (math.nan, "–"),
    ],
)
def test_measured_numbers_show_three_significant_digits(value: float | None, text: str) -> None:
    assert format_measured(value) == text


def test_chosen_numbers_lose_nothing_and_gain_no_zeros() -> None:
    assert [exact(value) for value in (0.0854, 10.0, -1.0471976, 1e5)] == ["0.0854", "10", "−1.0472", "100000"]
