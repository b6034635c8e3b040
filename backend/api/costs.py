"""What each route of the interface may compute, where, and what bounds it.

A route that is not listed fails a test: whoever adds one says what a request to it may cost. What a person can make
costly by what they send runs in a process beside the service, within limits: nothing that one request computes may keep
STOP waiting.
"""

from dataclasses import dataclass

from backend import workers
from backend.services import background_work, downloads, queue, signals
from backend.workers import WorkLimits

_UNLIMITED = WorkLimits()


@dataclass(frozen=True)
class Cost:
    """``where`` it is computed, within which ``limits``, and how many of them there may be ``at_a_time``."""

    where: str
    limits: WorkLimits = _UNLIMITED
    at_a_time: str = "one after the other"

    @property
    def computes(self) -> bool:
        """Whether it computes anything beyond reading, writing and passing on."""
        return self not in (AT_HAND, ROWS, LOOP)


def _places(places: int, viewers: int, each: int) -> str:
    return f"{places} waiting, {viewers} of viewers, {each} of one person"


AT_HAND = Cost("the service, from memory", at_a_time="any")
ROWS = Cost("a thread of the service, rows of the database", at_a_time="any")
LOOP = Cost("the control process", at_a_time="any")
FORMULAS = Cost("a thread of the service, formulas of bounded numbers", at_a_time="any")
TEXT = Cost(
    "the process for texts: one for operators, one for viewers",
    workers.TEXT_LIMITS,
    _places(background_work.MAX_TEXTS, background_work.MAX_VIEWER_TEXTS, background_work.MAX_TEXTS_PER_USER),
)
PREVIEW = Cost(
    "the process for texts: one for operators, one for viewers",
    workers.TEXT_LIMITS,
    _places(background_work.MAX_PREVIEWS, background_work.MAX_VIEWER_PREVIEWS, background_work.MAX_PREVIEWS_PER_USER),
)
ORDERED_TEXT = Cost("the process for texts of operators", workers.TEXT_LIMITS)
DRY_RUN = Cost(
    "the process for dry runs", workers.DRY_RUN_LIMITS, _places(queue.MAX_DRY_RUNS, queue.MAX_VIEWER_DRY_RUNS, each=1)
)
SHEET = Cost(
    "the process for sheets of charts",
    workers.SHEET_LIMITS,
    _places(background_work.MAX_SHEETS, background_work.MAX_VIEWER_SHEETS, background_work.MAX_SHEETS_PER_USER),
)
REPORT = Cost("the process for reports", workers.REPORT_LIMITS)
LONG_RECORDING = Cost("a thread; of long recordings the process for reports", workers.REPORT_LIMITS)
RANGE = Cost(
    "threads of the service; of long ranges and of files a process for each", at_a_time=f"{signals.MAX_RANGES}"
)
EVALUATION = Cost("the process for evaluations of stored runs", workers.EVALUATION_LIMITS)
MODELS = Cost("the process for results and banks")
STUDY = Cost("the processes for studies")
DOWNLOAD = Cost("a process for each download", at_a_time=f"{downloads.MAX_DOWNLOADS}")
DATABASE = Cost("a thread of the service, the whole database")

COSTS: dict[str, Cost] = {
    "GET /api/health": AT_HAND,
    "GET /api/session": AT_HAND,
    "POST /api/session": AT_HAND,
    "DELETE /api/session": AT_HAND,
    "PUT /api/session/name": AT_HAND,
    "POST /api/page-address": AT_HAND,
    "POST /api/session/tokens/rotate": AT_HAND,
    "GET /api/checklist": ROWS,
    "GET /api/preferences": ROWS,
    "PUT /api/preferences": ROWS,
    "POST /api/control": AT_HAND,
    "DELETE /api/control": AT_HAND,
    "POST /api/control/wishes": AT_HAND,
    "POST /api/control/wishes/{id}": AT_HAND,
    "GET /api/state": AT_HAND,
    "POST /api/stop": LOOP,
    "POST /api/reset": LOOP,
    "POST /api/mode": LOOP,
    "PUT /api/references": LOOP,
    "POST /api/push": LOOP,
    "PUT /api/touch": LOOP,
    "PUT /api/wall": LOOP,
    "GET /api/player": AT_HAND,
    "PUT /api/player": LOOP,
    "PUT /api/trigger": ROWS,
    "DELETE /api/trigger": ROWS,
    "GET /api/bring-up": ROWS,
    "POST /api/bring-up/confirm": LOOP,
    "POST /api/bring-up/cancel": LOOP,
    "POST /api/bring-up/drives": LOOP,
    "POST /api/bring-up/{step}": LOOP,
    "GET /api/faults": AT_HAND,
    "POST /api/faults/injection": LOOP,
    "DELETE /api/faults/injection": LOOP,
    "GET /api/log": ROWS,
    "PUT /api/log/{id}/remark": ROWS,
    "GET /api/flights": ROWS,
    "GET /api/flights/{id}/data.{format}": DOWNLOAD,
    "POST /api/flights/{id}/replay": ROWS,
    "GET /api/formulas": ROWS,
    "PUT /api/formulas/{name}": ROWS,
    "DELETE /api/formulas/{name}": ROWS,
    "GET /api/tuning": AT_HAND,
    "PUT /api/tuning": FORMULAS,
    "POST /api/tuning/undo": FORMULAS,
    "POST /api/tuning/redo": FORMULAS,
    "POST /api/tuning/trial": FORMULAS,
    "DELETE /api/tuning/trial": LOOP,
    "POST /api/tuning/trial/keep": ROWS,
    "GET /api/tuning/saved": FORMULAS,
    "PUT /api/tuning/saved": ROWS,
    "GET /api/tuning/preview": PREVIEW,
    "GET /api/tuning/motor": PREVIEW,
    "GET /api/tuning/robust": PREVIEW,
    "POST /api/identifications": ORDERED_TEXT,
    "GET /api/identifications": ROWS,
    "PUT /api/identifications/pause": AT_HAND,
    "POST /api/identifications/prediction": PREVIEW,
    "GET /api/identification-kinds": AT_HAND,
    "GET /api/identifications/{id}": ROWS,
    "GET /api/identifications/{id}/curves": ROWS,
    "GET /api/identifications/{id}/unseen": MODELS,
    "GET /api/identification-trend": MODELS,
    "GET /api/spring-tables": ROWS,
    "POST /api/spring-tables": TEXT,
    "GET /api/spring-tables/{id}": ROWS,
    "GET /api/spring-tables/{id}/curves": ROWS,
    "GET /api/parameters": ROWS,
    "POST /api/parameters": FORMULAS,
    "POST /api/parameters/undo": FORMULAS,
    "GET /api/banks": ROWS,
    "POST /api/banks": FORMULAS,
    "POST /api/banks/file": FORMULAS,
    "GET /api/banks/in-use/difference": MODELS,
    "GET /api/banks/{id}": ROWS,
    "GET /api/banks/{id}/detail": MODELS,
    "GET /api/banks/{id}/difference": MODELS,
    "GET /api/banks/{id}/file": ROWS,
    "POST /api/banks/geometry/activate": FORMULAS,
    "POST /api/banks/{id}/activate": FORMULAS,
    "GET /api/experiments/schema": AT_HAND,
    "GET /api/experiments/own": TEXT,
    "POST /api/experiments/own": TEXT,
    "POST /api/experiments/check": TEXT,
    "GET /api/experiments/texts/{name}": TEXT,
    "GET /api/experiments/own/{name}/versions": TEXT,
    "GET /api/experiments/as-run/{run_id}": TEXT,
    "GET /api/experiments": TEXT,
    "POST /api/experiments": ORDERED_TEXT,
    "GET /api/experiments/dry-run/progress": AT_HAND,
    "POST /api/experiments/dry-run": DRY_RUN,
    "GET /api/experiments/queue": AT_HAND,
    "POST /api/experiments/queue": ORDERED_TEXT,
    "POST /api/experiments/queue/run": ORDERED_TEXT,
    "POST /api/experiments/queue/hold": AT_HAND,
    "PUT /api/experiments/queue/{id}/place": AT_HAND,
    "DELETE /api/experiments/queue/{id}": AT_HAND,
    "GET /api/experiments/{id}": ROWS,
    "GET /api/run-words": ROWS,
    "GET /api/saved-searches": ROWS,
    "PUT /api/saved-searches/{name}": ROWS,
    "DELETE /api/saved-searches/{name}": ROWS,
    "PATCH /api/run-tags/{tag}": ROWS,
    "GET /api/run-comparison": ROWS,
    "GET /api/run-comparison/differences": LONG_RECORDING,
    "GET /api/run-comparison/{content}.csv": DOWNLOAD,
    "GET /api/run-comparison/report.{format}": REPORT,
    "GET /api/metric-history": ROWS,
    "GET /api/runs": ROWS,
    "GET /api/runs/foxglove-layout.json": AT_HAND,
    "GET /api/runs/{id}": ROWS,
    "PATCH /api/runs/{id}": ROWS,
    "POST /api/runs/{id}/tags": ROWS,
    "DELETE /api/runs/{id}/tags/{tag}": ROWS,
    "POST /api/runs/{id}/evaluation": EVALUATION,
    "GET /api/runs/{id}/lineage": ROWS,
    "GET /api/runs/{id}/marks": ROWS,
    "GET /api/runs/{id}/planned": TEXT,
    "POST /api/runs/{id}/replay": ROWS,
    "GET /api/runs/{id}/samples": LONG_RECORDING,
    "GET /api/runs/{id}/samples.bin": LONG_RECORDING,
    "GET /api/runs/{id}/statistics": RANGE,
    "GET /api/runs/{id}/spectra": RANGE,
    "GET /api/runs/{id}/range.csv": RANGE,
    "GET /api/runs/{id}/values": ROWS,
    "GET /api/runs/{id}/report.html": REPORT,
    "GET /api/runs/{id}/report.pdf": REPORT,
    "GET /api/runs/{id}/data.{format}": DOWNLOAD,
    "GET /api/runs/{id}/bundle.zip": DOWNLOAD,
    "POST /api/chart-sheet.pdf": SHEET,
    "GET /api/studies": ROWS,
    "POST /api/studies/check": TEXT,
    "GET /api/studies/numbers": AT_HAND,
    "POST /api/studies": ORDERED_TEXT,
    "GET /api/studies/{id}": REPORT,
    "POST /api/studies/{id}/stop": ROWS,
    "POST /api/studies/{id}/resume": STUDY,
    "GET /api/system": AT_HAND,
    "POST /api/system/check": DATABASE,
    "POST /api/system/backups": DATABASE,
    "GET /api/system/recordings": ROWS,
    "POST /api/system/recordings/removal": DATABASE,
}
"""By method and path, as the description of the interface has them."""
