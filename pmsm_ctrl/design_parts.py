"""The parts of a design: frozen, validated, in SI units or under a datasheet's own names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from pmsm_ctrl.units import DATASHEET, DatasheetValue, rounded, torque_constant

__all__ = [
    "LARGE", "SMALL", "Acceptance", "Assumed", "Compensation", "Drive", "EffectEntry", "Effects", "Evaluated", "Finite",
    "Load", "LogMap", "Motor", "NonNegative", "Part", "Positive", "Sampled", "Sensor",
]  # fmt: skip

# In SI units every machine from a watch to a ship lies well inside. A number outside has a wrong unit, and products of
# such numbers overflow a double. A field with narrower bounds is a plain float: of two bounds pydantic keeps one.
SMALL, LARGE = 1e-15, 1e15
LONG = 1e300  # an integer of more digits is no double
Positive = Annotated[float, Field(ge=SMALL, le=LARGE, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=LARGE, allow_inf_nan=False)]
Finite = Annotated[float, Field(ge=-LARGE, le=LARGE, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, lt=1)]
# Whole numbers stay whole, so that a shaft's are written as such.
PolePairs = Annotated[
    float, Field(ge=1, le=1000, allow_inf_nan=False), AfterValidator(lambda p: int(p) if p == int(p) else p)
]


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
        return [name for name, sheet in cls.sheet().items() if sheet.field in fields]

    @classmethod
    def sheet(cls) -> Mapping[str, DatasheetValue]:
        """Return the datasheet names that are converted."""
        return DATASHEET


def _convert_datasheet(data: dict[str, Any], part: type[SheetPart]) -> dict[str, Any]:
    """Replace datasheet names by SI fields; two names for one field are an error."""
    out: dict[str, Any] = {}
    origin: dict[str, str] = {}
    for key, value in data.items():
        sheet = part.sheet().get(key)
        targets = {key: value}
        if sheet is not None:
            if isinstance(value, bool) or not isinstance(value, int | float) or LONG < abs(value) < math.inf:
                raise ValueError(f"{key} must be a number ({sheet.meaning}), not {value!r:.60}")
            pole_pairs: Any = data.get("p")
            if sheet.per_pole_pair and not (isinstance(pole_pairs, int | float) and pole_pairs >= 1):
                raise ValueError(f"{key} needs the pole pairs p, a number of at least 1")
            si = sheet.to_si(value, pole_pairs if sheet.per_pole_pair else 1)
            targets = {"L_d": si, "L_q": si} if sheet.field == "L" else {sheet.field: si}
        for name, converted in targets.items():
            if name in origin:
                raise ValueError(f"{key} and {origin[name]} both determine {name}; keep one")
            if sheet is not None and name not in part.model_fields:
                raise ValueError(f"{key} does not belong in [{part.__name__.lower()}]")
            origin[name] = key
            out[name] = converted
    return out


# Parameters of which a datasheet may state the tolerance; the last two are those of a second mass.
TOLERATED = ("J", "psi_f", "R", "L_d", "L_q", "J_load", "k")
USUAL_TOLERANCE = {"J": 0.15, "psi_f": 0.07, "R": 0.15, "L_d": 0.2, "L_q": 0.2}  # of a datasheet that states none


class Motor(SheetPart):
    """The machine. Either its electrical data are known, or only its torque constant `K_t` (a plain axis).

    Datasheet names of `pmsm_ctrl.units.DATASHEET` (``J_kg_cm2``, ``K_t_rms``, ``L_line_to_line_mH``, ...) are
    accepted in place of the SI fields and converted once, here.
    """

    J: Positive | None = Field(
        description="rotor inertia, kg m^2 (moving mass in kg for a linear axis), or 'unknown': a log then tells it"
    )
    p: PolePairs | None = Field(
        default=None, description="pole pairs; of a linear axis in 2 pi m, pi m over the pole pitch, no whole number"
    )
    psi_f: Positive | None = Field(default=None, description="permanent-magnet flux linkage, Wb")
    R: Positive | None = Field(default=None, description="phase resistance, Ohm")
    L_d: Positive | None = Field(default=None, description="direct-axis inductance, H")
    L_q: Positive | None = Field(default=None, description="quadrature-axis inductance, H")
    K_t: Positive | None = Field(
        default=None, description="torque per unit of the drive signal where no electrical data are known"
    )
    tolerance: dict[str, Fraction] = Field(
        default_factory=USUAL_TOLERANCE.copy,
        description=f"relative datasheet tolerance of each parameter: {', '.join(TOLERATED)}; "
        "of those left out a fit takes the usual one, and a tuning examines no corner",
    )

    def tolerance_of(self, parameter: str, otherwise: float) -> float:
        """Return the relative tolerance of a parameter: as stated, or the usual one.

        Parameters
        ----------
        parameter : str
        otherwise : float
            Where there is no usual one.
        """
        return self.tolerance.get(parameter, USUAL_TOLERANCE.get(parameter, otherwise))

    @field_validator("tolerance")
    @classmethod
    def _known(cls, value: dict[str, float]) -> dict[str, float]:
        if wrong := sorted(set(value) - set(TOLERATED)):
            raise ValueError(f"no parameter {', '.join(wrong)} has a tolerance here; accepted: {', '.join(TOLERATED)}")
        return value

    @field_validator("J", mode="before")
    @classmethod
    def _unknown(cls, value: Any) -> Any:
        if value is None:
            raise ValueError("a number, or 'unknown' in quotes, was expected")
        return None if value == "unknown" else value

    @model_validator(mode="after")
    def _complete(self) -> Motor:
        electrical = {name: getattr(self, name) for name in ("p", "psi_f", "R", "L_d", "L_q")}
        if self.K_t is not None and all(value is None for name, value in electrical.items() if name != "p"):
            return self  # a plain axis; its pole pairs tell electrical orders
        missing = [name for name, value in electrical.items() if value is None]
        if len(missing) == len(electrical) and self.K_t is None:
            raise ValueError(
                "give p, psi_f (or K_t_peak, K_e_...), R, L_d and L_q, or K_t alone for a plain axis "
                "(p may stand beside it)"
            )
        if missing and len(missing) < len(electrical):
            hint = ""
            if missing == ["psi_f"] and self.K_t is not None:
                hint = "; beside p, R, L_d and L_q give the torque constant as K_t_peak (N m/A of the peak current) or "
                hint += "K_t_rms, or K_e_..., from which psi_f follows"
            raise ValueError(f"electrical data incomplete: {', '.join(missing)} missing{hint}")
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
    """The load."""

    J: NonNegative = Field(default=0.0, description="load inertia at the load's own shaft, kg m^2")
    gear: float = Field(default=1.0, ge=1e-6, le=1e6, allow_inf_nan=False, description="motor turns per load turn")

    @property
    def at_motor(self) -> float:
        """Its inertia at the motor shaft, kg m^2."""
        return self.J / self.gear**2

    def kept(self, rotor: float | None) -> float:
        """Return the inertia at the motor shaft that stays when the total changes, kg m^2.

        Parameters
        ----------
        rotor : float or None
        """
        return self.at_motor if rotor is None else min(rotor, self.at_motor)

    def beside(self, rotor: float | None, total: float, stderr: float) -> dict[str, dict[str, float]]:
        """Return the changed part of a design, motor or load, that has this total inertia at the motor shaft.

        Parameters
        ----------
        rotor : float or None
        total, stderr : float
            kg m^2; it is rounded to two digits of its standard error.
        """
        kept = self.kept(rotor)
        if kept == self.at_motor:
            return {"motor": {"J": rounded(total - kept, stderr)}}
        return {"load": {"J": rounded((total - kept) * self.gear**2, stderr * self.gear**2)}}


class Drive(SheetPart):
    """Power stage and sampling of the drive."""

    u_dc: Positive = Field(default=560.0, description="dc-link voltage, V")
    i_max: float = Field(default=math.inf, ge=SMALL, description="current limit, A peak", allow_inf_nan=True)
    f_control: float = Field(
        default=16000.0, ge=1.0, le=1e7, allow_inf_nan=False, description="current control rate = PWM rate, Hz"
    )
    speed_divider: int = Field(default=4, ge=1, le=1000, description="current periods per speed and position period")
    delay_periods: int = Field(default=1, ge=0, le=1, description="computation delay in control periods")
    plant_steps: int = Field(
        default=1,
        ge=1,
        le=64,
        description="least integration steps per control period; "
        "more are taken where the drive's fastest mode needs them",
    )

    @property
    def speed_period(self) -> float:
        """Period of the speed and position controllers, s."""
        return self.speed_divider / self.f_control


class Sensor(Part):
    """Encoder, current measurement and recording."""

    encoder_counts: int = Field(
        default=0, ge=0, le=1 << 48, description="counts per turn (per metre, linear); 0 = ideal"
    )
    current_noise: NonNegative = Field(default=0.0, description="noise of the measured i_d and i_q, A rms")
    speed_filter: NonNegative = Field(default=0.0, description="time constant of the speed filter, s")
    log_divider: int = Field(default=16, ge=1, le=1_000_000, description="control periods per logged sample")


class Assumed(SheetPart):
    """Values that the controller and the evaluation assume where they differ from the motor."""

    K_t: Positive | None = Field(
        default=None, description="torque constant of controller and evaluation, N m/A peak; K_t_rms: N m/A rms"
    )
    R: Positive | None = Field(default=None, description="phase resistance that the current loop is tuned for, Ohm")
    L_d: Positive | None = Field(default=None, description="of the decoupling and of the tuned current loop, H")
    L_q: Positive | None = Field(default=None, description="of the decoupling and of the tuned current loop, H")
    J: Positive | None = Field(
        default=None, description="load included: of the feedforward, the observer and the tuned speed loop, kg m^2"
    )

    @classmethod
    def sheet(cls) -> Mapping[str, DatasheetValue]:
        """Return the one name that is converted: its field is the torque constant, and not the flux."""
        return {"K_t_rms": DatasheetValue("K_t", math.sqrt(0.5), DATASHEET["K_t_rms"].meaning)}


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


MOST_EFFECTS = 100  # of one axis: every one is fitted beside all others


def _counted(value: tuple[EffectEntry, ...]) -> tuple[EffectEntry, ...]:
    if len(value) > MOST_EFFECTS:
        raise ValueError(f"found {len(value)} effects; at most {MOST_EFFECTS} are evaluated together")
    return value


Effects = Annotated[tuple[EffectEntry, ...], AfterValidator(_counted)]


class Compensation(Part):
    """Feedforward friction compensation."""

    source: Literal["reference", "commanded", "measured", "adaptive", "observer"] = "reference"
    gain: NonNegative | None = Field(
        default=None,
        description="share of the modelled friction that is fed forward; left out: none, and a code export takes 1",
    )
    smoothing: NonNegative | None = Field(
        default=None,
        description="speed over which the sign is smoothed, rad/s; left out: five encoder counts times K_v with the "
        "commanded speed, else 0",
    )
    effects: tuple[str, ...] = Field(default=("coulomb", "viscous"), description="effects that are compensated")
    dead_zone: NonNegative = Field(default=0.0, description="speed up to which the direction counts as 0, rad/s")
    ramp: NonNegative | None = Field(
        default=None,
        description="travel over which the fed-forward friction turns at a reversal, rad; left out: the deflection of "
        "the design's presliding, without presliding 0",
    )
    limit: Positive | None = Field(
        default=None, description="largest current that is fed forward, A peak; left out: the drive's i_max"
    )
    bandwidth: Positive | None = Field(default=None, description="of the disturbance observer (source observer), rad/s")
    inertia: Positive | None = Field(
        default=None, description="inertia that the observer assumes, kg m^2; left out: the controller's"
    )

    @property
    def share(self) -> float:
        """The gain of the simulated drive: 0 where none is stated."""
        return 0.0 if self.gain is None else self.gain


class Acceptance(Part):
    """One line of the acceptance: in this scenario this metric must not exceed this limit."""

    scenario: str = Field(description="a trial of the compensation study, or a scenario under position control")
    metric: str = Field(description="rms, peak, reversal_peak, cycle_amplitude, ..., or one of them with _change")
    limit: Finite = Field(description="in SI units; a change as a share, -0.8 for -80 %")
    factor: Positive = Field(default=1.0, description="what the compensated parameters are off by")


class Sampled(Part):
    """When the samples of a channel were taken, beside the time stamps."""

    sampling: Literal["unknown", "instant", "mean", "command"] = Field(
        default="unknown", description="sampled at once, mean over the period before, or the drive's command, which is "
        "held for a period"
    )  # fmt: skip
    late: Finite = Field(default=0.0, description="time by which the samples lag the time stamps, s")
    filter: NonNegative = Field(default=0.0, description="time constant of the channel's filter, s")

    @property
    def stated(self) -> bool:
        """Whether the time of sampling is stated, so that it is no nuisance parameter of a fit."""
        return self.sampling in ("instant", "mean")


class LogMap(Part):
    """How the columns of a foreign file become channels, and how they were sampled."""

    channels: dict[str, str] = Field(default_factory=dict, description="channel = 'column [unit]' or 'column'")
    scale: dict[str, Finite] = Field(default_factory=dict, description="factor applied to a channel after units")
    separator: str | None = None
    decimal: Literal[".", ","] | None = None
    rate: Positive | None = Field(
        default=None, description="rate of a file without time, or whose time counts samples, Hz"
    )
    wrap: Positive | None = Field(
        default=None, description="period at which the position wraps where that is no turn, rad"
    )
    window: tuple[Finite, Finite] | None = Field(
        default=None, description="first and last time of the file that count, s"
    )
    sampling: Literal["unknown", "instant", "mean", "command"] = Field(
        default="unknown", description="torque and currents beside the position: sampled at once, mean over the period "
        "before, or the drive's command"
    )  # fmt: skip
    late: Finite = Field(
        default=0.0, description="time by which torque and currents lag the position of their row, s; negative where "
        "they were sampled after it"
    )  # fmt: skip
    filter: NonNegative = Field(default=0.0, description="time constant of the filter of torque and currents, s")
    sampled: dict[Literal["theta", "omega", "torque", "i_q", "u_d", "u_q"], Sampled] = Field(
        default_factory=dict, description="the same for single channels: [log.sampled.u_q]; i_d is taken as i_q"
    )

    @field_validator("scale")
    @classmethod
    def _usable(cls, scale: dict[str, float]) -> dict[str, float]:
        for channel, factor in scale.items():
            if factor == 0.0:
                raise ValueError(f"{channel} = {factor:g}, but a factor other than 0 was expected")
        return scale

    @field_validator("window")
    @classmethod
    def _forwards(cls, window: tuple[float, float] | None) -> tuple[float, float] | None:
        if window is not None and not window[0] < window[1]:
            raise ValueError(f"found [{window[0]:g}, {window[1]:g}], but the first time should be before the last, s")
        return window

    def of(self, channel: str) -> Sampled:
        """Return how a channel was sampled; what is stated of all is stated of torque and currents.

        Parameters
        ----------
        channel : str
        """
        own = self.sampled.get(channel)  # type: ignore[call-overload]
        if own is not None:
            return Sampled.model_validate(own)
        if channel in ("torque", "i_q", "i_d"):
            return Sampled(sampling=self.sampling, late=self.late, filter=self.filter)
        return Sampled()


class Evaluated(Part):
    """How the log that a design was fitted to was read, so that `compare` reads that log in the same way.

    The band and the sampling are found beside the base model, and would come out otherwise beside the fitted one.
    """

    log: str = Field(default="", description="fingerprint of the log's channels")
    cutoff: NonNegative = Field(default=0.0, description="of the low-pass of both sides, Hz")
    late: Finite = Field(default=0.0, description="delay of torque and currents that was corrected, s")
    filter: NonNegative = Field(default=0.0, description="time constant of their filter that was corrected, s")
    reversals: Finite = Field(default=0.0, description="delay of the same that was corrected at reversals, s")
    stepped: Finite | None = Field(
        default=None, description="periods after a reversal at which the friction steps in the torque, if it does"
    )
    commanded: bool = Field(default=False, description="whether torque and currents are commands")
    in_step: bool = Field(
        default=False, description="whether they were sampled in step with a position reference that is held"
    )
    age: Finite | None = Field(default=None, description="age of a speed that is all that is known of the motion, s")
    speed_filter: NonNegative = Field(default=0.0, description="time constant of its filter that was corrected, s")
    weight: NonNegative = Field(default=0.0, description="share of the torque that errors at edges are weighed by")
    edges: float = Field(default=1.0, ge=0, le=1, description="error of edges, as a share of a period's")
    encoder_lines: tuple[int, ...] = Field(default=(), description="lines of the encoder whose errors are fitted")
    left_out: tuple[tuple[Finite, Finite], ...] = Field(
        default=(), description="stretches in which something happened once, begin and end in s"
    )
    changes: tuple[Finite, ...] = Field(default=(), description="times from which on the dry friction is another, s")
    counts: tuple[tuple[Finite, ...], ...] = Field(
        default=(), description="by which the weights of each record were multiplied, for each balance"
    )
    zeros: tuple[tuple[Finite, NonNegative], ...] = Field(
        default=(), description="what was added to the position of each record, and its standard error, rad (m)"
    )
