"""What is refused of exports and imports."""


class ExportError(ValueError):
    """It cannot be exported; the message says why, and what to do instead."""


class ImportRefusedError(ValueError):
    """A file is not taken in, and nothing of it; the message says which part of it is wrong."""
