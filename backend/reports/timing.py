"""The timing of a run from its samples: lateness, missed deadlines, gaps."""

import numpy as np

from backend.models import StoredRealTimeStatus
from backend.recording import count_missing_ticks
from backend.reports import messages
from backend.reports.model import Column, ReportSection, Table, format_measured
from backend.reports.run_data import RunData
from backend.storage import EndState


def timing_section(source: RunData) -> tuple[ReportSection, ...]:
    """Return a section with the timing of the samples; nothing for a run without any."""
    columns = source.columns
    if columns["t"].size == 0:
        return ()
    none = np.zeros(1)
    late_ms, overruns = 1e3 * columns.get("lateness_s", none), columns.get("overruns", none)
    gaps = int(np.count_nonzero(np.diff(np.round(columns["t"] * 1e3)) > 1.5))
    on_a_clock = bool(np.any(late_ms != 0.0))
    rows: list[tuple[str, str, str, str]] = [
        ("Samples", str(columns["t"].size), "", messages.samples_are_one_per_tick()),
        ("Missing samples", _describe_missing(source), "", messages.ticks_without_sample()),
        ("Gaps", str(gaps), "", messages.ranges_with_missing_samples()),
    ]
    if on_a_clock:
        figures = (np.median(late_ms), np.percentile(late_ms, 99.0), late_ms.max())
        rows += [
            ("Deadlines missed", f"{overruns[-1] - overruns[0]:.0f}", "", messages.between_first_and_last_sample()),
            *(
                (
                    f"Lateness, {name}",
                    format_measured(float(figure)),
                    "ms",
                    messages.delay_of_control_step(),
                )
                for name, figure in zip(("median", "99 %", "largest"), figures, strict=True)
            ),
        ]
    else:
        rows.append(("Lateness", "none", "", messages.computed_in_batches()))
    rows += granted_rows(source.run.set_to.granted)
    titles = (
        Column("Quantity", number=False),
        Column("Value"),
        Column("Unit", number=False),
        Column("Meaning", number=False, wide=True),
    )
    return (ReportSection("Timing", (Table(messages.timing_of_run(), titles, tuple(rows)),)),)


def granted_rows(granted: StoredRealTimeStatus | None) -> list[tuple[str, str, str, str]]:
    """Return rows of what the machine granted to the loop.

    Returns nothing for a run without a real-time clock, or of an older Sinew.
    """
    if granted is None:
        return []
    scheduling = f"SCHED_FIFO {granted.priority}" if granted.priority else "standard"
    memory = "locked" if granted.memory_locked else "not locked"
    return [
        ("Scheduling", scheduling, "", messages.granted_by_operating_system()),
        ("Memory", memory, "", messages.granted_by_operating_system()),
        (
            "Timer slack",
            str(granted.timer_slack_ns),
            "ns",
            messages.largest_timer_delay(),
        ),
        *(("Not granted", "", "", refusal) for refusal in granted.refusals),
    ]


def _describe_missing(source: RunData) -> str:
    if source.run.end_state == EndState.SERVICE_DIED:
        return messages.service_died_while_recording()
    missing = source.result.metrics.missing_samples if source.result else count_missing_ticks(source.columns)
    return messages.not_stored() if missing is None else str(missing)
