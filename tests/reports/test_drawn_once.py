"""What is drawn of the same is drawn once, and what differs in anything is drawn anew."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backend.analysis.disturbance_metrics import HoldWindow
from backend.reports.experiment_report import tracking_report
from backend.reports.model import to_html
from backend.reports.plotting import cached_figure, forget_drawings
from backend.reports.run_data import RunData
from backend.units import AngleUnit

Given = tuple[tuple[Any, ...], dict[str, Any]]
T = np.arange(5.0)
HELD = HoldWindow(0.0, 1.0, *([0.0] * 9))
OTHERS: dict[str, Given] = {
    "a sample": (({"t": T, "q": np.array([0.0, 1.0, 2.0, 3.0, 4.5])}, [HELD]), {"name": "one"}),
    "the type of samples": (({"t": T, "q": T.astype(np.float32)}, [HELD]), {"name": "one"}),
    "the shape of samples": (({"t": T, "q": T[None]}, [HELD]), {"name": "one"}),
    "the name of samples": (({"t": T, "S": T}, [HELD]), {"name": "one"}),
    "no samples": (({"t": T}, [HELD]), {"name": "one"}),
    "a field": (({"t": T, "q": T}, [replace(HELD, end_s=2.0)]), {"name": "one"}),
    "how many": (({"t": T, "q": T}, [HELD, HELD]), {"name": "one"}),
    "a word": (({"t": T, "q": T}, [HELD]), {"name": "two"}),
    "a choice": (({"t": T, "q": T}, [HELD]), {"name": "one", "angles": AngleUnit.RADIANS}),
    "nothing": (({"t": T, "q": T}, [HELD]), {"name": None}),
}


@pytest.fixture
def counted() -> Iterator[tuple[Callable[..., str], list[Given]]]:
    calls: list[Given] = []

    def draw(*args: Any, **named: Any) -> str:
        calls.append((args, named))
        return f"drawing {len(calls)}"

    forget_drawings()
    yield cached_figure(draw), calls
    forget_drawings()


@pytest.mark.parametrize("other", OTHERS)
def test_the_same_is_drawn_once_and_anything_else_anew(
    counted: tuple[Callable[..., str], list[Given]], other: str
) -> None:
    draw, calls = counted
    args, named = OTHERS[other]
    assert draw({"t": T, "q": T}, [HELD], name="one") == "drawing 1"
    assert draw({"t": T.copy(), "q": T.copy()}, [replace(HELD)], name="one") == "drawing 1"
    assert draw(*args, **named) == "drawing 2"
    assert draw({"t": T, "q": T}, [HELD], name="one") == "drawing 1"
    assert len(calls) == 2


def test_only_the_last_drawings_are_kept(counted: tuple[Callable[..., str], list[Given]]) -> None:
    draw, calls = counted
    for number in range(100):
        draw(number)
        draw("always")
    assert len(calls) == 101
    draw(99)
    assert len(calls) == 101
    draw(0)
    assert len(calls) == 102


def test_what_a_drawing_cannot_be_known_by_is_refused(counted: tuple[Callable[..., str], list[Given]]) -> None:
    draw, _ = counted
    with pytest.raises(TypeError, match="a drawing is made of data: function"):
        draw(lambda: 1)


def test_a_report_from_remembered_drawings_is_that_of_new_ones(tracking_source: RunData) -> None:
    pages = [to_html(tracking_report(tracking_source)) for _ in range(2)]
    forget_drawings()
    assert {*pages, to_html(tracking_report(tracking_source))} == {pages[0]}
