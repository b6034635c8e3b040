"""Turns exceptions into the one error body of the interface."""

import logging
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection

from backend.analysis.evaluation import NotEvaluableError
from backend.analysis.identification import NotComparableError
from backend.banks.builder import BankError
from backend.errors import ErrorCode, OutOfRangeError, RequestRejectedError
from backend.execution.runner import NotReadyError
from backend.experiments.parser import ExperimentError
from backend.exports.base import ExportError
from backend.identification.records import DataFileError, IdentificationError
from backend.models.document import UnreadableDocumentError
from backend.models.settings import SettingError
from backend.realtime.ipc import ChannelError
from backend.realtime.program import LEGAL
from backend.realtime.supervisor import LoopExitedError
from backend.recording.reader import UnknownSignalError
from backend.recording.retention import NotRemovableError
from backend.schemas.base import (
    ErrorDetail,
    ErrorResponse,
    plain,
    printable,
    problem_of,
    problem_of_experiment,
    problem_of_form,
    problem_of_setting,
)
from backend.server.deployment import no_such_page
from backend.server.security import message_page, wants_page
from backend.storage.database import BackupError
from backend.storage.orm import StorageError, UnknownRecordError
from backend.tuning.gains import TuningError
from backend.units import AngleUnit, format_angles
from backend.workers import WorkerDiedError, WorkLimitError

_log = logging.getLogger(__name__)

STATUS = {
    ErrorCode.MALFORMED: 400,
    ErrorCode.NOT_SIGNED_IN: 401,
    ErrorCode.NOT_ALLOWED: 403,
    ErrorCode.UNKNOWN: 404,
    ErrorCode.NOT_NOW: 409,
    ErrorCode.TOO_LARGE: 413,
    ErrorCode.BAD_VALUE: 422,
    ErrorCode.TOO_MANY: 429,
    ErrorCode.UNAVAILABLE: 503,
}
"""What HTTP calls each reason."""

_CODES = {405: "method_not_allowed", 500: "internal_error"} | {status: str(why) for why, status in STATUS.items()}

RESPONSES: dict[int | str, dict[str, Any]] = {
    status: {"model": ErrorResponse, "description": description}
    for status, description in {
        400: "the body cannot be parsed",
        401: "not signed in",
        403: "the role, the host or the origin does not allow it",
        404: "no such thing",
        409: "not possible in the present state",
        411: "the length of the body is not told",
        413: "the body is too large",
        422: "a value is refused",
        429: "too many wrong tokens, or too much asked for at once",
        503: "the loop process does not answer",
    }.items()
}
"""The refusals that any route may answer with, for the documentation."""


_BECAUSE: dict[type[Exception], ErrorCode] = {
    UnknownRecordError: ErrorCode.UNKNOWN,
    BackupError: ErrorCode.UNAVAILABLE,
    BankError: ErrorCode.BAD_VALUE,
    IdentificationError: ErrorCode.BAD_VALUE,
    TuningError: ErrorCode.BAD_VALUE,
    UnknownSignalError: ErrorCode.BAD_VALUE,
    ChannelError: ErrorCode.BAD_VALUE,
    ExportError: ErrorCode.BAD_VALUE,
    NotComparableError: ErrorCode.BAD_VALUE,
    NotRemovableError: ErrorCode.NOT_NOW,
    LoopExitedError: ErrorCode.UNAVAILABLE,
    NotEvaluableError: ErrorCode.NOT_NOW,
    StorageError: ErrorCode.UNAVAILABLE,
    UnreadableDocumentError: ErrorCode.UNAVAILABLE,
    WorkerDiedError: ErrorCode.UNAVAILABLE,
}
"""Refusals of the parts below whose message says everything."""


Handler = Callable[[Request, Exception], Awaitable[JSONResponse]]
AnglesOf = Callable[[HTTPConnection], Awaitable[AngleUnit]]
"""Tells in which unit whoever asks reads angles."""
Told = Callable[[HTTPConnection, str], None]
"""Hears of each refusal: of which request, and why, with angles in SI."""


def install(app: FastAPI, angles_of: AnglesOf, told: Told = lambda _request, _reason: None) -> None:
    """Register the handlers on ``app``; ``angles_of`` is asked where a refusal speaks of an angle, all are ``told``."""

    async def answer(
        request: Request,
        status: int,
        problem: Callable[[AngleUnit], ErrorDetail],
        headers: Mapping[str, str] | None = None,
    ) -> JSONResponse:
        said, reason = problem(AngleUnit.DEGREES), problem(AngleUnit.RADIANS).message
        told(request, reason)
        if said.message != reason:
            said = problem(await angles_of(request))
        return _answer(status, said, headers)

    @app.exception_handler(RequestRejectedError)
    async def refused(request: Request, error: RequestRejectedError) -> JSONResponse:
        return await answer(
            request, STATUS[error.because], partial(_in_words, _problem_of_refusal(error)), _headers(error)
        )

    @app.exception_handler(OutOfRangeError)
    async def out_of_range(request: Request, error: OutOfRangeError) -> JSONResponse:
        return await answer(request, 422, partial(problem_of, error))

    @app.exception_handler(SettingError)
    async def setting_refused(request: Request, error: SettingError) -> JSONResponse:
        return await answer(request, 422, partial(problem_of_setting, error))

    @app.exception_handler(ExperimentError)
    async def experiment_refused(request: Request, error: ExperimentError) -> JSONResponse:
        return await answer(request, 422, partial(problem_of_experiment, error))

    @app.exception_handler(NotReadyError)
    async def not_ready(request: Request, error: NotReadyError) -> JSONResponse:
        told(request, str(error))
        return _answer(
            409, ErrorDetail(code="not_ready", message=str(error), legal=[str(m) for m in LEGAL[error.mode]])
        )

    @app.exception_handler(WorkLimitError)
    async def beyond_limit(request: Request, error: WorkLimitError) -> JSONResponse:
        told(request, str(error))
        return _answer(
            422,
            ErrorDetail(
                code="work_limit",
                message=str(error),
                quantity=error.quantity,
                maximum=error.bound,
                unit=error.unit,
            ),
        )

    @app.exception_handler(DataFileError)
    async def file_refused(request: Request, error: DataFileError) -> JSONResponse:
        field = {"--header": "header", "--decimal": "decimal"}.get(error.option or "", "table")
        problem = ErrorDetail(code=error.fault, message=str(error), quantity=field, path=[field], line=error.line)
        return await answer(request, 422, partial(_in_words, problem))

    for kind, because in _BECAUSE.items():
        app.add_exception_handler(kind, _plain_handler(answer, because))

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        return await answer(request, 422, partial(_form_problem, request, error.errors()[0]))

    @app.exception_handler(HTTPException)
    async def http(request: Request, error: HTTPException) -> Response:
        path = request.url.path
        if error.status_code == 404 and not path.startswith("/api/") and wants_page(request.headers, request.method):
            return message_page(404, no_such_page(path))
        problem = ErrorDetail(code=_CODES.get(error.status_code, "error"), message=str(error.detail))
        return _answer(error.status_code, problem, error.headers)

    @app.exception_handler(Exception)
    async def unexpected(request: Request, error: Exception) -> JSONResponse:
        _log.error("unexpected error in %s %s", request.method, request.url.path, exc_info=error)
        return _answer(
            500, ErrorDetail(code="internal_error", message="the service failed on this request; see its log")
        )


def answer_to(error: RequestRejectedError) -> JSONResponse:
    """Return the answer that a refusal is."""
    return _answer(STATUS[error.because], _problem_of_refusal(error), _headers(error))


def _problem_of_refusal(error: RequestRejectedError) -> ErrorDetail:
    return ErrorDetail(code=error.code, message=str(error), legal=error.legal)


def _headers(error: RequestRejectedError) -> dict[str, str]:
    return {"Retry-After": str(error.retry_after_s)} if error.retry_after_s else {}


def _plain_handler(answer: Callable[..., Awaitable[JSONResponse]], because: ErrorCode) -> Handler:
    async def handle(request: Request, error: Exception) -> JSONResponse:
        return await answer(request, STATUS[because], partial(_in_words, ErrorDetail(code=because, message=str(error))))

    return handle


def _in_words(problem: ErrorDetail, angles: AngleUnit) -> ErrorDetail:
    return problem.model_copy(update={"message": format_angles(problem.message, angles)})


def _form_problem(request: Request, error: Mapping[str, Any], angles: AngleUnit) -> ErrorDetail:
    wanted = getattr(request.scope.get("route"), "body_field", None) if error["loc"][:1] == ("body",) else None
    problem = problem_of_form(error, None if wanted is None else wanted.field_info.annotation, angles)
    return problem.model_copy(update={"value": plain(problem.value)})


def _answer(status: int, problem: ErrorDetail, headers: Mapping[str, str] | None = None) -> JSONResponse:
    body = printable(ErrorResponse(error=problem).model_dump(exclude_none=True))
    return JSONResponse(body, status_code=status, headers=dict(headers or {}))
