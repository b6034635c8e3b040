"""What the compiled tick is told of the mode machine before it is made."""

from backend.control.step import Orders
from backend.faults import FAULT_CODE, Limit
from backend.loop.mode import MODE_CODE
from backend.loop.mode_machine import ModeMachine
from backend.loop.module_trial import ModuleTrial


def orders_of(machine: ModeMachine) -> Orders:
    """Return what the next tick is to know."""
    zeros, lambdas, push, motion = machine.zeros, machine.tunings.lambdas, machine.push, machine.motion
    trial = isinstance(motion, ModuleTrial)  # the trip that it provokes is heard when it is done, and then in any case
    return Orders(
        zeros.offset_A,
        zeros.offset_B,
        zeros.middle,
        zeros.motors_known,
        machine.keeps_taut,
        machine.contact.felt_from(motion),
        trial,
        trial and motion is not None and motion.done,
        machine.reached_told,
        push.F_push,
        push.load,
        machine.tunings.number,
        push.wall,
        push.touch,
        MODE_CODE[machine.mode],
        machine.run,
        lambdas.lam_q,
        lambdas.lam_S,
        FAULT_CODE[machine.fault],
        Limit.CONTACT if machine.contact.felt else 0,
    )
