"""``sinew serve`` and ``sinew link``."""

import sys
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.garbage import look_as_usual
from backend.cli.output import fail
from backend.cli.place import (
    CardAddress,
    DataFolder,
    ParameterSet,
    PlantName,
    Recording,
    StationName,
    VirtualCard,
    WiringFile,
    settings_with,
)

if TYPE_CHECKING:
    from backend.auth.sessions import Tokens

SAID_AFTER_S = 3.0
STILL_STARTING = "Sinew is starting. The first start after an installation compiles: that takes up to a minute."


def serve(
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    card_address: CardAddress = None,
    recording: Recording = None,
    params: ParameterSet = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on. [127.0.0.1]")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on, 0 for any free one. [8000]")] = None,
    public_url: Annotated[
        str | None,
        typer.Option(help="Address that browsers open at a reverse proxy, such as https://rig.lab/sinew/."),
    ] = None,
    trusted_proxy: Annotated[
        list[str] | None,
        typer.Option(help="Address or network of that proxy, once for each. [127.0.0.0/8 and ::1]"),
    ] = None,
    data: DataFolder = None,
    station: StationName = None,
    show_link: Annotated[
        bool | None,
        typer.Option("--show-link/--hide-link", help="Print the sign-in link. [on a terminal only: logs are kept]"),
    ] = None,
) -> None:
    """Run the dashboard and the control loop until interrupted."""
    from backend.main import serve as run_service
    from backend.server.server import served_by
    from plant.factory import require_available

    settings = settings_with(
        plant=plant,
        virtual_card=virtual_card,
        wiring=wiring,
        card_address=card_address,
        recording=recording,
        params=params,
        host=host,
        port=port,
        public_url=public_url,
        trusted_proxies=tuple(trusted_proxy) if trusted_proxy else None,
        data=data,
        station=station,
        show_link=show_link,
    )
    require_available(settings.plant_choice)
    shown = sys.stdout.isatty() if settings.show_link is None else settings.show_link

    slow = threading.Timer(SAID_AFTER_S, print, (STILL_STARTING,), {"flush": True})
    slow.daemon = True

    def tell(address: str, tokens: "Tokens | None") -> None:
        slow.cancel()
        addresses = [address, *([settings.public_url] if settings.public_url else [])]
        if tokens is not None and not shown:
            answers = " and ".join(_bases(addresses))
            print(f"Sinew answers at {answers}. The sign-in link: sinew link --data {settings.data}", flush=True)
        else:
            _print_links(addresses, tokens)
        if served := served_by(settings.host):
            print(served, flush=True)

    look_as_usual()
    slow.start()
    try:
        run_service(settings, tell)
    finally:
        slow.cancel()


def link(data: DataFolder = None) -> None:
    """Print the sign-in links of the service that works on the data folder; exit 1 when there is none."""
    from backend.auth.sessions import load_tokens
    from backend.data_folder import addresses_of_service, why_no_address

    settings = settings_with(data=data)
    addresses = addresses_of_service(settings.data)
    if not addresses:
        fail(why_no_address(settings.data))
    _print_links(addresses, load_tokens(settings.data) if settings.require_token else None)


def _print_links(addresses: Sequence[str], tokens: "Tokens | None") -> None:
    """Print the links to sign in at the last of the addresses, the public one where there is one."""
    *others, base = _bases(addresses)
    if tokens is None:
        print(f"Sinew answers at {base} without sign-in", flush=True)
        return
    print(f"Sinew answers. Sign in: {base}/?token={tokens.operator}", flush=True)
    print(f"To watch only:          {base}/?token={tokens.viewer}", flush=True)
    for other in others:
        print(f"At this machine:        {other}/?token={tokens.operator}", flush=True)


def _bases(addresses: Sequence[str]) -> list[str]:
    return [address.rstrip("/") for address in addresses]
