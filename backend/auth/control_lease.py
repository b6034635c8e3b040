"""The control lease, and the order in which commands are executed."""

import asyncio
import re
import secrets
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import NamedTuple

from backend.auth import messages
from backend.auth.authentication import BEARER, OPEN, User
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.schemas import HolderView, Lease
from backend.supervision import Part
from plant import ErrorCode, InvariantError

# Command sequence ----------------------------------------------------------------------------------
# Executes the commands of one page once each, in the order in which the page sent them.
#
# A browser sends over several connections, so that a command can arrive before its predecessor. It
# waits for the predecessor to arrive (GAP_S) and to be answered (BUSY_S). A command that arrives
# after a later one was executed is refused, because it is outdated.


GAP_S = 0.3
"""Time [s] that a command waits for a predecessor that has not arrived."""

BUSY_S = 1.0
"""Time [s] that a command waits for the answer to its predecessor."""

WAITING = 32
"""Commands of one page that may wait."""

_WAIT_S = 0.05


class CommandSequencer:
    """Puts the commands of one page, which numbers them 1, 2, 3 …, into order."""

    def __init__(self) -> None:
        self._last_executed = 0
        self._busy_since: float | None = None
        self._waiting: set[int] = set()
        self._changed = asyncio.Condition()

    @asynccontextmanager
    async def turn(self, number: int) -> AsyncIterator[None]:
        """Wait for the turn of a command, and hold back its successors for the block.

        Raises RequestRejectedError for an outdated command and if too many wait.
        """
        if number <= self._last_executed or number in self._waiting:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.command_out_of_order(), code="stale_command")
        if len(self._waiting) >= WAITING:
            raise RequestRejectedError(
                ErrorCode.TOO_MANY,
                messages.too_many_commands(maximum=WAITING),
                code="too_many_commands",
            )
        self._waiting.add(number)
        try:
            await self._wait(number)
        finally:
            self._waiting.discard(number)
        if number <= self._last_executed:
            raise InvariantError(f"command {number} became due after command {self._last_executed}")
        self._last_executed = number
        self._busy_since = started = _now_s()
        try:
            yield
        finally:
            if self._busy_since == started:  # else a successor has stopped waiting for this command
                self._busy_since = None
            async with self._changed:
                self._changed.notify_all()

    async def _wait(self, number: int) -> None:
        arrived_s = _now_s()
        async with self._changed:
            while not self._is_next(number, arrived_s):
                with suppress(TimeoutError):
                    async with asyncio.timeout(_WAIT_S):
                        await self._changed.wait()

    def _is_next(self, number: int, arrived_s: float) -> bool:
        now_s = _now_s()
        if number != min(self._waiting):
            return False
        if self._busy_since is not None and now_s - self._busy_since < BUSY_S:
            return False
        return number == self._last_executed + 1 or now_s - arrived_s >= GAP_S


def _now_s() -> float:
    return asyncio.get_running_loop().time()


# Control lease -------------------------------------------------------------------------------------
# One named user at one page has control until another user takes it over, or it is given up or
# lost.
#
# A page that takes control gets a key and keeps it in its own memory, so that a copy of the page
# does not have it. Each command carries a command token "key.sequence". A command with another key
# comes from a page that has lost control, and one with a used sequence number is a repetition: both
# are refused. The others are executed in order (CommandSequencer). A page that is reloaded presents
# its key and gets a new one. Scripts, which send the bearer token, need no command token while no
# other user has control. STOP does not depend on the lease.


CONTROL_HEADER = "Sinew-Control"
"""HTTP header that carries the command token."""

CONTROL_LEASE_PART = Part(
    "The monitor of lost pages", "Any motion was stopped softly: check the service's log, take control, then reset."
)

LOST_S = 2.0
"""Time [s] without a ping after which a page is lost; it pings every second."""

HOLD_S = 2.0
"""Time [s] that the references are held for a lost page to return, before the soft stop."""

SCRIPT_S = 10.0
"""Time [s] without a command after which a script loses control; nothing is stopped then."""

POLL_S = 0.1
_MAX_POLL_S = 2.0 * POLL_S
_COMMAND_TOKEN = re.compile(r"([A-Za-z0-9_-]{16})\.([0-9]{1,15})")


class CommandToken(NamedTuple):
    """Key of the page and sequence number that a command of a page carries."""

    page_key: str
    sequence: int


@dataclass
class LeaseHolder:
    """The user who has control, at a page or with a script."""

    user: User
    epoch: int
    """Number of the lease, by which other pages know it."""

    is_page: bool
    page_key: str = field(default_factory=lambda: secrets.token_urlsafe(12))
    sequencer: CommandSequencer = field(default_factory=CommandSequencer)
    silent_s: float = 0.0
    """Time since the last ping of the page, or the last command of the script [s]."""

    @property
    def is_lost(self) -> bool:
        """Whether the page has sent no ping for LOST_S."""
        return self.is_page and not self.silent_s <= LOST_S

    def is_at(self, user: User, page_key: str | None) -> bool:
        """Return whether a page of ``user`` with this key is the page that has control."""
        if page_key is None or not self.is_page or user.session != self.user.session:
            return False
        return secrets.compare_digest(page_key.encode(), self.page_key.encode())

    def build_lease(self) -> Lease:
        """Return the lease as it is sent to the page that has it."""
        return Lease(epoch=self.epoch, page=self.page_key, name=self.user.name)


def parse_command_token(text: str | None) -> CommandToken | None:
    """Parse the value of CONTROL_HEADER, None without header.

    Raises RequestRejectedError.
    """
    if text is None:
        return None
    match = _COMMAND_TOKEN.fullmatch(text)
    if match is None:
        raise RequestRejectedError(
            ErrorCode.MALFORMED,
            messages.invalid_command_token(header=CONTROL_HEADER),
            code="bad_stamp",
        )
    return CommandToken(match[1], int(match[2]))


@dataclass(frozen=True)
class ControlReleased:
    """Event: the holder has lost control or is lost; manual inputs must end."""


@dataclass(frozen=True)
class HolderChanged:
    """Event: control was given up, lost, or taken by another user.

    Not the reload of a page.
    """


class ControlLease:
    """The lease of one service. Publishes ControlReleased and HolderChanged."""

    def __init__(
        self,
        events: EventBus,
        on_lost: Callable[[str], Awaitable[None]],
        on_change: Callable[[str, str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Call ``on_lost`` with the name of a lost holder after LOST_S + HOLD_S.

        ``on_change`` gets a text for the event log and the name of the user who caused the change.
        """
        self.holder: LeaseHolder | None = None
        self._last_session = ""
        self._events = events
        self._on_lost = on_lost
        self._on_change = on_change
        self._clock = clock
        self._checked_at = clock()
        # Epochs start with the time, so that the lease of a page from before a restart of the service is not valid.
        self._epoch = int(time.time())
        self._is_ignoring_pings = False

    def take(self, user: User, *, is_page: bool, take_over: bool = False, handed: str = "") -> LeaseHolder:
        """Give control to a user.

        Raises RequestRejectedError while another holder has it, unless ``take_over``. ``handed`` replaces the text for
        the event log if control was handed over.
        """
        holder = self.holder
        if holder is not None and not take_over and not holder.is_lost:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                messages.control_held(holder=_describe_holder(holder, user)),
                code="control_held",
            )
        self._epoch += 1
        self._is_ignoring_pings = False
        self._events.publish(ControlReleased())
        if user.session != self._last_session:
            self._events.publish(HolderChanged())
        self._last_session = user.session
        self.holder = LeaseHolder(user, self._epoch, is_page)
        if is_page:
            taken = "control taken" if holder is None else f"control taken over from {holder.user.name}"
            self._on_change(handed or taken, user.name)
        return self.holder

    def resume(self, user: User, page_key: str) -> LeaseHolder:
        """Return control to a reloaded page, with a new key.

        Raises RequestRejectedError if it has lost control.
        """
        self._require_holder(user, page_key)
        self._epoch += 1
        self._events.publish(ControlReleased())
        # Commands from before the reload that still wait carry the old key, and are refused.
        self.holder = LeaseHolder(user, self._epoch, is_page=True)
        return self.holder

    async def give_up(self, user: User, command_token: CommandToken | None) -> None:
        """Give up control. Raises RequestRejectedError for a user who does not have it."""
        async with self.turn(user, command_token):
            self.holder = None
            self._events.publish(ControlReleased())
            self._events.publish(HolderChanged())
            self._on_change("control given up", user.name)

    @asynccontextmanager
    async def turn(self, user: User, command_token: CommandToken | None) -> AsyncIterator[None]:
        """Execute a command of the holder in its turn.

        Raises RequestRejectedError for other users and pages.
        """
        if command_token is None:
            self._require_script(user)
            yield
            return
        sequencer = self._require_holder(user, command_token.page_key).sequencer
        async with sequencer.turn(command_token.sequence):
            # Another user may have taken over while this command waited.
            self._require_holder(user, command_token.page_key).silent_s = 0.0
            yield

    def record_ping(self, user: User, page_key: str | None) -> None:
        """Record a ping.

        ``page_key`` is the key of the lease that the page believes to have.
        """
        holder = self.holder
        if holder is not None and not self._is_ignoring_pings and holder.is_at(user, page_key):
            holder.silent_s = 0.0

    def rename(self, user: User) -> None:
        """Show the holder under a new name."""
        if self.holder is not None and self.holder.user.session == user.session:
            self.holder.user = user

    def view(self) -> HolderView | None:
        """Return the holder as the page shows it."""
        holder = self.holder
        if holder is None:
            return None
        return HolderView(
            name=holder.user.name,
            epoch=holder.epoch,
            page=holder.is_page,
            silent_s=holder.silent_s,
            lost=holder.is_lost,
        )

    def ignore_pings(self) -> None:
        """Ignore the pings of the holder, to simulate the loss of its page."""
        self._is_ignoring_pings = True

    async def run(self) -> None:
        """Check the holder regularly, until cancelled."""
        while True:
            await asyncio.sleep(POLL_S)
            await self.check()

    async def check(self) -> None:
        """Update the silence of the holder, and end control after too long a silence.

        Ends control and raises InvariantError if the lease is inconsistent: the supervision of this task then stops the
        motion softly and restarts the task.
        """
        now = self._clock()
        try:
            if not now >= self._checked_at:
                raise InvariantError(f"the clock of the control lease jumped from {self._checked_at} s to {now} s")
            self.require_consistent()
        except InvariantError:
            self._checked_at, self.holder = self._clock(), None
            self._events.publish(ControlReleased())
            self._events.publish(HolderChanged())
            raise
        # While this process was suspended, pings have queued in its sockets. The limit does not count that as silence.
        elapsed_s, self._checked_at = min(now - self._checked_at, _MAX_POLL_S), now
        holder = self.holder
        if holder is None:
            return
        was_lost = holder.is_lost
        holder.silent_s += elapsed_s
        if holder.is_lost and not was_lost:
            self._events.publish(ControlReleased())
            self._events.publish(HolderChanged())
        if holder.silent_s > (LOST_S + HOLD_S if holder.is_page else SCRIPT_S):
            self.holder = None
            self._events.publish(ControlReleased())
            if holder.is_page:
                await self._on_lost(holder.user.name)

    def require_consistent(self) -> None:
        """Raise InvariantError if holder and lease do not match.

        Also if the silence is out of range or NaN.
        """
        holder = self.holder
        if holder is None:
            return
        if holder.epoch != self._epoch:
            raise InvariantError(f"the holder of epoch {holder.epoch} does not match the lease of epoch {self._epoch}")
        if not 0.0 <= holder.silent_s <= LOST_S + HOLD_S + SCRIPT_S:
            raise InvariantError(f"the silence of the holder of control is out of range: {holder.silent_s} s")
        if holder.user.session != self._last_session:
            raise InvariantError("the session of the holder is not the one that took control")

    def _require_holder(self, user: User, page_key: str) -> LeaseHolder:
        self.require_consistent()
        holder = self.holder
        if holder is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.control_released(), code="control_lost")
        if not holder.is_at(user, page_key):
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                messages.control_taken_over(holder=_describe_holder(holder, user)),
                code="control_lost",
            )
        return holder

    def _require_script(self, user: User) -> None:
        """Accept a command of a script, which takes control if it is free.

        Raises RequestRejectedError.
        """
        holder = self.holder
        if user.session not in (BEARER, OPEN):
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                messages.command_without_token(header=CONTROL_HEADER),
                code="control_needed",
            )
        self.require_consistent()
        if holder is None:
            holder = self.take(user, is_page=False)
        if holder.is_page or holder.user != user:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                messages.control_held(holder=_describe_holder(holder, user)),
                code="control_held",
            )
        holder.silent_s = 0.0


def _describe_holder(holder: LeaseHolder, user: User) -> str:
    """Return how a message to ``user`` names the holder."""
    if holder.user.session == user.session:
        return "another of your pages" if holder.is_page else "one of your scripts"
    return holder.user.name
