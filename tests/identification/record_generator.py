"""Provoked records with known parameters: good ones of every shape, and faulty ones that identification must detect.

All are generated from a seed. Simulated by the discretization of SciPy, or sample by sample by the motor of
:mod:`tests.identification.own_motor`, independent of the filters of the package.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, dlsim, lfilter, tf2ss

from tests.identification.own_motor import K_M, PERIOD_S, T_M, motor, voltages

Array = NDArray[np.float64]
Random = np.random.Generator
COUNT = 3000
COUNT_RAD = 2.0 * np.pi / 8000


@dataclass(frozen=True)
class Provoked:
    """A record and its true parameters.

    ``truth`` is the gain and the sum of lags (and dead time) that tuning would use; None if no model of this
    structure is true. ``more`` contains further arguments of the record.
    """

    u: Array
    y: Array
    structure: str
    truth: tuple[float, float] | None
    period_s: float = 0.01
    more: dict[str, Any] = field(default_factory=dict)


def plant(random: Random, order: int = 1) -> tuple[float, list[float]]:
    """Gain and time constants [s] at a sample time of 10 ms."""
    T = float(random.uniform(0.15, 0.5))
    return float(random.uniform(0.5, 5.0)), [T, *(T * random.uniform(0.1, 0.3, order - 1)).tolist()]


def response(K: float, lags: list[float], u: Array, period_s: float = 0.01, late: int = 0) -> Array:
    """Return the response from rest to a held input, delayed by this number of samples."""
    denominator = np.array([1.0])
    for lag in lags:
        denominator = np.convolve(denominator, [lag, 1.0])
    y = dlsim(cont2discrete(tf2ss([K], denominator), period_s), u)[1][:, 0]
    return np.concatenate((np.zeros(late), y))[: u.size]


def held(random: Random, length: int = 60, *, binary: bool = True, count: int = COUNT) -> Array:
    """Return random values, each held for half to one and a half times ``length`` samples."""
    chips: list[Array] = []
    while sum(chip.size for chip in chips) < count:
        value = random.choice([-1.0, 1.0]) if binary else random.uniform(-1.0, 1.0)
        chips.append(np.full(int(random.integers(length // 2, 3 * length // 2)), value))
    return np.concatenate(chips)[:count]


def noise(random: Random, y: Array, share: float) -> Array:
    return np.asarray(share * np.std(y) * random.standard_normal(y.size))


def binary(random: Random) -> Provoked:
    K, lags = plant(random)
    u = held(random)
    y = response(K, lags, u)
    return Provoked(u, y + noise(random, y, random.uniform(0.005, 0.1)), "first", (K, lags[0]))


def levels(random: Random) -> Provoked:
    K, lags = plant(random, 2)
    u = held(random, binary=False)
    y = response(K, lags, u)
    return Provoked(u, y + noise(random, y, random.uniform(0.002, 0.02)), "order:2", (K, sum(lags)))


def step_from_rest(random: Random) -> Provoked:
    """Alternately exact, rounded or noisy; the rest takes 5 to 60 % of the record."""
    K, lags = plant(random)
    u = np.where(np.arange(COUNT) < random.uniform(0.05, 0.6) * COUNT, 0.0, random.uniform(0.5, 4.0))
    y = response(K, lags, u)
    kind = int(random.integers(3))
    if kind == 1:
        step = np.ptp(y) / random.uniform(100.0, 5000.0)
        y = step * np.round(y / step)
    return Provoked(u, y + noise(random, y, 0.01) if kind == 2 else y, "first", (K, lags[0]))


def controller_at_its_limit(random: Random) -> Provoked:
    """A proportional controller in saturation for 10 to 60 % of the time, with white noise."""
    K, lags = plant(random)
    limit, r, decay = random.uniform(0.6, 1.5), 2.0 * held(random, 150), np.exp(-0.01 / lags[0])
    u, y = np.zeros(COUNT), np.zeros(COUNT)
    spread, state = 0.01 * K * limit, 0.0
    for k in range(COUNT):
        y[k] = state + spread * random.standard_normal()
        u[k] = np.clip(2.0 / K * (r[k] - y[k] / 2.0), -limit, limit)
        state = decay * state + K * (1.0 - decay) * u[k]
    return Provoked(u, y, "first", (K, lags[0]))


def ramps_with_rest(random: Random) -> Provoked:
    K, lags = plant(random)
    slopes = held(random, 100, binary=False)
    u = np.cumsum(np.where(np.repeat(random.random(COUNT // 100) < 0.4, 100), 0.0, slopes)) / 100.0
    y = response(K, lags, u)
    return Provoked(u, y + noise(random, y, 0.002), "first", (K, lags[0]))


def steps_with_rest(random: Random) -> Provoked:
    """Two fifths of the steps are to zero; every second record has no noise."""
    K, lags = plant(random)
    u = np.repeat(np.where(random.random(COUNT // 50) < 0.4, 0.0, random.uniform(-3.0, 3.0, COUNT // 50)), 50)
    y = response(K, lags, u)
    return Provoked(u, y + noise(random, y, 0.01 * random.integers(2)), "first", (K, lags[0]))


def free_of_noise(random: Random) -> Provoked:
    order = int(random.integers(1, 3))
    K, lags = plant(random, order)
    u = held(random)
    return Provoked(u, response(K, lags, u), f"order:{order}", (K, sum(lags)))


def rounded(random: Random) -> Provoked:
    """A sensor of 50 to 2000 counts over the motion."""
    K, lags = plant(random)
    u = held(random, binary=bool(random.integers(2)))
    y = response(K, lags, u)
    step = np.ptp(y) / random.uniform(50.0, 2000.0)
    return Provoked(u, step * np.round(y / step), "first", (K, lags[0]))


def encoder(random: Random, *, offset: float = 0.0) -> Provoked:
    """Initial rest, Coulomb friction, and encoder counts without noise."""
    u = np.concatenate((np.zeros(500), voltages("levels", 5500, int(random.integers(1000)))))
    turn = motor(u + offset, float(random.uniform(0.05, 0.8)))[1]
    return Provoked(u, COUNT_RAD * np.round(turn / COUNT_RAD), "motor", (K_M, T_M), PERIOD_S)


def amplifier_offset(random: Random) -> Provoked:
    return encoder(random, offset=float(random.choice([-1.0, 1.0]) * random.uniform(0.1, 0.6)))


def cut_and_drifting(random: Random) -> Provoked:
    K, lags = plant(random)
    u = held(random, count=COUNT + 300)
    y = response(K, lags, u + random.uniform(-1.0, 1.0))
    y = y + noise(random, y, 0.02) + 10.0 * K + K * np.linspace(0.0, random.uniform(0.0, 1.0), y.size)
    return Provoked(u[300:], y[300:], "first", (K, lags[0]))


def saturated_output(random: Random) -> Provoked:
    K, lags = plant(random)
    u = held(random, binary=bool(random.integers(2)))
    y = response(K, lags, u)
    limit = random.uniform(0.5, 0.8) * float(np.max(np.abs(y)))
    return Provoked(u, np.clip(y + noise(random, y, 0.01 * random.integers(2)), -limit, limit), "first", (K, lags[0]))


def wrong_period(random: Random) -> Provoked:
    """A sample time that deviates from the time column by a thousandth or more."""
    good = binary(random)
    off = 1.0 + random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(-2.8, 1.0)
    more = {"t": np.arange(COUNT) * 0.01 * abs(off)}
    return Provoked(good.u, good.y, "first", None, more=more)


def dead_time_left_out(random: Random) -> Provoked:
    K, lags = plant(random)
    u, late = held(random), int(random.integers(3, 40))
    y = response(K, lags, u, late=late)
    return Provoked(u, y + noise(random, y, random.uniform(0.0, 0.03)), "first", (K, lags[0] + 0.01 * late))


def gap(random: Random) -> Provoked:
    """One to five blocks of samples are missing without an indication."""
    good = binary(random)
    kept = np.ones(COUNT, dtype=bool)
    for _ in range(int(random.integers(1, 6))):
        at = int(random.integers(200, COUNT - 200))
        kept[at : at + int(random.integers(20, 150))] = False
    return Provoked(good.u[kept], good.y[kept], "first", good.truth)


def weak(random: Random) -> Provoked:
    """Noise at least as large as the motion, or a sensor with a few counts."""
    K, lags = plant(random)
    u = held(random)
    y = response(K, lags, u)
    if random.integers(2):
        return Provoked(u, y + noise(random, y, random.uniform(1.0, 5.0)), "first", (K, lags[0]))
    step = np.ptp(y) / random.uniform(2.0, 15.0)
    return Provoked(u, step * np.round(y / step), "first", (K, lags[0]))


def wrapped_angle(random: Random) -> Provoked:
    u = voltages("levels", 6000, int(random.integers(1000)))
    turn = np.mod(motor(u, 0.2)[1] + random.uniform(0.0, 6.0), 2.0 * np.pi)
    return Provoked(u, COUNT_RAD * np.round(turn / COUNT_RAD), "motor", None, PERIOD_S)


def swapped(random: Random) -> Provoked:
    good = binary(random)
    return Provoked(good.y, good.u, "first", None)


def unnamed_loop(random: Random) -> Provoked:
    """A proportional-integral loop with coloured noise; neither set point nor controller is given."""
    K, lags = plant(random)
    colour, excitation = float(random.uniform(0.95, 0.995)), held(random)
    disturbance = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], random.standard_normal(COUNT))
    spread, gain, decay = 0.05 * K * random.uniform(0.3, 3.0), random.uniform(1.0, 8.0) / K, np.exp(-0.01 / lags[0])
    u, y, state, integral = np.zeros(COUNT), np.zeros(COUNT), 0.0, 0.0
    for k in range(COUNT):
        y[k] = state + spread * disturbance[k]
        integral -= 0.01 * gain / lags[0] * y[k]
        u[k] = excitation[k] - gain * y[k] + integral
        state = decay * state + K * (1.0 - decay) * u[k]
    return Provoked(u, y, "first", (K, lags[0]))


def dry_friction(random: Random) -> Provoked:
    u = voltages(str(random.choice(["binary", "levels", "sines"])), 6000, int(random.integers(1000)))
    speed = motor(u, float(random.uniform(0.1, 2.0)))[0]
    return Provoked(u, speed + noise(random, speed, random.uniform(0.005, 0.05)), "first", (K_M, T_M), PERIOD_S)


def order_too_low(random: Random) -> Provoked:
    K, lags = plant(random, 3)
    u = held(random, int(random.integers(20, 80)))
    y = response(K, lags, u)
    return Provoked(u, y + noise(random, y, random.uniform(0.0, 0.05)), "first", (K, sum(lags)))


GOOD: dict[str, Callable[[Random], Provoked]] = {
    make.__name__: make
    for make in (
        binary,
        levels,
        step_from_rest,
        controller_at_its_limit,
        ramps_with_rest,
        steps_with_rest,
        free_of_noise,
        rounded,
        encoder,
        amplifier_offset,
        cut_and_drifting,
    )
}
FAULTY: dict[str, Callable[[Random], Provoked]] = {
    make.__name__: make
    for make in (
        saturated_output,
        wrong_period,
        dead_time_left_out,
        gap,
        weak,
        wrapped_angle,
        swapped,
        unnamed_loop,
        dry_friction,
        order_too_low,
    )
}


def provoked(kind: str, seed: int) -> Provoked:
    """Return the record of this kind and seed."""
    make = GOOD.get(kind) or FAULTY[kind]
    return make(np.random.default_rng([seed, *kind.encode()]))


def without_lag() -> dict[str, tuple[Array, Array]]:
    """Return inputs and outputs without lag, or without relation, by name."""
    random, count = np.random.default_rng(5), 500
    walk = np.cumsum(random.uniform(0.1, 0.2, count) * np.sign(np.sin(np.arange(count) / 30.0)))
    chips, white = np.repeat(random.choice([-1.0, 1.0], 25), 20), random.standard_normal(count)
    step = np.where(np.arange(count) < 100, 0.0, 1.0)
    return {
        "twice": (walk, 2.0 * walk),
        "rounded": (np.round(walk, 3), np.round(2.0 * walk, 3)),
        "same": (walk, walk),
        "negative": (chips, -3.0 * chips),
        "chips": (chips, 2.0 * chips),
        "offset": (chips, 2.0 * chips + 100.0),
        "white": (white, 2.0 * white),
        "one sample late": (chips, 2.0 * np.roll(chips, 1)),
        "one sample early": (chips, 2.0 * np.roll(chips, -1)),
        "step": (step, 2.0 * step),
        "ramp": (np.arange(count) * 1e-3, np.arange(count) * 2e-3),
        "tiny": (walk, 1e-9 * walk),
        "huge": (walk, 1e9 * walk),
        "noisy": (white, 2.0 * white + 0.1 * random.standard_normal(count)),
        "square": (walk, walk**2),
        "pulse": ((np.arange(count) == 250).astype(float), 2.0 * (np.arange(count) == 250)),
    }


def each(kinds: dict[str, Callable[[Random], Provoked]], seeds: range) -> Iterator[tuple[str, int]]:
    """Yield kinds and seeds."""
    for kind in kinds:
        for seed in seeds:
            yield kind, seed
