"""A loop that ends while hands are at the rig hands its lock of the drives on to the next one."""

from backend.faults import Fault
from backend.realtime.commands import (
    Accepted,
    Command,
    ReadinessChanged,
    Refused,
    Reset,
    SetMode,
    Shutdown,
    Stop,
    SwitchDrives,
)
from backend.realtime.ipc import Setup, decode_to_loop, encode
from backend.realtime.modes import Mode
from backend.realtime.program import SetTuning
from backend.realtime.supervisor import Supervisor
from plant.interface import PlantChoice, PlantKind
from plant.parameters import PlantParameters
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring
from tests.realtime.worker_bench import Bench

VIRTUAL = PlantChoice(PlantKind.VIRTUAL_CARD)


def life(
    setup: Setup, parameters: PlantParameters, tuning: SetTuning, *orders: Command
) -> tuple[Setup, list[object], list[bool]]:
    """One loop started with ``setup``, told ``orders`` one a tick.

    Return the setup for the next loop, what was told, and the drive-enable line at each tick.
    """
    rig = VirtualRig(load_wiring("pcie-6323"), Simulator(parameters, 0))
    _, received = decode_to_loop(encode(setup))
    assert isinstance(received, Setup)
    bench = Bench(parameters, tuning, rig, drives_off=received.drives_off)
    line: list[bool] = []

    def service(tick: int) -> None:
        line.append(rig.card_state().drive_enabled)
        if tick < len(orders):
            bench.say(orders[tick], tick + 1)
        if tick == len(orders) + 1:
            bench.say(Shutdown(), 99)

    bench.run(service)
    told = bench.hear()
    supervisor = Supervisor(setup)
    for message in told:
        supervisor._take(message)  # type: ignore[arg-type]  # what decode_from_loop gave
    supervisor.ring.close()
    bench.service.close()
    bench.ring.close()
    return supervisor.setup, told, line


def answers(told: list[object]) -> list[type]:
    return [type(event) for event in told if isinstance(event, Accepted | Refused) and 0 < event.sequence < 99]


def test_a_new_loop_stays_locked_until_somebody_switches_the_drives_on(
    ideal: PlantParameters, tuning: SetTuning
) -> None:
    first = Setup(VIRTUAL, "ideal", 0, tuning)
    locked, told, line = life(first, ideal, tuning, SwitchDrives(on=False))
    assert (line[0], line[-1], locked.drives_off) == (True, False, True)
    orders = SetMode(Mode.PRETENSION), Stop(Fault.STOP_PRESSED), Reset(), SetMode(Mode.PRETENSION)
    still, told, line = life(locked, ideal, tuning, *orders)
    assert not any(line)
    assert answers(told) == [Refused, Accepted, Accepted, Refused]
    assert [event.drives_off for event in told if isinstance(event, ReadinessChanged)] == [True]
    assert still == locked  # nobody has said that the hands are away
    free, told, line = life(still, ideal, tuning, SwitchDrives(on=True), SetMode(Mode.PRETENSION))
    assert answers(told) == [Accepted, Accepted]
    assert (line[0], line[-1]) == (False, True)
    assert free == first
    assert life(free, ideal, tuning)[2][0]


def test_what_switching_on_takes_is_no_overrun(ideal: PlantParameters, tuning: SetTuning) -> None:
    """The trial of the card's watchdog waits on purpose; a pause that nobody meant is counted all the same."""
    trial_ns, pause_ns = 600_000_000, 5_000_000

    class Unhurried(VirtualRig):
        def switch_drives(self, *, on: bool) -> None:
            bench.now_ns += trial_ns
            super().switch_drives(on=on)

    bench = Bench(ideal, tuning, Unhurried(load_wiring("pcie-6323"), Simulator(ideal, 0)))

    def service(tick: int) -> None:
        if tick == 10:
            bench.say(SwitchDrives(on=True), 1)
        if tick == 30:
            bench.now_ns += pause_ns
        if tick == 50:
            bench.say(Shutdown(), 2)

    bench.run(service)
    overruns = bench.column("overruns")
    assert (overruns[20], overruns[-1]) == (0, pause_ns // 1_000_000 - 1)
    assert bench.now_ns > trial_ns
    bench.service.close()
    bench.ring.close()
