"""docs/how-to/rig.md contains the shipped wiring, the figures of the code, and the findings of ``sinew doctor``."""

import inspect
import re
from pathlib import Path

import pytest

from backend.cli import server
from plant.interface import DEFAULT_WIRING
from plant.rig import CYCLE_MAX_S, TRIED_CYCLES, UNATTENDED
from plant.safety_card import WATCHDOG_S
from plant.wiring import PFI_OF_COUNTER, WATCHDOG_MAX_S, load_wiring

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "rig.md").read_text(encoding="utf-8")
SAID = " ".join(PAGE.split())
WIRING = load_wiring(DEFAULT_WIRING)


def rows(heading: str) -> list[list[str]]:
    under = PAGE.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line.strip("|").split("|") for line in under.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in line] for line in lines]


def test_the_table_equals_the_shipped_wiring() -> None:
    w = WIRING
    expected = {"`card.device`": (w.card.device, f"timed {w.card.timing}, watchdog {w.card.watchdog_s:g} s")}
    for side in "AB":
        motor, cell = getattr(w, f"motor_{side}"), getattr(w, f"load_cell_{side}")
        expected[f"`motor_{side}.channel`"] = (motor.channel, f"{motor.gain:g} V/V")
        calibration = f"{cell.slope:g} N/V, {cell.offset:g} V"
        expected[f"`load_cell_{side}.channel`"] = (f"{cell.channel}, differential", calibration)
    for name in ("q", "A", "B"):
        encoder = getattr(w, f"encoder_{name}")
        lines = (f"{signal} at PFI{pfi}" for signal, pfi in zip("ABZ", PFI_OF_COUNTER[encoder.counter], strict=True))
        counts = f"{encoder.counts_per_rev:g} counts, direction {encoder.direction:g}"
        expected[f"`encoder_{name}.counter`"] = (f"{encoder.counter}: {', '.join(lines)}", counts)
    for name in ("drive_enable", "safety_tripped", "end_switch"):
        line = getattr(w, name)
        expected[f"`{name}.line`"] = (line.line, f"active {line.active}")
    assert {row[1]: (row[2], row[3]) for row in rows("What to connect")} == expected


@pytest.mark.parametrize(
    "statement",
    [
        f"the card's watchdog, {WATCHDOG_MAX_S:g} s after the last write",
        f"{WATCHDOG_MAX_S:g} s is the longest time that a wiring file may set",
        f"more than {UNATTENDED * WATCHDOG_MAX_S:g} s late stops itself",
        f"On the virtual card the time is {WATCHDOG_S:g} s",
        f"{TRIED_CYCLES} cycles of reading and writing",
        f"takes more than {1e3 * CYCLE_MAX_S:g} ms",
    ],
)
def test_figures_on_the_page_equal_those_of_the_code(statement: str) -> None:
    assert statement in SAID


def test_findings_on_the_page_have_the_names_of_sinew_doctor() -> None:
    named = {re.findall(r"`([^`]+)`", row[2])[0] for row in rows("The machine")}
    known = set(re.findall(r'Finding\(\s*"([^"]+)"', inspect.getsource(server)))
    assert len(named) == 6
    assert named <= known
