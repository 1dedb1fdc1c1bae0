"""Design: the model of the drive. Frozen parts, read from and written to TOML without loss."""

from __future__ import annotations

import math
import os
import re
import tomllib
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import tomli_w
from pydantic import Field, PrivateAttr, ValidationError, field_validator, model_validator

from pmsm_ctrl.complaints import built, explain
from pmsm_ctrl.design_loops import CurrentLoop, Filter, Loops, PositionLoop, SpeedLoop
from pmsm_ctrl.design_parts import (
    Acceptance,
    Assumed,
    Compensation,
    Drive,
    EffectEntry,
    Effects,
    Evaluated,
    Finite,
    Load,
    LogMap,
    Motor,
    Part,
    Sensor,
)  # fmt: skip
from pmsm_ctrl.design_text import design_in_json, edited_text, plain, same, text_of_file, with_tuples
from pmsm_ctrl.errors import DesignError, NextCommand, nearest
from pmsm_ctrl.files import example_design, write_text
from pmsm_ctrl.rooms import provided
from pmsm_ctrl.units import encoder_step, psi_f_from, rounded

__all__ = [
    "Acceptance", "Assumed", "Compensation", "CurrentLoop", "Design", "Drive", "EffectEntry", "Evaluated", "Filter",
    "Load", "LogMap", "Loops", "Motor", "PositionLoop", "Sensor", "SpeedLoop",
]  # fmt: skip

FREE = 0.999  # tolerance of an inertia of which nothing is known; a fit over a whole log takes no notice of it
DEEPEST = 32  # parts of a dotted key
DEEP = re.compile(rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{DEEPEST}}}""")


class Design(Part):
    """The model of the drive and its controllers.

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
    effects: Effects = ()
    compensation: Compensation = Compensation()
    acceptance: tuple[Acceptance, ...] = ()
    scenarios: dict[str, dict[str, Finite]] = Field(
        default_factory=dict, description="parameters of named scenarios: [scenarios.sweep] speed_max = 200.0"
    )
    log: LogMap = LogMap()
    evaluated: Evaluated = Evaluated()
    source: str = Field(default="", exclude=True, repr=False, description="file the design was read from")
    # Code, so no field: a design file cannot name it, and equality and text ignore it.
    _own_effects: tuple[Any, ...] = PrivateAttr(default=())
    _inertia_free: bool = PrivateAttr(default=False)  # a log alone told it; no field, so that no file states it
    _text: str = PrivateAttr(default="")  # of the file it was read from, which a changed copy is written like

    @field_validator("name")
    @classmethod
    def _printable(cls, name: str) -> str:
        # it is printed, and appears in reports and in generated code
        if any(unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp") for c in name):
            raise ValueError(f"found {name[:60]!r}; one line of printable characters was expected")
        return name

    @model_validator(mode="after")
    def _consistent(self) -> Design:
        if self.motion == "rotary" and self.motor.p is not None and self.motor.p != int(self.motor.p):
            raise ValueError(f"motor.p: found {self.motor.p:g}; a whole number of pole pairs was expected")
        if self.loops is not None:
            self.loops.require_sampled(self.drive.speed_period)
        return self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Design) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    @property
    def own_effects(self) -> tuple[Any, ...]:
        """The user's own effects (`pmsm_ctrl.effects.Effect`) that the design may name beside the catalogue."""
        return self._own_effects

    def with_own_effects(self, *effects: Any) -> Design:
        """Return a copy that carries own effects, so that every verb knows them.

        They extend the catalogue, not the list of effects: `with_effect` adds one to the axis. Copies keep them;
        files do not contain them.

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
        """Total inertia at the motor shaft: J_motor + J_load / gear^2.

        Raises
        ------
        DesignError
            When the motor's inertia is unknown.
        """
        if self.motor.J is None:
            message = f"{self.source or self.name or 'design'}: motor.J is unknown; a number was expected"
            raise DesignError(message, next_command=NextCommand.INERTIA)
        return self.motor.J + self.load.at_motor

    @property
    def K_t(self) -> float:
        """The plant's torque constant, N m/A peak."""
        return self.motor.torque_constant

    @property
    def K_t_assumed(self) -> float:
        """The torque constant that the controller and the evaluation use, N m/A peak."""
        return self.assumed.K_t if self.assumed.K_t is not None else self.K_t

    def starting_from(self, J: float) -> Design:
        """Return a copy with a rotor inertia that only a log tells: fits start there, and have no prior of it.

        An inertia that is set later is a known one. Files have the number alone.

        Parameters
        ----------
        J : float
            kg m^2.
        """
        copy = self.replace(motor={"J": J})
        copy._inertia_free = True
        return copy

    def tolerance(self, parameter: str, otherwise: float) -> float:
        """Return the relative tolerance that a fit takes as its prior of a motor parameter.

        Parameters
        ----------
        parameter : str
        otherwise : float
            Where the motor states none, and there is no usual one.
        """
        return FREE if parameter == "J" and self._inertia_free else self.motor.tolerance_of(parameter, otherwise)

    @property
    def encoder_step(self) -> float:
        """Step of the measured position, rad (m); 0 for an ideal encoder."""
        return encoder_step(self.sensor.encoder_counts, self.motion)

    @property
    def log_period(self) -> float:
        """Period at which the drive records, s."""
        return self.sensor.log_divider / self.drive.f_control

    def require_loops(self) -> Loops:
        """Return the loops of a design that must have them.

        Returns
        -------
        Loops

        Raises
        ------
        DesignError
            When the design has none.
        """
        if self.loops is None:
            following = NextCommand.TUNE if self.motor.electrical else NextCommand.LOOPS
            raise DesignError(f"{self.source or self.name}: loops: missing", next_command=following)
        return self.loops

    def parameters(self, effect: str) -> dict[str, float]:
        """Return the parameters of the first effect with this id; empty when the design has none.

        Parameters
        ----------
        effect : str
            Id of the catalogue or of an own effect.

        Returns
        -------
        dict of symbol to value
            SI.
        """
        for entry in self.effects:
            if entry.id == effect:
                return dict(entry.parameters)
        return {}

    def with_effect(
        self, effect: str, parameters: dict[str, float] | None = None, stderr: dict[str, float] | None = None
    ) -> Design:
        """Return a copy with the effect added, or its parameters replaced if it is there already.

        Parameters
        ----------
        effect : str
            Id of the catalogue or of an own effect.
        parameters : dict of symbol to value
            SI.
        stderr : dict of symbol to value, optional
            Standard errors, where fitted.

        Returns
        -------
        Design

        Raises
        ------
        DesignError
            For an effect or a parameter that does not exist, or a value that is no number.
        """
        entry = self._entry(effect, parameters or {}, stderr or {})
        return self.replace_effects((*(e for e in self.effects if e.id != effect), entry))

    def add_effect(self, effect: str, parameters: dict[str, float], stderr: dict[str, float] | None = None) -> Design:
        """Return a copy with one more instance of the effect (a second cogging order, say).

        Parameters
        ----------
        effect : str
            Id of the catalogue or of an own effect.
        parameters : dict of symbol to value
            SI.
        stderr : dict of symbol to value, optional
            Standard errors, where fitted.

        Returns
        -------
        Design

        Raises
        ------
        DesignError
            As `with_effect`.
        """
        return self.replace_effects((*self.effects, self._entry(effect, parameters, stderr or {})))

    def _entry(self, effect: str, parameters: dict[str, float], stderr: dict[str, float]) -> EffectEntry:
        entry = built(EffectEntry, f"effect '{effect}'", id=effect, parameters=parameters, stderr=stderr)
        provided("rules of effects")(self, entry)
        return entry

    def without_effect(self, effect: str) -> Design:
        """Return a copy without any instance of the effect.

        Parameters
        ----------
        effect : str
            Id of the catalogue or of an own effect.

        Returns
        -------
        Design
        """
        return self.replace_effects(tuple(e for e in self.effects if e.id != effect))

    def replace_effects(self, effects: tuple[EffectEntry, ...]) -> Design:
        """Return a copy with exactly these effects.

        Parameters
        ----------
        effects : tuple of EffectEntry

        Returns
        -------
        Design
        """
        return self.model_copy(update={"effects": effects})

    def with_parameters(self, *, stderr: Mapping[str, float] | None = None, **values: float) -> Design:
        """Return a copy with SI motor parameters changed (`J`, `psi_f`, `R`, `L_d`, `L_q`, `K_t`).

        `J` is the total inertia at the motor shaft; the larger one of rotor and load takes the change.

        Parameters
        ----------
        stderr : dict of symbol to value, optional
            Standard errors, SI. A value is rounded to two digits of its own.
        **values : float
            SI.

        Returns
        -------
        Design
        """
        changed, known = dict(values), stderr or {}
        parts = self.load.beside(self.motor.J, changed.pop("J"), known.get("J", math.nan)) if "J" in changed else {}
        changed = {name: rounded(value, known.get(name, math.nan)) for name, value in changed.items()}
        if "K_t" in changed and self.motor.p is not None and self.motor.psi_f is not None:
            changed["psi_f"] = psi_f_from(changed.pop("K_t"), self.motor.p)
        found = self.replace(**{**parts, "motor": {**parts.get("motor", {}), **changed}})
        found._inertia_free &= "J" not in values  # the load may have taken the change
        return found

    def replace(self, **parts: dict[str, Any]) -> Design:
        """Return a validated copy with fields of parts changed: ``design.replace(sensor={"current_noise": 0})``.

        Parameters
        ----------
        **parts : dict of field to value
            A field that is no table is replaced as a whole.

        Returns
        -------
        Design

        Raises
        ------
        DesignError
            When a part, a field or a value is not valid.
        """
        data = self.to_dict()
        for part, fields in parts.items():
            if part not in type(self).model_fields:
                raise DesignError(f"no part '{part}' in a design{nearest(part, type(self).model_fields)}")
            table = isinstance(fields, dict) and isinstance(data.get(part, {}), dict)
            data[part] = data.get(part, {}) | fields if table else fields
        changed = Design.from_dict(data, source=self.source).with_own_effects(*self._own_effects)
        changed._text = self._text
        changed._inertia_free = self._inertia_free and changed.motor.J == self.motor.J
        return changed

    def to_dict(self) -> dict[str, Any]:
        """Return the design as plain SI values, fit for TOML; defaults are left out, but for a stated control rate."""
        data = self.model_dump(mode="python", exclude_none=True, exclude_defaults=True)
        if "f_control" in self.drive.model_fields_set:  # one that is not stated counts as unknown
            data["drive"] = {**data.get("drive", {}), "f_control": self.drive.f_control}
        data["motor"] = ({"J": "unknown"} if self.motor.J is None else {}) | self.motor.model_dump(exclude_none=True)
        if self.effects:
            data["effects"] = [
                {"id": e.id, **e.parameters} | ({"stderr": dict(e.stderr)} if e.stderr else {}) for e in self.effects
            ]
        if self.acceptance:
            data["acceptance"] = [a.model_dump(exclude_defaults=True) for a in self.acceptance]
        return {key: plain(item) for key, item in data.items() if item not in ({}, ())}

    def to_toml(self) -> str:
        """Return the design as TOML text."""
        return tomli_w.dumps(self.to_dict())

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the design as TOML, atomically.

        One that was read from a file keeps the comments, the order and the datasheet fields of that file.

        Parameters
        ----------
        path : path

        Returns
        -------
        Path
            The same path.
        """
        return write_text(path, self._edited() or self.to_toml())

    def _edited(self) -> str | None:
        """Return the text that the design was read from with its changes; None where that would be another design."""
        if not self._text:
            return None
        wanted = self.to_dict()
        text = edited_text(self._text, Design.from_toml(self._text).to_dict(), wanted)
        if text is None:
            return None
        try:
            read_back = Design.from_toml(text)
        except DesignError:
            return None
        return text if same(read_back.to_dict(), wanted) else None

    @classmethod
    def from_dict(cls, data: dict[str, Any], source: str = "") -> Design:
        """Build a design from plain values.

        Parameters
        ----------
        data : dict
            As the TOML file has it.
        source : str
            File the values come from, for messages.

        Returns
        -------
        Design

        Raises
        ------
        DesignError
            Naming the file, the field, what was found and what would have been accepted.
        """
        try:
            return cls.model_validate(with_tuples(data) | {"source": source})
        except ValidationError as error:
            raise DesignError(explain(error, cls, source, data)) from None

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Design:
        """Read a design from a TOML file, or from the JSON of a command that found one (`--json`).

        Parameters
        ----------
        path : path

        Returns
        -------
        Design

        Raises
        ------
        DesignError
            When `path` is none, the file is missing, is not TOML, or has a field that is wrong.
        """
        text = text_of_file(path)
        if Path(path).suffix == ".json":
            return cls.from_dict(design_in_json(text, str(path)), source=str(path))
        return cls.from_toml(text, source=str(path))

    @classmethod
    def example(cls, name: str) -> Design:
        """Return a design that comes with the package, such as ``seed_motor``.

        Parameters
        ----------
        name : str

        Returns
        -------
        Design

        Raises
        ------
        RequestError
            For an unknown name.
        """
        return cls.read(example_design(name)).model_copy(update={"source": ""})

    @classmethod
    def from_toml(cls, text: str, source: str = "") -> Design:
        """Build a design from TOML text.

        Parameters
        ----------
        text : str
        source : str
            File the text comes from, for messages.

        Returns
        -------
        Design

        Raises
        ------
        DesignError
            When it is not TOML, or has a field that is wrong.
        """
        where = f"{source}: " if source else ""
        if DEEP.search(text):  # tomllib takes memory with the square of the depth
            raise DesignError(f"{where}a key of more than {DEEPEST} parts; a design in TOML was expected")
        try:
            data = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise DesignError(f"{where}not valid TOML: {error}") from None
        except ValueError as error:  # a number of 5000 digits
            raise DesignError(f"{source!r}: cannot be read ({error})") from None
        if not data:
            raise DesignError(f"{where}empty; a design needs at least a [motor] table")
        design = cls.from_dict(data, source=source)
        design._text = text
        return design
