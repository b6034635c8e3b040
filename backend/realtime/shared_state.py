"""Context of the compiled step: its memory, and the code for the active motion."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from backend.control import (
    AT_REST,
    NO_INPUTS,
    ControlOutput,
    ControlState,
    Moving,
    StepInputs,
    TickRange,
    cascade,
    decoupler,
    disturbance_observer,
    fault_detection,
    motion_primitives,
    step,
)
from backend.realtime.motions import Motion
from backend.sample import FIELDS
from plant import (
    NO_RAW,
    NOT_MEASURED,
    ZERO_VOLTS,
    Measurement,
    MotorCommand,
    PlantParameters,
    PrecompiledCall,
    RawReading,
    ShaftLoad,
    Simulated,
    StateBlock,
    T_s,
)

_BatchResult = tuple[int, int, float, float, Measurement]
_Run = Callable[
    [StateBlock[ControlState], StateBlock[Moving], StateBlock[Simulated], Measurement, TickRange, NDArray[np.float64]],
    _BatchResult,
]
_DetectFaults = Callable[[Measurement, int], int]
_ComputeControl = Callable[[], tuple[int, float, float]]
_WriteRow = Callable[[NDArray[np.float64], int, MotorCommand, RawReading, float, int], None]


class StepContext:
    """Control state of one loop, and its active motion.

    ``unattended_max_s`` [s]: how long the plant may be left without a write. ``detect_faults``, ``compute_control`` and
    ``write_row`` are those of ``backend.control.step``, for this state and its motion.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        unattended_max_s: float,
        tuning: cascade.CascadeTuning,
    ) -> None:
        self.block = cell = StateBlock(
            ControlState(
                tuning=tuning,
                fault_limits=fault_detection.build_fault_limits(parameters, round(unattended_max_s / T_s)),
                inputs=NO_INPUTS,
                fault_state=fault_detection.FaultDetectionState(
                    0.0, False, NOT_MEASURED, NOT_MEASURED, fault_detection.make_reading_memory()
                ),
                detected_fault=fault_detection.CLEAR,
                velocity=motion_primitives.VelocityState(0.0, math.nan),
                m=NOT_MEASURED,
                command=ZERO_VOLTS,
                output=AT_REST,
                observer=disturbance_observer.build_observer(parameters),
                observer_state=disturbance_observer.UNKNOWN,
                bias=np.zeros((0, 2)),
                F_ext_hat=math.nan,
            )
        )
        self._tuning, self._inputs_block, self._m = cell.field("tuning"), cell.field("inputs"), cell.field("m")
        self._command, self._output, self._velocity = (
            cell.field("command"), cell.field("output"), cell.field("velocity"),
        )  # fmt: skip
        self._detected_fault, self._fault_state = cell.field("detected_fault"), cell.field("fault_state")
        self._observer_state, self._bias, self._F_ext_hat = (
            cell.field(name) for name in ("observer_state", "bias", "F_ext_hat")
        )
        self._inputs = NO_INPUTS
        self._motion_blocks: dict[type, tuple[StateBlock[Moving], _ComputeControl]] = {}
        row = np.zeros(len(FIELDS))
        self.detect_faults: _DetectFaults = partial(PrecompiledCall(step.detect_faults, cell, NOT_MEASURED, 0), cell)
        self.write_row: _WriteRow = partial(
            PrecompiledCall(step.write_row, cell, row, 0, ZERO_VOLTS, NO_RAW, 0.0, 0), cell
        )

    def begin(self, raw: Measurement) -> None:
        """Initialise the state with the measurement before the first tick."""
        self._m.set(raw)
        self._velocity.set(motion_primitives.VelocityState(0.0, raw.q))

    def set_motion(self, motion: Motion) -> None:
        """Make a motion the active one."""
        kind = type(motion.initial.state)
        if kind not in self._motion_blocks:
            block = StateBlock(motion.initial)
            self._motion_blocks[kind] = (
                block,
                partial(PrecompiledCall(step.compute_control, self.block, block), self.block, block),
            )
        self.moving, self.compute_control = self._motion_blocks[kind]
        motion.bind(self.moving)
        self._run: _Run | None = None  # real-time loops run no batches

    def run(
        self, simulated: StateBlock[Simulated], m: Measurement, tick_range: TickRange, rows: NDArray[np.float64]
    ) -> _BatchResult:
        """Execute steps in a batch (``backend.control.step``)."""
        if self._run is None:
            # not the ring's own rows, since the ring is closed before this object
            rows_like = np.zeros((1, len(FIELDS)))
            self._run = PrecompiledCall(step.run_batch, self.block, self.moving, simulated, m, tick_range, rows_like)
        result = self._run(self.block, self.moving, simulated, m, tick_range, rows)
        self._inputs = self._inputs_block.get()
        return result

    @property
    def active_disturbance(self) -> tuple[float, ShaftLoad]:
        """Active push [N] and loads [N·m] of the compiled step."""
        return self._inputs.F_push, self._inputs.load

    def set_inputs(self, inputs: StepInputs) -> None:
        """Set the inputs of the next control step."""
        if inputs != self._inputs:
            self._inputs = inputs
            self._inputs_block.set(inputs)

    @property
    def m(self) -> Measurement:
        """Measurement with zeroed motors."""
        m: Measurement = self._m.get()
        return m

    @m.setter
    def m(self, m: Measurement) -> None:
        self._m.set(m)

    @property
    def output(self) -> ControlOutput:
        """Control output of the last step."""
        output: ControlOutput = self._output.get()
        return output

    @output.setter
    def output(self, output: ControlOutput) -> None:
        self._output.set(output)

    @property
    def command(self) -> MotorCommand:
        """Last command written."""
        command: MotorCommand = self._command.get()
        return command

    @property
    def detected_fault(self) -> fault_detection.DetectedFault:
        """Fault that the checks have detected."""
        fault: fault_detection.DetectedFault = self._detected_fault.get()
        return fault

    @property
    def fault_state(self) -> fault_detection.FaultDetectionState:
        """State of the checks."""
        state: fault_detection.FaultDetectionState = self._fault_state.get()
        return state

    def retune(self, tuning: cascade.CascadeTuning) -> None:
        """Replace all gains of the cascade."""
        self._tuning.set(tuning)

    @property
    def F_ext_hat(self) -> float:
        """Estimated external force [N]; NaN unless the motors are zeroed."""
        F_ext_hat: float = self._F_ext_hat.get()
        return F_ext_hat

    @property
    def rest_statistics(self) -> tuple[float, float, float]:
        """Stiffness [N·m/rad], and mean and standard deviation of the estimated force [N].

        The statistics cover the last 0.3 s, without subtraction of the bias.
        """
        observer_state, m, tuning = self._observer_state.get(), self.m, self._tuning.get()
        S = decoupler.measured_stiffness(tuning.decoupler, m.q, m.theta_A, m.theta_B)
        return S, observer_state.mean / tuning.decoupler.r_j, math.sqrt(observer_state.variance) / tuning.decoupler.r_j

    def set_bias(self, bias: NDArray[np.float64]) -> NDArray[np.float64]:
        """Set the bias (n, 2) of S [N·m/rad] and force [N]; return the previous one."""
        previous: NDArray[np.float64] = self._bias.get()
        self._bias.set(bias)
        return previous

    @property
    def has_bias(self) -> bool:
        """Whether a bias is set."""
        return len(self._bias.get()) > 0

    def reset_joint_position(self, q: float) -> None:
        """Set the joint position [rad] without counting the change as a motion."""
        self._observer_state.set(disturbance_observer.UNKNOWN)
        self._velocity.set(self._velocity.get()._replace(q_before=q))
