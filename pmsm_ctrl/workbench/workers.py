"""One process for every session, so that a computation neither stops the server nor another page."""

from __future__ import annotations

import asyncio
import multiprocessing
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from pmsm_ctrl.errors import PmsmCtrlError, RequestError

__all__ = ["Workers", "spawned"]

MOST = 4  # processes that are kept; each holds the fits of its session
KILLED = (
    "the process that computed this has ended (killed, or out of memory). Nothing that was entered is lost: "
    "repeat the last step"
)


def _warm() -> None:
    """Import what every computation needs, while the page is still being looked at."""
    from pmsm_ctrl.workbench import tasks

    tasks.prepare()


def spawned() -> Executor:
    """Return an executor of one fresh process; a fork would share locks and threads with the server.

    Returns
    -------
    Executor
    """
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_warm)


class Workers:
    """The processes by session; the one that has been idle longest makes room.

    Parameters
    ----------
    make : function
        Returns a new executor.
    """

    def __init__(self, make: Callable[[], Executor] = spawned) -> None:
        self._make = make
        self._by_session: dict[str, Executor] = {}
        self._busy: Counter[str] = Counter()  # calls by session
        self._spare: Executor | None = None

    def prepare(self) -> None:
        """Start a process before a session asks for one."""
        if self._spare is None:
            self._spare = self._make()
            self._spare.submit(int)

    def _of(self, session: str) -> Executor:
        found = self._by_session.pop(session, None) or self._spare or self._make()
        if found is self._spare:
            self._spare = None
        self._by_session[session] = found  # the last one is the latest used
        idle = [one for one in self._by_session if one != session and not self._busy[one]]
        for one in idle[: max(0, len(self._by_session) - MOST)]:
            self.release(one)
        return found

    def release(self, session: str) -> None:
        """End the process of a session, if there is one.

        Parameters
        ----------
        session : str
        """
        found = self._by_session.pop(session, None)
        if found is not None:
            found.shutdown(wait=False, cancel_futures=True)

    async def run(self, session: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function of `tasks` in the process of a session.

        Parameters
        ----------
        session : str
        function : function
        *arguments : object
            What can be pickled.

        Returns
        -------
        object

        Raises
        ------
        PmsmCtrlError
            What the function raises on purpose.
        RequestError
            When the process has ended, or failed.
        """
        self._busy[session] += 1
        try:
            return await asyncio.wrap_future(self._of(session).submit(function, *arguments))
        except BrokenProcessPool:
            self._by_session.pop(session, None)
            raise RequestError(KILLED) from None
        except PmsmCtrlError:
            raise
        except MemoryError:
            raise RequestError("not enough memory for this; use a shorter log or a window of it") from None
        except RuntimeError as error:
            if "shutdown" not in str(error):  # of a process that had to make room
                raise
            self._by_session.pop(session, None)
            raise RequestError(KILLED) from None
        finally:
            self._busy[session] -= 1

    def close(self) -> None:
        """End all processes."""
        for one in (*self._by_session.values(), self._spare):
            if one is not None:
                one.shutdown(wait=False, cancel_futures=True)
        self._by_session, self._spare = {}, None
