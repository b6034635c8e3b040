"""Verdict on each entry of a two-channel model, and on the whole model."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from backend.identification import messages
from backend.identification.models import FirstOrder, Grade, Verdict, worst_grade
from backend.identification.records import RestAtLimit
from backend.identification.two_channel_models import EntryEstimate, RelativeGain
from backend.identification.validation import (
    CAUTION_MISFIT_PERCENT,
    CAUTION_STD_PERCENT,
    MAX_MISFIT_PERCENT,
    MAX_OTHER_STD_PERCENT,
    MAX_STD_PERCENT,
    MIN_COUNTS,
    NEGLIGIBLE_PERCENT,
    Finding,
    grade_fit,
    grade_value,
)
from plant import Message

SIGNIFICANT_STD = 3.0
"""Distance from zero, in standard errors, of a static gain that is used."""
MIN_RELATIVE_GAIN = 0.5
"""Relative gain below which the other pairing has less interaction (Bristol 1966)."""


@dataclass(frozen=True)
class EntryData:
    """Data of the verdict on one entry.

    - ``is_direct``: the entry of the paired input, 11 or 22; the others are couplings.
    - ``gain``, ``gain_std``, ``wald``, ``wald_bound``, ``is_zero``, ``first_order``, ``motion_percent``: as in
      :class:`EntryEstimate`; ``gain_std_percent`` [%]: motion that the standard error of the gain corresponds to,
      relative to that of the output.
    - ``relative_errors`` [%]: those of the denominator's parameters, by name.
    - ``fit``, ``misfit`` [%]: fit on validation data, and the part of the motion that neither model nor sensor explain;
      NaN if not available.
    - ``is_white``, ``is_independent``: results of the residual tests, of this input; ``rounding``: the residuals are no
      larger than rounding; ``has_known_sensor``: the resolution of the output is known.
    - ``counts``: peak-to-peak of the output in counts, None if unknown; ``wrap``: size of a turn of an angle that
      wraps; ``at_limit``: rest of the output at its extreme while this input moves.
    - ``is_fed_back``: the input reacts to noise of the output, and the loop's external signals are unknown.
    """

    input: str
    output: str
    is_direct: bool
    gain: float
    gain_std: float
    wald: float
    wald_bound: float
    first_order: FirstOrder | None
    motion_percent: float
    gain_std_percent: float
    relative_errors: dict[str, float]
    fit: float
    misfit: float
    is_white: bool
    is_independent: bool
    rounding: bool
    has_known_sensor: bool
    counts: float | None
    wrap: float | None
    at_limit: RestAtLimit | None
    is_fed_back: bool

    @property
    def is_zero(self) -> bool:
        """Whether the entry is not distinguishable from zero."""
        return self.wald <= self.wald_bound

    @property
    def is_unexplained(self) -> bool:
        """Whether the residuals indicate unmodelled effects larger than rounding."""
        return not (self.is_white and self.is_independent) and not self.is_negligible

    @property
    def is_negligible(self) -> bool:
        """Whether the residuals are only rounding."""
        return self.rounding or self.misfit <= NEGLIGIBLE_PERCENT


def judge_entry(entry: EntryData) -> Verdict:
    """Grade one entry and give the reasons. A value that is not available counts as bad."""
    findings = [*_signals(entry), *_fit(entry), *_gain(entry), *_denominator(entry), *_residuals(entry)]
    for grade in (Grade.UNUSABLE, Grade.CAUTION):
        if any(found is grade for found, _ in findings):
            ordered = sorted(findings, key=lambda finding: finding[0] is not Grade.UNUSABLE)
            reasons = [reason for _, reason in ordered]
            return Verdict(grade, (*reasons, _describe_zero(entry)) if _is_absent(entry) else tuple(reasons))
    if _is_absent(entry):
        return Verdict(Grade.USABLE, (_describe_zero(entry),))
    described = messages.entry_described(
        gain=entry.gain, gain_std=entry.gain_std, motion_percent=entry.motion_percent, output=entry.output
    )
    return Verdict(Grade.USABLE, (messages.fit_on_validation_data(fit_percent=entry.fit), described))


def _is_absent(entry: EntryData) -> bool:
    """Return whether the entry is a coupling that is not distinguishable from zero."""
    return entry.is_zero and not entry.is_direct


def _describe_zero(entry: EntryData) -> Message:
    return messages.entry_not_distinguishable_from_zero(
        input=entry.input,
        output=entry.output,
        gain=entry.gain,
        gain_std=entry.gain_std,
        statistic=entry.wald,
        bound=entry.wald_bound,
    )


def _signals(entry: EntryData) -> Iterator[Finding]:
    if entry.wrap is not None:
        yield Grade.UNUSABLE, messages.output_wraps(jump=entry.wrap)
    if entry.counts is not None and not entry.counts >= MIN_COUNTS:
        yield Grade.UNUSABLE, messages.too_little_motion(counts=entry.counts, minimum=MIN_COUNTS)
    rest = entry.at_limit
    if rest is not None and entry.is_direct and entry.is_unexplained:
        if rest.abrupt:
            yield (
                Grade.UNUSABLE,
                messages.output_stops_at_limit(limit=rest.limit, time_percent=rest.share_percent),
            )
        else:
            yield (
                Grade.CAUTION,
                messages.output_rests_at_limit(limit=rest.limit, moving_percent=rest.moving_percent),
            )
    if entry.is_fed_back and not entry.is_negligible:
        grade = grade_value(entry.misfit, 0.0, MAX_STD_PERCENT)
        yield (
            grade,
            messages.noise_fed_back_to_input(input=entry.input, output=entry.output, misfit_percent=entry.misfit),
        )


def _fit(entry: EntryData) -> Iterator[Finding]:
    yield from grade_fit(entry.fit, entry.misfit)


def _gain(entry: EntryData) -> Iterator[Finding]:
    """Grade the static gain: relative to itself for a direct entry, to the motion for a coupling."""
    if not entry.is_direct:
        # An error of a coupling matters as much as the motion of the output that it stands for.
        grade = grade_value(entry.gain_std_percent, CAUTION_STD_PERCENT, MAX_STD_PERCENT)
        if not np.isfinite(entry.gain_std_percent):
            yield grade, messages.parameter_undetermined(parameter="K")
        elif grade is not Grade.USABLE:
            yield grade, messages.coupling_uncertain(output=entry.output, std_percent=entry.gain_std_percent)
        return
    if entry.is_zero:
        yield Grade.UNUSABLE, _describe_zero(entry)
        return
    if entry.first_order is None:
        yield Grade.UNUSABLE, messages.parameter_undetermined(parameter="K")
        return
    found = entry.first_order
    for name, value, std in zip("KT", (found.K, found.T), found.deviations, strict=True):
        spread = 100.0 * std / abs(value)
        grade = grade_value(spread, CAUTION_STD_PERCENT, MAX_STD_PERCENT)
        if grade is not Grade.USABLE:
            if np.isfinite(spread):
                yield grade, messages.parameter_uncertain(parameter=name, std_percent=spread)
            else:
                yield grade, messages.parameter_undetermined(parameter=name)


def _denominator(entry: EntryData) -> Iterator[Finding]:
    """Grade the parameters of the denominator, which both inputs share, once per output."""
    if not entry.is_direct:
        return
    for name, spread in entry.relative_errors.items():
        grade = grade_value(spread, MAX_STD_PERCENT, MAX_OTHER_STD_PERCENT)
        if grade is not Grade.USABLE and name != "T":
            if np.isfinite(spread):
                yield grade, messages.structure_parameter_uncertain(parameter=name, std_percent=spread)
            else:
                yield grade, messages.structure_parameter_undetermined(parameter=name)


def _residuals(entry: EntryData) -> Iterator[Finding]:
    if not entry.is_unexplained or not np.isfinite(entry.misfit):
        return
    if not entry.is_independent or entry.has_known_sensor:
        # With known resolution the sensor is known too: larger, coloured residuals are friction, not noise.
        grade = grade_value(entry.misfit, CAUTION_MISFIT_PERCENT, MAX_MISFIT_PERCENT)
        if grade is not Grade.USABLE:
            yield grade, messages.motion_unexplained(misfit_percent=entry.misfit)
            return
    if not entry.has_known_sensor:
        if not entry.is_independent:
            yield Grade.CAUTION, messages.residuals_follow_input(misfit_percent=entry.misfit)
        else:
            yield Grade.CAUTION, messages.residuals_not_white(misfit_percent=entry.misfit)


def judge_model(entries: list[EntryEstimate], gain: RelativeGain) -> Verdict:
    """Return the worst grade of the entries, with the reasons of those that have it.

    A relative gain below one half, or that may be, adds the reason that the other pairing interacts less.
    """
    findings = [
        (
            entry.verdict.grade,
            messages.reason_of_channel(channel=f"{entry.output} from {entry.input}", reason=reason),
        )
        for entry in entries
        for reason in entry.verdict.reasons
    ]
    if not gain.value >= MIN_RELATIVE_GAIN:
        findings.append((Grade.UNUSABLE, messages.pairing_interacts(value=gain.value, std=gain.std)))
    elif not gain.value - SIGNIFICANT_STD * gain.std >= MIN_RELATIVE_GAIN:
        findings.append((Grade.CAUTION, messages.pairing_uncertain(value=gain.value, std=gain.std)))
    grade = worst_grade(*(found for found, _ in findings))
    return Verdict(grade, tuple(reason for found, reason in findings if found is grade))
