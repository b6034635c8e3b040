"""One glossary: every symbol, parameter, figure, verdict, fault and limit with its meaning, equation and source.

Nothing is defined here that has its words elsewhere: signals and quantities come from ``docs/reference/notation.md``,
faults and limits from ``docs/reference/faults.md`` and ``backend/faults.py``, figures from their declarations beside
what computes them, what the loop's timing says from the message that carries it. ``glossary.py`` itself defines only
the words for verdicts and modes. The page gets all of it as ``glossary.gen.ts``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
