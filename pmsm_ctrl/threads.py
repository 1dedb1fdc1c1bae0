"""How many threads the linear algebra may use: one.

Its matrices have some twenty columns. A second thread brings no time on the clock, and waits busily: 82 s of processor
in place of 44 s for the 24 logs of a small fleet, 13 s in place of 9 s for a log of 10 min; beside other work, where
the second thread is not let in, 13 s in place of 2 s for one diagnosis.
"""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

__all__ = ["ONE_THREAD", "one_thread"]

# read by the libraries when they are loaded
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@cache
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401 - brings a library of its own, which is to be among those that are found
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which the linear algebra of this process uses one thread.

    Nothing is changed where a variable of `ONE_THREAD` says how many there should be, as on the command line.
    """
    if any(os.environ.get(name) for name in ONE_THREAD):
        return nullcontext()
    limited: AbstractContextManager[Any] = _libraries().limit(limits=1, user_api="blas")
    return limited
