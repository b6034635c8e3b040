"""Glossary of the page: meaning, equation and source of each term.

Terms are symbols, parameters, metrics, verdicts, faults and limits. Most texts are defined elsewhere: signals and
quantities in ``docs/reference/notation.md``, faults and limits in ``docs/reference/faults.md`` and
``backend/faults.py``, metrics in the classes that declare them, timing in ``TimingView``. ``glossary.py`` itself
defines only the texts of verdicts and states. The page gets the glossary as ``glossary.gen.ts``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
