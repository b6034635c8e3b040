"""Parameter sets of the plant: frozen dataclasses loaded from TOML, each number with its unit and its source."""

import math
import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from plant.dynamics import Dynamics
from plant.friction import Friction
from plant.joint import Joint
from plant.motor import Motor
from plant.spring import Spring, polynomial_spring, tension

SHIPPED = ("ideal", "lab")

_FOLDER = Path(__file__).parent / "parameters"


class ParameterError(ValueError):
    """A parameter file is missing, incomplete or out of bounds; the message names the entry and the remedy."""


def _quantity(unit: str, minimum: float = -math.inf, maximum: float = math.inf) -> Any:
    return field(metadata={"unit": unit, "minimum": minimum, "maximum": maximum})


@dataclass(frozen=True)
class Geometry:
    """Reel and pulley radii, joint inertia and damping, joint range (±)."""

    r_m: float = _quantity("m", 1e-4, 1.0)
    r_j: float = _quantity("m", 1e-3, 1.0)
    J_j: float = _quantity("kg·m²", 1e-7, 10.0)
    B_j: float = _quantity("N·m·s/rad", 0.0, 100.0)
    q_max: float = _quantity("rad", 0.01, 10.0)


@dataclass(frozen=True)
class SpringParameters:
    """Polynomial of force over elongation, lowest power first, and where it turns solid."""

    k: tuple[float, ...] = _quantity("N/m^i")
    x_solid: float = _quantity("m", 1e-3, 1.0)
    k_solid: float = _quantity("N/m", 1.0, 1e6)


@dataclass(frozen=True)
class MotorParameters:
    """Geared motor seen at the gearbox outlet (equations 8, 9, 17), Coulomb friction, output range (±)."""

    K_m: float = _quantity("rad/(V·s)", 1e-3, 1e3)
    T_m: float = _quantity("s", 1e-3, 10.0)
    K_t: float = _quantity("N·m/V", 1e-4, 1e3)
    tau_e: float = _quantity("s", 1e-3, 0.1)
    c0: float = _quantity("N·m", 0.0, 10.0)
    c1: float = _quantity("1", 0.0, 0.9)
    omega_smooth: float = _quantity("rad/s", 1e-3, 1.0)
    u_max: float = _quantity("V", 0.1, 10.0)


@dataclass(frozen=True)
class Asymmetry:
    """Factors on the force of each spring and on the torque constant of each motor."""

    spring_A: float = _quantity("1", 0.5, 2.0)
    spring_B: float = _quantity("1", 0.5, 2.0)
    motor_A: float = _quantity("1", 0.5, 2.0)
    motor_B: float = _quantity("1", 0.5, 2.0)


@dataclass(frozen=True)
class Sensors:
    """Encoder counts per revolution (0: exact), load cell delay and noise, converter resolution (0: exact)."""

    joint_counts: float = _quantity("1/rev", 0.0, 1e7)
    motor_counts: float = _quantity("1/rev", 0.0, 1e7)
    force_delay: float = _quantity("s", 0.0, 0.060)
    force_noise: float = _quantity("N", 0.0, 10.0)
    converter_bits: float = _quantity("1", 0.0, 24.0)


@dataclass(frozen=True)
class Safety:
    """Bound of the independent safety module on tendon force; the joint's is ``Geometry.q_max``."""

    F_max: float = _quantity("N", 1.0, 1e4)


@dataclass(frozen=True)
class PlantParameters:
    """One named parameter set. ``sources`` maps "section.entry" to where the number comes from."""

    name: str
    geometry: Geometry
    spring: SpringParameters
    motor: MotorParameters
    asymmetry: Asymmetry
    sensors: Sensors
    safety: Safety
    sources: dict[str, str]

    @property
    def nominal_spring(self) -> Spring:
        """The spring as identified: what the controller knows, the same for both sides."""
        return polynomial_spring(self.spring.k, self.spring.x_solid, self.spring.k_solid)

    def document(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Return all numbers by section and entry, each {value, unit, source}, as JSON can hold them."""
        sections = {
            part.name: getattr(self, part.name) for part in fields(self) if part.name not in ("name", "sources")
        }
        return {
            section: {
                entry.name: {
                    "value": list(value) if isinstance(value := getattr(part, entry.name), tuple) else value,
                    "unit": entry.metadata["unit"],
                    "source": self.sources.get(f"{section}.{entry.name}", ""),
                }
                for entry in fields(part)
            }
            for section, part in sections.items()
        }

    def dynamics(self) -> Dynamics:
        """Constants of the simulated plant, asymmetry included. Source: method section 1."""
        g = self.geometry
        return Dynamics(
            joint=Joint(g.r_m, g.r_j, g.J_j, g.B_j),
            motor_A=self._motor(self.asymmetry.motor_A),
            motor_B=self._motor(self.asymmetry.motor_B),
            spring_A=self._spring(self.asymmetry.spring_A),
            spring_B=self._spring(self.asymmetry.spring_B),
        )

    def _motor(self, factor: float) -> Motor:
        m = self.motor
        B_m = m.K_t / m.K_m
        return Motor(B_m * m.T_m, B_m, factor * m.K_t, m.tau_e, Friction(m.c0, m.c1, m.omega_smooth))

    def _spring(self, factor: float) -> Spring:
        s = self.spring
        return polynomial_spring(tuple(factor * k for k in s.k), s.x_solid, s.k_solid)


def load_parameters(name_or_path: str | Path) -> PlantParameters:
    """Load "ideal", "lab" or a TOML file. Raises ParameterError naming the entry, its bound and unit."""
    path = _FOLDER / f"{name_or_path}.toml" if name_or_path in SHIPPED else Path(name_or_path)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        shipped = ", ".join(SHIPPED)
        raise ParameterError(
            f"parameter set {str(name_or_path)!r} cannot be read: use one of {shipped} or a TOML file"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path.name} is not a TOML file: {error}") from error
    sections = {
        "geometry": Geometry,
        "spring": SpringParameters,
        "motor": MotorParameters,
        "asymmetry": Asymmetry,
        "sensors": Sensors,
        "safety": Safety,
    }
    unknown = sorted(set(document) - set(sections))
    if unknown:
        raise ParameterError(f"{path.name}: unknown section {unknown[0]!r}; known are {', '.join(sections)}")
    sources: dict[str, str] = {}
    parts = {name: _section(path.name, name, kind, document.get(name, {}), sources) for name, kind in sections.items()}
    parameters = PlantParameters(name=path.stem, sources=sources, **parts)
    _check_spring(path.name, parameters)
    return parameters


def _section(file: str, section: str, kind: type, table: dict[str, Any], sources: dict[str, str]) -> Any:
    known = {entry.name: entry for entry in fields(kind)}
    for name in table:
        if name not in known:
            raise ParameterError(f"{file}: unknown entry {section}.{name}; known are {', '.join(known)}")
    values: dict[str, Any] = {}
    for name, entry in known.items():
        label = f"{file}: {section}.{name}"
        if not isinstance(table.get(name), dict) or set(table[name]) != {"value", "unit", "source"}:
            raise ParameterError(
                f'{label} must read {{ value = ..., unit = "{entry.metadata["unit"]}", source = "..." }}'
            )
        given = table[name]
        if given["unit"] != entry.metadata["unit"]:
            raise ParameterError(f"{label} is in {given['unit']!r}: give it in {entry.metadata['unit']!r}")
        values[name] = _value(label, given["value"], entry.metadata, entry.type)
        sources[f"{section}.{name}"] = str(given["source"])
    return kind(**values)


def _value(label: str, value: Any, bounds: Any, kind: Any) -> Any:
    many = kind is not float
    numbers = value if many and isinstance(value, list) else [value]
    for number in numbers:
        if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
            raise ParameterError(f"{label} = {number!r} is not a finite number")
        if not bounds["minimum"] <= number <= bounds["maximum"]:
            low, high, unit = bounds["minimum"], bounds["maximum"], bounds["unit"]
            raise ParameterError(f"{label} = {number:g} {unit} is outside {low:g} to {high:g} {unit}")
    return tuple(float(number) for number in numbers) if many else float(value)


def _check_spring(file: str, parameters: PlantParameters) -> None:
    try:
        spring = parameters.nominal_spring
    except ValueError as error:
        raise ParameterError(f"{file}: {error}") from error
    if tension(spring, spring.x_solid) > parameters.safety.F_max * 1.2:
        raise ParameterError(
            f"{file}: spring.x_solid = {spring.x_solid:g} m carries {tension(spring, spring.x_solid):.1f} N, "
            f"far above safety.F_max = {parameters.safety.F_max:g} N"
        )
