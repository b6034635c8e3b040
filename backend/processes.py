"""The processes beside the service, one for each kind of work that must not wait for the others.

What they compute would keep Python's lock for longer than the loop waits for a heartbeat. Each is started by its first
work. What a person can make arbitrarily costly has limits of time and memory.
"""

from functools import partial

from backend.libraries import SCIENCE
from backend.offload import POLITE, Limits, Offload
from backend.supervision import Part, Supervision

_AGAIN = "What it worked on is done once more."

DRY_RUNS = Limits(600.0, 4_000_000_000, "play a shorter experiment, or play it with `sinew experiment`")
"""What a dry run may take; of ten minutes of motion it is about one minute."""

TEXTS = Limits(30.0, 1_000_000_000, "shorten the text, or split it", SCIENCE)
"""What looking over a text that a person wrote or brought in may take; what is accepted takes about a second."""

SHEETS = Limits(60.0, 1_000_000_000, "draw fewer curves, or shorter texts", ("typst",))
"""What a sheet of charts may take to become a PDF; the largest that is accepted takes about a second."""

REPORTS = Limits(1800.0, None, "report fewer runs, or shorter ones")
"""What a report, or the envelope of a long recording, may take: an hour at 1 kHz takes minutes."""

EVALUATIONS = Limits(1800.0, None, "evaluate a shorter run")
"""What it may take to evaluate a stored run once more."""


class Processes:
    """``computing`` is what somebody at the bench waits for; all others give way to it.

    ``texts`` and ``viewers_texts`` look over what operators and viewers have written, ``evaluations`` stored runs once
    more. ``studies`` has processes of its own, one for each core but one.
    """

    def __init__(self, supervision: Supervision) -> None:
        def process(works: str, niceness: int = POLITE, limits: Limits | None = None) -> Offload:
            return Offload(partial(supervision.died, Part(f"The process for {works}", _AGAIN)), niceness, limits)

        self.computing = process("results and banks", niceness=0)
        self.evaluations = process("evaluations of stored runs", limits=EVALUATIONS)
        self.reports = process("reports and exports", limits=REPORTS)
        self.sheets = process("sheets of charts", limits=SHEETS)
        self.dry_runs = process("dry runs", limits=DRY_RUNS)
        self.texts = process("texts of operators", niceness=0, limits=TEXTS)
        self.viewers_texts = process("texts of viewers", limits=TEXTS)
        self.studies = process("studies")

    def close(self) -> None:
        """End them, whatever they work on."""
        for process in vars(self).values():
            process.close()
