"""docs/reference/notation.md agrees with the code: names, symbols, units and meanings."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from backend.realtime.modes import MODES
from backend.sample import FIELDS
from plant.interface import T_s
from plant.parameters import MECHANISMS, SECTIONS

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "notation.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """Return the cells of the table under a heading, without its header."""
    part = PAGE.split(f"\n## {heading}", 1)[1].split("\n## ", 1)[0]
    lines = re.findall(r"^\|(.*)\|$", part, re.MULTILINE)
    return [[cell.strip() for cell in line.split("|")] for line in lines[2:]]


def test_documented_signals_equal_the_columns_of_a_sample() -> None:
    written = [(code.strip("`"), symbol, unit, meaning) for symbol, code, unit, meaning, _ in rows("Signals")]
    assert written == [(field.name, field.symbol, field.unit, field.meaning) for field in FIELDS]


def test_meanings_of_signals_contain_no_code_names() -> None:
    for field in FIELDS:
        assert "backend." not in field.meaning, field.name
    meaning = next(field.meaning for field in FIELDS if field.name == "mode")
    assert meaning.endswith(", ".join(f"{code} {mode}" for code, mode in enumerate(MODES)))


@pytest.mark.parametrize(
    ("heading", "kinds"), [("Parameters of the plant", SECTIONS), ("Parameters of other mechanisms", MECHANISMS)]
)
def test_documented_parameters_equal_those_of_the_plant(heading: str, kinds: dict[str, type]) -> None:
    written = [(code.strip("`"), unit) for _, code, unit, _, _ in rows(heading)]
    assert written == [
        (f"{section}.{entry.name}", entry.metadata["unit"]) for section, kind in kinds.items() for entry in fields(kind)
    ]


def test_the_sampling_period_is_one_millisecond() -> None:
    meaning = next(meaning for symbol, _, _, meaning, _ in rows("Control") if symbol == "T_s")
    assert f"{T_s * 1000:g} ms" in meaning


def test_documented_code_names_occur_in_the_code() -> None:
    root = Path(__file__).parents[2]
    source = "\n".join(
        path.read_text(encoding="utf-8") for part in ("plant", "backend") for path in (root / part).rglob("*.py")
    )
    for _, code, *_ in rows("Control") + rows("Identification"):
        for name in re.findall(r"`(\w+)`", code):
            assert re.search(rf"\b{name}\b", source), f"docs/reference/notation.md names {name}, the code does not"
