"""Modules that hold a function of their own name: called, they call it, and imported, they are modules.

So `pmsm_ctrl.tune(design)` is a verb, and `import pmsm_ctrl.tune.margins as m` a module.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.threads import one_thread

if TYPE_CHECKING:
    import inspect

__all__ = ["Room", "provide", "provided"]

# What a lower layer asks of a higher one, which it does not import: module and function, by what it is.
_PROVIDED: dict[str, tuple[str, str]] = {}


def provide(what: str, module: str, function: str) -> None:
    """State which function answers what a lower layer asks.

    Parameters
    ----------
    what, module, function : str
    """
    _PROVIDED[what] = module, function


def provided(what: str) -> Callable[..., Any]:
    """Return the function that answers; its module is imported by then.

    Parameters
    ----------
    what : str
    """
    module, function = _PROVIDED[what]
    answer: Callable[..., Any] = getattr(import_module(module), function)
    return answer


class Room(ModuleType):
    """A package whose modules, and which itself, can be called where they list a function of their own name."""

    def __setattr__(self, name: str, value: Any) -> None:
        # the import system binds every submodule here
        if type(value) is ModuleType and name in getattr(value, "__all__", ()):
            value.__class__ = Room
        super().__setattr__(name, value)

    @property
    def _function(self) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(self, self.__name__.rpartition(".")[2])
        return function

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the function of the module's name, its linear algebra on one thread."""
        with one_thread():
            return self._function(*args, **kwargs)

    @property
    def __signature__(self) -> inspect.Signature:
        import inspect  # here, since help alone needs it

        return inspect.signature(self._function)

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        """The module's text, and what help says of the function."""
        import inspect

        own = str(vars(self).get("__doc__") or "")
        name = self.__name__.rpartition(".")[2]
        if name not in vars(self).get("__all__", ()) or name == self.__name__:
            return own
        return f"{own}\n\nCalled, it is `{name}{self.__signature__}`:\n\n{inspect.getdoc(self._function) or ''}"

    def __reduce__(self) -> tuple[Callable[[str], ModuleType], tuple[str]]:
        return import_module, (self.__name__,)
