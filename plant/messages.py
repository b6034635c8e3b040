"""Messages about plants: why one is not available, obstructed, wired or configured, and what it refuses to do."""

from collections.abc import Mapping, Sequence

from plant.message import catalogue_entry
from plant.quantity import Angle, Quantity

# Compiler and interface ----------------------------------------------------------------------------


@catalogue_entry
def compiler_disabled() -> str:
    return "NUMBA_DISABLE_JIT is set, but the control laws run only as compiled code: unset it"


@catalogue_entry
def voltages_not_finite(*, u_A: float, u_B: float) -> str:
    return f"voltages of {u_A:g} and {u_B:g} V: both must be finite numbers"


# Obstacles -----------------------------------------------------------------------------------------


@catalogue_entry
def obstacle_side_invalid(*, side: float) -> str:
    return f"side of the obstacle: {side:g} is neither 1 (above q_wall) nor -1 (below it)"


@catalogue_entry
def obstacle_angle_out_of_range(*, q_wall: float, minimum: float, maximum: float) -> str:
    return (
        f"angle of the obstacle: {Quantity(q_wall, 'rad'):g} is outside {Quantity(minimum, 'rad', maximum)}; "
        "the safety module trips beyond these angles"
    )


@catalogue_entry
def obstacle_stiffness_out_of_range(*, k_wall: float, minimum: float, maximum: float) -> str:
    return (
        f"stiffness of the obstacle: {Quantity(k_wall, 'N/m'):g} is outside {Quantity(minimum, 'N/m', maximum)}; a "
        "softer obstacle would not stop the joint, and the integration steps of the simulator do not resolve a "
        "stiffer one"
    )


@catalogue_entry
def obstacle_damping_out_of_range(*, c_wall: float, minimum: float, maximum: float) -> str:
    return (
        f"damping of the obstacle: {Quantity(c_wall, 's/m'):g} is outside {Quantity(minimum, 's/m', maximum)}; "
        "the integration steps of the simulator do not resolve a stronger damping"
    )


@catalogue_entry
def joint_inside_obstacle(*, q: float, q_wall: float, side: float) -> str:
    where = "above" if side < 0.0 else "below"
    return (
        f"the joint is at {Angle(q):.4g}, inside the obstacle at {Angle(q_wall):.4g}: move it "
        f"{where} that angle first, or place the obstacle elsewhere"
    )


# Springs -------------------------------------------------------------------------------------------


@catalogue_entry
def spring_without_root(*, x_solid: float) -> str:
    return f"the spring polynomial has no zero-force root below x_solid = {x_solid:g} m"


@catalogue_entry
def spring_falls(*, x_solid: float, x: float) -> str:
    return f"the spring polynomial must rise up to x_solid = {x_solid:g} m, but falls at x = {x:.4f} m"


@catalogue_entry
def spring_does_not_stiffen(*, x: float) -> str:
    return (
        f"the spring does not stiffen at x = {x:.4f} m, so that tension cannot set the joint's stiffness "
        "there: fit a polynomial of order 2, or give fewer and smoother points"
    )


@catalogue_entry
def tension_outside_spring(*, F: float, F_solid: float) -> str:
    return f"tension {F:g} N is outside 0-{F_solid:.1f} N, where the spring is neither slack nor fully compressed"


@catalogue_entry
def spring_table_of_wrong_shape(*, x: tuple[int, ...], F: tuple[int, ...]) -> str:
    return f"a spring table needs two columns of equal length, 3 rows or more; got {x} and {F}"


@catalogue_entry
def spring_table_not_finite() -> str:
    return "the spring table holds values that are not finite: remove those rows"


@catalogue_entry
def spring_table_falls(*, row: int, x: float, F: float) -> str:
    return (
        "elongation [m] and force [N] of the spring table must both rise from row to row, but do not after "
        f"row {row}: ({x:g} m, {F:g} N)"
    )


@catalogue_entry
def tendons_required(*, name: str, mechanism: str) -> str:
    return (
        f"the parameter set {name} describes an actuator without tendons ({mechanism}); the dashboard and the "
        "identifications require tendons with load cells: use sinew experiment with this set"
    )


@catalogue_entry
def several_mechanisms(*, file: str, sections: Sequence[str]) -> str:
    return f"{file} must describe one mechanism, but has the sections {', '.join(sections)}; keep one of them"


@catalogue_entry
def not_one_value_per_motor(*, label: str, values: Sequence[float]) -> str:
    return f"{label} must be a list of one number for motor A and one for motor B, but has {len(values)} numbers"


@catalogue_entry
def mechanism_unusable(*, label: str, reason: str) -> str:
    return f"{label}: {reason}"


@catalogue_entry
def stiffness_does_not_rise(*, label: str, minimum: float, maximum: float) -> str:
    return (
        f"{label}: the stiffness at rest must rise from preset_min to preset_max, but does not in "
        f"{Quantity(minimum, 'rad', maximum)}; choose a smaller range"
    )


@catalogue_entry
def deflected_beyond_trip_at_rest(*, label: str, deflection: float, maximum: float) -> str:
    return (
        f"{label} is {Quantity(maximum, 'rad'):g}, but at preset_max a spring deflects by "
        f"{Quantity(deflection, 'rad'):g} at rest; choose a larger deflection_max or a smaller preset_max"
    )


@catalogue_entry
def load_cells_missing(*, fault: str) -> str:
    return f"{fault} requires load cells, which this actuator does not have"


@catalogue_entry
def stiffness_range_not_reached(*, label: str, S_min: float, S_max: float, lowest: float, highest: float) -> str:
    return (
        f"{label}: S_min and S_max must lie in this order between the stiffnesses at preset_min and preset_max, "
        f"{lowest:g} and {highest:g} N·m/rad, but are {S_min:g} and {S_max:g} N·m/rad"
    )


@catalogue_entry
def torque_table_too_small(*, delta: tuple[int, ...], preset: tuple[int, ...]) -> str:
    return (
        "a torque table must have at least 3 deflections and 3 presets, each as a list of numbers, but the shapes are "
        f"{delta} and {preset}"
    )


@catalogue_entry
def torque_table_of_wrong_shape(*, torque: tuple[int, ...], stiffness: tuple[int, ...]) -> str:
    return (
        "torque and stiffness of a torque table must have one row per deflection and one column per preset, but their "
        f"shapes are {torque} and {stiffness}"
    )


@catalogue_entry
def torque_table_not_finite() -> str:
    return "all numbers of a torque table must be finite"


@catalogue_entry
def torque_table_does_not_rise(*, axis: str, at: float) -> str:
    return f"{axis} of a torque table must rise, but does not after {at:g}"


@catalogue_entry
def torque_table_without_zero(*, lowest: float, highest: float) -> str:
    return (
        f"the deflections of a torque table must include both signs, but have the range "
        f"{Quantity(lowest, 'rad', highest)}; add the missing points"
    )


@catalogue_entry
def spring_table_not_from_zero(*, F: float) -> str:
    return f"the spring table must begin at zero force, not {F:g} N"


@catalogue_entry
def x_solid_outside_table(*, x_solid: float, lowest: float, highest: float) -> str:
    return f"x_solid = {x_solid:g} m lies outside the spring table, {lowest:g} to {highest:g} m"


# Parameter files -----------------------------------------------------------------------------------
# ``label`` names an entry with its file and section.


@catalogue_entry
def section_without_entries(*, file: str, section: str, value: object) -> str:
    return f"{file}: {section} = {value!r} must be a section: [{section}]"


@catalogue_entry
def unknown_parameter(*, file: str, section: str, name: str, known: Sequence[str]) -> str:
    return f"{file}: unknown entry {section}.{name}; choose one of {', '.join(known)}"


@catalogue_entry
def parameter_incomplete(*, label: str, unit: str) -> str:
    return f'{label} must read {{ value = ..., unit = "{unit}", source = "..." }}'


@catalogue_entry
def parameter_in_other_unit(*, label: str, unit: object, expected: str) -> str:
    return f"{label} is in {unit!r}: give it in {expected!r}"


@catalogue_entry
def parameter_is_not_a_list(*, label: str, value: object, items: str) -> str:
    return f"{label} = {value!r} must be a list of {items}"


@catalogue_entry
def row_of_other_length(*, label: str, row: object, length: int, unit: str) -> str:
    return f"{label}: row {row!r} must have {length} numbers [{unit}]"


@catalogue_entry
def parameter_not_finite(*, label: str, value: object) -> str:
    return f"{label} = {value!r} is not a finite number"


@catalogue_entry
def parameter_out_of_range(*, label: str, value: float, minimum: float, maximum: float, unit: str) -> str:
    return f"{label} = {Quantity(value, unit):g} is outside {Quantity(minimum, unit, maximum):g}"


@catalogue_entry
def static_friction_undecided(*, label: str, given: Sequence[str]) -> str:
    verb = "requires" if len(given) == 1 else "require"
    return f"{label}.sigma_0 is missing, and {' and '.join(given)} {verb} it: set it (0 for smoothed Coulomb friction)"


@catalogue_entry
def static_friction_incomplete(*, label: str, missing: str) -> str:
    return f"{label}.{missing} is missing: static friction (sigma_0 above 0) requires it"


@catalogue_entry
def static_friction_without_coulomb_friction(*, label: str) -> str:
    return f"{label}.c0 = 0 N·m with sigma_0 above 0: static friction would vanish with a slack tendon; set c0 above 0"


@catalogue_entry
def bristles_too_stiff(*, label: str, name: str, value: float, J_m: float, rate: float, rate_max: float) -> str:
    return (
        f"{label}.{name} = {value:g} on a motor of {J_m:.3g} kg·m² gives a rate "
        f"of {rate:.3g}/s, above the {rate_max:g}/s that the integration steps of the simulator "
        "resolve: reduce it"
    )


@catalogue_entry
def parameters_unreadable(*, name: str, shipped: Sequence[str]) -> str:
    return f"parameter set {name!r} cannot be read: use one of {', '.join(shipped)} or a TOML file"


@catalogue_entry
def parameters_are_not_toml(*, file: str, reason: str) -> str:
    return f"{file} is not a TOML file: {reason}"


@catalogue_entry
def parameters_name_too_long(*, name: str, maximum: int) -> str:
    return (
        f"the name of the file {name[:40]}... has {len(name)} characters, but at most {maximum} are allowed: rename "
        "the file"
    )


@catalogue_entry
def unknown_section(*, file: str, section: str, known: Sequence[str]) -> str:
    return f"{file}: unknown section {section!r}; choose one of {', '.join(known)}"


@catalogue_entry
def output_range_of_one_side(*, file: str, side: str) -> str:
    return f"{file}: motor_{side}.u_max: the output range is the same for both sides: set motor.u_max"


@catalogue_entry
def spring_without_one_curve(*, label: str) -> str:
    return f"{label} must define the spring either by the polynomial k or by points"


@catalogue_entry
def spring_order_out_of_range(*, label: str, coefficients: int) -> str:
    return f"number of coefficients of {label}.k: {coefficients} is outside 3 to 6 (order 2 to 5)"


@catalogue_entry
def spring_unusable(*, label: str, reason: str) -> str:
    return f"{label}: {reason}"


@catalogue_entry
def spring_force_too_large(*, label: str, x_solid: float, F_solid: float, F_max: float) -> str:
    return (
        f"{label}: at spring.x_solid = {x_solid:g} m its force is {F_solid:.1f} N, more than 1.2 times "
        f"safety.F_max = {F_max:g} N"
    )


# Wiring files --------------------------------------------------------------------------------------
# A problem and its remedy are two texts of ``wiring_problem``.


@catalogue_entry
def wiring_problem(*, place: str, entry: str, problem: str, remedy: str) -> str:
    return f"{place}: {entry}: {problem}; {remedy}"


@catalogue_entry
def wiring_rejected(*, problems: Sequence[str]) -> str:
    return "\n".join(problems)


@catalogue_entry
def wiring_unreadable() -> str:
    return "it cannot be read"


@catalogue_entry
def choose_wiring(*, shipped: Sequence[str]) -> str:
    return f"use one of {', '.join(shipped)}, or a TOML file"


@catalogue_entry
def wiring_is_not_toml(*, reason: str) -> str:
    return f"it is not valid TOML: {reason}"


@catalogue_entry
def correct_file() -> str:
    return "correct the file"


@catalogue_entry
def wiring_name_too_long(*, length: int, maximum: int) -> str:
    return f"its name has {length} characters, but at most {maximum} are allowed"


@catalogue_entry
def rename_file() -> str:
    return "rename the file"


@catalogue_entry
def wiring_entry_unknown() -> str:
    return "this name is unknown"


@catalogue_entry
def choose_known_entry(*, known: Sequence[str]) -> str:
    return f"choose one of {', '.join(known)}"


@catalogue_entry
def wiring_entry_missing() -> str:
    return "it is missing"


@catalogue_entry
def give_section(*, section: str) -> str:
    return f"give a section [{section}]"


@catalogue_entry
def unknown_connection(*, value: object) -> str:
    return f"{value!r} is not known"


@catalogue_entry
def give_connection(*, expected: str) -> str:
    return f"give {expected}"


@catalogue_entry
def number_without_unit_and_source() -> str:
    return "a number requires a unit and a source"


@catalogue_entry
def write_number_with_unit_and_source(*, entry: str, unit: str) -> str:
    return f'write {entry} = {{ value = ..., unit = "{unit}", source = "..." }}'


@catalogue_entry
def number_in_other_unit(*, unit: object) -> str:
    return f"it is in {unit!r}"


@catalogue_entry
def give_unit(*, unit: str) -> str:
    return f"give it in {unit!r}"


@catalogue_entry
def number_not_finite(*, value: object) -> str:
    return f"{value!r} is not a finite number"


@catalogue_entry
def number_out_of_range(*, value: float, unit: str) -> str:
    return f"{Quantity(value, unit):g} is out of range"


@catalogue_entry
def choose_number_in_range(*, minimum: float, maximum: float, unit: str) -> str:
    return f"choose {Quantity(minimum, unit, maximum):g}"


@catalogue_entry
def scale_is_zero() -> str:
    return "0 is not a valid scale"


@catalogue_entry
def give_measured_scale() -> str:
    return "give the measured value with its sign"


@catalogue_entry
def end_switch_at_zero() -> str:
    return "an end switch at 0 rad is at neither end of the joint's range"


@catalogue_entry
def give_signed_switch_position() -> str:
    return "give the joint angle at which the switch closes, with its sign"


@catalogue_entry
def not_a_direction(*, value: float) -> str:
    return f"{value:g} is not a direction"


@catalogue_entry
def give_direction() -> str:
    return "give 1 or -1"


@catalogue_entry
def not_a_table_of_rising_voltage() -> str:
    return "it is not a table of two or more points with rising voltage"


@catalogue_entry
def give_table() -> str:
    return "give [[V, N], [V, N], ...]"


@catalogue_entry
def forces_not_monotonic() -> str:
    return "its forces are not monotonic"


@catalogue_entry
def make_forces_monotonic() -> str:
    return "make them rise, or fall, with the voltage"


@catalogue_entry
def table_without_zero_force(*, minimum: float, maximum: float) -> str:
    return f"it covers {minimum:g} to {maximum:g} N"


@catalogue_entry
def add_zero_force() -> str:
    return "add a measured point at 0 N: the load cell also reads a slack tendon"


@catalogue_entry
def terminal_in_use(*, terminal: str, section: str) -> str:
    return f"{terminal} is already used by {section}"


@catalogue_entry
def use_separate_terminals() -> str:
    return "use a separate terminal for each"


@catalogue_entry
def load_cell_without_calibration() -> str:
    return "it has no calibration"


@catalogue_entry
def load_cell_with_two_calibrations() -> str:
    return "it has two calibrations"


@catalogue_entry
def give_one_calibration() -> str:
    return "give slope and offset, which the bring-up measures, or a table"


# Watchdog and card ---------------------------------------------------------------------------------


@catalogue_entry
def watchdog_test_failed(*, within_s: float) -> str:
    return (
        f"the card's watchdog did not disable the drives within {within_s:g} s in the proof "
        "test: the drives stay off; restart the control loop, and do not continue if this recurs"
    )


@catalogue_entry
def watchdog_dead() -> str:
    return "the card's watchdog has died: restart the control loop, which starts a new watchdog"


@catalogue_entry
def watchdog_did_not_start(*, within_s: float) -> str:
    return f"the card's watchdog did not start within {within_s:g} s: restart the control loop"


@catalogue_entry
def watchdog_not_responding(*, silent_s: float) -> str:
    return f"the card's watchdog did not respond for {silent_s:g} s: the drives are off"


@catalogue_entry
def watchdog_expired(*, watchdog_s: float) -> str:
    return f"the card's watchdog received no write for {watchdog_s:g} s and disabled the drives"


@catalogue_entry
def card_not_open() -> str:
    return "the card is not open"


@catalogue_entry
def driver_not_installed() -> str:
    return (
        "NI's driver is not installed on this machine: install NI-DAQmx from ni.com, or give the "
        "address of a device server with --card-address"
    )


@catalogue_entry
def card_failed(*, reason: str) -> str:
    return f"NI-DAQmx: {reason}"


@catalogue_entry
def server_address_invalid(*, address: str) -> str:
    return f"{address!r} is not the address of a device server: give HOST:PORT, for example 192.168.1.20:31763"


@catalogue_entry
def server_not_answering(*, address: str, within_s: float) -> str:
    return (
        f"no server answers at {address} within {within_s:g} s: start NI's gRPC device "
        "server there, and check address and firewall"
    )


@catalogue_entry
def driver_version(*, major: int, minor: int, cards: Sequence[tuple[str, str]]) -> str:
    return f"NI-DAQmx {major}.{minor}, {', '.join(f'{name} ({kind})' for name, kind in cards) or 'no card'}"


@catalogue_entry
def timed_by_card() -> str:
    return "timed by the card's clock"


@catalogue_entry
def timed_by_machine() -> str:
    return "timed by this machine: the card offers no hardware-timed single point"


@catalogue_entry
def timed_on_demand() -> str:
    return "timed by this machine, on demand"


# Rig -----------------------------------------------------------------------------------------------


@catalogue_entry
def load_cells_not_measured() -> str:
    return "the load cells have not been calibrated with this wiring: do Tare and Calibration in the bring-up"


@catalogue_entry
def directions_not_proven() -> str:
    return "the directions of the motors are not confirmed with this wiring: do Motor directions in the bring-up"


@catalogue_entry
def zero_not_set() -> str:
    return "the encoders count from the rig's position at the start of the loop: set the zero in the bring-up"


@catalogue_entry
def drive_enable_not_switched(*, on: bool) -> str:
    return (
        f"the drive-enable line did not switch {'on' if on else 'off'}: "
        "keep clear of the rig, and check drive_enable and its wires"
    )


@catalogue_entry
def drive_enable_reads_off(*, line: str) -> str:
    return f"drive-enable ({line}) was switched on but reads off: check drive_enable and its wires"


@catalogue_entry
def drive_enable_stays_on(*, line: str) -> str:
    return f"drive-enable ({line}) was switched off but stays on: check drive_enable and its wires"


@catalogue_entry
def watchdog_did_not_expire(*, within_s: float) -> str:
    return (
        f"the card's watchdog did not expire within {within_s:g} s when it was tested at zero "
        "volts: the drives cannot be disabled; check drive_enable and its wires, and do not "
        "continue until this test passes"
    )


@catalogue_entry
def watchdog_left_drives_on(*, line: str, within_s: float) -> str:
    return (
        f"the card's watchdog expired, but drive-enable ({line}) stayed on within {within_s:g} s when it was tested "
        "at zero volts: the drives cannot be disabled; check drive_enable and its wires, and do not "
        "continue until this test passes"
    )


@catalogue_entry
def card_too_slow(*, cycle_s: float, longest_s: float, cycles: int, maximum_s: float) -> str:
    return (
        f"reading and writing with this card takes {1e3 * cycle_s:.2f} ms (median of {cycles} cycles at zero volts, "
        f"at most {1e3 * longest_s:.2f} ms), but 1 kHz leaves {1e3 * maximum_s:g} ms for it: "
        "close other programs, or use a PCIe card: a USB card is too slow"
    )


@catalogue_entry
def server_too_slow(*, address: str, cycle_s: float, longest_s: float, cycles: int, maximum_s: float) -> str:
    return (
        f"reading and writing through the device server at {address} takes {1e3 * cycle_s:.2f} ms "
        f"(median of {cycles} cycles at zero volts, at most {1e3 * longest_s:.2f} ms), "
        f"but 1 kHz leaves {1e3 * maximum_s:g} ms for it: run Sinew on the machine that contains the card"
    )


@catalogue_entry
def no_reading_yet() -> str:
    return "no reading yet: read once, then set the positions of joint and motors"


@catalogue_entry
def end_switch_not_held() -> str:
    return "the end switch is not held: turn the joint onto it and hold it there"


@catalogue_entry
def rig_cannot_be_pushed() -> str:
    return "a rig cannot be pushed by command: push it by hand"


@catalogue_entry
def rig_cannot_load_shafts() -> str:
    return "a rig cannot load its motor shafts: simulate the experiment as a dry run"


@catalogue_entry
def rig_without_fault_injection() -> str:
    return "faults cannot be injected into a rig: use the simulator or the virtual card"


@catalogue_entry
def safety_module_tripped() -> str:
    return "the safety module stays tripped: remove the cause that it displays, and acknowledge the trip at the rig"


@catalogue_entry
def wired_card(*, wiring: str, device: str, address: str, timing: str) -> str:
    server = f" at {address}" if address else ""
    return f"{wiring} as {device}{server}, {timing}"


@catalogue_entry
def card_with_cycle(*, card: str, cycle_s: float) -> str:
    return f"{card}, {1e3 * cycle_s:.2f} ms to read and write"


@catalogue_entry
def virtual_card(*, card: str) -> str:
    return f"virtual card, {card}"


# Simulator -----------------------------------------------------------------------------------------


@catalogue_entry
def reading_failed_by_injection() -> str:
    return "the sensors cannot be read (injected)"


@catalogue_entry
def writing_failed_by_injection() -> str:
    return "the outputs cannot be written (injected)"


@catalogue_entry
def shaft_load_negative(*, load_A: float, load_B: float) -> str:
    return f"loads of {load_A:g} and {load_B:g} N·m: a load pulls like a tendon and must be at least 0 N·m"


@catalogue_entry
def fault_requires_card(*, fault: str) -> str:
    return f"{fault}: this fault requires the virtual card: start with --plant rig --virtual-card"


@catalogue_entry
def simulator_has_its_zeros() -> str:
    return "the positions of joint and motors are absolute in the simulator: there is nothing to zero"


@catalogue_entry
def injected_fault_persists(*, fault: str) -> str:
    return f"the injected fault persists: {fault}; clear it first"


@catalogue_entry
def limit_still_exceeded() -> str:
    return "the safety module stays tripped: a tension or the joint position is still beyond its limit"


# Recordings ----------------------------------------------------------------------------------------
# ``recording`` is the name of the file.


@catalogue_entry
def recording_too_short(*, recording: str, samples: int) -> str:
    return f"the recording {recording} cannot be played: it has too few samples ({samples}, at least 2 are required)"


@catalogue_entry
def recording_unreadable(*, recording: str, reason: str) -> str:
    return f"the recording {recording} cannot be played: {reason}"


@catalogue_entry
def recording_of_other_format(*, recording: str) -> str:
    return (
        f"the recording {recording} cannot be played: only .csv and .parquet are read, as sinew runs export writes them"
    )


@catalogue_entry
def column_missing(*, recording: str, column: str, unit: str, columns: Sequence[str]) -> str:
    return (
        f"the recording {recording} cannot be played: "
        f"there is no column {column} [{unit}]; the file has {', '.join(columns)}"
    )


@catalogue_entry
def column_not_unique(*, recording: str, column: str) -> str:
    return f"the recording {recording} cannot be played: there is more than one column {column}: keep only one"


@catalogue_entry
def column_in_other_unit(*, recording: str, column: str, unit: str, expected: str) -> str:
    return f"the recording {recording} cannot be played: the column {column} is in {unit}, but must be in {expected}"


@catalogue_entry
def column_without_numbers(*, recording: str, column: str) -> str:
    return f"the recording {recording} cannot be played: the column {column} contains values that are not numbers"


@catalogue_entry
def sample_without_time(*, recording: str, sample: int) -> str:
    return f"the recording {recording} cannot be played: sample {sample} has no time t"


@catalogue_entry
def recording_of_other_period(*, recording: str, period_s: float, expected_s: float) -> str:
    return (
        f"the recording {recording} cannot be played: "
        f"its period is {1e3 * period_s:g} ms, but must be {1e3 * expected_s:g} ms"
    )


@catalogue_entry
def samples_missing(*, recording: str, t: float, step_s: float) -> str:
    return (
        f"the recording {recording} cannot be played: "
        f"the sample after t = {t:.3f} s follows after {1e3 * step_s:g} ms, not after one period; use only the part "
        "of the file before or after it"
    )


@catalogue_entry
def sample_not_a_number(*, recording: str, column: str, t: float) -> str:
    return (
        f"the recording {recording} cannot be played: "
        f"{column} is not a number at t = {t:.3f} s, and no fault is recorded there"
    )


@catalogue_entry
def sample_out_of_range(*, recording: str, column: str, value: float, t: float, maximum: float, unit: str) -> str:
    return (
        f"the recording {recording} cannot be played: {column} is {value:g} at t = {t:.3f} s, beyond "
        f"{Quantity(maximum, unit):.4g}: the column must be in {unit}"
    )


@catalogue_entry
def recording_ended(*, samples: int, difference_V: float, output: str, t: float) -> str:
    return (
        f"the recording has ended after {samples} samples; the commanded voltages differed from the recorded ones by "
        f"at most {Quantity(difference_V, 'V'):.3g} ({output} at t = {t:.3f} s)"
    )


@catalogue_entry
def replay_cannot_be_pushed() -> str:
    return "a replay cannot be pushed: use the simulator"


@catalogue_entry
def replay_cannot_be_loaded() -> str:
    return "a replay cannot load its motor shafts: use the simulator"


@catalogue_entry
def replay_without_fault_injection() -> str:
    return "faults cannot be injected into a replay: use the simulator or the virtual card"


@catalogue_entry
def replay_has_its_zeros() -> str:
    return "a recording contains its zeros: they cannot be set"


@catalogue_entry
def replay_of(*, file: str, duration_s: float) -> str:
    return f"replay of {file}, {duration_s:.3f} s"


# Plants of packages --------------------------------------------------------------------------------
# ``plant`` is the name of an entry point of ``package``, ``maker`` its value.


@catalogue_entry
def unknown_plant(*, plant: str, installed: Sequence[str]) -> str:
    others = (
        f", or {', '.join(installed)} from an installed package"
        if installed
        else "; no installed package provides another plant"
    )
    return f"there is no plant {plant}: choose simulator, rig or replay{others}"


@catalogue_entry
def plant_not_unique(*, plant: str, packages: Sequence[str]) -> str:
    return f"more than one package provides a plant {plant}: {', '.join(packages)}; uninstall all but one"


@catalogue_entry
def plant_not_imported(*, plant: str, package: str, reason: str) -> str:
    return f"plant {plant} of the package {package} cannot be imported: {reason}"


@catalogue_entry
def plant_name_too_long(*, plant: str, maximum: int) -> str:
    return (
        f"the name of the plant {plant[:20]}... has {len(plant)} characters, but at most {maximum} are allowed: "
        "shorten it"
    )


@catalogue_entry
def maker_not_callable(*, plant: str, package: str, maker: str, kind: str) -> str:
    return f"plant {plant} of the package {package}: {maker} must be callable, but is {kind}"


@catalogue_entry
def plant_not_created(*, plant: str, package: str, reason: str) -> str:
    return f"plant {plant} of the package {package} cannot be created: {reason}"


@catalogue_entry
def created_object_is_not_a_plant(*, plant: str, package: str, maker: str, kind: str, missing: str) -> str:
    return f"plant {plant} of the package {package}: {maker} returned {kind}, which is not a Plant: it has no {missing}"


@catalogue_entry
def card_package_not_installed() -> str:
    return (
        "a card requires NI's Python package, which is not installed: install Sinew with the package extra 'rig', "
        "`make run EXTRAS=rig` or pip install 'sinew[rig]'"
    )


# Conformance ---------------------------------------------------------------------------------------
# What a plant does against its interface, and why a requirement cannot be tested.


@catalogue_entry
def writes_without_effect() -> str:
    return "written voltages have no effect on this plant"


@catalogue_entry
def no_voltage_permitted() -> str:
    return "the plant would move: permit a small voltage"


@catalogue_entry
def not_a_measurement(*, kind: str) -> str:
    return f"read returned an object of type {kind}, but must return a Measurement"


@catalogue_entry
def reading_without_floats(*, names: Sequence[str]) -> str:
    return f"values that are not floats: {', '.join(names)}"


@catalogue_entry
def reading_not_finite(*, names: Sequence[str]) -> str:
    return f"values that are not finite: {', '.join(names)}"


@catalogue_entry
def q_implausible(*, q: float, q_max: float) -> str:
    return f"q = {q:g}, beyond {Angle(q_max):.3g}: is it in rad?"


@catalogue_entry
def tension_implausible(*, name: str, F: float, F_max: float) -> str:
    return f"{name} = {F:g}, outside 0 to {F_max:g} N: is it in N, and tared?"


@catalogue_entry
def theta_implausible(*, name: str, theta: float, theta_max: float) -> str:
    return f"{name} = {theta:g}, beyond {Angle(theta_max)}: is it in rad at the gearbox output?"


@catalogue_entry
def safety_trip_invalid(*, value: float) -> str:
    return f"safety_trip = {value:g}, but must be 0 or 1"


@catalogue_entry
def raw_reading_incomplete() -> str:
    return "raw must be a RawReading, with NaN values if the plant has no card"


@catalogue_entry
def moved_at_zero_volts(*, name: str, travel: float) -> str:
    return f"{name} moved by {Angle(travel):.2g} at zero volts"


@catalogue_entry
def parts_missing(*, missing: str) -> str:
    return f"it has no {missing}"


@catalogue_entry
def attribute_not_boolean(*, attribute: str) -> str:
    return f"{attribute} must be True or False"


@catalogue_entry
def unattended_time_invalid(*, value: object) -> str:
    return f"unattended_max_s = {value}: give a finite time in seconds, longer than a period"


@catalogue_entry
def unready_is_not_text() -> str:
    return "unready must be a sentence, empty if the plant may be controlled"


@catalogue_entry
def stepped_and_paced() -> str:
    return "stepped and paces_loop: only one of them may be True"


@catalogue_entry
def description_empty() -> str:
    return "it is empty"


@catalogue_entry
def description_of_several_lines() -> str:
    return "it has more than one line"


@catalogue_entry
def not_a_raw_reading() -> str:
    return "raw must be a RawReading"


@catalogue_entry
def motor_not_turned(*, voltage: float, motor: str, angle: float) -> str:
    return f"{voltage:g} V on motor {motor} turned it by {Angle(angle):.2g}: is the sign wrong, or the voltage too low?"


@catalogue_entry
def other_motor_turned(*, voltage: float, motor: str, angle: float) -> str:
    return f"{voltage:g} V on motor {motor} turned the other one by {Angle(angle):.2g}: are the motors swapped?"


@catalogue_entry
def plant_not_stepped() -> str:
    return "the plant is not stepped: it moves with the clock, not with the writes"


@catalogue_entry
def moved_without_write(*, before: tuple[float, ...], after: tuple[float, ...]) -> str:
    return f"it moved between two readings without a write: {before} to {after}"


@catalogue_entry
def full_voltage_in_real_time() -> str:
    return "a plant that moves in real time is not driven at full voltage"


@catalogue_entry
def voltage_not_limited(*, voltage: float, excess: float, u_max: float) -> str:
    return f"at {voltage:g} V a motor turned {Angle(excess):.2g} further than at {u_max:g} V"


@catalogue_entry
def refusal_without_message(*, operation: str) -> str:
    return f"{operation} is refused without a message"


@catalogue_entry
def attribute_contradicted(*, attribute: str, value: bool, operation: str) -> str:
    return f"{attribute} is {value}, but {operation} is {'refused' if value else 'not refused'}"


@catalogue_entry
def plant_tripped() -> str:
    return "its safety module has tripped: acknowledge the trip first"


@catalogue_entry
def readings_before_due(*, readings: int, duration_s: float) -> str:
    return f"{readings} readings arrived within {duration_s:.3f} s, before they were due"


@catalogue_entry
def cycle_longer_than_period(*, cycle_s: float) -> str:
    return f"a reading and a write take {1e3 * cycle_s:.2f} ms, longer than a period"


@catalogue_entry
def memory_grows(*, blocks: int, ticks: int) -> str:
    return f"{blocks} more memory blocks after {ticks} cycles"


@catalogue_entry
def readings_not_repeated() -> str:
    return "the second execution returned different readings"


@catalogue_entry
def check_failed(*, reason: str) -> str:
    return f"it failed: {reason}"


@catalogue_entry
def other_error_raised(*, kind: str, reason: str) -> str:
    return f"{kind} instead of a PlantError: {reason}"


# Observations of the checks that hold.


@catalogue_entry
def unattended_time(*, limit_s: float) -> str:
    return f"may run unattended for {1e3 * limit_s:g} ms"


@catalogue_entry
def first_reading(*, q: float, F_A: float, F_B: float) -> str:
    return f"q = {Angle(q):.4g}, F_A = {Quantity(F_A, 'N'):.3g}, F_B = {Quantity(F_B, 'N'):.3g}"


@catalogue_entry
def motors_turned(*, voltage: float, angles: Mapping[str, float]) -> str:
    return f"{voltage:g} V turned {', '.join(f'{motor} by {Angle(angle):.3g}' for motor, angle in angles.items())}"


@catalogue_entry
def voltage_refused(*, reason: str) -> str:
    return f"refused: {reason}"


@catalogue_entry
def voltage_limited(*, u_max: float) -> str:
    return f"limited to {u_max:g} V"


@catalogue_entry
def replaced_by_zero_volts() -> str:
    return "replaced by zero volts"


@catalogue_entry
def operations_refused(*, operations: Sequence[str]) -> str:
    return f"refuses {', '.join(operations)}"


@catalogue_entry
def operations_supported() -> str:
    return "supports all of them"


@catalogue_entry
def duration_of_ticks(*, ticks: int, duration_s: float) -> str:
    return f"{ticks} cycles took {duration_s:.3f} s"


@catalogue_entry
def duration_of_cycle(*, cycle_s: float) -> str:
    return f"a reading and a write take {1e6 * cycle_s:.0f} µs (median)"


@catalogue_entry
def ticks_without_growth(*, ticks: int) -> str:
    return f"{ticks} cycles"
