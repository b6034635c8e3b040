"""What is asked of a recording that is played, and what is told of it, as plain data."""

from dataclasses import dataclass

SPEED_MIN, SPEED_MAX = 0.25, 4.0
"""Samples of the recording for each tick: slower repeats samples, faster leaves some out."""


@dataclass(frozen=True)
class PlayRecording:
    """Play or pause, set the speed [samples per tick], go to a sample; None leaves a thing as it is."""

    playing: bool | None = None
    speed: float | None = None
    sample: int | None = None


@dataclass(frozen=True)
class PlayerMoved:
    """From ``tick`` on, which shows ``sample``, a recording of ``samples`` plays at ``speed``, or stands there.

    While it plays, the tick that comes n later shows the sample ``floor(sample + n * speed)``, at most the last one.
    """

    tick: int
    playing: bool
    speed: float
    sample: float
    samples: int
