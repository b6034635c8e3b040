"""Parameter sets of the plant, loaded from TOML with units and sources.

``motor`` and ``spring`` are the true plant, ``identified`` is the controller's knowledge of it. A section such as
``motor_B`` gives entries of ``motor`` that differ on side B. A file of another actuator has a section of its mechanism,
such as ``lever``, in place of ``spring`` and the other entries of tendons.
"""

import math
import tomllib
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from plant import messages
from plant.dynamics import (
    NO_SPRING,
    SUBSTEPS,
    Dynamics,
    Friction,
    Joint,
    LuGre,
    Motor,
    Spring,
    polynomial_spring,
    require_stiffening,
    tabulated_spring,
)
from plant.errors import ErrorCode, SinewError
from plant.interface import FILE_NAME_MAX, T_s
from plant.mechanisms import (
    ANTAGONISTIC_AXES,
    SERIES_AXES,
    Bidirectional,
    Lever,
    Mechanism,
    MotorAxes,
    Pretension,
    build_torque_table,
    compute_rest,
    elastic_deflection,
    motor_axes,
    tendon_axes,
)

# Parameter entries ---------------------------------------------------------------------------------
# Parsing of one section of a parameter file: each number has a unit and a source, and errors name the entry.


Value = float | tuple[float, ...] | tuple[tuple[float, ...], ...]


class ParameterError(SinewError, ValueError):
    """Parameter file that is missing, incomplete or out of bounds.

    The message names the entry and the remedy.
    """

    category = ErrorCode.BAD_VALUE


def quantity(unit: str, minimum: float, maximum: float) -> Any:
    """Return a field for a number or a list of numbers, with unit and bounds."""
    return field(metadata={"unit": unit, "minimum": minimum, "maximum": maximum, "optional": False, "width": None})


def optional_quantity(unit: str, minimum: float, maximum: float) -> Any:
    """Return an optional field for a number, with unit and bounds."""
    metadata = {"unit": unit, "minimum": minimum, "maximum": maximum, "optional": True, "width": None}
    return field(default=0.0, metadata=metadata)


def tendon_quantity(unit: str, minimum: float, maximum: float, absent: float = math.nan) -> Any:
    """Return a field for a number that actuators with tendons have, else ``absent``."""
    metadata = {"unit": unit, "minimum": minimum, "maximum": maximum, "optional": False, "width": None}
    return field(metadata=metadata | {"tendons": True, "absent": absent})


def mechanism_quantity(unit: str, minimum: float, maximum: float) -> Any:
    """Return a field for a number that actuators without tendons have, inf for others."""
    metadata = {"unit": unit, "minimum": minimum, "maximum": maximum, "optional": False, "width": None}
    return field(metadata=metadata | {"tendons": False, "absent": math.inf})


_ANY_WIDTH = -1


def required_list(unit: str, minimum: float, maximum: float, *, rows: bool = False) -> Any:
    """Return a field for a list of numbers, or of rows of numbers, with unit and bounds."""
    width = _ANY_WIDTH if rows else None
    return field(metadata={"unit": unit, "minimum": minimum, "maximum": maximum, "optional": False, "width": width})


def alternative(unit: str, width: int | None = None) -> Any:
    """Return an optional field for a list of numbers, or of rows of ``width`` numbers."""
    return field(metadata={"unit": unit, "minimum": -math.inf, "maximum": math.inf, "optional": True, "width": width})


def select_entries(kind: type, *, has_tendons: bool) -> "list[Field[Any]]":
    """Return the entries of a section that an actuator with or without tendons has."""
    return [entry for entry in fields(kind) if entry.metadata.get("tendons", has_tendons) == has_tendons]


def read_section(
    file: str, section: str, kind: type, table: Any, *, has_tendons: bool = True
) -> tuple[dict[str, Value], dict[str, str]]:
    """Return values and sources of a section by entry. Raises ParameterError."""
    known = {entry.name: entry for entry in select_entries(kind, has_tendons=has_tendons)}
    if not isinstance(table, dict):
        raise ParameterError(messages.section_without_entries(file=file, section=section, value=table))
    values: dict[str, Value] = {}
    sources: dict[str, str] = {}
    for name, entries in table.items():
        if name not in known:
            raise ParameterError(messages.unknown_parameter(file=file, section=section, name=name, known=list(known)))
        label, entry = f"{file}: {section}.{name}", known[name]
        if not isinstance(entries, dict) or set(entries) != {"value", "unit", "source"}:
            raise ParameterError(messages.parameter_incomplete(label=label, unit=entry.metadata["unit"]))
        if entries["unit"] != entry.metadata["unit"]:
            raise ParameterError(
                messages.parameter_in_other_unit(label=label, unit=entries["unit"], expected=entry.metadata["unit"])
            )
        values[name] = _value(label, entries["value"], entry)
        sources[name] = str(entries["source"])
    return values, sources


def fill_defaults(
    file: str, section: str, kind: type, values: dict[str, Value], *, has_tendons: bool = True
) -> dict[str, Value]:
    """Return all entries of a section with defaults, or (), for the optional ones.

    Raises ParameterError for a missing entry.
    """
    for entry in select_entries(kind, has_tendons=has_tendons):
        if entry.name not in values and not entry.metadata["optional"]:
            raise ParameterError(
                messages.parameter_incomplete(label=f"{file}: {section}.{entry.name}", unit=entry.metadata["unit"])
            )
    defaults: dict[str, Value] = {
        item.name: item.metadata.get("absent", ()) if item.default is MISSING else item.default for item in fields(kind)
    }
    return defaults | values


def _value(label: str, value: Any, entry: "Field[Any]") -> Value:
    if entry.type is float:
        return _number(label, value, entry)
    width = entry.metadata["width"]
    if not isinstance(value, list) or not value:
        items = "numbers" if width is None else "rows"
        raise ParameterError(messages.parameter_is_not_a_list(label=label, value=value, items=items))
    if width is None:
        return tuple(_number(label, item, entry) for item in value)
    for row in value:
        if not isinstance(row, list) or len(row) not in (width, *([len(value[0])] if width == _ANY_WIDTH else [])):
            raise ParameterError(
                messages.row_of_other_length(label=label, row=row, length=width, unit=entry.metadata["unit"])
            )
    return tuple(tuple(_number(label, item, entry) for item in row) for row in value)


def _number(label: str, value: Any, entry: "Field[Any]") -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ParameterError(messages.parameter_not_finite(label=label, value=value))
    low, high, unit = entry.metadata["minimum"], entry.metadata["maximum"], entry.metadata["unit"]
    if not low <= value <= high:
        raise ParameterError(
            messages.parameter_out_of_range(label=label, value=value, minimum=low, maximum=high, unit=unit)
        )
    return float(value)


# Parameter sections --------------------------------------------------------------------------------
# Sections of a parameter file, each entry with its unit and bounds.


Side = Literal["A", "B"]
SIDES: tuple[Side, ...] = get_args(Side)


@dataclass(frozen=True)
class Geometry:
    """Reel and pulley radii, joint inertia and damping, joint range (±)."""

    r_m: float = tendon_quantity("m", 1e-4, 1.0)
    r_j: float = quantity("m", 1e-3, 1.0)
    J_j: float = quantity("kg·m²", 1e-7, 10.0)
    B_j: float = quantity("N·m·s/rad", 0.0, 100.0)
    q_max: float = quantity("rad", 0.01, 10.0)


@dataclass(frozen=True)
class SpringParameters:
    """Force over elongation, as a polynomial (lowest power first) or measured points.

    ``x_solid`` is the elongation at which the spring turns solid.
    """

    k: tuple[float, ...] = alternative("N/m^i")
    points: tuple[tuple[float, ...], ...] = alternative("m, N", width=2)
    x_solid: float = quantity("m", 1e-3, 1.0)
    k_solid: float = quantity("N/m", 1.0, 1e6)

    def make_spring(self, factor: float = 1.0) -> Spring:
        """Return the spring with its force multiplied by ``factor``. Raises ValueError."""
        if not self.points and not self.k:
            return NO_SPRING
        if self.points:
            x, F = np.array(self.points).T
            return tabulated_spring(x, factor * F, self.x_solid, self.k_solid)
        return polynomial_spring(tuple(factor * k for k in self.k), self.x_solid, self.k_solid)


@dataclass(frozen=True)
class MotorParameters:
    """Geared motor at its outlet (equations 8, 9, 17), friction, output range (±).

    The last four enable static friction (LuGre); if ``sigma_0`` is missing or 0, friction is smoothed.
    """

    K_m: float = quantity("rad/(V·s)", 1e-3, 1e3)
    T_m: float = quantity("s", 1e-3, 10.0)
    K_t: float = quantity("N·m/V", 1e-4, 1e3)
    tau_e: float = quantity("s", 1e-3, 0.1)
    c0: float = quantity("N·m", 0.0, 10.0)
    c1: float = quantity("1", 0.0, 0.9)
    omega_smooth: float = quantity("rad/s", 1e-3, 1.0)
    u_max: float = quantity("V", 0.1, 10.0)
    sigma_0: float = optional_quantity("N·m/rad", 0.0, 1e5)
    sigma_1: float = optional_quantity("N·m·s/rad", 0.0, 1e3)
    stiction_ratio: float = optional_quantity("1", 1.0, 10.0)
    omega_s: float = optional_quantity("rad/s", 1e-4, 10.0)

    def make_motor(self, factor: float = 1.0) -> Motor:
        """Return the motor with its torque constant multiplied by ``factor``."""
        B_m = self.K_t / self.K_m
        lugre = LuGre(self.sigma_0, self.sigma_1, self.stiction_ratio, self.omega_s) if self.sigma_0 > 0.0 else None
        friction = Friction(self.c0, self.c1, self.omega_smooth, lugre)
        return Motor(B_m * self.T_m, B_m, factor * self.K_t, self.tau_e, friction)

    @property
    def stiction(self) -> float:
        """Ratio of break-away torque to Coulomb friction [1]; 1 if friction is smoothed."""
        return self.stiction_ratio if self.sigma_0 > 0.0 else 1.0


@dataclass(frozen=True)
class Identified:
    """Identified motor (equation 17) and spring, as the controller uses them."""

    K_m: float = quantity("rad/(V·s)", 1e-3, 1e3)
    T_m: float = quantity("s", 1e-3, 10.0)
    k: tuple[float, ...] = alternative("N/m^i")
    points: tuple[tuple[float, ...], ...] = alternative("m, N", width=2)


@dataclass(frozen=True)
class Asymmetry:
    """Factors on the force of each spring and on the torque constant of each motor."""

    spring_A: float = quantity("1", 0.5, 2.0)
    spring_B: float = quantity("1", 0.5, 2.0)
    motor_A: float = quantity("1", 0.5, 2.0)
    motor_B: float = quantity("1", 0.5, 2.0)


@dataclass(frozen=True)
class Sensors:
    """Encoder counts per revolution, load cell delay and noise, converter resolution.

    Counts and resolution of 0 mean exact.
    """

    joint_counts: float = quantity("1/rev", 0.0, 1e7)
    motor_counts: float = quantity("1/rev", 0.0, 1e7)
    force_delay: float = tendon_quantity("s", 0.0, 0.060, absent=0.0)
    force_noise: float = tendon_quantity("N", 0.0, 10.0, absent=0.0)
    converter_bits: float = quantity("1", 0.0, 24.0)

    @property
    def joint_step(self) -> float:
        """One count of the joint encoder [rad], 0 if it is exact."""
        return 2.0 * math.pi / self.joint_counts if self.joint_counts else 0.0

    @property
    def motor_step(self) -> float:
        """One count of a motor encoder [rad], 0 if it is exact."""
        return 2.0 * math.pi / self.motor_counts if self.motor_counts else 0.0


@dataclass(frozen=True)
class Safety:
    """Limit of the independent safety module on tendon force, or on deflection.

    Its limit of the joint angle is ``Geometry.q_max``.
    """

    F_max: float = tendon_quantity("N", 1.0, 1e4)
    deflection_max: float = mechanism_quantity("rad", 1e-3, 3.2)


@dataclass(frozen=True)
class OperatingRange:
    """Range of the preset and of the stiffness references of a mechanism."""

    preset_min: float = quantity("rad", -1e3, 1e3)
    preset_max: float = quantity("rad", -1e3, 1e3)
    S_min: float = quantity("N·m/rad", 1e-4, 1e5)
    S_max: float = quantity("N·m/rad", 1e-4, 1e5)


@dataclass(frozen=True)
class BidirectionalParameters(OperatingRange):
    """Springs with the load p e^(κ d) − n e^(−κ d), of motor A and of motor B."""

    p: tuple[float, ...] = required_list("N·m", 0.0, 1e3)
    n: tuple[float, ...] = required_list("N·m", 0.0, 1e3)
    kappa: tuple[float, ...] = required_list("1/rad", 1e-2, 1e3)

    def make_mechanism(self, factor_A: float = 1.0, factor_B: float = 1.0) -> Mechanism:
        """Return the mechanism with its springs multiplied by the factors."""
        p, n, kappa = self.p, self.n, self.kappa
        return Bidirectional(
            p_A=factor_A * p[0],
            n_A=factor_A * n[0],
            kappa_A=kappa[0],
            p_B=factor_B * p[1],
            n_B=factor_B * n[1],
            kappa_B=kappa[1],
        )


@dataclass(frozen=True)
class LeverParameters(OperatingRange):
    """Lever whose pivot motor B moves: y = y_0 + lead θ_B."""

    K_s: float = quantity("N·m/rad", 1e-3, 1e5)
    L: float = quantity("m", 1e-3, 1.0)
    r_t: float = quantity("m", 1e-4, 1.0)
    y_0: float = quantity("m", 0.0, 1.0)
    lead: float = quantity("m/rad", 1e-6, 1.0)

    def make_mechanism(self, factor_A: float = 1.0, factor_B: float = 1.0) -> Mechanism:
        """Return the mechanism with its spring multiplied by both factors."""
        return Lever(factor_A * factor_B * self.K_s, self.L, self.r_t, self.y_0, self.lead)


@dataclass(frozen=True)
class PretensionParameters(OperatingRange):
    """Spring between an arm B and a point at distance C; motor B winds it on radius r."""

    B: float = quantity("m", 1e-4, 1.0)
    C: float = quantity("m", 1e-4, 1.0)
    r: float = quantity("m", 1e-5, 1.0)
    kappa: float = quantity("N/m", 1.0, 1e7)

    def make_mechanism(self, factor_A: float = 1.0, factor_B: float = 1.0) -> Mechanism:
        """Return the mechanism with its spring multiplied by both factors."""
        return Pretension(self.B, self.C, self.r, factor_A * factor_B * self.kappa)


@dataclass(frozen=True)
class TableParameters(OperatingRange):
    """Measured torque and stiffness: one row per deflection, one column per preset.

    ``antagonistic`` is 1 if half the difference of the motors is the preset, 0 if motor B alone is.
    """

    antagonistic: float = quantity("1", 0.0, 1.0)
    delta: tuple[float, ...] = required_list("rad", -3.2, 3.2)
    preset: tuple[float, ...] = required_list("rad", -1e3, 1e3)
    torque: tuple[tuple[float, ...], ...] = required_list("N·m", -1e4, 1e4, rows=True)
    stiffness: tuple[tuple[float, ...], ...] = required_list("N·m/rad", -1e5, 1e5, rows=True)

    def make_mechanism(self, factor_A: float = 1.0, factor_B: float = 1.0) -> Mechanism:
        """Return the mechanism with its torque multiplied by both factors.

        Raises ValueError.
        """
        factor = factor_A * factor_B
        return build_torque_table(
            np.array(self.delta),
            np.array(self.preset),
            factor * np.array(self.torque),
            factor * np.array(self.stiffness),
            ANTAGONISTIC_AXES if self.antagonistic else SERIES_AXES,
        )


MechanismParameters = BidirectionalParameters | LeverParameters | PretensionParameters | TableParameters


SECTIONS: dict[str, type] = {
    "geometry": Geometry,
    "spring": SpringParameters,
    "motor": MotorParameters,
    "identified": Identified,
    "asymmetry": Asymmetry,
    "sensors": Sensors,
    "safety": Safety,
}
SIDED: dict[str, type] = {
    f"{name}_{side}": SECTIONS[name] for name in ("spring", "motor", "identified") for side in SIDES
}


MECHANISMS: dict[str, type] = {
    "bidirectional": BidirectionalParameters,
    "lever": LeverParameters,
    "pretension": PretensionParameters,
    "table": TableParameters,
}
"""Sections of mechanisms, of which a file without tendons has one."""

_WITHOUT_TENDONS = SpringParameters(k=(), points=(), x_solid=math.inf, k_solid=0.0)


# Stiction checks -----------------------------------------------------------------------------------
# Consistency of a motor's parameters for static friction.


_COMPANIONS = ("sigma_1", "stiction_ratio", "omega_s")


def require_stiction(label: str, motor: MotorParameters, *, is_given: bool) -> None:
    """Raise ParameterError for inconsistent friction parameters.

    ``is_given``: ``sigma_0`` is in the file, possibly as 0.
    """
    if motor.sigma_0 == 0.0:
        others = [name for name in _COMPANIONS if getattr(motor, name) != 0.0]
        if others and not is_given:
            raise ParameterError(messages.static_friction_undecided(label=label, given=others))
        return
    for name in ("stiction_ratio", "omega_s"):
        if getattr(motor, name) == 0.0:
            raise ParameterError(messages.static_friction_incomplete(label=label, missing=name))
    if motor.c0 == 0.0:
        raise ParameterError(messages.static_friction_without_coulomb_friction(label=label))
    _require_resolved_stiction(label, motor)


def _require_resolved_stiction(label: str, motor: MotorParameters) -> None:
    """Raise ParameterError for bristles too stiff for the Runge-Kutta steps."""
    rate_max, J_m = SUBSTEPS / T_s, motor.make_motor().J_m
    for name, rate in (("sigma_0", math.sqrt(motor.sigma_0 / J_m)), ("sigma_1", motor.sigma_1 / J_m)):
        if rate > rate_max:
            raise ParameterError(
                messages.bristles_too_stiff(
                    label=label, name=name, value=getattr(motor, name), J_m=J_m, rate=rate, rate_max=rate_max
                )
            )


# Parameters ----------------------------------------------------------------------------------------


SHIPPED = ("ideal", "lab", "lab-stick")

OF_OTHER_MECHANISMS = ("qbmove", "bavs", "awas2", "maccepa")
"""Sets of actuators without tendons."""

_FOLDER = Path(__file__).parent / "parameters"


@dataclass(frozen=True)
class PlantParameters:
    """One named parameter set.

    ``sources`` maps "section.entry" to the source of the number; ``sided`` maps a section such as "motor_B" to the
    entries in which that side differs. ``mechanism`` is None for two tendons.
    """

    name: str
    geometry: Geometry
    spring: SpringParameters
    motor: MotorParameters
    identified: Identified
    asymmetry: Asymmetry
    sensors: Sensors
    safety: Safety
    sources: dict[str, str]
    sided: dict[str, dict[str, Any]] = field(default_factory=dict)
    mechanism: MechanismParameters | None = None

    @property
    def mechanism_name(self) -> str:
        """Name of the mechanism's section, "tendons" for two tendons."""
        return next((name for name, kind in MECHANISMS.items() if isinstance(self.mechanism, kind)), "tendons")

    @property
    def axes(self) -> MotorAxes:
        """Directions of the motor angles."""
        if self.mechanism is None:
            return tendon_axes(self.geometry.r_m, self.geometry.r_j)
        return motor_axes(self.mechanism.make_mechanism())

    def select_spring(self, side: Side) -> SpringParameters:
        """Return the spring of one side, without its asymmetry factor."""
        return replace(self.spring, **self.sided.get(f"spring_{side}", {}))

    def select_motor(self, side: Side) -> MotorParameters:
        """Return the motor of one side, without its asymmetry factor."""
        return replace(self.motor, **self.sided.get(f"motor_{side}", {}))

    def select_identified(self, side: Side) -> Identified:
        """Return the identified motor and spring of one side."""
        return replace(self.identified, **self.sided.get(f"identified_{side}", {}))

    def select_identified_spring(self, side: Side) -> SpringParameters:
        """Return the identified spring of one side; x_solid and k_solid are the plant's."""
        known = self.select_identified(side)
        return replace(self.select_spring(side), k=known.k, points=known.points)

    def make_identified_spring(self, side: Side) -> Spring:
        """Return the identified spring of one side for the compiled functions."""
        return self.select_identified_spring(side).make_spring()

    def with_identified(self, sections: dict[str, dict[str, dict[str, Any]]]) -> "PlantParameters":
        """Return the parameters with these identified sections, as in ``to_document``.

        Returns itself for an empty mapping. Raises ParameterError.
        """
        if not sections:
            return self
        sections_kept = {
            name: entries for name, entries in self.to_document().items() if not name.startswith("identified")
        }
        return parse_parameters(self.name, sections_kept | sections)

    def make_dynamics(self) -> Dynamics:
        """Return the constants of the simulated plant (method section 1).

        The factors of asymmetry are included.
        """
        factor = self.asymmetry
        mechanism = None
        if self.mechanism is not None:
            mechanism = self.mechanism.make_mechanism(factor.spring_A, factor.spring_B)
        return Dynamics(
            joint=self._make_joint(),
            motor_A=self.select_motor("A").make_motor(factor.motor_A),
            motor_B=self.select_motor("B").make_motor(factor.motor_B),
            spring_A=self.select_spring("A").make_spring(factor.spring_A),
            spring_B=self.select_spring("B").make_spring(factor.spring_B),
            mechanism=mechanism,
        )

    def make_identified_dynamics(self) -> Dynamics:
        """Return the constants that the controller uses: identified, without friction."""

        def motor(side: Side) -> Motor:
            known = self.select_identified(side)
            return replace(
                self.select_motor(side), K_m=known.K_m, T_m=known.T_m, c0=0.0, c1=0.0, sigma_0=0.0
            ).make_motor()

        return Dynamics(
            joint=self._make_joint(),
            motor_A=motor("A"),
            motor_B=motor("B"),
            spring_A=self.make_identified_spring("A"),
            spring_B=self.make_identified_spring("B"),
            mechanism=None if self.mechanism is None else self.mechanism.make_mechanism(),
        )

    def _make_joint(self) -> Joint:
        g = self.geometry
        return Joint(g.r_m, g.r_j, g.J_j, g.B_j)

    def to_document(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Return all numbers by section and entry as {value, unit, source}, for JSON."""
        has_tendons = self.mechanism is None
        entries = {name: vars(getattr(self, name)) for name in SECTIONS if has_tendons or name != "spring"} | self.sided
        if self.mechanism is not None:
            entries[self.mechanism_name] = vars(self.mechanism)
        return {
            section: {
                entry.name: {
                    "value": _convert_to_lists(entries[section][entry.name]),
                    "unit": entry.metadata["unit"],
                    "source": self.sources.get(f"{section}.{entry.name}", ""),
                }
                for entry in select_entries(kind, has_tendons=has_tendons)
                if self._is_given(section, entry, entries[section])
            }
            for section, kind in (SECTIONS | SIDED | MECHANISMS).items()
            if section in entries
        }

    def _is_given(self, section: str, entry: "Field[Any]", entries: dict[str, Any]) -> bool:
        """Return whether a section gives an entry; the document omits what the file omits."""
        value = entries.get(entry.name, ())
        return value != () and (value != entry.default or f"{section}.{entry.name}" in self.sources)


def load_parameters(name_or_path: str | Path) -> PlantParameters:
    """Load a set of ``SHIPPED`` or a TOML file.

    Raises ParameterError naming the entry, its bound and unit.
    """
    path = _FOLDER / f"{name_or_path}.toml" if name_or_path in (*SHIPPED, *OF_OTHER_MECHANISMS) else Path(name_or_path)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))  # some editors write a BOM
    except OSError as error:
        raise ParameterError(messages.parameters_unreadable(name=str(name_or_path), shipped=SHIPPED)) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ParameterError(messages.parameters_are_not_toml(file=path.name, reason=str(error))) from error
    if len(path.stem) > FILE_NAME_MAX:
        raise ParameterError(messages.parameters_name_too_long(name=path.stem, maximum=FILE_NAME_MAX))
    return parse_parameters(path.stem, document, path.name)


def require_tendons(parameters: PlantParameters) -> None:
    """Raise ParameterError for an actuator without tendons and load cells."""
    if parameters.mechanism is not None:
        raise ParameterError(messages.tendons_required(name=parameters.name, mechanism=parameters.mechanism_name))


def parse_parameters(name: str, document: dict[str, Any], file: str = "") -> PlantParameters:
    """Return the set ``name`` from a document of ``to_document`` or a TOML file.

    Raises ParameterError naming the entry, its bound and unit, and the ``file``.
    """
    file = file or name
    kinds = SECTIONS | SIDED | MECHANISMS
    for section in document:
        if section not in kinds:
            raise ParameterError(messages.unknown_section(file=file, section=section, known=list(kinds)))
    named = [section for section in MECHANISMS if section in document]
    has_tendons = not named
    if len(named) > 1 or (named and any(section.startswith("spring") for section in document)):
        springs = [section for section in document if section.startswith("spring")]
        raise ParameterError(messages.several_mechanisms(file=file, sections=[*named, *springs]))
    sources: dict[str, str] = {}
    entries: dict[str, dict[str, Value]] = {}
    for section, kind in kinds.items():
        if section in document or (section in SECTIONS and (has_tendons or section != "spring")):
            entries[section], section_sources = read_section(
                file, section, kind, document.get(section, {}), has_tendons=has_tendons
            )
            sources |= {f"{section}.{name}": source for name, source in section_sources.items()}
    parts = {
        section: kind(**fill_defaults(file, section, kind, entries[section], has_tendons=has_tendons))
        for section, kind in (SECTIONS | MECHANISMS).items()
        if section in entries
    }
    mechanism = parts.pop(named[0]) if named else None
    sided = {section: _only_one_curve(entries[section]) for section in SIDED if section in entries}
    parameters = PlantParameters(
        name=name, sources=sources, sided=sided, mechanism=mechanism, **{"spring": _WITHOUT_TENDONS, **parts}
    )
    _check(file, parameters)
    return parameters


def _only_one_curve(entries: dict[str, Value]) -> dict[str, Value]:
    """Let a curve of one side replace a curve of the other kind for both sides.

    A polynomial replaces points, and points replace a polynomial.
    """
    if "k" in entries:
        return {"points": (), **entries}
    return {"k": (), **entries} if "points" in entries else entries


def _check(file: str, parameters: PlantParameters) -> None:
    if parameters.mechanism is not None:
        _check_mechanism(file, parameters.mechanism_name, parameters.mechanism, parameters.safety.deflection_max)
    F_max = parameters.safety.F_max
    for side in SIDES:
        if "u_max" in parameters.sided.get(f"motor_{side}", {}):
            raise ParameterError(messages.output_range_of_one_side(file=file, side=side))
        section_name = f"motor_{side}" if f"motor_{side}" in parameters.sided else "motor"
        is_given = any(f"{section}.sigma_0" in parameters.sources for section in ("motor", section_name))
        require_stiction(f"{file}: {section_name}", parameters.select_motor(side), is_given=is_given)
        if parameters.mechanism is not None:
            continue
        for section in ("spring", "identified"):
            label = f"{file}: {section}_{side}" if f"{section}_{side}" in parameters.sided else f"{file}: {section}"
            known = parameters.select_spring(side) if section == "spring" else parameters.select_identified(side)
            if bool(known.k) == bool(known.points):
                raise ParameterError(messages.spring_without_one_curve(label=label))
            if known.k and not 3 <= len(known.k) <= 6:
                raise ParameterError(messages.spring_order_out_of_range(label=label, coefficients=len(known.k)))
            try:
                if section == "spring":
                    spring = parameters.select_spring(side).make_spring()
                else:
                    spring = parameters.make_identified_spring(side)
                    require_stiffening(spring)
            except ValueError as error:
                raise ParameterError(messages.spring_unusable(label=label, reason=str(error))) from error
            if spring.F_solid > 1.2 * F_max:
                raise ParameterError(
                    messages.spring_force_too_large(
                        label=label, x_solid=spring.x_solid, F_solid=spring.F_solid, F_max=F_max
                    )
                )


def _check_mechanism(file: str, section: str, mechanism: MechanismParameters, deflection_max: float) -> None:
    """Raise ParameterError for a mechanism that does not reach its range of stiffness.

    At rest, too, its deflection must be below that at which the safety module trips.
    """
    if isinstance(mechanism, BidirectionalParameters):
        for name, values in (("p", mechanism.p), ("n", mechanism.n), ("kappa", mechanism.kappa)):
            if len(values) != len(SIDES):
                raise ParameterError(messages.not_one_value_per_motor(label=f"{file}: {section}.{name}", values=values))
    try:
        elastic = mechanism.make_mechanism()
    except ValueError as error:
        raise ParameterError(messages.mechanism_unusable(label=f"{file}: {section}", reason=str(error))) from error
    presets = np.linspace(mechanism.preset_min, mechanism.preset_max, 201)
    S = np.array([compute_rest(elastic, preset)[1] for preset in presets])
    if not (mechanism.preset_min < mechanism.preset_max and np.all(np.diff(S) > 0.0)):
        raise ParameterError(
            messages.stiffness_does_not_rise(
                label=f"{file}: {section}", minimum=mechanism.preset_min, maximum=mechanism.preset_max
            )
        )
    axes = motor_axes(elastic)
    theta_A, theta_B = axes.n_A * mechanism.preset_max, axes.n_B * mechanism.preset_max
    deflection = abs(elastic_deflection(elastic, compute_rest(elastic, mechanism.preset_max)[0], theta_A, theta_B))
    if not deflection < deflection_max:
        raise ParameterError(
            messages.deflected_beyond_trip_at_rest(
                label=f"{file}: safety.deflection_max", deflection=deflection, maximum=deflection_max
            )
        )
    if not S[0] <= mechanism.S_min < mechanism.S_max <= S[-1]:
        raise ParameterError(
            messages.stiffness_range_not_reached(
                label=f"{file}: {section}",
                S_min=mechanism.S_min,
                S_max=mechanism.S_max,
                lowest=float(S[0]),
                highest=float(S[-1]),
            )
        )


def _convert_to_lists(value: Any) -> Any:
    return [_convert_to_lists(item) for item in value] if isinstance(value, tuple) else value
