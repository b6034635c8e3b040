"""A page with one sentence, for whoever opens an address in a browser and gets no dashboard."""

import html

from fastapi.responses import HTMLResponse
from starlette.datastructures import Headers

DOCUMENT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; frame-ancestors 'self'"
"""Content-Security-Policy of documents without scripts."""

_STYLE = (
    ":root { color-scheme: light dark } body { font: 16px/1.5 system-ui, sans-serif; max-width: 44rem; "
    "margin: 12vh auto; padding: 0 16px; overflow-wrap: anywhere }"
)


def message_page(status: int, text: str) -> HTMLResponse:
    """Return a page that says ``text``."""
    content = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>Sinew</title><style>{_STYLE}</style><main><h1>Sinew</h1><p>{html.escape(text)}</p></main></html>"
    )
    return HTMLResponse(content, status_code=status, headers={"Content-Security-Policy": DOCUMENT_POLICY})


def wants_page(headers: Headers, method: str) -> bool:
    """Return whether a person opens the address, not a script: only then a browser asks for a page before all else."""
    return method == "GET" and headers.get("accept", "").startswith("text/html")
