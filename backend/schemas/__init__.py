"""Requests and responses by subject: pydantic models that know no HTTP."""
