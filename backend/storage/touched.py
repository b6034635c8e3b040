"""Which runs a transaction has changed something of that they are searched by; the index is renewed at its end."""

from sqlalchemy.orm import Session

_KEY = "sinew_touched_runs"


def touch(session: Session, *run_ids: int) -> None:
    """Have what these runs are searched by written anew before the transaction is committed."""
    session.info.setdefault(_KEY, set()).update(run_ids)


def take_touched(session: Session) -> list[int]:
    """Return the runs that were touched, in order, and begin anew."""
    return sorted(session.info.pop(_KEY, ()))
