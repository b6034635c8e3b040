"""All gains of the cascade, as plain data: a command of its own, and part of a program that changes them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EntryGains:
    """Gains of the two outer loops at one point of the bank, scaled for the decoupler (erratum E3)."""

    S_nominal: float
    k_p_q: float
    k_i_q: float
    k_r_q: float
    k_p_S: float
    k_i_S: float
    k_r_S: float


@dataclass(frozen=True)
class MotorGains:
    """Gains of the inner I-PD loops (table 2)."""

    k_p: float
    k_i: float
    k_d: float
    t_f: float


@dataclass(frozen=True)
class SetTuning:
    """Replace all gains at once, bumpless: the motor voltages do not jump.

    The service computes gains from models and λ; the loop only applies them. ``interpolate`` chooses between gain
    scheduling and switching with hysteresis when there is more than one entry. ``u_plan`` [V] is the voltage limit of
    time-optimal motion, 0 for lambda motion. ``k_ext`` [1]: share of the outside force that is rejected by
    feed-forward, where its bias was learned.
    """

    lam_q: float
    lam_S: float
    motor_A: MotorGains
    motor_B: MotorGains
    entries: tuple[EntryGains, ...]
    interpolate: bool
    u_plan: float = 0.0
    k_ext: float = 0.0
