"""Alembic migrations of the database, in order of their numbers."""
