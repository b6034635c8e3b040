"""``sinew rig``."""

import sys
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli import rig_bring_up, rig_check
from backend.cli.output import AsJson, errors, fail, out, print_json
from backend.cli.place import CardAddress, ParameterSet, PlantName, Recording, VirtualCard, WiringFile, settings_with

if TYPE_CHECKING:
    from plant.conformance import Finding

app = typer.Typer(help="Look at what is driven, and bring it up.", no_args_is_help=True, rich_markup_mode=None)
app.command()(rig_check.check)
app.command()(rig_bring_up.bring_up)
app.command()(rig_bring_up.tare)
app.command()(rig_bring_up.calibrate)

STEPPED_VOLTAGE = 0.5
"""What is put on the outputs where nothing real moves [V]."""


@app.command()
def conformance(
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    recording: Recording = None,
    params: ParameterSet = None,
    voltage: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=2.0,
            help="Largest voltage [V] a check may put on a motor, for 0.3 s. [0; 0.5 where nothing real moves]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check a plant against the contract that the loop relies on; exit 1 when it does not keep it."""
    from plant.conformance import Outcome, Subject, run_contract
    from plant.factory import make_plant
    from plant.interface import PlantKind
    from plant.parameters import load_parameters
    from plant.replay import Replay

    settings = settings_with(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        recording=recording,
        params=params,
    )
    choice, parameters = settings.plant_choice, load_parameters(settings.params)
    first = make_plant(choice, parameters, 0)
    if choice.kind is PlantKind.RIG:
        _require_hands_off()
    allowed = voltage if voltage is not None else STEPPED_VOLTAGE if first.stepped else 0.0
    subject = Subject(lambda: make_plant(choice, parameters, 0), parameters, allowed)
    if isinstance(first, Replay):
        subject = replace(subject, answers=False, lasts=first.samples)
    findings = []
    for finding in run_contract(subject):
        findings.append(finding)
        if not as_json:
            _show(finding)
    broken = [finding for finding in findings if finding.outcome is Outcome.BROKEN]
    if as_json:
        print_json({"plant": choice.name, "findings": [asdict(finding) for finding in findings]})
    if broken:
        fail(f"{choice.name}: {len(broken)} of {len(findings)} promises are not kept")
    errors.print(f"{choice.name}: keeps what a plant promises", highlight=False, markup=False)


def _require_hands_off() -> None:
    """End the command but for a person at the rig: the drives come on, also where a service keeps them off."""
    if not sys.stdin.isatty():
        fail("standard input is no terminal: a person at the rig has to say that no hand is in it; the drives come on")
    typer.confirm("Its drives come on. Has everybody taken their hands off the rig?", abort=True, err=True)


def _show(finding: "Finding") -> None:
    seen = f"\n           {finding.seen}" if finding.seen else ""
    out.print(f"{finding.outcome:9}  {finding.sentence}{seen}", highlight=False, markup=False, soft_wrap=True)
