"""What a column's name says, word by word: English, German, French, Italian and Japanese, romanised or not.

`names.guess_channel` knows whole names and is trusted; a name understood here is a proposal that somebody confirms.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache

__all__ = ["Meaning", "begins_with_time", "meaning_of", "says_measured", "says_reference"]

_QUANTITIES = {
    "time": "time zeit temps tempo jikan timestamp zeitstempel",
    "position": "position pos angle winkel phi lage stellung drehwinkel rotorlage posizione angolo ichi kakudo theta "
    "posicion istlage lagegeber",
    "speed": "velocity velo vel speed drehzahl geschwindigkeit vitesse velocita velocite sokudo kaitensu kaitensuu "
    "omega rpm velocidad regime giri",
    "acceleration": "acceleration accel acc beschleunigung accelerazione kasokudo",
    "current": "current cur curr strom courant corrente denryu denryuu isq isd iq id corriente amps",
    "torque": "torque trq drehmoment moment couple coppia toruku torukku tau force kraft forza chikara par effort",
    "voltage": "voltage volt spannung tension tensione denatsu uq ud vq vd usq usd",
    "temperature": "temperature temperatur temperatura ondo temp",
}
_REFERENCES = (
    "reference ref setpoint setpt set soll sollwert demand demanded command commanded cmd target desired des consigne "
    "riferimento rif shirei mokuhyo mokuhyou sollw vorgabe commande sp tgt"
)
# What is said of a measured channel only.
_MEASURED = (
    "actual act ist istwert measured meas measure feedback fbk fb reel reelle reale mesure mesuree misurata misurato "
    "attuale jissai genzai genzaichi kenshutsu fidobakku fiidobakku"
)
# Letters of formulas: a quantity where nothing else in the name is one.
_LETTERS = {"position": "x y z s th", "speed": "v n w om", "acceleration": "a", "current": "i", "torque": "m f"}
_LETTERS |= {"voltage": "u"}
# Words of quantities that are no channel: what stands behind one of them is left alone.
_OTHERS = (
    "error err deviation dev lag following droop abweichung fehler schlepp schleppfehler regelabweichung erreur ecart "
    "errore scarto hensa limit grenze limite max min maximum minimum window offset override ratio status state zustand "
    "alarm warning word mode feedforward ffw vorsteuerung kp ki kd gain pid power leistung puissance potenza energy "
    "energie phase peak noise estimate integral stoerung disturbance flags digital bit activated function supply"
)
_AXES = {"q": "q iq isq uq vq usq quadrature quer", "d": "d id isd ud vd usd direct laengs"}
_BUS = "dc bus link zwischenkreis zk vdc udc"
_LOADS = "load last charge carico fuka abtrieb"
_NEUTRAL = (
    "actual act ist istwert istw value wert valeur valore atai measured meas measure feedback fbk fb effective reel "
    "reelle reale mesure mesuree misurata misurato attuale effettiva effettivo jissai genzai genzaichi kenshutsu "
    "averaged average mean filtered raw motor moteur motore axis achse axe asse jiku rotor shaft mechanical encoder "
    "geber signal channel kanal data main gvl drive servo antrieb absolute abs multi turn single en n s von des der "
    "du de la le del della di no ni my x of the producing generating rms eff standard detected fidobakku fiidobakku "
    "internal display fine angular angulaire angolare mechanisch ch ax nc fb plc tag sensor monitor user process image"
)

# Japanese words, of which a longer one comes first, as they are romanised
_WRITTEN = (
    "トルク=toruku 時間=jikan 時刻=jikan 回転速度=sokudo 加速度=kasokudo 速度=sokudo 回転数=kaitensu 位置=ichi "
    "角度=kakudo 電流=denryu 電圧=denatsu 温度=ondo 推力=chikara 指令=shirei 目標=mokuhyo 実際=jissai 現在=genzai "
    "検出=kenshutsu フィードバック=fidobakku 偏差=hensa 負荷=fuka 制限=limit 軸=jiku モータ=motor 値=atai"
)
_ROMANISED = {pair.split("=")[0]: pair.split("=")[1] for pair in _WRITTEN.split(" ")}


_KIND: dict[str, tuple[str, str]] = {
    **dict.fromkeys(_NEUTRAL.split(), ("neutral", "")),
    **dict.fromkeys(_LOADS.split(), ("load", "")),
    **dict.fromkeys(_BUS.split(), ("bus", "")),
    **{word: ("axis", "") for words in _AXES.values() for word in words.split()},
    **dict.fromkeys(_REFERENCES.split(), ("reference", "")),
    **dict.fromkeys(_OTHERS.split(), ("other", "")),
    # last, because "iq" is an axis and a current
    **{word: ("quantity", quantity) for quantity, words in _QUANTITIES.items() for word in words.split()},
}
_LETTER = {letter: quantity for quantity, letters in _LETTERS.items() for letter in letters.split()}
_CHOOSING = frozenset((_REFERENCES + " " + _MEASURED).split())
_SHORTEST_PART = 3  # letters of a word inside a compound; shorter ones stand in any word
_LINKS = ("en", "s", "n", "e")  # what German puts between the parts of a compound
_LONGEST = 40  # letters of a word that is taken apart

_CHANNELS = {
    ("time", False): "t", ("position", False): "theta", ("position", True): "theta_ref", ("speed", False): "omega",
    ("speed", True): "omega_ref", ("acceleration", True): "alpha_ref", ("torque", False): "torque",
    ("temperature", False): "temperature",
}  # fmt: skip


@dataclass(frozen=True)
class Meaning:
    """What a name was understood as.

    Attributes
    ----------
    channel : str
    words : tuple of str
        The words that decided.
    unsure : str
        Why it may be another channel; empty where nothing says so.
    letter : bool
        Whether the quantity is the letter of a formula: a unit has to fit the axis.
    bare : bool
        Whether that letter is all there is: a unit has to be stated, or an ``x`` to be that of a linear axis.
    """

    channel: str
    words: tuple[str, ...]
    unsure: str = ""
    letter: bool = False
    bare: bool = False


def meaning_of(name: str) -> Meaning | None:
    """Return the channel that the words of a name mean, or None.

    Parameters
    ----------
    name : str
        Of a column, with or without a path before it.
    """
    for text in (_last(name), name):
        found = _understood(_parts(text))
        if found is not None:
            return found
    return None


def says_reference(name: str) -> bool:
    """Whether a name states a reference, in whole words or glued: ``x_soll``, ``vcmd``, ``PosSP``."""
    last, before = _parts(_last(name)), _parts(" ".join(re.split(r"[./\\:|]", name.strip())[-2:-1]))
    stated = set(_REFERENCES.split())
    return not stated.isdisjoint(last) or (stated.issuperset(before) and bool(before) and not _said_measured(last))


def begins_with_time(name: str) -> bool:
    """Whether a name begins with a word of time: ``Time current``, ``Zeit_2``, ``t2`` is none."""
    return _KIND.get(next(iter(_parts(name)), "")) == ("quantity", "time")


def says_measured(name: str) -> bool:
    """Whether a name states a measurement, in whole words or glued: ``x_ist``, ``vact``, ``PosMeas``."""
    return not says_reference(name) and _said_measured(_parts(_last(name)))


def _said_measured(words: list[str]) -> bool:
    return not set(_MEASURED.split()).isdisjoint(words)


def _last(name: str) -> str:
    return re.split(r"[./\\:|]", name.strip())[-1]


def _parts(text: str) -> list[str]:
    """Return the words of a name: without accents, split at signs and capitals, compounds taken apart."""
    for letter, plain in (("ä", "ae"), ("ö", "oe"), ("ü", "ue"), ("ß", "ss")):
        text = text.replace(letter, plain)
    for written, romanised in _ROMANISED.items():
        text = text.replace(written, f" {romanised} ")
    text = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    text = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", text)
    return [part for word in re.split(r"[^A-Za-z]+", text) if word for part in _taken_apart(word.lower())]


@lru_cache(maxsize=4096)
def _taken_apart(word: str) -> tuple[str, ...]:
    """Return a known word as it is, a compound of known words as those, and any other word unchanged."""
    if word in _KIND or len(word) > _LONGEST:
        return (word,)
    for cut in (1, 2):  # xref, thsoll
        if word[:cut] in (*_LETTER, "iq", "id", "uq", "ud") and word[cut:] in _CHOOSING:
            return (word[:cut], word[cut:])
    if word.endswith("sp") and (parts := _taken_apart(word[:-2])) and all(part in _KIND for part in parts):
        return (*parts, "sp")
    # best[k]: the fewest words that make up the first k letters
    best: list[tuple[str, ...] | None] = [()] + [None] * len(word)
    for stop in range(_SHORTEST_PART, len(word) + 1):
        for start in range(stop - _SHORTEST_PART + 1):
            before, part = best[start], word[start:stop]
            if before is None:
                continue
            stem = next((s for s in (part, *(part.removesuffix(link) for link in _LINKS)) if s in _KIND), "")
            fits = len(stem) >= _SHORTEST_PART or (start == 0 and stem in ("iq", "id", "uq", "ud"))
            if fits and (best[stop] is None or len(before) + 1 < len(best[stop] or ())):
                best[stop] = (*before, stem)
    return best[-1] or (word,)


def _understood(words: list[str]) -> Meaning | None:
    kinds = [_KIND.get(word, ("", "")) for word in words]
    if any(kind == "other" for kind, _ in kinds):
        return None
    quantities = list(dict.fromkeys(quantity for kind, quantity in kinds if kind == "quantity"))
    letters = [] if quantities else [word for word in words if word in _LETTER]
    if len(letters) == 1:
        return _by_letter(letters[0], [word for word in words if word != letters[0]])
    axis = next((axis for axis, own in _AXES.items() if set(words) & set(own.split())), "")
    if quantities[:1] == ["current"] and "current" in words:  # the current position is the present one
        quantities = quantities[1:] or quantities
    if set(quantities) == {"torque", "current"}:  # the torque current
        quantities, axis = ["current"], axis or "q"
    if set(quantities) == {"position", "speed"}:  # the speed of the angle
        quantities = ["speed"]
    if len(quantities) != 1:
        return None
    quantity, reference = quantities[0], any(kind == "reference" for kind, _ in kinds)
    known = tuple(word for word, (kind, _) in zip(words, kinds, strict=True) if kind not in ("", "neutral"))
    strange = [word for word, (kind, _) in zip(words, kinds, strict=True) if not kind and len(word) > 1]
    unsure = f"'{strange[0]}' was not understood" if strange else ""
    loaded = any(kind == "load" for kind, _ in kinds)
    if quantity == "current":
        if len(words) > 1 and words[-1] in ("u", "v", "w", "a", "b", "c") and not axis:
            return None  # of a phase
        channel = f"i_{axis or 'q'}" + ("_ref" if reference else "")
        return Meaning(channel, known, unsure or ("" if axis else "the name does not say which current"))
    if quantity == "voltage":
        bus = any(kind == "bus" for kind, _ in kinds)
        found = "u_dc" if bus else f"u_{axis}" if axis else ""
        return Meaning(found, known, unsure) if found else None
    if quantity == "torque" and reference:
        return Meaning("torque", known, "it is a command, and no measured torque")
    if loaded and quantity in ("position", "torque") and not reference:
        return Meaning("theta_load" if quantity == "position" else "T_load", known, unsure)
    found = _CHANNELS.get((quantity, reference), "")
    return Meaning(found, known, unsure) if found else None


def _by_letter(letter: str, rest: list[str]) -> Meaning | None:
    """Return what a letter of a formula means beside words that say which: ``x soll``, ``i q cmd``, ``n ist motor``."""
    quantity = _LETTER[letter]
    kinds = [_KIND.get(word, ("", ""))[0] for word in rest]
    axes = [axis for axis, own in _AXES.items() if set(rest) & set(own.split())]
    electric, said = quantity in ("current", "voltage"), [word for word in rest if word in _CHOOSING]
    if set(kinds) - {"reference", "neutral", "axis"} or len(axes) > electric or (rest and not said and not axes):
        return None
    reference, unsure = "reference" in kinds, ""
    channel = _CHANNELS.get((quantity, reference), "")
    if quantity == "voltage" and axes:
        channel = f"u_{axes[0]}"
    elif quantity == "current" and rest:
        channel = f"i_{axes[0] if axes else 'q'}" + ("_ref" if reference else "")
        unsure = "" if axes else "the name does not say which current"
    return Meaning(channel, (letter, *said), unsure, letter=True, bare=not rest) if channel else None
