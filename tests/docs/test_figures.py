"""Figures in the documents equal the computed ones, and the comparison detects wrong figures."""

import re
from pathlib import Path

import pytest

from backend.identification.models import TABLE_1
from tests.docs.figures import places
from tests.docs.figures.declared import COMPUTATIONS
from tests.docs.figures.identification_page import FIRST_ORDER, GAINS, MOTOR
from tests.docs.figures.places import (
    Computation,
    Found,
    PlaceError,
    Prose,
    Table,
    differences,
    printed_rows,
    same,
    write,
)

DECLARED = [place for computation in COMPUTATIONS for place in computation.places]


@pytest.mark.parametrize("computation", [pytest.param(one, id=one.name) for one in COMPUTATIONS])
def test_printed_figures_equal_the_computed_figures(computation: Computation) -> None:
    assert differences(computation, computation.found()) == [], "make figures writes them anew"


def test_marked_tables_are_declared_and_declared_tables_are_marked_once() -> None:
    declared = sorted({(place.page, place.name) for place in DECLARED if isinstance(place, Table)})
    pages = sorted(path.relative_to(places.ROOT).as_posix() for path in (places.ROOT / "docs").rglob("*.md"))
    marked = sorted((page, name) for page in pages for name in places.marked_tables(page))
    assert marked == declared


def test_every_printed_row_has_a_computation() -> None:
    """A row without a computation would stay on the page forever."""
    for table in {place for place in DECLARED if isinstance(place, Table)}:
        keys = [table.key_of(row) for row in printed_rows(table)]
        assert len(keys) == len(set(keys)), table.name
        assert len(keys) >= sum(table in computation.places for computation in COMPUTATIONS), table.name


@pytest.mark.parametrize(
    ("printed", "computed", "alike"),
    [
        ("2.49 s", "2.50 s", True),
        ("2.49 s", "2.51 s", False),
        ("−0.213", "-0.214", True),
        ("-0.213", "0.213", False),
        ("7.33e-05; 0.64", "7.34e-05; 0.64", True),
        ("7.33e-05; 0.64", "7.33e-04; 0.64", False),
        ("above 1.25 Hz", "1.25 Hz", False),
        ("not within 4", "1.23", False),
        ("1.0", "nan", False),
        ("nan", "nan", True),
    ],
)
def test_figures_are_compared_within_one_unit_of_the_last_printed_digit(
    printed: str, computed: str, alike: bool
) -> None:
    assert same(printed, computed) is alike


TABLE = Table("docs/page.md", "sizes", ("plant", "motion", "size"), key=2)
SENTENCE = Prose("docs/page.md", "largest", "the largest is {size:.1f} m, the least {least:.1f} m")
PAGE = """# Sizes

<!-- computed: sizes -->

| plant | motion | size |
| --- | --- | --- |
| `lab` | lambda | 1.0 m |
| `ideal` | lambda | 2.0 m |

<!-- end -->

Of these the largest
is 2.0 m, the least −1.0 m; the rest is text.
"""
FIRST = Computation("first", (TABLE, SENTENCE), lambda: {})
SECOND = Computation("second", (TABLE,), lambda: {})
CHANGED: Found = {TABLE: [["`lab`", "lambda", "1.3 m"]], SENTENCE: {"size": 2.2, "least": -0.4}}


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(places, "ROOT", tmp_path)
    path = tmp_path / "docs" / "page.md"
    path.parent.mkdir()
    path.write_text(PAGE, encoding="utf-8")
    return path


def test_a_different_figure_is_reported_with_its_location(page: Path) -> None:
    told = differences(FIRST, {TABLE: [["`lab`", "lambda", "1.3 m"]], SENTENCE: {"size": 2.0, "least": -1.0}})
    assert told == ["docs/page.md, sizes, `lab` / lambda, size: printed '1.0 m', computed '1.3 m'"]
    told = differences(FIRST, {TABLE: [["`lab`", "lambda", "1.0 m"]], SENTENCE: {"size": 2.2, "least": -1.4}})
    assert [each.split(", ")[2].split(":")[0] for each in told] == ["size", "least"]


def test_a_missing_row_is_reported(page: Path) -> None:
    told = differences(SECOND, {TABLE: [["`lab-stick`", "lambda", "1.0 m"]]})
    assert "printed '', computed '1.0 m'" in told[-1]


def test_writing_updates_the_figures_and_leaves_other_text_unchanged(page: Path) -> None:
    assert write({FIRST: CHANGED}, (FIRST, SECOND)) == ["docs/page.md"]
    assert differences(FIRST, CHANGED) == []
    expected = PAGE.replace("| 1.0 m", "| 1.3 m").replace("is 2.0 m", "is 2.2 m").replace("−1.0 m", "−0.4 m")
    assert page.read_text(encoding="utf-8") == expected
    assert write({FIRST: CHANGED}, (FIRST, SECOND)) == []


def test_a_row_without_computation_is_removed_when_all_rows_are_computed(page: Path) -> None:
    found: Found = {TABLE: [["`lab`", "lambda", "1.0 m"]]}
    write({SECOND: found}, (SECOND,))
    assert printed_rows(TABLE) == [["`lab`", "lambda", "1.0 m"]]


def test_a_changed_sentence_is_reported_and_nothing_is_written(page: Path) -> None:
    changed = PAGE.replace("the largest", "the biggest")
    page.write_text(changed, encoding="utf-8")
    with pytest.raises(PlaceError):
        write({FIRST: CHANGED}, (FIRST, SECOND))
    assert page.read_text(encoding="utf-8") == changed


def numbers(cell: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.?\d*", cell)]


def test_identified_motor_agrees_with_the_paper() -> None:
    rows = {row[0]: row[1:] for row in printed_rows(MOTOR)}
    K_m, T_m = (numbers(cell)[0] for cell in rows["A and B, 63.21 % rule"])
    assert pytest.approx(2.86, rel=0.002) == K_m
    assert pytest.approx(0.22, rel=0.01) == T_m


def test_identified_gains_equal_the_geometric_gains_at_every_tension() -> None:
    for row in printed_rows(GAINS):
        assert float(row[2]) == pytest.approx(0.05, rel=0.01)
        assert float(row[6]) == pytest.approx(0.721, rel=0.005)


def test_published_columns_equal_table_1_and_T_of_G_q_increases_with_tension() -> None:
    before = 0.0
    for (tension, row), q, S in zip(
        TABLE_1.items(), printed_rows(FIRST_ORDER["q"]), printed_rows(FIRST_ORDER["S"]), strict=True
    ):
        assert q[:3] == [f"{tension:g} N", f"{row.K_q:g}", f"{row.T_q:g}"]
        assert S[:3] == [f"{tension:g} N", f"{row.K_S:g}", f"{row.T_S:g}"]
        T, _ = numbers(q[4])
        assert before < T
        before = T
