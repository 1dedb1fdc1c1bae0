"""An effect's scalar term over whole arrays: the regression reads the very function the simulation runs."""

from __future__ import annotations

import contextlib
import importlib.util
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmsm_ctrl.effects.signals import SIGNALS
from pmsm_ctrl.effects.soundness import refusal
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.files import write_text
from pmsm_ctrl.kernels import OPTIONS, cache_folder, soundly_cached

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["called", "column", "columns", "columns_less_noise", "compiled_loop"]

Array = NDArray[np.float64]

# One compiled loop per term and process. The key is the term itself, not the id: a user may change an own
# effect and keep its name.
_LOOPS: dict[Any, Any] = {}

# Of what numba says: colours of a terminal, lines that name no cause, and how one begins that does.
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_NO_CAUSE = ("Failed in nopython", "During:", "File ", "<source missing", "^")
_CAUSE = re.compile(r"^\w+Error: ")


def column(effect: Effect, signals: Mapping[str, ArrayLike], parameters: Mapping[str, float]) -> Array:
    """Evaluate an effect's term over arrays.

    Parameters
    ----------
    effect : Effect
        Of the catalogue, or a user's own.
    signals : mapping of str to array of shape (n,) or float
        SI signals by the names of `pmsm_ctrl.effects.SIGNALS`; those the term does not read are ignored.
    parameters : mapping of str to float
        A value for every parameter that the term reads.

    Returns
    -------
    array, shape (n,), or (2, n) for a term that returns two channels
        The term in the unit of the balance it enters. A call with scalars alone returns n = 1.

    Raises
    ------
    RequestError
        When a signal or a parameter is missing, the lengths differ, or the term of an own effect is not finite.
    """
    arrays, n = _broadcast(effect, signals)
    values = _values(effect, parameters)
    loop = _LOOPS.get(effect.term)
    if loop is None:
        loop = _LOOPS[effect.term] = _columns_loop(effect)
    width = len(effect.channels)
    out = np.empty((width, n))
    loop(out, *arrays, *values)
    _require_finite(effect, out, arrays, values)
    return out if width > 1 else out[0]


def columns(
    effect: Effect, signals: Mapping[str, ArrayLike], parameters: Mapping[str, float]
) -> tuple[dict[str, Array], Array]:
    """Split an effect's term into one column per linear parameter and the part that is none of theirs.

    ``term(parameters) = sum(parameters[s] * columns[s]) + rest`` with the nonlinear parameters held. A linear
    parameter's column is the term with that parameter 1 and the other linear ones 0, less the rest, so the
    physics is still written only in the term.

    Returns
    -------
    columns : dict of symbol to array, shape (n,) or (2, n)
    rest : array of the same shape
        The whole term where the effect has no linear parameter; zero for a homogeneous one.
    """
    arrays, n = _broadcast(effect, signals)
    linear = [p.symbol for p in effect.linear]
    values = _values(effect, {**parameters, **dict.fromkeys(linear, 0.0)})
    key = "columns", effect.term, tuple(linear)
    loop = _LOOPS.get(key)
    if loop is None:
        loop = _LOOPS[key] = _columns_loop(effect, linear)
    width = len(effect.channels)
    out = np.empty((width * (1 + len(linear)), n))
    loop(out, *arrays, *values)
    _require_finite(effect, out, arrays, values)
    rest, *parts = out.reshape(1 + len(linear), width, n) if width > 1 else out
    return dict(zip(linear, parts, strict=True)), rest


def columns_less_noise(
    effect: Effect, signals: Mapping[str, ArrayLike], parameters: Mapping[str, float], noise: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the columns of `columns`, less what noise of some signals adds to them in the mean, to second order.

    That is ``2 f(x) - (f(x + noise) + f(x - noise)) / 2``, in one pass: most of the time goes into sines and cosines of
    the angle, which all three have in common.

    Parameters
    ----------
    effect : Effect
        With linear parameters.
    signals, parameters
        As for `columns`.
    noise : dict of signal to array, shape (n,)
        The standard deviation of each signal that is noisy; all follow one noise.

    Returns
    -------
    dict of symbol to array, shape (n,) or (2, n)
    """
    arrays, n = _broadcast(effect, signals)
    linear = [p.symbol for p in effect.linear]
    values = _values(effect, {**parameters, **dict.fromkeys(linear, 0.0)})
    key = "less noise", effect.term, tuple(linear), tuple(noise)
    loop = _LOOPS.get(key)
    if loop is None:
        loop = _LOOPS[key] = _columns_loop(effect, linear, tuple(noise))
    width = len(effect.channels)
    out = np.empty((width * len(linear), n))
    loop(out, *arrays, *map(np.ascontiguousarray, noise.values()), *values)
    _require_finite(effect, out, arrays, values)
    parts = out.reshape(len(linear), width, n) if width > 1 else out
    return dict(zip(linear, parts, strict=True))


def _require_finite(effect: Effect, out: Array, signals: Sequence[Array], values: Sequence[float]) -> None:
    """Refuse an own effect that is not finite where its signals are: a power or an exponential of a log's own values.

    Those of the package are tried at every shape in its tests.
    """
    if (effect.py_term.__module__ or "").startswith("pmsm_ctrl.effects.") or np.isfinite(out).all():
        return
    bad = ~np.isfinite(out).all(axis=0)
    for signal in signals:
        bad &= np.isfinite(signal)
    if not bad.any():
        return
    k = int(np.argmax(bad))
    own = (name for name in effect.arguments if name not in SIGNALS)
    at = dict(zip(effect.signals, (float(signal[k]) for signal in signals), strict=True))
    found = next(value for value in out[:, k].tolist() if not np.isfinite(value))
    raise refusal(effect, at | dict(zip(own, values, strict=True)), str(found))


def _values(effect: Effect, parameters: Mapping[str, float]) -> list[float]:
    """Parameters of a term in the order of its arguments."""
    values = []
    for name in effect.arguments:
        if name in SIGNALS:
            continue
        if name not in parameters:
            raise RequestError(f"effect '{effect.id}': no value for parameter '{name}' (given: {_list(parameters)})")
        values.append(float(parameters[name]))
    return values


def _list(names: Mapping[str, Any]) -> str:
    return ", ".join(names) or "none"


def _broadcast(effect: Effect, signals: Mapping[str, ArrayLike]) -> tuple[list[Array], int]:
    """The signals that a term reads, and the length of all: a constant term is as long as the log it belongs to."""
    n = max(map(np.size, signals.values()), default=1)
    wanted = []
    for name in effect.signals:
        if name not in signals:
            raise RequestError(f"effect '{effect.id}': its term reads '{name}', which is not there ({_list(signals)})")
        values = np.asarray(signals[name], dtype=np.float64)
        if values.ndim > 1 or values.size not in (1, n):
            raise RequestError(f"effect '{effect.id}': signal '{name}' has shape {values.shape}, others have ({n},)")
        if values.size != n or values.ndim == 0:
            values = np.broadcast_to(values.reshape(-1), (n,))
        wanted.append(np.ascontiguousarray(values))
    return wanted, n


def called(effect: Effect, /, **given: str) -> str:
    """Return the call of a term in the text of a loop: its own parameters by their symbols, its signals as given.

    Raises
    ------
    RequestError
        When the term reads a signal that is not given.
    """
    for name in effect.signals:
        if name not in given:
            raise RequestError(f"effect '{effect.id}': its term reads '{name}', which its structure does not know here")
    return f"term({', '.join(given.get(name, name) for name in effect.arguments)})"


def compiled_loop(
    effect: Effect, kind: str, write: Callable[[Effect], tuple[str, tuple[str, ...]]]
) -> tuple[Callable[..., Any], tuple[str, ...]]:
    """Return a loop around an effect's term and the symbols of the parameters it takes, in order.

    Parameters
    ----------
    effect : Effect
    kind : str
        A name for what the loop does; one loop per kind and term is compiled.
    write : function of Effect
        Returns the source of a function ``loop`` that calls ``term``, and the symbols.
    """
    text, symbols = write(effect)
    key = kind, effect.term, text
    if key not in _LOOPS:
        _LOOPS[key] = _compiled(effect, kind, text)
    return _LOOPS[key], symbols


def _columns_loop(
    effect: Effect, linear: Sequence[str] | None = None, noisy: Sequence[str] = ()
) -> Callable[..., Any]:  # fmt: skip
    """Return the loop over the term's arguments, signals first, compiled for arrays.

    With the linear parameters, it gives the term without them, and then what each of them adds: one pass, in which the
    compiler works out once what all of these have in common. With noisy signals, whose noises come behind the signals,
    it gives what each of them adds, less what the noise does.
    """
    own = [name for name in effect.arguments if name not in SIGNALS]
    signals = [*effect.signals, *(f"_noise_{name}" for name in noisy)]
    at = {name: f"{name}[_at]" for name in effect.signals}
    width = len(effect.channels)
    moved = [{name: f"{name}[_at] {sign} _noise_{name}[_at]" for name in noisy} for sign in "+-" if noisy]
    places = [at, *({**at, **one} for one in moved)]
    # all into locals before anything is stored: a store ends what the compiler remembers of a sine
    lines = [
        f"{_names(width, part, which)} = {call}"
        for which, place in enumerate(places)
        for part, call in enumerate(
            [called(effect, **place), *(called(effect, **place, **{symbol: "1.0"}) for symbol in linear or ())]
        )
    ]
    count = 1 + len(linear or ())
    if noisy:
        lines += [
            f"_out[{(part - 1) * width + row}, _at] = 2.0 * {_added(part, row, 0)}"
            f" - 0.5 * ({_added(part, row, 1)} + {_added(part, row, 2)})"
            for part in range(1, count)
            for row in range(width)
        ]
    else:
        lines += [
            f"_out[{part * width + row}, _at] = {_added(part, row, 0) if part else f'_0_0_{row}'}"
            for part in range(count)
            for row in range(width)
        ]
    head = f"def loop(_out, {', '.join((*signals, *own))}):\n    for _at in range(_out.shape[1]):\n"
    text = head + "".join(f"        {line}\n" for line in lines)
    loop: Any = _compiled(effect, "column" if linear is None else "less_noise" if noisy else "columns", text)
    if hasattr(loop, "py_func"):
        array = numba.types.Array(numba.types.float64, 1, "C", readonly=True)
        scalars = [numba.types.float64] * len(own)
        with naming(effect):
            loop.compile(numba.types.void(numba.float64[:, ::1], *([array] * len(signals)), *scalars))
        loop.disable_compile()
    compiled: Callable[..., Any] = loop
    return compiled


@contextlib.contextmanager
def naming(effect: Effect) -> Iterator[None]:
    """Turn an error that numba finds in an effect's function into one line with the file, the effect and the cause.

    Parameters
    ----------
    effect : Effect

    Raises
    ------
    DesignError
    """
    try:
        yield
    except numba.core.errors.NumbaError as error:
        lines = [_COLOURS.sub("", line).strip() for line in str(error).splitlines()]
        said = [line for line in lines if line and not line.startswith(_NO_CAUSE)]
        causes = [line for line in said if _CAUSE.match(line)] or said or [type(error).__name__]
        code = effect.py_term.__code__
        place = f"{Path(code.co_filename).name}: effect '{effect.id}': function '{code.co_name}'"
        raise DesignError(f"{place} cannot be compiled: {_CAUSE.sub('', causes[-1])}") from error


def _names(width: int, part: int, which: int) -> str:
    return ", ".join(f"_{which}_{part}_{row}" for row in range(width))


def _added(part: int, row: int, which: int) -> str:
    """What a linear parameter adds to one channel of the term."""
    return f"(_{which}_{part}_{row} - _{which}_0_{row})"


def _compiled(effect: Effect, kind: str, text: str) -> Any:
    """Return the function ``loop`` of a source text; in plain Python where the term is."""
    if not hasattr(effect.term, "py_func"):
        return _executed(effect, text)
    module = effect.py_term.__module__ or ""  # none where it was typed at a prompt
    if module.startswith("pmsm_ctrl.effects.") and getattr(sys.modules.get(module), "term", None) is effect.term:
        return soundly_cached(numba.njit(**OPTIONS)(_filed(f"{kind}_{module.rpartition('.')[2]}", module, text)))
    # An own effect may change between two runs without numba noticing, so its loop is never kept on disk.
    return numba.njit(**{**OPTIONS, "cache": False})(_executed(effect, text))


def _executed(effect: Effect, text: str) -> Callable[..., Any]:
    scope: dict[str, Any] = {"term": effect.term}
    exec(text, scope)
    loop: Callable[..., Any] = scope["loop"]
    return loop


def _filed(name: str, module: str, loop: str) -> Callable[..., Any]:
    """Load a loop from a file in the cache folder, where numba can keep what it compiles.

    The folder's name holds the hash of all compiled sources, so a changed term never meets an old loop.
    """
    path = cache_folder() / f"{name}.py"
    text = f"from {module} import term\n\n\n{loop}"
    if not path.exists() or path.read_bytes() != text.encode():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    spec = importlib.util.spec_from_file_location(f"_pmsm_ctrl_{name}", path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = loaded
    spec.loader.exec_module(loaded)
    function: Callable[..., Any] = loaded.loop
    return function
