"""Reader of docs/reference/faults.md."""

import re
from pathlib import Path

from backend.faults import Fault

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "faults.md").read_text(encoding="utf-8")
SECTIONS = {
    name: re.sub(r"\n {2}(?=\S)", " ", section)
    for name, section in re.findall(r"^### `(\w+)`\n(.*?)(?=^## |^### `)", PAGE, re.MULTILINE | re.DOTALL)
}
"""Text by fault; list items that go on in indented lines are joined."""


def documented_ms(fault: Fault) -> int:
    """Return the documented reaction time to a fault, from its cause."""
    found = re.search(r"^- Within: (\d+) ms ", SECTIONS[fault], re.MULTILINE)
    assert found is not None, fault
    return int(found[1])
