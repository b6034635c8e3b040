"""The processes beside the service, one for each kind of work that must not wait for the others.

What they compute would keep Python's lock for longer than the loop waits for a heartbeat. Each is started by its first
work.
"""

from functools import partial

from backend.offload import Offload
from backend.supervision import Part, Supervision

_AGAIN = "What it worked on is done once more."


class Processes:
    """``computing`` is what somebody at the bench waits for; ``reports`` and ``dry_runs`` give way to all others.

    ``studies`` has processes of its own, one for each core but one.
    """

    def __init__(self, supervision: Supervision) -> None:
        def died_as(name: str) -> partial[float]:
            return partial(supervision.died, Part(name, _AGAIN))

        self.computing = Offload(died_as("The process for evaluations and banks"), niceness=0)
        self.reports = Offload(died_as("The process for reports and exports"))
        self.dry_runs = Offload(died_as("The process for dry runs"))
        self.studies = Offload(died_as("The process for studies"))

    def close(self) -> None:
        """End them, whatever they work on."""
        for process in (self.computing, self.reports, self.dry_runs, self.studies):
            process.close()
