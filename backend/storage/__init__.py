"""Everything that outlives the process: runs and their samples, models, banks, results, events, settings.

The only package that speaks SQL. ``open_database`` gives a ``Database``; its ``session()`` is one writing transaction
and its ``reading()`` one snapshot; the functions of the modules here take that session first and speak plain
dataclasses::

    database = open_database(settings.data)
    with database.session() as session:
        run = runs.create(session, NewRun(kind=RunKind.TRACKING, ...))

Documents (``parameters``, ``settings``, ``model`` ...) are JSON: None stands for a number that is not there.
"""

from backend.storage.database import Database, Session, open_database, require_intact_database
from backend.storage.orm import DamagedError, GoneError, StorageError, UnfitError

__all__ = [
    "DamagedError",
    "Database",
    "GoneError",
    "Session",
    "StorageError",
    "UnfitError",
    "open_database",
    "require_intact_database",
]
