"""Persistent data: runs, samples, models, banks, results, events, settings.

The only package with SQL. ``open_database`` returns a ``Database``; its ``session()`` is one writing transaction and
its ``reading()`` one snapshot; the functions of the modules here take that session as their first argument and return
plain dataclasses::

    database = open_database(settings.data)
    with database.session() as session:
        run = runs.create(session, NewRun(kind=RunKind.TRACKING, ...))

Documents (``parameters``, ``settings``, ``model`` ...) are JSON: None represents a missing number.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
