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

from backend.errors import RequestRejectedError
from backend.schemas import (
    ErrorDetail,
    ErrorResponse,
    build_error_detail,
    build_request_error,
    limit_rejected_value,
    replace_invalid_text,
)
from backend.server import is_page_request, missing_page_message, render_message_page
from backend.units import AngleUnit
from plant import ErrorCode, SinewError

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

    @app.exception_handler(SinewError)
    async def refused(request: Request, error: SinewError) -> JSONResponse:
        if error.category is None:
            return await unexpected(request, error)
        return await answer(request, STATUS[error.category], partial(build_error_detail, error), _headers(error))

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        return await answer(request, 422, partial(_form_problem, request, error.errors()[0]))

    @app.exception_handler(HTTPException)
    async def http(request: Request, error: HTTPException) -> Response:
        path = request.url.path
        if (
            error.status_code == 404
            and not path.startswith("/api/")
            and is_page_request(request.headers, request.method)
        ):
            return render_message_page(404, missing_page_message(path))
        problem = ErrorDetail(code=_CODES.get(error.status_code, "error"), message=str(error.detail))
        return _answer(error.status_code, problem, error.headers)

    @app.exception_handler(Exception)
    async def unexpected(request: Request, error: Exception) -> JSONResponse:
        _log.error("An unexpected error ended %s %s.", request.method, request.url.path, exc_info=error)
        return _answer(
            500, ErrorDetail(code="internal_error", message="the service failed on this request; see its log")
        )


def answer_to(error: RequestRejectedError) -> JSONResponse:
    """Return the answer that a refusal is."""
    return _answer(STATUS[error.category], build_error_detail(error), _headers(error))


def _headers(error: SinewError) -> dict[str, str]:
    retry_after_s = getattr(error, "retry_after_s", 0)
    return {"Retry-After": str(retry_after_s)} if retry_after_s else {}


def _form_problem(request: Request, error: Mapping[str, Any], angles: AngleUnit) -> ErrorDetail:
    wanted = getattr(request.scope.get("route"), "body_field", None) if error["loc"][:1] == ("body",) else None
    problem = build_request_error(error, None if wanted is None else wanted.field_info.annotation, angles)
    return problem.model_copy(update={"value": limit_rejected_value(problem.value)})


def _answer(status: int, problem: ErrorDetail, headers: Mapping[str, str] | None = None) -> JSONResponse:
    body = replace_invalid_text(ErrorResponse(error=problem).model_dump(exclude_none=True))
    return JSONResponse(body, status_code=status, headers=dict(headers or {}))
