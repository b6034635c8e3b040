"""What is told of two lines that differ."""

import pytest

from backend.reports.verification import find_difference


@pytest.mark.parametrize(
    ("one", "other"), [("usable " * 9, "usable " * 9 + "not"), ("<b>q</b>", "<b >q</b>"), ("", "0")]
)
def test_what_is_told_of_a_difference_is_never_the_same_twice(one: str, other: str) -> None:
    said, found = find_difference(one, other)
    assert said != found
