"""Reasons of verdicts in tests, by code and values instead of text."""

from collections.abc import Mapping

from backend.identification.models import Verdict
from plant import Message


def list_reasons(verdict: Verdict) -> list[Message]:
    """Return the reasons of a verdict, those of a channel without its name."""
    inner = [(reason, reason.values.get("reason")) for reason in verdict.reasons]
    return [within if isinstance(within, Message) else reason for reason, within in inner]


def list_codes(verdict: Verdict) -> list[str]:
    """Return the codes of the reasons of a verdict."""
    return [reason.code for reason in list_reasons(verdict)]


def find_reason(verdict: Verdict, code: str) -> Mapping[str, object]:
    """Return the values of the first reason with this code; the verdict must have one."""
    found = [reason.values for reason in list_reasons(verdict) if reason.code == code]
    assert found, verdict
    return found[0]
