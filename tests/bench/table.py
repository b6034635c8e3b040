"""Output of the benchmarks: ratios from one run with their bounds."""

from dataclasses import dataclass

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True)
class Ratio:
    """One line: ``ratio`` of two values of this run; ``bound`` as text and whether it is ``met`` (None: no bound)."""

    what: str
    ratio: float
    bound: str = ""
    met: bool | None = None
    detail: str = ""

    @classmethod
    def at_most(cls, what: str, ratio: float, bound: float, detail: str = "") -> "Ratio":
        return cls(what, ratio, f"at most {bound:g}", ratio <= bound, detail)

    @classmethod
    def at_least(cls, what: str, ratio: float, bound: float, detail: str = "") -> "Ratio":
        return cls(what, ratio, f"at least {bound:g}", ratio >= bound, detail)


def print_ratios(console: Console, title: str, ratios: list[Ratio]) -> bool:
    """Print the lines; return whether all bounds are met."""
    table = Table(title=title, title_justify="left", title_style="bold")
    for heading in ("what", "ratio", "bound", "", "detail"):
        table.add_column(heading, justify="right" if heading == "ratio" else "left")
    for row in ratios:
        verdict = "" if row.met is None else "met" if row.met else "MISSED"
        table.add_row(row.what, f"{row.ratio:.3g}", row.bound, verdict, row.detail)
    console.print(table)
    return all(row.met is not False for row in ratios)
