"""Plays a program tick by tick: segments of references and pushes, and the sequence of an excitation."""

import math
from typing import NamedTuple

from backend.loop.program import Excitation, Segment, Shape
from plant.interface import NO_LOAD, ShaftLoad, T_s


class Target(NamedTuple):
    """What a program asks for in one tick: q_ref [rad], S_ref [N·m/rad], F_push [N], loads of the shafts [N·m]."""

    q_ref: float
    S_ref: float
    F_push: float
    load: ShaftLoad = NO_LOAD


class SegmentPlayer:
    """Walks through segments, one call a tick, in constant time whatever the length of the program."""

    def __init__(self, segments: tuple[Segment, ...], start: Target) -> None:
        self._segments = segments
        self._position = 0
        self._elapsed = 0
        self._from = start

    def step(self) -> Target | None:
        """Return this tick's target, or None once the last segment has ended."""
        while self._position < len(self._segments):
            segment = self._segments[self._position]
            if self._elapsed < round(segment.duration_s / T_s):
                self._elapsed += 1
                return self._within(segment, self._elapsed * T_s)
            self._from = self._within(segment, segment.duration_s)
            self._position += 1
            self._elapsed = 0
        return None

    def _within(self, segment: Segment, time_s: float) -> Target:
        if segment.shape is Shape.RAMP:
            share = min(time_s / segment.duration_s, 1.0)
        elif segment.shape is Shape.SINE:
            share = math.sin(2.0 * math.pi * time_s / segment.period_s)
        else:
            share = 1.0
        start = self._from
        return Target(
            start.q_ref + share * (segment.q_ref - start.q_ref),
            start.S_ref + share * (segment.S_ref - start.S_ref),
            start.F_push + share * (segment.F_push - start.F_push),
            ShaftLoad(segment.load_A, segment.load_B),
        )


class ExcitationPlayer:
    """Walks through the chips of an excitation, one call a tick."""

    def __init__(self, excitation: Excitation) -> None:
        self._levels = tuple(
            excitation.amplitude_rad if level == "+" else -excitation.amplitude_rad for level in excitation.levels
        )
        self._chip_ticks = max(round(excitation.chip_s / T_s), 1)
        self._ticks = excitation.periods * len(self._levels) * self._chip_ticks
        self._tick = 0

    def step(self) -> float | None:
        """Return this tick's offset of theta_A_ref [rad], or None once the last period has ended."""
        if self._tick >= self._ticks:
            return None
        chip = (self._tick // self._chip_ticks) % len(self._levels)
        self._tick += 1
        return self._levels[chip]
