"""The laws that the cascade is compared with, playing a program; their gains stay as they were at the start."""

from typing import NamedTuple

from backend.controllers import cascade, feedback_linearization, motors, single_loop
from backend.tick.decision import Carry, Decision, Target
from backend.tick.player import Player, play
from backend.tick.tracking import decided
from plant.compiled import compiled
from plant.interface import Measurement


class SingleLoop(NamedTuple):
    """One loop on position and one on stiffness."""

    tuning: single_loop.Tuning
    law: single_loop.State
    player: Player


class FeedbackLinearization(NamedTuple):
    """The law with a full model."""

    tuning: feedback_linearization.Tuning
    law: feedback_linearization.State
    player: Player


@compiled
def step_single_loop(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: SingleLoop, m: Measurement
) -> tuple[Decision, Carry, SingleLoop]:
    """One tick; the cascade's tuning is only what the next motion takes over."""
    done, target, player = play(state.player, target)
    y, law = single_loop.step(state.tuning, state.law, target.q_ref, target.S_ref, m)
    return decided(y, target, True, done), _left(tuning, y, m), SingleLoop(state.tuning, law, player)


@compiled
def step_feedback_linearization(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: FeedbackLinearization, m: Measurement
) -> tuple[Decision, Carry, FeedbackLinearization]:
    """One tick; the cascade's tuning is only what the next motion takes over."""
    done, target, player = play(state.player, target)
    y, law = feedback_linearization.step(state.tuning, state.law, target.q_ref, target.S_ref, m)
    return decided(y, target, True, done), _left(tuning, y, m), FeedbackLinearization(state.tuning, law, player)


@compiled
def _left(tuning: cascade.Tuning, y: cascade.Output, m: Measurement) -> Carry:
    """Motor loops that hold the joint where the law has left it."""
    state = motors.at_rest(tuning.motors, m.theta_A, m.theta_B, y.u_A, y.u_B)
    return Carry(state, tuning.motors, m.theta_A, m.theta_B)
