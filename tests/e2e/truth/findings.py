"""Differences between page and service, as sentences that contain both values."""

from collections.abc import Sequence

from tests.e2e.truth.figures import Range, agrees, tells


class Findings(list[str]):
    """One sentence per difference; empty if the page agrees with the service."""

    def same(self, what: str, shown: object, told: object) -> None:
        """Compare texts or booleans."""
        if shown != told:
            self.append(f"{what}: shown {shown!r}, the service says {told!r}")

    def figure(self, what: str, shown: str | None, told: float | Range) -> None:
        """Compare a number to the precision of its last digit."""
        if shown is None or not agrees(shown, told):
            self.append(f"{what}: shown {shown!r}, the service says {told!r}")

    def sentence(self, what: str, shown: str | None, template: str, *told: float | Range) -> None:
        """Compare a text with numbers: {n} for a number, {d} for a duration [s]."""
        if shown is None or not tells(shown, template, told):
            self.append(f"{what}: shown {shown!r}, the service says {template!r} of {told}")

    def holds(self, what: str, shown: str | None, words: str) -> None:
        """Compare whether the page contains a text."""
        if shown is None or words not in shown:
            self.append(f"{what}: shown {shown!r}, which does not say {words!r}")

    def rows(self, what: str, shown: Sequence[Sequence[str]] | None, told: Sequence[Sequence[str]]) -> None:
        """Compare a table line by line."""
        if shown is None:
            self.append(f"{what}: not shown, the service has {len(told)} lines")
            return
        self.same(f"number of lines of {what}", len(shown), len(told))
        for number, (line, wanted) in enumerate(zip(shown, told, strict=False), 1):
            self.same(f"{what}, line {number}", list(line), list(wanted))
