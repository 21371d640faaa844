"""Linear algebra on one thread: the same bits everywhere, and faster for small matrices."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])


@cache
def _controller() -> Any:
    import scipy.linalg  # noqa: F401 - its BLAS must be loaded to be found
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def on_one_thread(function: Function) -> Function:
    """Let `function` run with BLAS on one thread.

    The order of BLAS's sums, and so the result, depends on its number of threads; and waking
    threads takes longer than a product of matrices with a hundred rows.
    """

    @wraps(function)
    def alone(*arguments: Any, **named: Any) -> Any:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*arguments, **named)

    return alone  # type: ignore[return-value]
