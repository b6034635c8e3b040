"""Everything that outlives the process: runs and their samples, models, banks, results, events, settings.

The only package that speaks SQL. ``open_database`` gives a ``Database``; its ``session()`` is one writing transaction
and its ``reading()`` one snapshot; the functions of the modules here take that session first and speak plain
dataclasses::

    database = open_database(settings.data)
    with database.session() as session:
        run = runs.create(session, NewRun(kind=RunKind.TRACKING, ...))

Documents (``parameters``, ``settings``, ``model`` ...) are JSON: None stands for a number that is not there.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
