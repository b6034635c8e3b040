"""Cost of each route: where it computes and what limits it.

A test rejects routes without an entry. Requests whose cost depends on the input run in worker processes within limits,
so that no request delays STOP.
"""

from dataclasses import dataclass

from backend import workers
from backend.services import background_work, downloads, queue, signals
from backend.workers import WorkLimits

_UNLIMITED = WorkLimits()


@dataclass(frozen=True)
class Cost:
    """Place of a route's computation, its limits and the number at the same time."""

    where: str
    limits: WorkLimits = _UNLIMITED
    at_a_time: str = "one at a time"

    @property
    def is_computation(self) -> bool:
        """Whether the route computes more than reading, writing and forwarding."""
        return self not in (IN_MEMORY, DATABASE_ROWS, CONTROL_LOOP)


def _describe_limits(places: int, viewers: int, each: int) -> str:
    return f"{places} queued, {viewers} from viewers, {each} per person"


IN_MEMORY = Cost("the service, from memory", at_a_time="any")
DATABASE_ROWS = Cost("a thread of the service, single database rows", at_a_time="any")
CONTROL_LOOP = Cost("the control loop", at_a_time="any")
FORMULAS = Cost("a thread of the service, formulas of bounded size", at_a_time="any")
TEXT = Cost(
    "the worker process for texts: one for operators, one for viewers",
    workers.TEXT_LIMITS,
    _describe_limits(background_work.MAX_TEXTS, background_work.MAX_VIEWER_TEXTS, background_work.MAX_TEXTS_PER_USER),
)
PREVIEW = Cost(
    "the worker process for texts: one for operators, one for viewers",
    workers.TEXT_LIMITS,
    _describe_limits(
        background_work.MAX_PREVIEWS, background_work.MAX_VIEWER_PREVIEWS, background_work.MAX_PREVIEWS_PER_USER
    ),
)
ORDERED_TEXT = Cost("the worker process for operators' texts", workers.TEXT_LIMITS)
DRY_RUN = Cost(
    "the worker process for dry runs",
    workers.DRY_RUN_LIMITS,
    _describe_limits(queue.MAX_DRY_RUNS, queue.MAX_VIEWER_DRY_RUNS, each=1),
)
SHEET = Cost(
    "the worker process for chart sheets",
    workers.SHEET_LIMITS,
    _describe_limits(
        background_work.MAX_SHEETS, background_work.MAX_VIEWER_SHEETS, background_work.MAX_SHEETS_PER_USER
    ),
)
REPORT = Cost("the process for reports", workers.REPORT_LIMITS)
LONG_RECORDING = Cost("a thread; for long recordings the worker process for reports", workers.REPORT_LIMITS)
RANGE = Cost("threads of the service; for each long range or file one process", at_a_time=f"{signals.MAX_RANGES}")
EVALUATION = Cost("the worker process for evaluations of stored runs", workers.EVALUATION_LIMITS)
MODELS = Cost("the worker process for results and banks")
STUDY = Cost("the worker processes for studies")
DOWNLOAD = Cost("a process for each download", at_a_time=f"{downloads.MAX_DOWNLOADS}")
DATABASE = Cost("a thread of the service, the whole database")

COSTS: dict[str, Cost] = {
    "GET /api/health": IN_MEMORY,
    "GET /api/session": IN_MEMORY,
    "POST /api/session": IN_MEMORY,
    "DELETE /api/session": IN_MEMORY,
    "PUT /api/session/name": IN_MEMORY,
    "POST /api/page-address": IN_MEMORY,
    "POST /api/session/tokens/rotate": IN_MEMORY,
    "GET /api/checklist": DATABASE_ROWS,
    "GET /api/preferences": DATABASE_ROWS,
    "PUT /api/preferences": DATABASE_ROWS,
    "POST /api/control": IN_MEMORY,
    "DELETE /api/control": IN_MEMORY,
    "POST /api/control/wishes": IN_MEMORY,
    "POST /api/control/wishes/{id}": IN_MEMORY,
    "GET /api/state": IN_MEMORY,
    "POST /api/stop": CONTROL_LOOP,
    "POST /api/reset": CONTROL_LOOP,
    "POST /api/mode": CONTROL_LOOP,
    "PUT /api/references": CONTROL_LOOP,
    "POST /api/push": CONTROL_LOOP,
    "PUT /api/touch": CONTROL_LOOP,
    "PUT /api/wall": CONTROL_LOOP,
    "GET /api/player": IN_MEMORY,
    "PUT /api/player": CONTROL_LOOP,
    "PUT /api/trigger": DATABASE_ROWS,
    "DELETE /api/trigger": DATABASE_ROWS,
    "GET /api/bring-up": DATABASE_ROWS,
    "POST /api/bring-up/confirm": CONTROL_LOOP,
    "POST /api/bring-up/cancel": CONTROL_LOOP,
    "POST /api/bring-up/drives": CONTROL_LOOP,
    "POST /api/bring-up/{step}": CONTROL_LOOP,
    "GET /api/faults": IN_MEMORY,
    "POST /api/faults/injection": CONTROL_LOOP,
    "DELETE /api/faults/injection": CONTROL_LOOP,
    "GET /api/log": DATABASE_ROWS,
    "PUT /api/log/{id}/remark": DATABASE_ROWS,
    "GET /api/flights": DATABASE_ROWS,
    "GET /api/flights/{id}/data.{format}": DOWNLOAD,
    "POST /api/flights/{id}/replay": DATABASE_ROWS,
    "GET /api/formulas": DATABASE_ROWS,
    "PUT /api/formulas/{name}": DATABASE_ROWS,
    "DELETE /api/formulas/{name}": DATABASE_ROWS,
    "GET /api/tuning": IN_MEMORY,
    "PUT /api/tuning": FORMULAS,
    "POST /api/tuning/undo": FORMULAS,
    "POST /api/tuning/redo": FORMULAS,
    "POST /api/tuning/trial": FORMULAS,
    "DELETE /api/tuning/trial": CONTROL_LOOP,
    "POST /api/tuning/trial/keep": DATABASE_ROWS,
    "GET /api/tuning/saved": FORMULAS,
    "PUT /api/tuning/saved": DATABASE_ROWS,
    "GET /api/tuning/preview": PREVIEW,
    "GET /api/tuning/motor": PREVIEW,
    "GET /api/tuning/robust": PREVIEW,
    "POST /api/identifications": ORDERED_TEXT,
    "GET /api/identifications": DATABASE_ROWS,
    "PUT /api/identifications/pause": IN_MEMORY,
    "POST /api/identifications/prediction": PREVIEW,
    "GET /api/identification-kinds": IN_MEMORY,
    "GET /api/identifications/{id}": DATABASE_ROWS,
    "GET /api/identifications/{id}/curves": DATABASE_ROWS,
    "GET /api/identifications/{id}/unseen": MODELS,
    "GET /api/identification-trend": MODELS,
    "GET /api/spring-tables": DATABASE_ROWS,
    "POST /api/spring-tables": TEXT,
    "GET /api/spring-tables/{id}": DATABASE_ROWS,
    "GET /api/spring-tables/{id}/curves": DATABASE_ROWS,
    "GET /api/parameters": DATABASE_ROWS,
    "POST /api/parameters": FORMULAS,
    "POST /api/parameters/undo": FORMULAS,
    "GET /api/banks": DATABASE_ROWS,
    "POST /api/banks": FORMULAS,
    "POST /api/banks/file": FORMULAS,
    "GET /api/banks/in-use/difference": MODELS,
    "GET /api/banks/{id}": DATABASE_ROWS,
    "GET /api/banks/{id}/detail": MODELS,
    "GET /api/banks/{id}/difference": MODELS,
    "GET /api/banks/{id}/file": DATABASE_ROWS,
    "POST /api/banks/geometry/activate": FORMULAS,
    "POST /api/banks/{id}/activate": FORMULAS,
    "GET /api/experiments/schema": IN_MEMORY,
    "GET /api/experiments/own": TEXT,
    "POST /api/experiments/own": TEXT,
    "POST /api/experiments/check": TEXT,
    "GET /api/experiments/texts/{name}": TEXT,
    "GET /api/experiments/own/{name}/versions": TEXT,
    "GET /api/experiments/as-run/{run_id}": TEXT,
    "GET /api/experiments": TEXT,
    "POST /api/experiments": ORDERED_TEXT,
    "GET /api/experiments/dry-run/progress": IN_MEMORY,
    "POST /api/experiments/dry-run": DRY_RUN,
    "GET /api/experiments/queue": IN_MEMORY,
    "POST /api/experiments/queue": ORDERED_TEXT,
    "POST /api/experiments/queue/run": ORDERED_TEXT,
    "POST /api/experiments/queue/hold": IN_MEMORY,
    "PUT /api/experiments/queue/{id}/place": IN_MEMORY,
    "DELETE /api/experiments/queue/{id}": IN_MEMORY,
    "GET /api/experiments/{id}": DATABASE_ROWS,
    "GET /api/run-words": DATABASE_ROWS,
    "GET /api/saved-searches": DATABASE_ROWS,
    "PUT /api/saved-searches/{name}": DATABASE_ROWS,
    "DELETE /api/saved-searches/{name}": DATABASE_ROWS,
    "PATCH /api/run-tags/{tag}": DATABASE_ROWS,
    "GET /api/run-comparison": DATABASE_ROWS,
    "GET /api/run-comparison/differences": LONG_RECORDING,
    "GET /api/run-comparison/{content}.csv": DOWNLOAD,
    "GET /api/run-comparison/report.{format}": REPORT,
    "GET /api/metric-history": DATABASE_ROWS,
    "GET /api/runs": DATABASE_ROWS,
    "GET /api/runs/foxglove-layout.json": IN_MEMORY,
    "GET /api/runs/{id}": DATABASE_ROWS,
    "PATCH /api/runs/{id}": DATABASE_ROWS,
    "POST /api/runs/{id}/tags": DATABASE_ROWS,
    "DELETE /api/runs/{id}/tags/{tag}": DATABASE_ROWS,
    "POST /api/runs/{id}/evaluation": EVALUATION,
    "GET /api/runs/{id}/lineage": DATABASE_ROWS,
    "GET /api/runs/{id}/marks": DATABASE_ROWS,
    "GET /api/runs/{id}/planned": TEXT,
    "POST /api/runs/{id}/replay": DATABASE_ROWS,
    "GET /api/runs/{id}/samples": LONG_RECORDING,
    "GET /api/runs/{id}/samples.bin": LONG_RECORDING,
    "GET /api/runs/{id}/statistics": RANGE,
    "GET /api/runs/{id}/spectra": RANGE,
    "GET /api/runs/{id}/range.csv": RANGE,
    "GET /api/runs/{id}/values": DATABASE_ROWS,
    "GET /api/runs/{id}/report.html": REPORT,
    "GET /api/runs/{id}/report.pdf": REPORT,
    "GET /api/runs/{id}/data.{format}": DOWNLOAD,
    "GET /api/runs/{id}/bundle.zip": DOWNLOAD,
    "POST /api/chart-sheet.pdf": SHEET,
    "GET /api/studies": DATABASE_ROWS,
    "POST /api/studies/check": TEXT,
    "GET /api/studies/numbers": IN_MEMORY,
    "POST /api/studies": ORDERED_TEXT,
    "GET /api/studies/{id}": REPORT,
    "POST /api/studies/{id}/stop": DATABASE_ROWS,
    "POST /api/studies/{id}/resume": STUDY,
    "GET /api/system": IN_MEMORY,
    "POST /api/system/check": DATABASE,
    "POST /api/system/backups": DATABASE,
    "GET /api/system/recordings": DATABASE_ROWS,
    "POST /api/system/recordings/removal": DATABASE,
}
"""Cost by method and path, as in the OpenAPI schema."""
