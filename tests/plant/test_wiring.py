"""A wiring file is checked line by line: all problems are reported together, with remedies."""

import math
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import pytest

import plant.wiring
from plant import messages
from plant.message import Message
from plant.wiring import SECTIONS, SHIPPED, MotorWiring, WiringError, WiringProblem, load_wiring

SHIPPED_TEXT = (Path(plant.wiring.__file__).parent / "wirings" / "pcie-6323.toml").read_text(encoding="utf-8")


def problems(tmp_path: Path, text: str) -> tuple[WiringProblem, ...]:
    """Return the problems of a file."""
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(WiringError) as error:
        load_wiring(path)
    found, message = error.value.problems, error.value.message
    assert message.code == "wiring_rejected"
    assert message.values == {"problems": [problem.sentence("mine.toml") for problem in found]}
    return found


def line_of(text: str, words: str) -> int:
    return next(number for number, line in enumerate(text.splitlines(), 1) if words in line)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_wirings_load_and_state_the_source_of_each_number(name: str) -> None:
    wiring = load_wiring(name)
    assert wiring.card.watchdog_s <= 0.05
    numbers = {
        f"{section}.{entry}"
        for section in SECTIONS
        for entry, value in vars(getattr(wiring, section)).items()
        if isinstance(value, float)
    }
    assert set(wiring.sources) <= numbers | {"load_cell_A.table", "load_cell_B.table"}
    assert all(wiring.sources.values())


def replaced(old: str, new: str) -> Callable[[str], str]:
    assert old in SHIPPED_TEXT
    return lambda text: text.replace(old, new, 1)


LINE_A = 'slope = { value = 10.0, unit = "N/V", source = "placeholder: 100 N at 10 V" }'


class Wrong(NamedTuple):
    """A change of the file, text in its line, and the problem of the entry with its remedy."""

    change: Callable[[str], str]
    words: str
    entry: str
    problem: Message
    remedy: Message


(ANALOG_OUTPUT,) = (entry.metadata["wanted"] for entry in fields(MotorWiring) if entry.name == "channel")

WRONG = {
    "unknown channel": Wrong(
        replaced('channel = "ao1"', 'channel = "ao9"'),
        'channel = "ao9"',
        "motor_B.channel",
        messages.unknown_connection(value="ao9"),
        messages.give_connection(expected=ANALOG_OUTPUT),
    ),
    "duplicate": Wrong(
        replaced('channel = "ao1"', 'channel = "ao0"'),
        "[motor_B]",
        "motor_B.channel",
        messages.terminal_in_use(terminal="ao0", section="motor_A"),
        messages.use_separate_terminals(),
    ),
    "missing calibration": Wrong(
        replaced('slope = { value = 10.0, unit = "N/V", source = "placeholder: 100 N at 10 V" }\n', ""),
        "[load_cell_A]",
        "load_cell_A",
        messages.load_cell_without_calibration(),
        messages.give_one_calibration(),
    ),
    "wrong unit": Wrong(
        replaced('slope = { value = 10.0, unit = "N/V"', 'slope = { value = 10.0, unit = "kg/V"'),
        "kg/V",
        "load_cell_A.slope",
        messages.number_in_other_unit(unit="kg/V"),
        messages.give_unit(unit="N/V"),
    ),
    "table without a slack tendon": Wrong(
        replaced(LINE_A, 'table = { value = [[0.5, 5], [9, 90]], unit = "V, N", source = "weights" }'),
        "[[0.5, 5], [9, 90]]",
        "load_cell_A.table",
        messages.table_without_zero_force(minimum=5.0, maximum=90.0),
        messages.add_zero_force(),
    ),
    "table that goes up and down": Wrong(
        replaced(LINE_A, 'table = { value = [[0, 0], [5, 60], [9, 50]], unit = "V, N", source = "weights" }'),
        "[[0, 0], [5, 60], [9, 50]]",
        "load_cell_A.table",
        messages.forces_not_monotonic(),
        messages.make_forces_monotonic(),
    ),
    "not a direction": Wrong(
        replaced("direction = { value = 1,", "direction = { value = 2,"),
        "direction = { value = 2,",
        "encoder_q.direction",
        messages.not_a_direction(value=2),
        messages.give_direction(),
    ),
    "end switch at neither end": Wrong(
        replaced("[end_switch]", '[end_switch]\nposition = { value = 0.0, unit = "rad", source = "measured" }'),
        "position = { value = 0.0",
        "end_switch.position",
        messages.end_switch_at_zero(),
        messages.give_signed_switch_position(),
    ),
    "slow watchdog": Wrong(
        replaced("watchdog_s = { value = 0.05", "watchdog_s = { value = 0.5"),
        "watchdog_s",
        "card.watchdog_s",
        messages.number_out_of_range(value=0.5, unit="s"),
        messages.choose_number_in_range(minimum=0.005, maximum=0.05, unit="s"),
    ),
    "number without source": Wrong(
        replaced(
            'counts_per_rev = { value = 4000, unit = "1", source = "paper: 1000 lines, four edges" }',
            "counts_per_rev = 4000",
        ),
        "counts_per_rev = 4000",
        "encoder_q.counts_per_rev",
        messages.number_without_unit_and_source(),
        messages.write_number_with_unit_and_source(entry="counts_per_rev", unit="1"),
    ),
    "not a number": Wrong(
        replaced("offset = { value = 0.0", "offset = { value = nan"),
        "offset = { value = nan",
        "load_cell_A.offset",
        messages.number_not_finite(value=math.nan),
        messages.write_number_with_unit_and_source(entry="offset", unit="V"),
    ),
    "entry nobody knows": Wrong(
        replaced('timing = "on-demand"', 'timing = "on-demand"\nrate = 5'),
        "rate = 5",
        "card.rate",
        messages.wiring_entry_unknown(),
        messages.choose_known_entry(known=["device", "timing", "watchdog_s"]),
    ),
    "line of an encoder": Wrong(
        replaced('line = "port2/line4"', 'line = "port2/line0"'),
        'line = "port2/line0"',
        "drive_enable.line",
        messages.terminal_in_use(terminal="port2/line0", section="encoder_q"),
        messages.use_separate_terminals(),
    ),
}


def test_a_direction_of_zero_has_one_problem(tmp_path: Path) -> None:
    text = replaced("direction = { value = 1,", "direction = { value = 0,")(SHIPPED_TEXT)
    (found,) = [found for found in problems(tmp_path, text) if found.entry == "encoder_q.direction"]
    assert found.text == messages.not_a_direction(value=0)


@pytest.mark.parametrize("wrong", WRONG)
def test_an_invalid_wiring_is_rejected_with_line_entry_and_remedy(tmp_path: Path, wrong: str) -> None:
    change, words, entry, problem, remedy = WRONG[wrong]
    text = change(SHIPPED_TEXT)
    found = next(found for found in problems(tmp_path, text) if found.entry == entry)
    expected = line_of(text, words)
    # what is about a section as a whole stands at its header, what is about an entry at the entry
    assert found.line in (expected, expected + 1)
    assert (found.text.code, found.remedy.code) == (problem.code, remedy.code)
    sentence = found.sentence("mine.toml")
    values = {"place": f"mine.toml:{found.line}", "entry": entry, "problem": problem, "remedy": remedy}
    assert (sentence.code, sentence.values) == ("wiring_problem", values)


def test_all_problems_are_reported_together_in_line_order(tmp_path: Path) -> None:
    text = SHIPPED_TEXT
    for wrong in (WRONG["unknown channel"], WRONG["wrong unit"], WRONG["slow watchdog"]):
        text = wrong.change(text)
    found = problems(tmp_path, text)
    assert [problem.entry for problem in found] == ["card.watchdog_s", "motor_B.channel", "load_cell_A.slope"]
    assert [problem.line for problem in found] == sorted(problem.line for problem in found)


@pytest.mark.parametrize("text", ["[card", "\x00", "card = 5"])
def test_a_file_that_is_no_wiring_is_rejected_in_one_sentence(tmp_path: Path, text: str) -> None:
    assert problems(tmp_path, text)


def test_a_missing_wiring_file_is_rejected_with_the_shipped_names() -> None:
    with pytest.raises(WiringError) as error:
        load_wiring("no-such-wiring")
    (problem,) = error.value.problems
    assert (problem.line, problem.text.code) == (0, "wiring_unreadable")
    assert (problem.remedy.code, problem.remedy.values) == ("choose_wiring", {"shipped": SHIPPED})
    assert "pcie-6323" in SHIPPED
