"""Names and units as drives and loggers spell them."""

from __future__ import annotations

import re

from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.units import UNITS

__all__ = ["counts_of", "guess_channel", "has_letter", "is_unit", "split_header", "unit_of", "unit_spelling"]

# spelling in files, without case -> spelling of pmsm_ctrl.units
_SPELLINGS = {
    "sec": "s", "seconds": "s", "sek": "s", "second": "s", "msec": "ms", "usec": "us", "μs": "us",
    "u/min": "rpm", "min^-1": "rpm", "min⁻¹": "rpm", "r/min": "rpm", "rev/min": "rpm",
    "umdr/min": "rpm", "degree": "deg", "degrees": "deg", "grad": "deg", "º": "deg", "°/s": "deg/s",
    "º/s": "deg/s", "degree/s": "deg/s", "turn": "rev", "turns": "rev", "umdr": "rev", "revs": "rev",
    "u/s": "rev/s", "rad s^-1": "rad/s", "rad·s⁻¹": "rad/s", "rad/sec": "rad/s", "radians": "rad",
    "rad/s²": "rad/s^2", "rad/s2": "rad/s^2", "arms": "A rms", "a_rms": "A rms", "a(rms)": "A rms",
    "aeff": "A rms", "a eff": "A rms", "apk": "A peak", "a_peak": "A peak", "a(peak)": "A peak",
    "amp": "A", "ampere": "A", "amps": "A", "volt": "V", "volts": "V", "n·m": "N m", "n.m": "N m", "n-m": "N m",
    "newton": "N", "marms": "mA rms", "ma_rms": "mA rms", "ma(rms)": "mA rms", "ma eff": "mA rms", "maeff": "mA rms",
    "mapk": "mA peak", "tr/min": "rpm", "trs/min": "rpm", "tours/min": "rpm", "giri/min": "rpm", "giri/1'": "rpm",
    "vueltas/min": "rpm", "tr/s": "rev/s", "giri/s": "rev/s", "vueltas/s": "rev/s", "tr": "rev", "tour": "rev",
    "tours": "rev", "giri": "rev", "giro": "rev", "vuelta": "rev", "vueltas": "rev", "gradi": "deg", "grado": "deg",
    "grados": "deg", "degré": "deg", "degrés": "deg", "degre": "deg", "degres": "deg", "gradi/s": "deg/s",
    "grados/s": "deg/s", "degrés/s": "deg/s",
    "m/s²": "m/s^2", "m/s2": "m/s^2", "celsius": "degC", "c": "degC", "℃": "degC", "meter": "m",
    "metre": "m", "none": "1",
}  # fmt: skip
_FOLDED = {unit.casefold(): unit for unit in UNITS if unit not in ("mN m", "mNm")}

# what a column may be called, without case, blanks and punctuation -> channel
_NAMES: dict[str, str] = {
    "t": """
        time zeit timestamp zeitstempel seconds sec timesec elapsedtime tempo temps
    """,
    "theta": """
        position pos angle winkel phi actpos actualposition positionactual positionactualvalue posact
        posactual istposition positionistwert lageistwert mechanicalangle rotorposition measuredposition
        lage drehwinkel rotorlage
        positionmeasured encoderposition positionmeas posmeas actposition
    """,
    "theta_ref": """
        positionreference referenceposition positionref posref positionsetpoint setpos posset setposition
        positiondemand positiondemandvalue targetposition commandposition positioncommand lagesollwert
        sollposition positionsollwert thetades desiredposition
    """,
    "omega": """
        velocity vel speed actvelo actvel actvelocity actualvelocity velocityactual velact
        velocityactualvalue actualspeed speedactual speedactualvalue actspeed drehzahl istdrehzahl
        drehzahlistwert geschwindigkeit istgeschwindigkeit rotorspeed motorspeed measuredvelocity
        velocitymeasured speedmeas nact nist angularvelocity velmeas
    """,
    "omega_ref": """
        referencevelocity velocityreference velocityref velref speedref speedreference referencespeed
        setvelo setvel setvelocity velocitysetpoint speedsetpoint setspeed targetvelocity targetspeed
        velocitydemand velocitydemandvalue commandvelocity velocitycommand speedcommand drehzahlsollwert
        solldrehzahl sollgeschwindigkeit nset nsoll desiredvelocity
    """,
    "alpha_ref": """
        referenceacceleration accelerationreference accelerationsetpoint setacc setacceleration
        sollbeschleunigung
    """,
    "i_q": """
        iq iqmeas iqact iqactual currentq qcurrent quadraturecurrent isq currentiq momentenstrom querstrom
        qaxiscurrent measurediq torqueproducingcurrent torquegeneratingcurrent
    """,
    "i_d": """
        id idmeas idact idactual currentd dcurrent directcurrent isd currentid daxiscurrent feldstrom
        laengsstrom
    """,
    "i_q_ref": """
        iqset iqsetpoint iqreference iqcommand iqsoll referenceiq iqtarget desirediq
    """,
    "i_d_ref": """
        idset idsetpoint idreference idcommand idsoll referenceid idtarget
    """,
    "u_q": """
        uq vq voltageq qvoltage usq qaxisvoltage
    """,
    "u_d": """
        ud vd voltaged dvoltage usd daxisvoltage
    """,
    "u_dc": """
        udc vdc dclinkvoltage dcbusvoltage busvoltage zwischenkreisspannung dcvoltage dclink
    """,
    "torque": """
        torque tau acttorque actualtorque torqueactual torqueactualvalue drehmoment drehmomentistwert
        istmoment istdrehmoment motortorque measuredtorque momentistwert force kraft torqueact
    """,
    "T_load": """
        tload loadtorque lastmoment externaltorque
    """,
    "temperature": """
        temperature temp temperatur motortemperature motortemp motortemperatur windingtemperature
    """,
}

# a quantity with a word before or after it that says which of the two it is; of a letter only after it ("xref")
_REFERENCE_WORDS = (
    "ref reference setpoint set sp cmd command commanded demand demanded target desired des soll sollwert consigne "
    "riferimento rif shirei"
)
_MEASURED_WORDS = "act actual ist istwert meas measured measure fbk feedback mesure misurato misurata"
_STEMS = {
    "theta": "theta position pos angle winkel phi lage posizione angolo", "i_d": "id", "i_q": "iq",
    "omega": "omega velocity velo vel speed drehzahl geschwindigkeit vitesse velocita",
    "alpha": "alpha acceleration accel acc beschleunigung accelerazione",
}  # fmt: skip
_LETTERS = {"theta": "x th", "omega": "v n w", "alpha": "a"}


def _composed(stems: dict[str, str], *, before: bool) -> dict[str, str]:
    """Return every name of a quantity and a word: the channel of its reference, or the measured one."""
    out = {}
    for quantity, named in stems.items():
        for words, channel in ((_REFERENCE_WORDS, f"{quantity}_ref"), (_MEASURED_WORDS, quantity)):
            pairs = [(stem, word) for stem in named.split() for word in words.split() if channel in CHANNELS]
            out.update({stem + word: channel for stem, word in pairs})
            out.update({word + stem: channel for stem, word in pairs if before})
    return out


def _folded(name: str) -> str:
    return re.sub(r"[\W_]+", "", name.casefold())


_LETTERED = _composed(_LETTERS, before=False)
_LOOKUP = _LETTERED | _composed(_STEMS, before=True)
_LOOKUP |= {alias: channel for channel, aliases in _NAMES.items() for alias in aliases.split()}
_LOOKUP |= {_folded(channel): channel for channel in CHANNELS if channel not in ("omega_true", "theta_true")}


# "% rated", "% of nominal": a share, of what the file does not state
_RATED = re.compile(r"^(%|‰)\s*+(?:of\s++|of\s++the\s++)?(?:rated|nominal|rtd|nenn\w{0,12}|nom)$", re.IGNORECASE)


def unit_spelling(unit: str) -> str:
    """Return the package's spelling of a unit as a file writes it; an unknown unit comes back as it is."""
    text = unit.strip().strip("[]()").strip()
    text = _RATED.sub(r"\1", text)
    if text in UNITS:
        return text
    return _SPELLINGS.get(text.casefold()) or _FOLDED.get(text.casefold(), text)


_RMS = re.compile(r"(?<![^\W_])(?:rms|eff|effektiv\w{0,10}|effective|efficace)(?![^\W_])", re.IGNORECASE)

# "% of 2.4 N m": torque in per cent of the rated one
_SHARE = re.compile(
    r"(?P<part>%|‰|per ?cent|per ?mille?|pro ?mille)\s*+(?:of|von|de|di)\s++"
    r"(?P<rated>\d{1,15}(?:\.\d{1,15})?(?:e[+-]?\d{1,3})?)\s*+(?P<unit>[^\s\d].*)",
    re.IGNORECASE,
)
_SHARES = {"%": 0.01, "percent": 0.01, "per cent": 0.01}


def unit_of(text: str) -> tuple[str, float] | None:
    """Return (SI unit, factor) of a unit as a file or a mapping writes it, or None.

    A share of a rated value is a unit as well: ``% of 2.4 N m``, ``‰ of 5 A rms``.
    """
    unit = unit_spelling(text)
    if unit in UNITS:
        return UNITS[unit]
    match = _SHARE.fullmatch(unit)
    if match is None or (whole := UNITS.get(unit_spelling(match["unit"]))) is None or not float(match["rated"]) > 0.0:
        return None
    return whole[0], whole[1] * float(match["rated"]) * _SHARES.get(match["part"].lower(), 1e-3)


def says_rms(name: str) -> bool:
    """Whether a name states an effective value: ``Iq rms``, ``Iq_eff``, ``Strom (Effektivwert)``."""
    return _RMS.search(name) is not None


_COUNTS = re.compile(
    r"(?:enc(?:oder)?[\s_.-]?+)?+(?:inc|incr|incs|increments?|ink|inkr|inkremente?|counts?|cnts?|cts|ticks?|pulses?)\.?+"
    r"(?P<rate>\s*+(?:/|per)\s*+s(?:ec)?+)?+",
    re.IGNORECASE,
)


def counts_of(unit: str) -> str:
    """Return what a unit of encoder counts measures: ``rad``, ``rad/s``, or empty where it is none.

    How many of them make a turn, or a metre, stands in the design.
    """
    match = _COUNTS.fullmatch(unit.strip().strip("[]()").strip())
    return "" if match is None else "rad/s" if match["rate"] else "rad"


def is_unit(text: str) -> bool:
    """Whether a text is a unit this package knows, in any spelling, encoder counts among them."""
    return unit_spelling(text) in UNITS or bool(counts_of(text))


# A bracket at the end is a unit unless it holds an index; other forms count only when the unit is known.
_BRACKETED = re.compile(r"^(.*?)(?<!\s)\s*+\[([^\[\]]*+)\]\s*+$")
_PARENTHESES = re.compile(r"^(.*?)(?<!\s)\s*+\(([^()]*+(?:\([^()]*+\)[^()]*+)?)\)\s*+$")
_WORDED = re.compile(r"^(\S.*?)\s++in\s++(\S.*)$")
_SUFFIX = re.compile(r"^(.+?)[_ ](rpm|ms|us|ns|deg|rad|nm|ma|mv|mm|um|rad_s|deg_s|degc)$", re.IGNORECASE)
_SUFFIX_UNITS = {"rad_s": "rad/s", "deg_s": "deg/s"}


def split_header(cell: str) -> tuple[str, str]:
    """Split ``speed [rpm]``, ``speed (rpm)``, ``n in rpm``, ``n / min-1`` or ``speed_rpm`` into name and unit."""
    text = cell.strip().strip('"').strip()
    if (match := _BRACKETED.match(text)) and not match[2].strip().isdigit():
        return match[1].strip(), match[2].strip()
    if (match := _PARENTHESES.match(text)) and match[1] and is_unit(match[2]):
        return match[1].strip(), match[2].strip()
    if (match := _WORDED.match(text)) and is_unit(match[2]):
        return match[1], match[2].strip()
    name, slash, unit = text.partition("/")
    if (
        slash
        and name.strip()
        and not is_unit(text)
        and (unit.strip() in UNITS or unit.strip().casefold() in _SPELLINGS)
    ):
        return name.strip(), unit.strip()
    if text not in CHANNELS and (match := _SUFFIX.match(text)):
        return match[1].strip(), _SUFFIX_UNITS.get(match[2].lower(), match[2])
    return text, ""


def guess_channel(name: str) -> str | None:
    """Return the channel that a column of this name most likely is, or None.

    The last parts of a dotted or slashed path are tried as well, so ``MAIN.Axis.ActVelo`` and ``Axis.Setpoint.Speed``
    are found.
    """
    for candidate in _candidates(name):
        channel = _LOOKUP.get(_folded(candidate))
        if channel is not None:
            return channel
    return None


def has_letter(name: str) -> bool:
    """Whether a name is a letter and a word: ``x_ref``, ``vcmd``. The unit has to fit the axis, or it is another's."""
    return any(_folded(one) in _LETTERED for one in _candidates(name))


def _candidates(name: str) -> tuple[str, ...]:
    parts = re.split(r"[./\\:|]", name.strip())
    return name, " ".join(parts[-2:]), parts[-1]
