"""JSON Schemas of what ``--json`` writes, by command; their version is the last part of ``schema``.

Keys may be added without a new version; those that are required here stay, with their types.
"""

from __future__ import annotations

from typing import Any

from pmsm_ctrl.errors import RequestError, nearest

__all__ = ["SCHEMAS", "schema_of"]

Schema = dict[str, Any]

NUMBER: Schema = {"type": ["number", "null"], "description": "null where it is not known"}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
COUNT: Schema = {"type": "integer", "minimum": 0}
TEXTS: Schema = {"type": "array", "items": TEXT}
VERDICTS = ("consistent", "effects_missing", "unexplained", "not_excited", "implausible", "inconclusive")

OUTCOMES = (
    "applied", "partly_applied", "not_applied", "wrong_gain", "wrong_sign", "late", "limit_cycle", "inconclusive",
)  # fmt: skip
COMPENSATIONS = ("recommended", "finer_step", "not_lowered", "not_resolved")


def _record(required: dict[str, Schema], optional: dict[str, Schema] | None = None) -> Schema:
    return {"type": "object", "properties": required | (optional or {}), "required": list(required)}


def _by_name(values: Schema) -> Schema:
    return {"type": "object", "additionalProperties": values}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _maybe(schema: Schema) -> Schema:
    return {"anyOf": [schema, {"type": "null"}]}


ESTIMATE = _record({"value": NUMBER, "unit": TEXT, "stderr": NUMBER}, {"nominal": NUMBER, "interval_95": _list(NUMBER)})
ESTIMATES = _by_name(ESTIMATE)
ERROR = _record({"rms": NUMBER, "unit": TEXT, "relative": NUMBER})
ERRORS = _by_name(ERROR)
DOUBTS = {"warnings": TEXTS, "warning_codes": TEXTS}
DESIGN = {"type": "object", "description": "a design as in its TOML file, SI units", "required": ["motor"]}
RECORDS = _list(
    _record({"name": TEXT, "held_out": FLAG, "duration": NUMBER, "rate": NUMBER, "before": ERRORS, "after": ERRORS})
)
STEP = _record(
    {
        "effect": TEXT, "equivalents": TEXTS, "parameters": ESTIMATES, "error_before": ERRORS, "error_after": ERRORS,
        "holdout_before": ERRORS, "holdout_after": ERRORS, "evidence": {"type": "object"},
    }
)  # fmt: skip
RANKED = _record(
    {"effect": TEXT, "explained": {"type": "number", "minimum": 0, "maximum": 1}, "p_value": NUMBER, "accepted": FLAG,
     "why_not": TEXT, "why_not_code": TEXT}
)  # fmt: skip
DEVIATION = _record(
    {
        "parameter": TEXT,
        "nominal": NUMBER,
        "estimate": NUMBER,
        "stderr": NUMBER,
        "unit": TEXT,
        "outside": FLAG,
        "flagged": FLAG,
    }
)
TRACKING = _record(
    {"rms": NUMBER, "peak": NUMBER, "reversal_peak": NUMBER, "cycle_amplitude": NUMBER, "cycle_frequency": NUMBER,
     "unit": TEXT}
)  # fmt: skip
CIRCLE = _record({"quadrant_error": NUMBER, "radius": NUMBER, "speed": NUMBER, "spikes": _list(NUMBER), "rest": NUMBER})
EXPERIMENT = _record({"separates": TEXTS, "profile": TEXT, "why": TEXT})
EFFECT = {
    "id": TEXT, "title": TEXT, "enters": {"enum": ["torque", "voltage", "measurement"]}, "equation": TEXT,
    "source": TEXT, "needs": TEXT,
    "parameters": _list(_record({"symbol": TEXT, "unit": TEXT, "lower": NUMBER, "upper": NUMBER, "linear": FLAG})),
}  # fmt: skip

# verb -> (name in "schema", keys that are always there, keys that may be)
_KEYS: dict[str, tuple[str, dict[str, Schema], dict[str, Schema]]] = {
    "init": ("init", {"design": DESIGN, "path": TEXT}, DOUBTS),
    "simulate": (
        "simulate",
        {"scenario": TEXT, "seed": COUNT, "output": TEXT, "samples": COUNT, "duration": NUMBER, "rate": NUMBER,
         "channels": _by_name(TEXT)},
        DOUBTS,
    ),
    "tune": (
        "tuning",
        {"defended": FLAG, "methods": _by_name(TEXT), "loops": {"type": "object"}, **DOUBTS},
        {"design": DESIGN},
    ),
    "identify": (
        "identification",
        {"log": TEXT, "method": TEXT, "plausible": FLAG, "parameters": ESTIMATES,
         "intervals_95": _by_name(_list(NUMBER)), "not_identifiable": _by_name(TEXT),
         "relative_error": NUMBER, "improved": FLAG, "cutoff": NUMBER,
         "inertia_over_cutoff": _list(_record({"cutoff": NUMBER, "value": NUMBER, "unit": TEXT, "stderr": NUMBER})),
         **DOUBTS},
        {"records": RECORDS, "design": DESIGN},
    ),
    "compare": (
        "comparison",
        {"verdict": {"enum": list(VERDICTS)}, "reasons": TEXTS, "log": TEXT, "errors": ERRORS, "records": RECORDS,
         "holdouts": _list(_record({"log": TEXT, "errors": ERRORS, "simulation": _list({"type": "object"})})),
         **DOUBTS},
        {},
    ),
    "diagnose": (
        "diagnosis",
        {"verdict": {"enum": list(VERDICTS)}, "reasons": TEXTS, "log": TEXT, "holdout": _maybe(TEXT),
         "errors": _record({"nominal": ERRORS, "base": ERRORS, "final": ERRORS, "noise_floor": ERRORS}),
         "base": _record({"parameters": ESTIMATES}), "steps": _list(STEP), "ranking": _list(RANKED),
         "parameter_deviations": _list(DEVIATION), "next_experiment": _maybe(EXPERIMENT), "unexplained": TEXT,
         "records": RECORDS, "improved": FLAG, **DOUBTS},
        {"design": DESIGN},
    ),
    "add": (
        "add",
        {"effect": TEXT, "supported": FLAG, "against": TEXTS, "improved": FLAG, "log": TEXT,
         "holdout_log": _maybe(TEXT), "parameters": ESTIMATES, "base": _record({"parameters": ESTIMATES}),
         "errors": _record({"nominal": ERRORS, "base": ERRORS, "final": ERRORS}), "holdout": _by_name(ERRORS),
         "records": RECORDS, "design": DESIGN, **DOUBTS},
        {},
    ),
    "track": (
        "tracking",
        {"log": TEXT, "estimates": ESTIMATES, "t": _list(NUMBER), "history": _by_name(_list(NUMBER)),
         "stderr": _by_name(_list(NUMBER)), **DOUBTS},
        {},
    ),
    "frf": (
        "frf",
        {"log": TEXT, "estimates": ESTIMATES, "responses": _by_name({"type": "object"}), **DOUBTS},
        {"design": DESIGN, "trusted": FLAG},
    ),
    "fleet": (
        "fleet",
        {"results": TEXT, "axes": COUNT, "logs": COUNT, "evaluated": COUNT, "reused": COUNT,
         "verdicts": _by_name(COUNT),
         "lost": _list(_record({"record": TEXT, "axis": TEXT, "reason": TEXT, "set_aside": FLAG})),
         "seconds": NUMBER, "processor_seconds": NUMBER, **DOUBTS},
        {},
    ),
    "verify": (
        "verification",
        {"verdict": {"enum": list(OUTCOMES)}, "advice": TEXT, "before": TEXT, "after": TEXT, "expected_gain": NUMBER,
         "gain": ESTIMATE, "gain_interval_95": _list(NUMBER), "gain_before": ESTIMATE, "delay": _maybe(ESTIMATE),
         "delay_interval_95": _list(NUMBER), "smoothing": _maybe(ESTIMATE), "smoothing_interval_95": _list(NUMBER),
         "smoothing_shape": {"enum": ["", "line", "tanh"]}, "parts": ESTIMATES, "implausible": TEXTS,
         "weight": _by_name(NUMBER), "channel": TEXT,
         "errors": _record({"before": TRACKING, "after": TRACKING}),
         "change": _record({"measured": _by_name(NUMBER), "promised": _by_name(NUMBER)}),
         "explained": NUMBER, **DOUBTS},
        {},
    ),
    "quadrants": (
        "quadrants",
        {"unit": TEXT, "before": CIRCLE, "after": _maybe(CIRCLE), "change": NUMBER, **DOUBTS},
        {},
    ),
    "export": ("export", {"language": TEXT, "flavour": TEXT}, {"source": TEXT, "files": _by_name(TEXT)}),
    "import": (
        "import",
        {"file": TEXT, "sha256": TEXT, "format": TEXT, "motion": {"enum": ["rotary", "linear"]}, "samples": COUNT,
         "duration": NUMBER, "channels": _by_name({"type": "object"}), **DOUBTS},
        {},
    ),
    "import-proposal": (
        "proposal",
        {"file": TEXT, "format": TEXT, "complete": FLAG, "missing": TEXTS,
         "channels": _by_name(_record({"column": TEXT, "mapping": TEXT, "reasons": TEXTS})), "unused": _by_name(TEXT),
         "log_table": TEXT, **DOUBTS},
        {},
    ),
    "fleet-report": (
        "fleet_report",
        {"results": TEXT,
         "axes": _list(_record({"axis": TEXT, "type": TEXT, "records": COUNT, "answered": COUNT,
                                "verdicts": {"type": "object"}, "missing": FLAG, "consistent": FLAG,
                                "p_value": NUMBER, "q_value": NUMBER, "findings": _list({"type": "object"})})),
         "changes": _list({"type": "object"}), "judged": {}, "unlike": _list({"type": "object"}),
         "worthless": _list({"type": "object"}), "unexplained": _list({"type": "object"}), **DOUBTS},
        {},
    ),
    "effects": ("effects", {}, {"effects": _list(_record(EFFECT)), **EFFECT}),
    "sweep": (
        "sweep",
        {"fits": _by_name(_record({"F_c": ESTIMATE, "F_v": ESTIMATE})), "rms_percent": NUMBER,
         "levels": _list({"type": "object"}), **DOUBTS},
        {"design": DESIGN},
    ),
    "compensate": (
        "compensation",
        {"verdict": {"enum": list(COMPENSATIONS)}, "units": _by_name(TEXT),
         "runs": _list(_record({"variant": TEXT, "motion": TEXT, "factor": NUMBER})),
         "windows": _by_name(_record({"safe": NUMBER, "safe_below": _maybe(NUMBER)})),
         "unresolved": _list(_record({"motion": TEXT, "rms_counts": NUMBER, "peak_counts": NUMBER})),
         "acceptance": _list(
             _record({"scenario": TEXT, "metric": TEXT, "limit": NUMBER, "value": NUMBER, "passed": FLAG})
         ),
         **DOUBTS},
        {"recommended": _maybe(_record({"source": TEXT, "gain": NUMBER, "effects": TEXTS, "rms": NUMBER})),
         "design": DESIGN},
    ),
    "study": (
        "study",
        {"verdict": TEXT, "numbers": _by_name(TEXT), "report": TEXT, **DOUBTS},
        {"design": DESIGN, **{verb: {"type": "object", "description": f"as of {verb}"} for verb in
                              ("tune", "sweep", "identify", "compare", "diagnose", "compensate", "track")}},
    ),
}  # fmt: skip


def _whole(name: str, keys: dict[str, Schema], more: dict[str, Schema]) -> Schema:
    version = f"pmsm-ctrl/{name}/1"
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": version,
        **_record({"schema": {"const": version}, **keys}, more),
    }


# A list of effects, or one in full.
_ONE_OF_EFFECTS = {"anyOf": [{"required": ["effects"]}, {"required": list(EFFECT)}]}
SCHEMAS: dict[str, Schema] = {verb: _whole(*given) for verb, given in _KEYS.items()}
SCHEMAS["effects"] |= _ONE_OF_EFFECTS


def schema_of(verb: str) -> Schema:
    """Return the JSON Schema of what a command writes with ``--json``.

    Parameters
    ----------
    verb : str

    Returns
    -------
    dict

    Raises
    ------
    RequestError
        For a command without one.
    """
    if verb not in SCHEMAS:
        raise RequestError(f"schema '{verb}'{nearest(verb, SCHEMAS)} (known: {', '.join(SCHEMAS)})")
    return SCHEMAS[verb]
