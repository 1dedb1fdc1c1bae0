"""A user's own effects from a Python file, for the command line. Loading a file runs it."""

from __future__ import annotations

import builtins
import dis
import importlib.util
import os
import sys
import traceback
from pathlib import Path

from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.effects.soundness import require_sound
from pmsm_ctrl.errors import PmsmCtrlError, RequestError

__all__ = ["load_effects"]


def load_effects(path: str | os.PathLike[str]) -> tuple[Effect, ...]:
    """Run a Python file and return every effect it defines at module level.

    Parameters
    ----------
    path : path
        The file may import modules that stand beside it.

    Returns
    -------
    tuple of Effect
        In the order of the file; effects of the catalogue that it imports are left out.

    Raises
    ------
    RequestError
        When the file is missing, cannot be run, defines no effect, or defines two with one id, or one whose term is
        no number at some value of its signals, has no linear parameter, or is not linear in those it states.
    """
    file = Path(path).resolve()
    if not file.is_file():
        what = "it is a folder" if file.is_dir() else "no such file"
        raise RequestError(f"{path}: {what}; a Python file that defines effects was expected")
    spec = importlib.util.spec_from_file_location(_module_name(file), file)
    if spec is None or spec.loader is None:
        raise RequestError(f"{path}: its name does not end in .py; a Python file that defines effects was expected")
    module = importlib.util.module_from_spec(spec)
    # As for a script: a helper beside the file can be imported. numba asks for the module by its name.
    sys.path.insert(0, str(file.parent))
    before = sys.modules.get(spec.name)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        if before is None:
            del sys.modules[spec.name]
        else:
            sys.modules[spec.name] = before
        # what the package says of an effect is a whole sentence; of anything else its kind belongs to it
        said = str(error) if isinstance(error, PmsmCtrlError) else f"cannot be run: {type(error).__name__}: {error}"
        raise RequestError(f"{path}: {_line(error, file)}{said}") from error
    finally:
        sys.path.remove(str(file.parent))
    found: dict[str, Effect] = {}
    for value in vars(module).values():
        if not isinstance(value, Effect) or CATALOGUE.get(value.id) is value:
            continue
        if found.setdefault(value.id, value) is not value:
            raise RequestError(f"{path}: two effects have the id '{value.id}'")
    for effect in found.values():
        _require_names(path, effect)
        require_sound(effect, f"{path}: ")
    if not found:
        raise RequestError(f"{path}: defines no effect; a module-level pmsm_ctrl.effects.Effect was expected")
    return tuple(found.values())


def _require_names(path: str | os.PathLike[str], effect: Effect) -> None:
    """Refuse an effect whose function reads a name that nothing defines; numba says so pages later."""
    function = effect.py_term
    known = {*function.__globals__, *vars(builtins)}
    read = {
        str(one.argval) for one in dis.get_instructions(function) if one.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }  # fmt: skip
    if missing := sorted(read - known):
        raise RequestError(
            f"{path}: effect '{effect.id}': function '{function.__name__}': name '{missing[0]}' is not defined"
        )


def _module_name(file: Path) -> str:
    """Return the name of the file as a module, or another one where a module that is no part of it has that name."""
    try:
        other = importlib.util.find_spec(file.stem)
    except (ImportError, ValueError):
        return file.stem
    return file.stem if other is None or other.origin == str(file) else f"own_{file.stem}"


def _line(error: BaseException, file: Path) -> str:
    """Return "line 7: ", the last line of this file that led to the error."""
    if isinstance(error, SyntaxError) and error.filename == str(file):
        return f"line {error.lineno}: "
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(file)]
    return f"line {lines[-1]}: " if lines else ""
