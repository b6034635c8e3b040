"""Parameter sets of the plant: frozen dataclasses loaded from TOML, each number with its unit and its source.

``motor`` and ``spring`` are the true plant, ``identified`` is what the controller knows of it. A section such as
``motor_B`` gives entries of ``motor`` that differ on side B.
"""

import tomllib
from dataclasses import Field, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from plant.choice import FILE_NAME_MAX
from plant.dynamics import Dynamics
from plant.joint import Joint
from plant.motor import Motor
from plant.parameter_entries import ParameterError as ParameterError
from plant.parameter_entries import Value, completed, read_section
from plant.parameter_sections import (
    SECTIONS,
    SIDED,
    SIDES,
    Asymmetry,
    Geometry,
    Identified,
    MotorParameters,
    Safety,
    Sensors,
    Side,
    SpringParameters,
)
from plant.spring import Spring, require_stiffening
from plant.stiction_checks import require_stiction

SHIPPED = ("ideal", "lab", "lab-stick")

_FOLDER = Path(__file__).parent / "parameters"


@dataclass(frozen=True)
class PlantParameters:
    """One named parameter set.

    ``sources`` maps "section.entry" to where the number comes from; ``sided`` maps a section such as "motor_B" to the
    entries in which that side differs.
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

    def spring_of(self, side: Side) -> SpringParameters:
        """Spring of one side, without its asymmetry factor."""
        return replace(self.spring, **self.sided.get(f"spring_{side}", {}))

    def motor_of(self, side: Side) -> MotorParameters:
        """Motor of one side, without its asymmetry factor."""
        return replace(self.motor, **self.sided.get(f"motor_{side}", {}))

    def identified_of(self, side: Side) -> Identified:
        """Motor and spring of one side as the controller knows them."""
        return replace(self.identified, **self.sided.get(f"identified_{side}", {}))

    def identified_curve(self, side: Side) -> SpringParameters:
        """Spring of one side as the controller knows it; that it turns solid is the plant's own."""
        known = self.identified_of(side)
        return replace(self.spring_of(side), k=known.k, points=known.points)

    def identified_spring(self, side: Side) -> Spring:
        """Return ``identified_curve`` ready for the compiled functions."""
        return self.identified_curve(side).spring()

    def with_identified(self, sections: dict[str, dict[str, dict[str, Any]]]) -> "PlantParameters":
        """Return the same plant of which the controller knows this, as ``document`` says it; as it is for nothing.

        Raises ParameterError.
        """
        if not sections:
            return self
        kept = {name: entries for name, entries in self.document().items() if not name.startswith("identified")}
        return parameters_of(self.name, kept | sections)

    def dynamics(self) -> Dynamics:
        """Constants of the simulated plant, asymmetry included. Source: method section 1."""
        factor = self.asymmetry
        return Dynamics(
            joint=self._joint(),
            motor_A=self.motor_of("A").motor(factor.motor_A),
            motor_B=self.motor_of("B").motor(factor.motor_B),
            spring_A=self.spring_of("A").spring(factor.spring_A),
            spring_B=self.spring_of("B").spring(factor.spring_B),
        )

    def identified_dynamics(self) -> Dynamics:
        """Constants of the plant as the controller knows it: identified motors and springs, no friction."""

        def motor(side: Side) -> Motor:
            known = self.identified_of(side)
            return replace(self.motor_of(side), K_m=known.K_m, T_m=known.T_m, c0=0.0, c1=0.0, sigma_0=0.0).motor()

        springs = self.identified_spring("A"), self.identified_spring("B")
        return Dynamics(self._joint(), motor("A"), motor("B"), *springs)

    def _joint(self) -> Joint:
        g = self.geometry
        return Joint(g.r_m, g.r_j, g.J_j, g.B_j)

    def document(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Return all numbers by section and entry, each {value, unit, source}, as JSON can hold them."""
        given = {name: vars(getattr(self, name)) for name in SECTIONS} | self.sided
        return {
            section: {
                entry.name: {
                    "value": _listed(given[section][entry.name]),
                    "unit": entry.metadata["unit"],
                    "source": self.sources.get(f"{section}.{entry.name}", ""),
                }
                for entry in fields(kind)
                if self._has(section, entry, given[section])
            }
            for section, kind in (SECTIONS | SIDED).items()
            if section in given
        }

    def _has(self, section: str, entry: "Field[Any]", given: dict[str, Any]) -> bool:
        """Whether a section says anything of an entry: what a file leaves out, its document leaves out."""
        value = given.get(entry.name, ())
        return value != () and (value != entry.default or f"{section}.{entry.name}" in self.sources)


def load_parameters(name_or_path: str | Path) -> PlantParameters:
    """Load a set of ``SHIPPED`` or a TOML file. Raises ParameterError naming the entry, its bound and unit."""
    path = _FOLDER / f"{name_or_path}.toml" if name_or_path in SHIPPED else Path(name_or_path)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))  # some editors begin a file with a BOM
    except OSError as error:
        shipped = ", ".join(SHIPPED)
        raise ParameterError(
            f"parameter set {str(name_or_path)!r} cannot be read: use one of {shipped} or a TOML file"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path.name} is not a TOML file: {error}") from error
    if len(path.stem) > FILE_NAME_MAX:
        raise ParameterError(
            f"the name of the file {path.stem[:40]}... has {len(path.stem)} characters, {FILE_NAME_MAX} are the most: "
            "rename the file"
        )
    return parameters_of(path.stem, document, path.name)


def parameters_of(name: str, document: dict[str, Any], file: str = "") -> PlantParameters:
    """Build the set called ``name`` from a document as ``PlantParameters.document`` gives it and TOML files hold it.

    Raises ParameterError naming the entry, its bound and unit, and the ``file``.
    """
    file = file or name
    kinds = SECTIONS | SIDED
    for section in document:
        if section not in kinds:
            raise ParameterError(f"{file}: unknown section {section!r}; known are {', '.join(kinds)}")
    sources: dict[str, str] = {}
    entries: dict[str, dict[str, Value]] = {}
    for section, kind in kinds.items():
        if section in SECTIONS or section in document:
            entries[section], given = read_section(file, section, kind, document.get(section, {}))
            sources |= {f"{section}.{name}": source for name, source in given.items()}
    parts = {section: kind(**completed(file, section, kind, entries[section])) for section, kind in SECTIONS.items()}
    sided = {section: _only_one_curve(entries[section]) for section in SIDED if section in entries}
    parameters = PlantParameters(name=name, sources=sources, sided=sided, **parts)
    _check(file, parameters)
    return parameters


def _only_one_curve(entries: dict[str, Value]) -> dict[str, Value]:
    """Let a polynomial given for one side take the place of the points for both, and the other way round."""
    if "k" in entries:
        return {"points": (), **entries}
    return {"k": (), **entries} if "points" in entries else entries


def _check(file: str, parameters: PlantParameters) -> None:
    F_max = parameters.safety.F_max
    for side in SIDES:
        if "u_max" in parameters.sided.get(f"motor_{side}", {}):
            raise ParameterError(f"{file}: motor_{side}.u_max: the output range is one for both sides, motor.u_max")
        own = f"motor_{side}" if f"motor_{side}" in parameters.sided else "motor"
        given = any(f"{section}.sigma_0" in parameters.sources for section in ("motor", own))
        require_stiction(f"{file}: {own}", parameters.motor_of(side), given=given)
        for section in ("spring", "identified"):
            label = f"{file}: {section}_{side}" if f"{section}_{side}" in parameters.sided else f"{file}: {section}"
            known = parameters.spring_of(side) if section == "spring" else parameters.identified_of(side)
            if bool(known.k) == bool(known.points):
                raise ParameterError(f"{label} must give the spring once, by the polynomial k or by points")
            if known.k and not 3 <= len(known.k) <= 6:
                raise ParameterError(f"{label}.k has {len(known.k)} coefficients: give 3 to 6, for an order of 2 to 5")
            try:
                if section == "spring":
                    spring = parameters.spring_of(side).spring()
                else:
                    spring = parameters.identified_spring(side)
                    require_stiffening(spring)
            except ValueError as error:
                raise ParameterError(f"{label}: {error}") from error
            if spring.F_solid > 1.2 * F_max:
                raise ParameterError(
                    f"{label}: at spring.x_solid = {spring.x_solid:g} m it carries {spring.F_solid:.1f} N, "
                    f"far above safety.F_max = {F_max:g} N"
                )


def _listed(value: Any) -> Any:
    return [_listed(item) for item in value] if isinstance(value, tuple) else value
