"""What goes wrong with a database, by what can be done about it."""


class StorageError(Exception):
    """The database cannot be reached, read or written, or refuses what breaks its rules; the message is its own."""


class UnfitError(StorageError):
    """What was to be stored breaks the database's rules: trying again will not help."""


class GoneError(StorageError):
    """The database's file is not where it was: what is written now would be kept nowhere."""


class DamagedError(StorageError):
    """The database's file is not whole; the message names the way back."""
