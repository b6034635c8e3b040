"""The service that works on a data folder, asked over HTTP by a command: with the operator's token of that folder."""

import http.client
import json
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from backend.cli.output import fail
from backend.settings import Settings

_PATIENCE_S = 30.0


@dataclass(frozen=True)
class RunningService:
    """``address`` is where it answers; ``token`` is empty where it asks for none."""

    address: str
    token: str

    def get(self, path: str) -> Any:
        """Return what stands at a path below ``/api``; a refusal ends the command with its words."""
        return self._ask("GET", path, None)

    def post(self, path: str, body: Any = None) -> Any:
        """Send a command, as ``get`` does."""
        return self._ask("POST", path, body)

    def put(self, path: str, body: Any) -> Any:
        """Put something in its place, as ``get`` does."""
        return self._ask("PUT", path, body)

    def delete(self, path: str) -> Any:
        """Take something away, as ``get`` does."""
        return self._ask("DELETE", path, None)

    def _ask(self, method: str, path: str, body: Any) -> Any:
        headers = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        content = None if body is None else json.dumps(body).encode()
        if content is not None:
            headers["Content-Type"] = "application/json"
        where = urlsplit(self.address)
        connection = http.client.HTTPConnection(where.hostname or "", where.port, timeout=_PATIENCE_S)
        try:
            connection.request(method, f"{where.path}/api{path}", content, headers)
            answer = connection.getresponse()
            text = answer.read()
        except (OSError, http.client.HTTPException) as error:
            fail(f"the service at {self.address} does not answer: {error or type(error).__name__}")
        finally:
            connection.close()
        return self._read(answer.status, text)

    def _read(self, status: int, text: bytes) -> Any:
        """Return what an answer says; one that refuses, or is none of Sinew's, ends the command."""
        try:
            said: Any = json.loads(text) if text else None
            refused = str(said["error"]["message"]) if status >= http.client.BAD_REQUEST else ""
        except (ValueError, LookupError, TypeError):
            fail(
                f"what answers at {self.address} is no Sinew: status {status}, {text[:80]!a}; look what works "
                "there, and start `sinew serve` again"
            )
        if refused:
            fail(refused)
        return said


def running_service(settings: Settings) -> RunningService:
    """Return the service of a data folder; without one the command ends."""
    from backend.access.tokens import load_tokens
    from backend.data_folder import address_of_service

    address = address_of_service(settings.data)
    if address is None:
        fail(f"no service works on the folder {settings.data}: start it with `sinew serve`, or choose --data")
    return RunningService(address, load_tokens(settings.data).operator if settings.require_token else "")
