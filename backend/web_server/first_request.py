"""The request that an application gets before anybody asks."""

from starlette.types import ASGIApp


async def put_routes_together(app: ASGIApp) -> None:
    """Send the application its first request: FastAPI prepares its routes only then, for a third of a second."""
    request = {
        "type": "http",
        "method": "GET",
        "path": "/api/docs",
        "query_string": b"",
        "headers": [(b"host", b"localhost")],
    }

    async def receive() -> dict[str, object]:
        return {"type": "http.request", "body": b""}

    async def send(_message: object) -> None:
        return None

    await app(request, receive, send)
