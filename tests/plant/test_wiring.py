"""A wiring file is checked line by line: everything wrong with it is told at once, with what to do."""

from collections.abc import Callable
from pathlib import Path

import pytest

import plant.wiring
from plant.wiring import SECTIONS, SHIPPED, WiringError, load_wiring

SHIPPED_TEXT = (Path(plant.wiring.__file__).parent / "wirings" / "pcie-6323.toml").read_text(encoding="utf-8")


def problems(tmp_path: Path, text: str) -> list[tuple[int, str, str]]:
    """Return line, entry and the whole sentence of each problem of a file."""
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(WiringError) as refused:
        load_wiring(path)
    return [(found.line, found.entry, found.sentence("mine.toml")) for found in refused.value.problems]


def line_of(text: str, words: str) -> int:
    return next(number for number, line in enumerate(text.splitlines(), 1) if words in line)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_wirings_load_and_name_the_source_of_each_number(name: str) -> None:
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

WRONG = {
    "unknown channel": (replaced('channel = "ao1"', 'channel = "ao9"'), 'channel = "ao9"', "motor_B.channel", "ao0"),
    "duplicate": (
        replaced('channel = "ao1"', 'channel = "ao0"'),
        "[motor_B]",
        "motor_B.channel",
        "already used by motor_A",
    ),
    "missing calibration": (
        replaced('slope = { value = 10.0, unit = "N/V", source = "placeholder: 100 N at 10 V" }\n', ""),
        "[load_cell_A]",
        "load_cell_A",
        "the bring-up measures them",
    ),
    "wrong unit": (
        replaced('slope = { value = 10.0, unit = "N/V"', 'slope = { value = 10.0, unit = "kg/V"'),
        "kg/V",
        "load_cell_A.slope",
        "give it in 'N/V'",
    ),
    "table without a slack tendon": (
        replaced(LINE_A, 'table = { value = [[0.5, 5], [9, 90]], unit = "V, N", source = "weights" }'),
        "[[0.5, 5], [9, 90]]",
        "load_cell_A.table",
        "it covers 5 to 90 N; add a measured point at 0 N",
    ),
    "table that goes up and down": (
        replaced(LINE_A, 'table = { value = [[0, 0], [5, 60], [9, 50]], unit = "V, N", source = "weights" }'),
        "[[0, 0], [5, 60], [9, 50]]",
        "load_cell_A.table",
        "its forces are not monotonic",
    ),
    "not a direction": (
        replaced("direction = { value = 1,", "direction = { value = 2,"),
        "direction = { value = 2,",
        "encoder_q.direction",
        "not a direction",
    ),
    "slow watchdog": (
        replaced("watchdog_s = { value = 0.05", "watchdog_s = { value = 0.5"),
        "watchdog_s",
        "card.watchdog_s",
        "0.005 to 0.05 s",
    ),
    "number without source": (
        replaced(
            'counts_per_rev = { value = 4000, unit = "1", source = "paper: 1000 lines, four edges" }',
            "counts_per_rev = 4000",
        ),
        "counts_per_rev = 4000",
        "encoder_q.counts_per_rev",
        "source",
    ),
    "not a number": (
        replaced("offset = { value = 0.0", "offset = { value = nan"),
        "offset = { value = nan",
        "load_cell_A.offset",
        "not a finite number",
    ),
    "entry nobody knows": (
        replaced('timing = "on-demand"', 'timing = "on-demand"\nrate = 5'),
        "rate = 5",
        "card.rate",
        "known are device, timing, watchdog_s",
    ),
    "line of an encoder": (
        replaced('line = "port2/line4"', 'line = "port2/line0"'),
        'line = "port2/line0"',
        "drive_enable.line",
        "already used by encoder_q",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_wiring_is_refused_with_line_entry_and_remedy(tmp_path: Path, wrong: str) -> None:
    change, words, entry, told = WRONG[wrong]
    text = change(SHIPPED_TEXT)
    found = problems(tmp_path, text)
    (line, sentence) = next((line, sentence) for line, named, sentence in found if named == entry)
    expected = line_of(text, words)
    # what is about a section as a whole stands at its header, what is about an entry at the entry
    assert line in (expected, expected + 1)
    assert sentence.startswith(f"mine.toml:{line}: {entry}: ")
    assert told in sentence
    assert "; " in sentence


def test_all_problems_are_told_at_once_in_the_order_of_their_lines(tmp_path: Path) -> None:
    text = SHIPPED_TEXT
    for change, *_ in (WRONG["unknown channel"], WRONG["wrong unit"], WRONG["slow watchdog"]):
        text = change(text)
    found = problems(tmp_path, text)
    assert [entry for _, entry, _ in found] == ["card.watchdog_s", "motor_B.channel", "load_cell_A.slope"]
    assert [line for line, _, _ in found] == sorted(line for line, _, _ in found)


@pytest.mark.parametrize("text", ["[card", "\x00", "card = 5"])
def test_what_is_no_wiring_is_refused_in_a_sentence(tmp_path: Path, text: str) -> None:
    assert problems(tmp_path, text)


def test_a_file_that_is_not_there_is_refused_with_what_is_shipped() -> None:
    with pytest.raises(WiringError, match="pcie-6323"):
        load_wiring("no-such-wiring")
