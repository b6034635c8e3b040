"""The two inner loops as a pair."""

from typing import NamedTuple

from backend.controllers import i_pd
from plant.compiled import compiled


class Gains(NamedTuple):
    """Gains of the loop of each motor."""

    A: i_pd.Gains
    B: i_pd.Gains


class State(NamedTuple):
    """State of the loop of each motor."""

    A: i_pd.State
    B: i_pd.State


class Output(NamedTuple):
    """Voltages within their limit [V], and what was clipped off [V]."""

    u_A: float
    u_B: float
    excess_A: float
    excess_B: float


@compiled
def step(
    gains: Gains,
    state: State,
    theta_A_ref: float,
    theta_B_ref: float,
    theta_A: float,
    theta_B: float,
    u_max: float,
    forward_A: float = 0.0,
    forward_B: float = 0.0,
    resting: bool = False,
) -> tuple[Output, State]:
    """One tick of both loops: references and measured positions [rad] to voltages [V] within ±u_max.

    ``forward_A``, ``forward_B`` [V] come on top of what the loops give. While they are ``resting`` their
    integrators leave errors alone.
    """
    u_A, excess_A, state_A = i_pd.step(gains.A, state.A, theta_A_ref, theta_A, u_max, forward_A, resting)
    u_B, excess_B, state_B = i_pd.step(gains.B, state.B, theta_B_ref, theta_B, u_max, forward_B, resting)
    return Output(u_A, u_B, excess_A, excess_B), State(state_A, state_B)


@compiled
def bumpless(before: Gains, after: Gains, state: State, theta_A: float, theta_B: float) -> State:
    """State with which ``after`` continues the voltages of ``before``."""
    return State(
        i_pd.bumpless(before.A, after.A, state.A, theta_A),
        i_pd.bumpless(before.B, after.B, state.B, theta_B),
    )


@compiled
def at_rest(gains: Gains, theta_A: float, theta_B: float, u_A: float, u_B: float) -> State:
    """State that holds the voltages u_A, u_B [V] at standing motors."""
    return State(i_pd.at_rest(gains.A, theta_A, u_A), i_pd.at_rest(gains.B, theta_B, u_B))


@compiled
def shift(gains: Gains, state: State, offset_A: float, offset_B: float) -> State:
    """State after the encoders' zeros moved by offset_A, offset_B [rad]: the voltages go on unchanged."""
    return State(i_pd.shift(gains.A, state.A, offset_A), i_pd.shift(gains.B, state.B, offset_B))
