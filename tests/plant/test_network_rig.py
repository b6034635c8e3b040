"""The same rig through a local gRPC server, as through NI's device server on another machine."""

import socket
from collections.abc import Iterator
from dataclasses import replace

import pytest
from nidaqmx import Task
from typer.testing import CliRunner

from backend.cli.messages import drives_require_terminal
from backend.cli.rig import app
from plant import device_server, messages, rig
from plant.daq import Daq
from plant.device_server import DeviceServer
from plant.factory import make_plant
from plant.interface import MotorCommand, PlantChoice, PlantError, PlantKind
from plant.parameters import load_parameters
from plant.rig import Rig
from plant.safety_card import WATCHDOG_S, Card
from plant.simulator import Simulator
from plant.virtual_daq import VirtualCard
from plant.wiring import Wiring, load_wiring
from tests.plant.served_card import served
from tests.reasons import assert_reason
from tests.refusals import refused

PARAMETERS = load_parameters("lab")
SHIPPED = load_wiring("pcie-6323")
WIRING = replace(SHIPPED, card=replace(SHIPPED.card, watchdog_s=WATCHDOG_S))
"""With a watchdog that waits for longer: on a busy machine a call over a socket may take 50 ms."""


@pytest.fixture
def registers() -> Iterator[Card]:
    made = Card.create()
    made.start_watchdog()
    yield made
    made.disarm()
    made.close()


def virtual(registers: Card) -> VirtualCard:
    return VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers, has_clock=False)


def network_rig(address: str, wiring: Wiring = WIRING) -> Rig:
    return Rig(wiring, Daq(wiring, DeviceServer(address).options), server=address)


@pytest.mark.live  # its watchdog counts on, however long a call over the socket takes
def test_a_network_rig_reads_and_writes_the_same_values(registers: Card, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long a cycle takes here, it is measured and reported, and the values are those of the card."""
    monkeypatch.setattr(rig, "CYCLE_MAX_S", 10.0)
    with served(virtual(registers)) as address:
        far = network_rig(address)
        far.open()
        card = messages.wired_card(
            wiring="pcie-6323", device="Dev1", address=address, timing=messages.timed_on_demand()
        )
        assert_reason(far.description, "card_with_cycle", card=card)
        assert registers.state().drive_enabled
        for _ in range(50):
            m = far.read()
            far.write(MotorCommand(0.7, -0.2))
        assert m.theta_A > 0.0 > m.theta_B
        assert (registers.state().u_A, registers.state().u_B) == pytest.approx((0.7, -0.2), abs=20.0 / 2**16)
        far.close()
        assert not registers.state().drive_enabled


def test_conformance_of_a_rig_requires_a_person_before_the_drives_are_enabled(registers: Card) -> None:
    with served(virtual(registers)) as address:
        ended = CliRunner().invoke(app, ["conformance", "--plant", "rig", "--card-address", address])
    assert ended.exit_code == 1
    assert drives_require_terminal() in ended.stderr
    assert registers.state().u_A == registers.state().u_B == 0.0
    assert not registers.state().drive_enabled


@pytest.mark.live  # as above, and each call is made to take longer
def test_a_too_long_round_trip_is_rejected_with_its_duration(registers: Card) -> None:
    """Seven calls per cycle, each delayed by 2 ms: no machine is fast enough to compensate for that."""
    with served(virtual(registers), delay_s=2e-3) as address:
        far = network_rig(address)
        with pytest.raises(PlantError) as error:
            far.open()
        message = error.value.message
        assert (message.code, message.values["address"]) == ("server_too_slow", address)
        assert (message.values["cycles"], message.values["maximum_s"]) == (50, pytest.approx(0.7e-3))
        cycle_s = message.values["cycle_s"]
        assert isinstance(cycle_s, float)
        assert cycle_s > 7 * 2e-3
        assert not registers.state().drive_enabled


def test_a_card_reserved_by_another_program_is_rejected(registers: Card) -> None:
    card = virtual(registers)
    with served(card) as address, Task("other", grpc_options=DeviceServer(address).options()) as other:
        other.ao_channels.add_ao_voltage_chan("Dev1/ao1")
        with pytest.raises(PlantError, match=r"reserved: ao1 belongs to the task other Status Code: -50103"):
            network_rig(address).open()
        assert not registers.state().drive_enabled
        # It has let go of what it had: once the other is gone, everything is free.
        other.close()
        again = Daq(WIRING, card.options)
        again.open()
        again.close()


@pytest.mark.parametrize(
    ("wiring", "said"),
    [
        (replace(WIRING, card=replace(WIRING.card, device="Dev7")), "Device identifier is invalid: Dev7 .*-200220"),
        (replace(WIRING, motor_B=replace(WIRING.motor_B, channel="ao4")), "does not exist.*: ao4 of Dev1 .*-200170"),
    ],
)
def test_a_missing_channel_or_card_is_rejected(registers: Card, wiring: Wiring, said: str) -> None:
    far = Rig(wiring, Daq(wiring, virtual(registers).options))
    with pytest.raises(PlantError, match=said) as error:
        far.open()
    assert error.value.message.code == "card_failed"
    assert "\n" not in error.value.message
    assert not registers.state().drive_enabled


def test_an_unreachable_address_is_reported_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_server, "CONNECTED_S", 0.1)
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        address = f"127.0.0.1:{nobody.getsockname()[1]}"
    plant = make_plant(PlantChoice(PlantKind.RIG, address=address), PARAMETERS, 0)
    with pytest.raises(PlantError) as error:
        plant.open()
    message = error.value.message
    assert (message.code, message.values) == ("server_not_answering", {"address": address, "within_s": 0.1})
    assert "\n" not in message
    with refused(PlantError, "server_address_invalid", address="lab-pc"):
        make_plant(PlantChoice(PlantKind.RIG, address="lab-pc"), PARAMETERS, 0).open()
