"""Versioned documents that the database stores as JSON, as dataclasses. Pure."""
