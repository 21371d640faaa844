"""Engines: Dask with two worker processes, and processes of this machine."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import sphere

from o3d_sofnn import reconstruct_tiles
from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.files import point_files

POINTS = sphere(1200).points * np.array([0.95, 0.95, 0.4])


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("engines")
    point_files.write_point_cloud(folder / "a.ply", CloudArrays(POINTS))
    reconstruct_tiles(folder / "a.ply", folder / "one", points_per_tile=1000, n_threads=1)
    return folder


def test_two_dask_workers_make_the_same_bits(inputs, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        found = reconstruct_tiles(
            inputs / "a.ply",
            tmp_path,
            points_per_tile=1000,
            scheduler=cluster.scheduler_address,
            n_threads=1,
        )
    assert found.figures["watertight"]
    assert found.mesh.read_bytes() == (inputs / "one" / "mesh.ply").read_bytes()


def test_two_processes_make_the_same_bits(inputs, tmp_path):
    found = reconstruct_tiles(inputs / "a.ply", tmp_path, points_per_tile=1000, workers=2)
    assert found.mesh.read_bytes() == (inputs / "one" / "mesh.ply").read_bytes()


def test_a_scheduler_that_is_not_there_is_named(inputs, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("o3d_sofnn.tiles.work.engine.PATIENCE", 1.0)
    with pytest.raises(ValueError, match=r"scheduler: no answer from tcp://127\.0\.0\.1:9"):
        reconstruct_tiles(inputs / "a.ply", tmp_path, scheduler="tcp://127.0.0.1:9")
