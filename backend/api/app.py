"""The FastAPI application: routes, refusals, documentation."""

from fastapi import FastAPI
from fastapi.routing import APIRoute

from backend import __version__
from backend.api import errors
from backend.api.routes import experiments, identifications, operate, runs, session, tuning

DESCRIPTION = (
    "Identify, tune and run an antagonistic variable stiffness actuator. SI units; signals are spelled as in the "
    "notation. Send `Authorization: Bearer TOKEN`, or sign in with the link that the service prints. "
    "Live samples come over the websocket `/api/live`."
)


def create_app() -> FastAPI:
    """Build the application without starting anything; ``app.state`` receives the gate and the service."""
    app = FastAPI(
        title="Sinew",
        version=__version__,
        description=DESCRIPTION,
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
        generate_unique_id_function=_operation_id,
        separate_input_output_schemas=False,
    )
    for part in (session, operate, tuning, identifications, experiments, runs):
        app.include_router(part.router, responses=errors.RESPONSES)
    errors.install(app)
    return app


def _operation_id(route: APIRoute) -> str:
    return route.name
