"""The service that works on a data folder, asked over HTTP by a command: with the operator's token of that folder."""

import http.client
import json
from dataclasses import dataclass
from typing import Any, TypeVar
from urllib.parse import urlsplit

from pydantic import BaseModel, ValidationError

from backend.cli.output import fail
from backend.settings import Settings

_PATIENCE_S = 30.0
_Answer = TypeVar("_Answer", bound=BaseModel)


@dataclass(frozen=True)
class RunningService:
    """``address`` is where it answers; ``token`` is empty where it asks for none."""

    address: str
    token: str

    def ask(self, method: str, path: str, body: Any, answer: type[_Answer]) -> _Answer:
        """Return what a request below ``/api`` is answered with; a refusal ends the command with its words."""
        headers = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        content = None if body is None else json.dumps(body).encode()
        if content is not None:
            headers["Content-Type"] = "application/json"
        where = urlsplit(self.address)
        connection = http.client.HTTPConnection(where.hostname or "", where.port, timeout=_PATIENCE_S)
        try:
            connection.request(method, f"{where.path}/api{path}", content, headers)
            said = connection.getresponse()
            text = said.read()
        except (OSError, http.client.HTTPException) as error:
            fail(f"the service at {self.address} does not answer: {error or type(error).__name__}")
        finally:
            connection.close()
        return self._read(said.status, text, answer)

    def _read(self, status: int, text: bytes, answer: type[_Answer]) -> _Answer:
        """Return what an answer says; one that refuses, or is none of Sinew's, ends the command."""
        from backend.schemas.base import Refusal

        try:
            if status < http.client.BAD_REQUEST:
                return answer.model_validate_json(text)
            refused = Refusal.model_validate_json(text).error.message
        except ValidationError:
            fail(
                f"what answers at {self.address} is no Sinew: status {status}, {text[:80]!a}; look what works "
                "there, and start `sinew serve` again"
            )
        fail(refused)


def running_service(settings: Settings) -> RunningService:
    """Return the service of a data folder; without one the command ends."""
    from backend.auth.sessions import load_tokens
    from backend.data_folder import address_of_service, why_no_address

    address = address_of_service(settings.data)
    if address is None:
        fail(why_no_address(settings.data))
    return RunningService(address, load_tokens(settings.data).operator if settings.require_token else "")
