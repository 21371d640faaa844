"""The number of threads of a call: its own, whatever runs beside it, and gone when it ends."""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
from shapes import sphere

from o3d_sofnn import pipeline
from o3d_sofnn.threads import thread_count, using_threads

POINTS = sphere(400).points


def test_blocks_nest_and_end():
    cores = thread_count()
    with using_threads(3):
        assert thread_count() == 3
        with using_threads(1):
            assert thread_count() == 1
        with using_threads(-1):
            assert thread_count() == cores
        assert thread_count() == 3
    assert thread_count() == cores >= 1


def test_an_error_ends_a_block():
    cores = thread_count()
    with pytest.raises(KeyError), using_threads(cores + 1):
        raise KeyError
    assert thread_count() == cores


def test_no_more_than_a_system_gives():
    with using_threads(2**31 - 1):
        assert thread_count() == 256


def counted(operator, n_threads, wait=lambda: None):
    """Run an operator; return the numbers that its stages were allowed."""
    found = set()

    def watch(fraction, stage):
        wait()
        found.add(thread_count())

    operator(POINTS, n_threads=n_threads, progress=watch)
    return found


@pytest.mark.parametrize("operator", [pipeline.estimate_normals, pipeline.reconstruct_surface])
def test_every_stage_has_the_number_of_the_call(operator):
    assert counted(operator, 1) == {1}
    assert counted(operator, 5) == {5}


def test_calls_at_the_same_time_have_each_their_own():
    together = Barrier(2, timeout=60)
    with ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(counted, pipeline.estimate_normals, n, together.wait) for n in (2, 7)]
        assert [job.result() for job in jobs] == [{2}, {7}]


def test_weights_are_computed_later_with_the_number_of_the_call(monkeypatch):
    found = []
    estimate = pipeline.reconstruct_surface(POINTS, n_threads=3)
    weights = pipeline.attribute_weights
    monkeypatch.setattr(
        pipeline, "attribute_weights", lambda *x: (found.append(thread_count()), weights(*x))[1]
    )
    again = estimate.source_weights
    assert found == [3]
    np.testing.assert_allclose(again.sum(axis=1), 1.0)
