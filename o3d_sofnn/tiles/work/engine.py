"""Tasks on any executor, in any order; those of workers that died are repeated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from o3d_sofnn.tiles.work.store import Receipt

RETRIES = 3
"""How often the tasks of workers that died are given to others."""


PATIENCE = 20.0
"""Seconds in which a scheduler must answer."""


@dataclass
class Engine:
    """Where tasks run.

    Attributes
    ----------
    executor : Executor
        Any executor of :mod:`concurrent.futures`; functions and arguments are pickled.
    renew : callable or None
        Makes another executor when a worker of a process pool has died, which breaks the pool.
    workers : int
        Number of workers on this machine, among which its cores and memory are divided; 0 for
        others.
    """

    executor: Executor
    renew: Callable[[], Executor] | None = None
    workers: int = 0

    def run(
        self,
        work: Callable[[int], Receipt],
        numbers: Sequence[int],
        done: Callable[[Receipt], None],
    ) -> None:
        """Run a task for each of some tiles; `done` gets the receipts in the order they come.

        Raises
        ------
        Exception
            What the first task that failed has raised; those that were running have ended, and
            `done` has had their receipts.
        """
        left, tries = list(numbers), 0
        while left:
            finished: set[int] = set()
            try:
                self._once(work, left, done, finished)
                return
            except BrokenExecutor:
                left = [n for n in left if n not in finished]
                tries += 1
                if self.renew is None or tries > RETRIES:
                    raise
                self.executor.shutdown(wait=False, cancel_futures=True)
                self.executor = self.renew()

    def _once(
        self,
        work: Callable[[int], Receipt],
        numbers: Sequence[int],
        done: Callable[[Receipt], None],
        finished: set[int],
    ) -> None:
        """Run each task once; `finished` gets the numbers of those that have ended well."""
        futures: dict[Future[Receipt], int] = {
            self.executor.submit(work, number): number for number in numbers
        }
        failure: BaseException | None = None
        try:
            for future in as_completed(futures):
                if future.cancelled():
                    continue
                error = future.exception()
                if error is None:
                    done(future.result())
                    finished.add(futures[future])
                elif failure is None or isinstance(failure, BrokenExecutor):
                    failure = error
                    for other in futures:
                        other.cancel()
        except BaseException:
            for other in futures:
                other.cancel()
            raise
        if failure is not None:
            raise failure


@contextmanager
def engine_of(
    workers: int | None, scheduler: str | None, executor: Executor | None
) -> Iterator[Engine]:
    """Provide an engine.

    Parameters
    ----------
    workers : int or None
        Number of processes on this machine; None and no other choice works in this process.
    scheduler : str or None
        Address of a Dask scheduler.
    executor : Executor or None
        Any executor; it is not shut down.
    """
    if executor is not None:
        yield Engine(executor)
    elif scheduler is not None:
        client = _client(scheduler)
        try:
            yield Engine(client.get_executor(pure=False, retries=RETRIES))
        finally:
            client.close()
    elif workers is None:
        with ThreadPoolExecutor(1) as one:
            yield Engine(one, workers=1)
    else:
        count = workers

        def make() -> Executor:
            return ProcessPoolExecutor(count, mp_context=_spawning())

        engine = Engine(make(), make, count)
        try:
            yield engine
        finally:
            engine.executor.shutdown(wait=True, cancel_futures=True)


def _spawning() -> Any:
    """Return a context that starts fresh processes: threads of this one do not survive a fork."""
    import multiprocessing

    return multiprocessing.get_context("spawn")


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise ImportError(
            'a scheduler needs Dask; type: pip install "dask[distributed]"'
        ) from error
    try:
        return Client(address, timeout=PATIENCE)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(f"scheduler: no answer from {address}: {error}") from error
