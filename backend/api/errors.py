"""Converts exceptions into the error response of the interface."""

import logging
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection

from backend.api import messages
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

STATUS_BY_CODE = {
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
"""HTTP status of each category of errors."""

_CODES = {405: "method_not_allowed", 500: "internal_error"} | {
    status: str(why) for why, status in STATUS_BY_CODE.items()
}

RESPONSES: dict[int | str, dict[str, Any]] = {
    status: {"model": ErrorResponse, "description": description}
    for status, description in {
        400: "the body cannot be parsed",
        401: "not signed in",
        403: "the role, the host or the origin does not allow it",
        404: "the resource does not exist",
        409: "not possible in the current state",
        411: "the request does not state the length of its body",
        413: "the body is too large",
        422: "a value is not valid",
        429: "too many invalid tokens, or too many simultaneous requests",
        503: "the control loop or another part of the service is not available",
    }.items()
}
"""Errors that any route can return, for the documentation."""


AngleUnitLoader = Callable[[HTTPConnection], Awaitable[AngleUnit]]
"""Returns the unit in which the client of a request reads angles."""
RejectionListener = Callable[[HTTPConnection, str], None]
"""Called with each rejected request and its reason, with angles in SI."""


def install_handlers(
    app: FastAPI, load_angle_unit: AngleUnitLoader, on_rejection: RejectionListener = lambda _request, _reason: None
) -> None:
    """Register the exception handlers on ``app``.

    ``load_angle_unit`` is called only for messages with angles, ``on_rejection`` for each error.
    """

    async def answer(
        request: Request,
        status: int,
        build_detail: Callable[[AngleUnit], ErrorDetail],
        headers: Mapping[str, str] | None = None,
    ) -> JSONResponse:
        detail, reason = build_detail(AngleUnit.DEGREES), build_detail(AngleUnit.RADIANS).message
        on_rejection(request, reason)
        if detail.message != reason:
            detail = build_detail(await load_angle_unit(request))
        return _build_json_response(status, detail, headers)

    @app.exception_handler(SinewError)
    async def handle_sinew_error(request: Request, error: SinewError) -> JSONResponse:
        if error.category is None:
            return await handle_unexpected_error(request, error)
        return await answer(
            request, STATUS_BY_CODE[error.category], partial(build_error_detail, error), _headers(error)
        )

    @app.exception_handler(RequestValidationError)
    async def handle_validation_error(request: Request, error: RequestValidationError) -> JSONResponse:
        return await answer(request, 422, partial(_describe_form_error, request, error.errors()[0]))

    @app.exception_handler(HTTPException)
    async def handle_http_error(request: Request, error: HTTPException) -> Response:
        path = request.url.path
        if (
            error.status_code == 404
            and not path.startswith("/api/")
            and is_page_request(request.headers, request.method)
        ):
            return render_message_page(404, missing_page_message(path))
        problem = ErrorDetail(code=_CODES.get(error.status_code, "error"), message=str(error.detail))
        return _build_json_response(error.status_code, problem, error.headers)

    @app.exception_handler(Exception)
    async def handle_unexpected_error(request: Request, error: Exception) -> JSONResponse:
        _log.error("An unexpected error ended %s %s.", request.method, request.url.path, exc_info=error)
        return _build_json_response(500, ErrorDetail(code="internal_error", message=messages.request_failed()))


def build_response(error: RequestRejectedError) -> JSONResponse:
    """Return the HTTP response of a rejected request."""
    return _build_json_response(STATUS_BY_CODE[error.category], build_error_detail(error), _headers(error))


def _headers(error: SinewError) -> dict[str, str]:
    retry_after_s = getattr(error, "retry_after_s", 0)
    return {"Retry-After": str(retry_after_s)} if retry_after_s else {}


def _describe_form_error(request: Request, error: Mapping[str, Any], angles: AngleUnit) -> ErrorDetail:
    wanted = getattr(request.scope.get("route"), "body_field", None) if error["loc"][:1] == ("body",) else None
    problem = build_request_error(error, None if wanted is None else wanted.field_info.annotation, angles)
    return problem.model_copy(update={"value": limit_rejected_value(problem.value)})


def _build_json_response(status: int, problem: ErrorDetail, headers: Mapping[str, str] | None = None) -> JSONResponse:
    body = replace_invalid_text(ErrorResponse(error=problem).model_dump(exclude_none=True))
    return JSONResponse(body, status_code=status, headers=dict(headers or {}))
