"""What the service can be told from outside: environment (``SINEW_...``) and command line."""

import ipaddress
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, model_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from backend.errors import require_station_name
from backend.logs import Level
from backend.public_url import LOOPBACK, PublicUrl, read_networks, read_public_url
from plant import DEFAULT_WIRING, ErrorCode, PlantChoice, PlantKind, SinewError

_PREFIX = "SINEW_"
_HOST_NAME = re.compile(r"[\w.-]{1,253}", re.ASCII)


class UnusableSettingError(SinewError):
    """The environment says something that cannot be used; the message names the variable and what it takes."""

    category = ErrorCode.BAD_VALUE


def _listed(given: object) -> object:
    """Return the texts in ``given``: with commas between them, or a JSON list."""
    if not isinstance(given, str):
        return given
    try:
        texts = json.loads(given) if given.lstrip().startswith("[") else given.split(",")
    except ValueError:
        texts = [given]
    return [text.strip() if isinstance(text, str) else str(text) for text in texts]


def _host_names(given: tuple[str, ...]) -> tuple[str, ...]:
    for name in given:
        if not _HOST_NAME.fullmatch(name) or name.isdigit():
            raise ValueError(f"{name!r} is no host name: give names such as rig.lab, without http:// or a port")
    return given


def _public_url(given: str | None) -> str | None:
    """Return the address in its one form; ValueError for what is none."""
    return None if given is None else f"{read_public_url(given)}/"


def _networks(given: tuple[str, ...]) -> tuple[str, ...]:
    read_networks(given)
    return given


def _without_tilde(path: Path) -> Path:
    """Return a path with ~ as the home of an account, where no shell has put that in its place."""
    try:
        return path.expanduser()
    except RuntimeError:
        raise ValueError(f"{path} begins with the home of an account that has none: write the path out") from None


class Settings(BaseSettings):
    """Settings of one service process.

    ``plant`` is ``simulator``, ``rig``, ``replay`` or the name of a plant that an installed package offers. A rig
    has a ``wiring``, shipped or a file; with ``virtual_card`` a simulated card takes the place of the real one, at
    ``card_address`` it is reached through NI's device server. A replay plays ``recording``. ``database_url``
    defaults to SQLite in the data folder; its password may stand in a file instead, so that no environment shows
    it. ``allowed_hosts`` are further names the dashboard may be reached by (the Host header is checked against DNS
    rebinding). ``public_url`` is the address at which browsers reach the service through a reverse proxy,
    ``trusted_proxies`` are the addresses or networks of the proxies whose X-Forwarded-For counts: with a public URL
    those of this machine where none is named. ``require_token`` off makes everyone an operator and is refused on
    any address but a loopback one, and with a public URL. ``show_link`` says whether the sign-in link is printed at
    the start; None: on a terminal only, as what is not a terminal is a log that others keep and read. Flight
    records of trips beyond ``flight_records`` or ``flight_records_MB`` give way to new ones, captures of triggers
    likewise. Recordings beyond ``recordings_GB`` may go once they are older than ``recordings_keep_days``, which is
    for a person to decide. ``station`` tells rigs apart that share a database. The log on standard error holds
    ``log_level`` and above; start, stop, connections, modes and runs are at info.
    """

    model_config = SettingsConfigDict(env_prefix=_PREFIX, env_ignore_empty=True, extra="ignore", frozen=True)

    data: Annotated[Path, AfterValidator(_without_tilde)] = Path("data")
    plant: str = "simulator"
    virtual_card: bool = False
    wiring: str = DEFAULT_WIRING
    card_address: str = ""
    recording: Path | None = None
    params: str = "lab"
    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65535)
    database_url: str | None = Field(default=None, repr=False)
    database_password_file: Path | None = None
    station: str = ""
    require_token: bool = True
    allowed_hosts: Annotated[tuple[str, ...], NoDecode, BeforeValidator(_listed), AfterValidator(_host_names)] = ()
    public_url: Annotated[str | None, AfterValidator(_public_url)] = None
    trusted_proxies: Annotated[tuple[str, ...], NoDecode, BeforeValidator(_listed), AfterValidator(_networks)] = ()
    show_link: bool | None = None
    flight_records: int = Field(default=300, ge=1, le=100_000)
    flight_records_MB: int = Field(default=100, ge=1, le=100_000)
    recordings_GB: float = Field(default=20.0, gt=0.0, le=100_000.0)
    recordings_keep_days: int = Field(default=30, ge=0, le=36_500)
    log_level: Level = "warning"

    @model_validator(mode="after")
    def _no_open_door(self) -> "Settings":
        if not self.require_token and not is_loopback(self.host):
            raise ValueError(
                f"host {self.host} is reachable from other machines and needs the token: "
                "leave require_token on, or bind to 127.0.0.1"
            )
        return self

    @model_validator(mode="after")
    def _no_open_proxy(self) -> "Settings":
        if not self.require_token and self.public_url is not None:
            raise ValueError(
                f"{self.public_url} is reachable from other machines and needs the token: leave require_token on"
            )
        return self

    @model_validator(mode="after")
    def _named_station(self) -> "Settings":
        require_station_name(self.station)
        return self

    @model_validator(mode="after")
    def _one_plant(self) -> "Settings":
        rig = self.plant == PlantKind.RIG
        for given, name in ((self.virtual_card, "virtual_card"), (self.card_address, "card_address")):
            if given and not rig:
                raise ValueError(f"{name} is about a rig: choose plant rig with it")
        if self.virtual_card and self.card_address:
            raise ValueError("a virtual card has no address: give virtual_card or card_address")
        if (self.plant == PlantKind.REPLAY) != (self.recording is not None):
            raise ValueError("a replay plays a recording: give plant replay and recording together")
        return self

    @model_validator(mode="after")
    def _proxies_of_a_public_url(self) -> "Settings":
        if self.trusted_proxies and self.public_url is None:
            raise ValueError("trusted_proxies are those of a public URL: give public_url too, or leave them out")
        return self

    @property
    def public(self) -> PublicUrl | None:
        """Where browsers reach the service through a proxy, with the proxies that are trusted; None without one."""
        if self.public_url is None:
            return None
        return replace(read_public_url(self.public_url), proxies=read_networks(self.trusted_proxies) or LOOPBACK)

    @property
    def plant_choice(self) -> PlantChoice:
        """Which plant is to be driven."""
        match self.plant:
            case PlantKind.SIMULATOR:
                return PlantChoice()
            case PlantKind.RIG:
                kind = PlantKind.VIRTUAL_CARD if self.virtual_card else PlantKind.RIG
                return PlantChoice(kind, wiring=self.wiring, address=self.card_address)
            case PlantKind.REPLAY:
                return PlantChoice(PlantKind.REPLAY, recording=str(self.recording))
            case package:
                return PlantChoice(PlantKind.PACKAGE, package=package)

    def database_password(self) -> str | None:
        """Return the password in ``database_password_file``, None where no file is named.

        Raises UnusableSettingError.
        """
        if self.database_password_file is None:
            return None
        name = f"{_PREFIX}DATABASE_PASSWORD_FILE={self.database_password_file}"
        try:
            password = self.database_password_file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise UnusableSettingError(f"{name}: the file cannot be read: {error}") from None
        if not password:
            raise UnusableSettingError(f"{name}: the file is empty: put the password into it")
        return password


def settings_of_environment() -> Settings:
    """Return what the environment says, defaults elsewhere. Raises UnusableSettingError."""
    try:
        return Settings()
    except ValidationError as error:
        details = error.errors(include_url=False)
        said = "; ".join(_sentence(detail["loc"], detail["input"], detail["msg"]) for detail in details)
        raise UnusableSettingError(said) from None


def _sentence(place: tuple[int | str, ...], given: object, message: str) -> str:
    said = message.removeprefix("Value error, ")
    return f"{_PREFIX}{str(place[0]).upper()}={given}: {said}" if place else said


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach ``host``."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
