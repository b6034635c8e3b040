"""docs/fidelity.md keeps what it promises, and its tables are those that the code gives."""

import re
from pathlib import Path

import numpy as np
import pytest

from backend.experiments.plans.stored_plan import ready_plan
from backend.experiments.results.impact import beside_each_other, hits_of
from backend.identification.published import TABLE_1
from plant.parameters import PlantParameters, load_parameters
from tests.bench.fidelity import default_plan, gain_rows, motor_rows
from tests.bench.fidelity_experiments import loaded_row, pushed_row
from tests.bench.fidelity_runs import Bench
from tests.experiments.test_impact import PROGRAM, impacts

PAGE = (Path(__file__).parents[2] / "docs" / "fidelity.md").read_text(encoding="utf-8")


def written(table: str) -> list[list[str]]:
    """Rows of a table of the page, cell by cell, headings left out."""
    found = re.search(rf"<!-- table: {table} -->\n((?:\|.*\n)+)", PAGE)
    assert found, f"docs/fidelity.md has no table {table}: run python -m tests.bench.fidelity --write docs/fidelity.md"
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in found[1].splitlines()[2:]]


def numbers(row: list[str]) -> list[float]:
    return [float(number) for cell in row[1:] for number in re.findall(r"-?\d+\.?\d*(?:e[+-]\d+)?", cell)]


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


def test_motor_is_identified_as_in_the_paper(lab: PlantParameters) -> None:
    computed = list(motor_rows(lab))
    assert [row[0] for row in computed] == [row[0] for row in written("motor")]
    for row, on_page in zip(computed, written("motor"), strict=True):
        assert numbers(row) == pytest.approx(numbers(on_page), abs=2e-3)
    mean = next(row for row in computed if row[0] == "A and B, 63.21 % rule")
    K_m, _, T_m, _ = numbers(mean)
    assert pytest.approx(2.86, rel=0.03) == K_m
    assert pytest.approx(0.22, rel=0.05) == T_m


def test_gains_are_geometric_at_every_tension() -> None:
    for row in written("gains"):
        assert float(row[2]) == pytest.approx(0.05, rel=0.05)
        assert float(row[6]) == pytest.approx(0.721, rel=0.02)


def test_gains_on_the_page_are_those_of_the_code(lab: PlantParameters) -> None:
    computed = next(gain_rows(lab, {20.0: Bench(lab).play(default_plan(20.0))}))
    on_page = next(row for row in written("gains") if row[0] == "20 N")
    for column in (2, 4, 6, 8):
        assert float(computed[column]) == pytest.approx(float(on_page[column]), rel=0.02)


def test_time_constant_of_the_first_order_fit_rises_with_tension() -> None:
    T = [float(row[4].split("±")[0]) for row in written("first order G_q")]
    assert np.all(np.diff(T) > 0.0)


def test_compliance_on_the_page_is_that_of_the_code(lab: PlantParameters) -> None:
    name = "steps of ±10 and ±20 N"
    on_page = next(row for row in written("figure 8") if row[0] == name)
    computed = pushed_row(name, lab, ready_plan("compliance", profile="steps"))
    assert numbers(computed) == pytest.approx(numbers(on_page), abs=2e-3)


def test_what_the_page_says_of_the_delay_follows_from_its_own_table() -> None:
    rate = {row[0]: float(row[4]) for row in written("figure 8") if row[4]}
    hand, steps, delay = rate["hand, as shipped"], rate["steps of ±10 and ±20 N"], 0.012
    assert f"12 ms at {hand} N/s are {delay * hand:.2f} N, at {steps} N/s {delay * steps:.2f} N" in PAGE
    assert f"makes 2.239 N at {2.239 / delay:.0f} N/s" in PAGE


def test_robustness_on_the_page_is_that_of_the_code() -> None:
    name = "here, `ideal`"
    on_page = next(row for row in written("robustness") if row[0] == name)
    computed = loaded_row(name, load_parameters("ideal"), ready_plan("robustness"))
    assert numbers(computed) == pytest.approx(numbers(on_page), abs=2e-3)


def test_published_columns_are_table_1() -> None:
    for (tension, row), q, S in zip(
        TABLE_1.items(), written("first order G_q"), written("first order G_S"), strict=True
    ):
        assert q[:3] == [f"{tension:g} N", f"{row.K_q:g}", f"{row.T_q:g}"]
        assert S[:3] == [f"{tension:g} N", f"{row.K_S:g}", f"{row.T_S:g}"]


def test_hits_on_the_page_are_those_of_the_code() -> None:
    hits = hits_of(impacts("lab").columns, PROGRAM)
    for row, soft, stiff in zip(marked("impact"), hits[:3], hits[3:6], strict=True):
        peaks, impulses = (soft.peak_N, stiff.peak_N), (soft.impulse_Ns, stiff.impulse_Ns)
        expected = [*peaks, peaks[0] / peaks[1], *impulses, impulses[0] / impulses[1]]
        assert numbers(row) == pytest.approx(expected, rel=0.01)
        assert float(row[0].split()[0]) == pytest.approx(soft.speed, rel=0.03)


def test_hits_that_are_given_way_to_on_the_page_are_those_of_the_code() -> None:
    pairs, _ = beside_each_other(hits_of(impacts("lab").columns, PROGRAM))
    ordered = sorted(pairs, key=lambda pair: (pair[0].S_ref, pair[0].speed))
    for row, (plain, hit) in zip(marked("reaction"), ordered, strict=True):
        times = [1e3 * time_s for time_s in (hit.felt_s, hit.gave_way_s, hit.fell_s)]
        peaks = [hit.peak_N, hit.peak_N / plain.peak_N]
        expected = [*times, *peaks, hit.impulse_Ns, hit.impulse_Ns / plain.impulse_Ns]
        assert numbers(row) == pytest.approx(expected, rel=0.02)
        assert [float(number) for number in re.findall(r"\d+\.?\d*", row[0])] == pytest.approx(
            [plain.S_ref, plain.speed], rel=0.03
        )


def marked(table: str) -> list[list[str]]:
    found = re.search(rf"<!-- {table} -->\n((?:\|.*\n)+)", PAGE)
    assert found
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in found[1].splitlines()[2:]]
