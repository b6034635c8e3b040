"""Who begins when many ask at once: STOP, then one of operators and one of the others in each round."""

import asyncio

from starlette.types import Receive, Scope, Send

from backend.api.export import build_openapi_schema
from backend.auth.authentication import BEARER, User
from backend.schemas.session import Role
from backend.server.connections import CONNECTION_SLOT, PASSES_BY, ConnectionSlot, RequestSchedulingMiddleware

CROWD = 20


def asked(path: str, role: Role | None = None) -> Scope:
    slot = ConnectionSlot("127.0.0.1", lambda: None)
    slot.holder = User(role, role, BEARER) if role else None
    return {"type": "http", "path": path, "state": {CONNECTION_SLOT: slot}}


class Answers:
    """Notes which request began in which round of the event loop."""

    def __init__(self) -> None:
        self.begun: dict[str, int] = {}
        self.round = 0
        self.pace = RequestSchedulingMiddleware(self._answer)

    async def to_all(self, *scopes: Scope) -> None:
        """Be asked by all in one round; return when all are over."""
        asking = [asyncio.create_task(self.ask(scope)) for scope in scopes]
        while not all(task.done() for task in asking):
            self.round += 1
            await asyncio.sleep(0)

    async def ask(self, scope: Scope) -> None:
        await self.pace(scope, self._nothing, self._nowhere)

    async def _answer(self, scope: Scope, _receive: Receive, _send: Send) -> None:
        self.begun[scope["path"]] = self.round

    async def _nothing(self) -> dict[str, object]:
        return {}

    async def _nowhere(self, _message: object) -> None:
        return None


def test_what_passes_by_is_the_service_s_stop() -> None:
    assert "post" in build_openapi_schema()["paths"][PASSES_BY]


def test_stop_begins_at_once_whoever_waits() -> None:
    answers = Answers()
    crowd = [asked(f"/{n}", Role.VIEWER) for n in range(CROWD)]
    asyncio.run(answers.to_all(*crowd, asked(PASSES_BY, Role.VIEWER)))
    assert answers.begun[PASSES_BY] == answers.begun["/0"]
    rounds = [answers.begun[f"/{n}"] for n in range(CROWD)]
    assert rounds == sorted(set(rounds))  # one a round, in the order of their coming


def test_an_operator_does_not_wait_for_viewers_nor_for_strangers() -> None:
    answers = Answers()
    crowd = [asked(f"/{n}", Role.VIEWER if n % 2 else None) for n in range(CROWD)]
    asyncio.run(answers.to_all(*crowd, asked("/mode", Role.OPERATOR), asked("/reset", Role.OPERATOR)))
    assert answers.begun["/mode"] <= answers.begun["/1"]
    assert answers.begun["/mode"] < answers.begun["/reset"] <= answers.begun["/2"]


def test_one_who_leaves_while_waiting_holds_up_nobody() -> None:
    async def leaves(answers: Answers) -> None:
        asking = asyncio.create_task(answers.to_all(*(asked(f"/{n}") for n in range(CROWD))))
        await asyncio.sleep(0)
        leaving = asyncio.create_task(answers.ask(asked("/gone")))
        await asyncio.sleep(0)
        leaving.cancel()
        last = asyncio.create_task(answers.to_all(asked("/last")))
        await asyncio.gather(asking, last)

    answers = Answers()
    asyncio.run(leaves(answers))
    assert "/gone" not in answers.begun
    assert "/last" in answers.begun


def test_who_comes_alone_does_not_wait() -> None:
    answers = Answers()
    asyncio.run(answers.to_all(asked("/alone")))
    assert answers.begun == {"/alone": 1}
