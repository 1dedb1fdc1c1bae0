"""Design: what we believe about the drive. Frozen parts, read from and written to TOML without loss."""

from __future__ import annotations

import math
import os
import tomllib
import unicodedata
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, field_validator, model_validator

from pmsm_ctrl.complaints import explain
from pmsm_ctrl.errors import DesignError, NextCommand, nearest
from pmsm_ctrl.files import write_text
from pmsm_ctrl.units import DATASHEET, psi_f_from, torque_constant

__all__ = [
    "Acceptance", "Assumed", "Compensation", "CurrentLoop", "Design", "Drive", "EffectEntry", "Load", "LogMap",
    "Loops", "Motor", "PositionLoop", "Sensor", "SpeedLoop",
]  # fmt: skip

# In SI units everything from a watch's motor to a ship's shaft lies well inside. What lies outside is a slip of the
# unit, and products of such numbers leave what a double can hold.
SMALL, LARGE = 1e-15, 1e15
MAX_FILE = 1 << 24  # bytes of a design
Positive = Annotated[float, Field(ge=SMALL, le=LARGE, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=LARGE, allow_inf_nan=False)]
Finite = Annotated[float, Field(ge=-LARGE, le=LARGE, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, lt=1)]


class Part(BaseModel):
    """A frozen part of a design; an unknown field is an error, and so is a text where a number belongs."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class SheetPart(Part):
    """A part whose fields may go by their names in `pmsm_ctrl.units.DATASHEET`, and are converted once, here."""

    @model_validator(mode="before")
    @classmethod
    def _from_datasheet(cls, data: Any) -> Any:
        return _convert_datasheet(data, cls) if isinstance(data, dict) else data

    @classmethod
    def datasheet_names(cls) -> list[str]:
        """Return the datasheet names that belong in this part."""
        fields = {*cls.model_fields, *(("L",) if "L_q" in cls.model_fields else ())}
        return [name for name, sheet in DATASHEET.items() if sheet.field in fields]


def _convert_datasheet(data: dict[str, Any], part: type[Part]) -> dict[str, Any]:
    """Replace datasheet names by SI fields; two names for one field are an error."""
    out: dict[str, Any] = {}
    origin: dict[str, str] = {}
    for key, value in data.items():
        sheet = DATASHEET.get(key)
        targets = {key: value}
        if sheet is not None:
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{key} must be a number ({sheet.meaning}), not {value!r}")
            pole_pairs = data.get("p")
            if sheet.per_pole_pair and (not isinstance(pole_pairs, int) or pole_pairs < 1):
                raise ValueError(f"{key} needs the pole pairs p, an integer of at least 1")
            si = sheet.to_si(value, pole_pairs or 1)
            targets = {"L_d": si, "L_q": si} if sheet.field == "L" else {sheet.field: si}
        for name, converted in targets.items():
            if name in origin:
                raise ValueError(f"{key} and {origin[name]} both determine {name}; keep one")
            if sheet is not None and name not in part.model_fields:
                raise ValueError(f"{key} does not belong in [{part.__name__.lower()}]")
            origin[name] = key
            out[name] = converted
    return out


class Motor(SheetPart):
    """The machine. Either its electrical data are known, or only its torque constant `K_t` (a plain axis).

    Datasheet names of `pmsm_ctrl.units.DATASHEET` (``J_kg_cm2``, ``K_t_rms``, ``L_line_to_line_mH``, ...) are
    accepted in place of the SI fields and converted once, here.
    """

    J: Positive = Field(description="rotor inertia, kg m^2 (moving mass in kg for a linear axis)")
    p: int | None = Field(default=None, ge=1, le=1000, description="pole pairs")
    psi_f: Positive | None = Field(default=None, description="permanent-magnet flux linkage, Wb")
    R: Positive | None = Field(default=None, description="phase resistance, Ohm")
    L_d: Positive | None = Field(default=None, description="direct-axis inductance, H")
    L_q: Positive | None = Field(default=None, description="quadrature-axis inductance, H")
    K_t: Positive | None = Field(
        default=None, description="torque per unit of the drive signal where no electrical data are known"
    )
    tolerance: dict[str, Fraction] = Field(
        default_factory=lambda: {"J": 0.15, "psi_f": 0.07, "R": 0.15, "L_d": 0.2, "L_q": 0.2},
        description="relative datasheet tolerance of each parameter",
    )

    @model_validator(mode="after")
    def _complete(self) -> Motor:
        electrical = {name: getattr(self, name) for name in ("p", "psi_f", "R", "L_d", "L_q")}
        missing = [name for name, value in electrical.items() if value is None]
        if len(missing) == len(electrical) and self.K_t is None:
            raise ValueError("give p, psi_f (or K_t_peak, K_e_...), R, L_d and L_q, or K_t alone for a plain axis")
        if missing and len(missing) < len(electrical):
            raise ValueError(f"electrical data incomplete: {', '.join(missing)} missing")
        if not missing and self.K_t is not None:
            raise ValueError("K_t follows from p and psi_f; name it K_t_peak or K_t_rms to derive psi_f from it")
        return self

    @property
    def electrical(self) -> bool:
        """Whether resistance, inductances, flux and pole pairs are known."""
        return self.R is not None

    @property
    def torque_constant(self) -> float:
        """K_t in N m per ampere peak: 1.5 p psi_f, or the plain axis' constant."""
        if self.p is not None and self.psi_f is not None:
            return torque_constant(self.p, self.psi_f)
        assert self.K_t is not None  # guaranteed by _complete
        return self.K_t


class Load(Part):
    """What hangs on the motor."""

    J: NonNegative = Field(default=0.0, description="load inertia at the load's own shaft, kg m^2")
    gear: Positive = Field(default=1.0, ge=1e-6, le=1e6, description="motor turns per load turn")


class Drive(SheetPart):
    """Power stage and sampling of the drive."""

    u_dc: Positive = Field(default=560.0, description="dc-link voltage, V")
    i_max: float = Field(default=math.inf, ge=SMALL, description="current limit, A peak", allow_inf_nan=True)
    f_control: Positive = Field(default=16000.0, ge=1.0, le=1e7, description="current control rate = PWM rate, Hz")
    speed_divider: int = Field(default=4, ge=1, le=1000, description="current periods per speed and position period")
    delay_periods: int = Field(default=1, ge=0, le=1, description="computation delay in control periods")
    plant_steps: int = Field(default=1, ge=1, le=64, description="integration steps per control period")

    @property
    def speed_period(self) -> float:
        """Period of the speed and position controllers, s."""
        return self.speed_divider / self.f_control


class Sensor(Part):
    """What the drive sees and what it records."""

    encoder_counts: int = Field(
        default=0, ge=0, le=1 << 48, description="counts per turn (per metre, linear); 0 = ideal"
    )
    current_noise: NonNegative = Field(default=0.0, description="noise of the measured i_d and i_q, A rms")
    speed_filter: NonNegative = Field(default=0.0, description="time constant of the speed filter, s")
    log_divider: int = Field(default=16, ge=1, le=1_000_000, description="control periods per logged sample")


class CurrentLoop(Part):
    """PI current controller: u = K_p (e + 1/T_n integral of e), the same in both axes or per axis."""

    K_p: Positive = Field(description="proportional gain, V/A")
    T_n: Positive = Field(description="reset time, s")
    K_p_d: Positive | None = Field(default=None, description="d-axis gain where it differs, V/A")
    T_n_d: Positive | None = Field(default=None, description="d-axis reset time where it differs, s")


class SpeedLoop(Part):
    """PI speed controller with reference filter: i_q = K_p (e + 1/T_n integral of e)."""

    K_p: NonNegative = Field(description="proportional gain, A/(rad/s)")
    T_n: Positive = Field(description="reset time, s")
    reference_filter: NonNegative = Field(default=0.0, description="time constant of the reference filter, s")


class PositionLoop(Part):
    """Proportional position controller with feedforward: omega = K_v e + k_v omega_ref; i_q += k_a J alpha_ref/K_t."""

    K_v: NonNegative = Field(description="position gain, 1/s")
    velocity_feedforward: NonNegative = Field(default=1.0, description="share of the reference speed fed forward")
    acceleration_feedforward: NonNegative = Field(default=0.0, description="share of J alpha_ref fed forward")


class Loops(Part):
    """The cascade."""

    current: CurrentLoop
    speed: SpeedLoop
    position: PositionLoop = PositionLoop(K_v=0.0)


class Assumed(Part):
    """What the controller and the evaluation believe where that differs from the motor itself."""

    K_t: Positive | None = Field(default=None, description="torque constant known to the controller, N m/A peak")
    R: Positive | None = None
    L_d: Positive | None = None
    L_q: Positive | None = None
    J: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_datasheet(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "K_t_rms" not in data:
            return data
        changed = dict(data)
        changed["K_t"] = changed.pop("K_t_rms") / math.sqrt(2.0)
        return changed


class EffectEntry(Part):
    """One effect of the catalogue with its parameters; `pmsm_ctrl.effects` knows what they mean."""

    id: str
    parameters: dict[str, Finite] = Field(default_factory=dict)
    stderr: dict[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]] = Field(
        default_factory=dict, description="standard errors, where fitted"
    )

    @model_validator(mode="before")
    @classmethod
    def _flat(cls, data: Any) -> Any:
        # In TOML the parameters stand beside the id: id = "coulomb", F_c = 0.02
        if not isinstance(data, dict) or "parameters" in data:
            return data
        rest = {key: value for key, value in data.items() if key not in ("id", "stderr")}
        return {key: data[key] for key in ("id", "stderr") if key in data} | {"parameters": rest}


class Compensation(Part):
    """Feedforward friction compensation."""

    source: Literal["reference", "commanded", "measured", "adaptive"] = "reference"
    gain: NonNegative = Field(default=0.0, description="share of the modelled friction that is fed forward")
    smoothing: NonNegative = Field(default=0.0, description="speed over which the sign is smoothed, rad/s")
    effects: tuple[str, ...] = Field(default=("coulomb", "viscous"), description="effects that are compensated")


class Acceptance(Part):
    """One line of the acceptance: in this scenario this metric must not exceed this limit."""

    scenario: str = Field(description="a trial of the compensation study, or a scenario under position control")
    metric: str = Field(description="rms, peak, reversal_peak, cycle_amplitude, ..., or one of them with _change")
    limit: Finite = Field(description="in SI units; a change as a share, -0.8 for -80 %")
    factor: Positive = Field(default=1.0, description="what the compensated parameters are off by")


class LogMap(Part):
    """How the columns of a foreign file become channels."""

    channels: dict[str, str] = Field(default_factory=dict, description="channel = 'column [unit]' or 'column'")
    scale: dict[str, Finite] = Field(default_factory=dict, description="factor applied to a channel after units")
    separator: str | None = None
    decimal: Literal[".", ","] | None = None


class Design(Part):
    """What we believe about the drive.

    Every part is frozen; `model_copy`, `with_effect` and `without_effect` return changed copies.
    """

    name: str = Field(default="axis", max_length=100, description="one line of printable characters")
    motion: Literal["rotary", "linear"] = Field(default="rotary", description="linear: theta in m, J in kg, T in N")
    motor: Motor
    load: Load = Load()
    drive: Drive = Drive()
    sensor: Sensor = Sensor()
    assumed: Assumed = Assumed()
    loops: Loops | None = None
    effects: tuple[EffectEntry, ...] = ()
    compensation: Compensation = Compensation()
    acceptance: tuple[Acceptance, ...] = ()
    scenarios: dict[str, dict[str, Finite]] = Field(
        default_factory=dict, description="parameters of named scenarios: [scenarios.sweep] speed_max = 200.0"
    )
    log: LogMap = LogMap()
    source: str = Field(default="", exclude=True, repr=False, description="file the design was read from")
    # Code, so never a field: a design file cannot name it, and it takes no part in equality and text.
    _own_effects: tuple[Any, ...] = PrivateAttr(default=())

    @field_validator("name")
    @classmethod
    def _printable(cls, name: str) -> str:
        # it is printed, and stands in reports and in generated code
        if any(unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp") for c in name):
            raise ValueError(f"found {name[:60]!r}; one line of printable characters was expected")
        return name

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Design) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    @property
    def own_effects(self) -> tuple[Any, ...]:
        """The user's own effects (`pmsm_ctrl.effects.Effect`) that the design may name beside the catalogue."""
        return self._own_effects

    def with_own_effects(self, *effects: Any) -> Design:
        """Return a copy that carries own effects, so that every verb knows them.

        They are the design's catalogue, not its list of effects: add one with `with_effect` where the axis has it. They
        stay with every copy and are not written to a file.

        Parameters
        ----------
        *effects : Effect
            Each takes the place of a carried one with the same id.

        Returns
        -------
        Design
        """
        carried = {effect.id: effect for effect in (*self._own_effects, *effects)}
        copy = self.model_copy()
        copy._own_effects = tuple(carried.values())
        return copy

    @property
    def J(self) -> float:
        """Total inertia at the motor shaft: J_motor + J_load / gear^2."""
        return self.motor.J + self.load.J / self.load.gear**2

    @property
    def K_t(self) -> float:
        """The plant's torque constant, N m/A peak."""
        return self.motor.torque_constant

    @property
    def K_t_assumed(self) -> float:
        """The torque constant that the controller and the evaluation use, N m/A peak."""
        return self.assumed.K_t if self.assumed.K_t is not None else self.K_t

    @property
    def log_period(self) -> float:
        """Period at which the drive records, s."""
        return self.sensor.log_divider / self.drive.f_control

    def require_loops(self) -> Loops:
        """Return the loops of a design that has to have some.

        Returns
        -------
        Loops

        Raises
        ------
        DesignError
            When the design has none.
        """
        if self.loops is None:
            raise DesignError(f"{self.source or self.name}: loops: missing", next_command=NextCommand.TUNE)
        return self.loops

    def parameters(self, effect: str) -> dict[str, float]:
        """Return the parameters of the first effect with this id; empty when the design has none."""
        for entry in self.effects:
            if entry.id == effect:
                return dict(entry.parameters)
        return {}

    def with_effect(
        self, effect: str, parameters: dict[str, float] | None = None, stderr: dict[str, float] | None = None
    ) -> Design:
        """Return a copy with the effect added, or its parameters replaced if it is there already."""
        entry = EffectEntry(id=effect, parameters=dict(parameters or {}), stderr=dict(stderr or {}))
        return self.replace_effects((*(e for e in self.effects if e.id != effect), entry))

    def add_effect(self, effect: str, parameters: dict[str, float], stderr: dict[str, float] | None = None) -> Design:
        """Return a copy with one more instance of the effect (a second cogging order, say)."""
        entry = EffectEntry(id=effect, parameters=dict(parameters), stderr=dict(stderr or {}))
        return self.replace_effects((*self.effects, entry))

    def without_effect(self, effect: str) -> Design:
        """Return a copy without any instance of the effect."""
        return self.replace_effects(tuple(e for e in self.effects if e.id != effect))

    def replace_effects(self, effects: tuple[EffectEntry, ...]) -> Design:
        """Return a copy with exactly these effects."""
        return self.model_copy(update={"effects": effects})

    def with_parameters(self, **values: float) -> Design:
        """Return a copy with SI motor parameters changed (`J`, `psi_f`, `R`, `L_d`, `L_q`, `K_t`).

        `J` is the total inertia at the motor shaft; the change is taken by the rotor's share.
        """
        changed = dict(values)
        if "J" in changed:
            changed["J"] -= self.load.J / self.load.gear**2
        if "K_t" in changed and self.motor.p is not None:
            changed["psi_f"] = psi_f_from(changed.pop("K_t"), self.motor.p)
        return self.replace(motor=changed)

    def replace(self, **parts: dict[str, Any]) -> Design:
        """Return a validated copy with fields of parts changed: ``design.replace(sensor={"current_noise": 0})``.

        Raises
        ------
        DesignError
            When a part, a field or a value is not valid.
        """
        data = self.to_dict()
        for part, fields in parts.items():
            if part not in type(self).model_fields:
                raise DesignError(f"no part '{part}' in a design{nearest(part, type(self).model_fields)}")
            if isinstance(fields, dict) and isinstance(data.get(part, {}), dict):
                data[part] = data.get(part, {}) | fields
            else:
                data[part] = fields
        return Design.from_dict(data, source=self.source).with_own_effects(*self._own_effects)

    def to_dict(self) -> dict[str, Any]:
        """Return the design as plain SI values, fit for TOML; defaults are left out."""
        data = self.model_dump(mode="python", exclude_none=True, exclude_defaults=True)
        data["motor"] = self.motor.model_dump(exclude_none=True)
        if self.effects:
            data["effects"] = [
                {"id": e.id, **e.parameters} | ({"stderr": dict(e.stderr)} if e.stderr else {}) for e in self.effects
            ]
        if self.acceptance:
            data["acceptance"] = [a.model_dump(exclude_defaults=True) for a in self.acceptance]
        return _plain(data)

    def to_toml(self) -> str:
        """Return the design as TOML text."""
        return tomli_w.dumps(self.to_dict())

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the design as TOML, atomically."""
        return write_text(path, self.to_toml())

    @classmethod
    def from_dict(cls, data: dict[str, Any], source: str = "") -> Design:
        """Build a design from plain values.

        Raises
        ------
        DesignError
            Naming the file, the field, what was found and what would have been accepted.
        """
        try:
            return cls.model_validate(_lists_to_tuples(data) | {"source": source})
        except ValidationError as error:
            raise DesignError(explain(error, cls, source)) from None

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Design:
        """Read a design from a TOML file.

        Raises
        ------
        DesignError
            When the file is missing, is not TOML, or has a field that is wrong.
        """
        try:
            if Path(path).exists() and not (Path(path).is_file() or Path(path).is_dir()):
                raise DesignError(f"{path}: is no file; a design in TOML was expected")
            if Path(path).stat().st_size > MAX_FILE:
                raise DesignError(f"{path}: larger than {MAX_FILE >> 20} MB; a design in TOML was expected")
            text = Path(path).read_bytes().decode("utf-8")
            data = tomllib.loads(text)
        except FileNotFoundError:
            message = f"{path}: no such file; a design in TOML was expected"
            raise DesignError(message, next_command=NextCommand.INIT) from None
        except OSError as error:
            raise DesignError(f"{path}: cannot be read ({error.strerror})") from None
        except UnicodeDecodeError as error:
            raise DesignError(f"{path}: not UTF-8 text at byte {error.start}; a design in TOML was expected") from None
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise DesignError(f"{path}: not valid TOML: {error}") from None
        except ValueError as error:  # a name with a zero byte
            raise DesignError(f"{path!r}: cannot be read ({error})") from None
        if not data:
            raise DesignError(f"{path}: empty; a design needs at least a [motor] table")
        return cls.from_dict(data, source=str(path))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items() if item not in ({}, ())}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def _lists_to_tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _lists_to_tuples(item) for key, item in value.items()}
    if isinstance(value, list):
        return tuple(_lists_to_tuples(item) for item in value)
    return value
