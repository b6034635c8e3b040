"""docs/faults.md names every fault and limit, with the words the screen shows."""

import re
from pathlib import Path

from backend.faults import EXPLAINED, FAULTS, Fault, Limit

PAGE = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")


def test_every_fault_has_its_message_cause_reaction_and_remedy() -> None:
    sections = dict(re.findall(r"^### `(\w+)`\n(.*?)(?=^##)", PAGE, re.MULTILINE | re.DOTALL))
    assert list(sections) == [str(fault) for fault in FAULTS if fault is not Fault.NONE]
    for name, text in sections.items():
        explained = EXPLAINED[Fault(name)]
        assert explained.message in text
        assert f"- Remedy: {explained.remedy}\n" in text
        assert re.search(r"^- Cause: .{10,}\n- Reaction: .{10,}\n- Remedy: ", text, re.MULTILINE), name


def test_every_limit_is_listed_with_its_bit() -> None:
    assert re.findall(r"^\| `(\w+)` \| (\d+) \| .{10,} \|$", PAGE, re.MULTILINE) == [
        (limit.name, str(limit.value)) for limit in Limit
    ]
