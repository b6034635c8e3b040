"""What a program begins with, as arrays and numbers for the compiled tick: held against a count by hand."""

import numpy as np

from backend.control import motion_primitives
from backend.realtime.motions import make_voltage_steps_state
from backend.realtime.program import Law, Program, VoltageStep


def test_voltage_steps_begin_on_the_way_to_the_centre_at_rest_with_the_first() -> None:
    room = motion_primitives.VoltageMargin(3.0, 3.5, 2.0, 12.0)
    up = VoltageStep(theta_start=-0.5, u=2.5, duration_s=0.25, travel_rad=1.5)
    down = VoltageStep(theta_start=0.75, u=-2.5, duration_s=0.1, travel_rad=2.0)
    begun = make_voltage_steps_state(Program(Law.MOTOR_STEPS, steps=(up, down), settle_s=0.3), room)
    np.testing.assert_array_equal(begun.steps, [[-0.5, 2.5, 250.0, 1.5], [0.75, -2.5, 100.0, 2.0]])
    assert begun._replace(steps=np.empty(0))[2:] == (
        300,
        0,
        motion_primitives.CENTRED,
        0,
        0.0,
        0.0,
        motion_primitives.BrakeState(0, 0, 0, 0),
    )
    assert begun.margin == room
