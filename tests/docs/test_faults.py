"""docs/reference/faults.md lists every fault and limit, with the messages of the page."""

import re

from backend.auth.control_lease import CONTROL_LEASE_PART as LOST_PAGES
from backend.faults import EXPLANATIONS, FAULTS, Fault, Limit
from tests.docs.faults_page import PAGE, SECTIONS

LINES = re.compile(r"^- Cause: .{10,}\n- Reaction: .{10,}\n- Within: \d+ ms .{10,}\n- Remedy: ", re.MULTILINE)


def test_every_fault_has_its_message_cause_reaction_time_and_remedy() -> None:
    assert list(SECTIONS) == [str(fault) for fault in FAULTS if fault is not Fault.NONE]
    for name, text in SECTIONS.items():
        explained = EXPLANATIONS[Fault(name)]
        assert explained.message in text
        assert f"- Remedy: {explained.remedy}\n" in text
        assert LINES.search(text), name


def test_every_limit_is_listed_with_its_bit() -> None:
    assert re.findall(r"^\| `(\w+)` \| (\d+) \| .{10,} \|$", PAGE, re.MULTILINE) == [
        (limit.name, str(limit.value)) for limit in Limit
    ]


def test_remedies_state_take_control_before_reset() -> None:
    remedies = [explained.remedy for explained in EXPLANATIONS.values()] + [LOST_PAGES.consequence]
    told = [remedy.lower() for remedy in remedies if "take control" in remedy]
    assert len(told) == 2
    for remedy in told:
        assert 0 <= remedy.find("take control") < remedy.find("reset"), remedy
