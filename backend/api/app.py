"""The FastAPI application: routes, error handlers, documentation."""

from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any

from fastapi import APIRouter, FastAPI
from fastapi.routing import APIRoute
from starlette.types import ASGIApp

from backend import __version__
from backend.api import errors
from backend.api.dependencies import load_angle_unit
from backend.api.middleware import AuthenticationMiddleware, log_rejected_command
from backend.api.routers import actuator, experiments, identifications, runs, session, system, tuning
from backend.public_url import PublicUrl
from backend.server import HostOriginMiddleware, RequestSchedulingMiddleware, SessionExpiryMiddleware

DESCRIPTION = (
    "Identify, tune and run an antagonistic variable stiffness actuator. Values are in SI units unless a field states "
    "another unit; signals are named as in the notation. Send `Authorization: Bearer TOKEN`, or sign in with the link "
    "that the service prints. The websocket `/api/live` streams live samples."
)

Lifespan = Callable[[FastAPI], AbstractAsyncContextManager[None]]


@asynccontextmanager
async def _run_without_lifespan(_app: FastAPI) -> AsyncIterator[None]:
    yield


class _Application(FastAPI):
    """Applies the host and origin check to every response, error responses included."""

    def __init__(self, allowed_hosts: tuple[str, ...], public: PublicUrl | None, **settings: Any) -> None:
        super().__init__(**settings)
        self._allowed_hosts = allowed_hosts
        self._public = public

    def build_middleware_stack(self) -> ASGIApp:
        """Return the middleware stack, with the host and origin check outermost."""
        return HostOriginMiddleware(super().build_middleware_stack(), self._allowed_hosts, self._public)


def create_app(
    lifespan: Lifespan = _run_without_lifespan,
    further_routes: Iterable[APIRouter] = (),
    allowed_hosts: Iterable[str] = (),
    public: PublicUrl | None = None,
) -> FastAPI:
    """Build the application.

    ``lifespan`` sets authentication and service in ``app.state``. ``further_routes`` come before the static files.
    """
    app = _Application(
        tuple(allowed_hosts),
        public,
        title="Sinew",
        version=__version__,
        description=DESCRIPTION,
        openapi_url=None,  # served at /api/openapi.json to signed-in users
        lifespan=lifespan,
        generate_unique_id_function=_operation_id,
        separate_input_output_schemas=False,
    )
    for router in (
        session.session_router,
        session.preferences_router,
        actuator.control_router,
        actuator.operate_router,
        actuator.player_router,
        system.bring_up_router,
        actuator.faults_router,
        runs.log_router,
        tuning.tuning_router,
        identifications.router,
        tuning.banks_router,
        experiments.own_experiments_router,  # its fixed paths take precedence over the numbers of runs
        experiments.experiments_router,
        runs.run_library_router,
        runs.formulas_router,
        runs.runs_router,
        runs.run_figures_router,
        runs.sheets_router,
        experiments.studies_router,
        system.system_router,
    ):
        app.include_router(router, responses=errors.RESPONSES)
    for router in (system.stream_router, *further_routes, system.site_router):
        app.include_router(router)
    system.mount_static(app)
    errors.install_handlers(app, load_angle_unit, log_rejected_command)
    app.add_middleware(RequestSchedulingMiddleware)
    app.add_middleware(SessionExpiryMiddleware)
    app.add_middleware(AuthenticationMiddleware)
    return app


def _operation_id(route: APIRoute) -> str:
    return route.name
