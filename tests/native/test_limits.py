"""Threads and memory that the system does not give: fewer threads, then a MemoryError."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

import pytest

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of Linux")

PRELUDE = """
import os, re, resource, sys, threading
import numpy as np
import shapes
from o3d_sofnn import _kernels, pipeline

points = shapes.torus(3000).points
expected = pipeline.estimate_normals(points, n_threads=1).normals

def limit(megabytes):
    used = int(re.search(r"VmSize:\\s+(\\d+)", open("/proc/self/status").read())[1]) << 10
    most = -1 if megabytes is None else used + (megabytes << 20)
    resource.setrlimit(resource.RLIMIT_AS, (most, -1))
"""

NO_THREADS = """
if os.getuid() == 0:  # to whom the limit does not apply
    os.setgid(65534)
    os.setuid(65534)
resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))
try:
    threading.Thread(target=print).start()
    sys.exit("a thread has started")
except RuntimeError:
    pass
found = pipeline.estimate_normals(points, n_threads=8).normals
assert found.tobytes() == expected.tobytes()
"""

LITTLE_MEMORY = """
outcomes = []
for megabytes in (400, 90, 25, 8, 1):
    limit(megabytes)
    try:
        found = pipeline.estimate_normals(points, n_threads=8).normals
        outcomes.append(True)
        assert found.tobytes() == expected.tobytes(), megabytes
    except MemoryError:
        outcomes.append(False)
limit(None)
assert outcomes[0], "400 MB are enough"
found = pipeline.estimate_normals(points, n_threads=8).normals
assert found.tobytes() == expected.tobytes()
"""

IN_A_WORKER = """
# The last of many cells needs 4 GB, in whichever thread it comes to lie.
offsets = np.append(np.arange(300), 20_300)
clusters = np.append(np.ones(299, np.int64), [20_000]).astype(np.int64)
cells = np.random.default_rng(0).normal(size=(20_300, 3))
tree = _kernels.KdTree(points, 4)
for _ in range(20):
    limit(1000)
    try:
        _kernels.typical_data(cells, offsets, clusters, 1, 0.0, 4)
        sys.exit("4 GB within one")
    except MemoryError:
        limit(None)
    # Threads have ended, and the next call works.
    assert np.asarray(tree.query(points, 2, np.inf)[1])[:, 0].tolist() == list(range(3000))
"""


@pytest.mark.parametrize("script", [NO_THREADS, LITTLE_MEMORY, IN_A_WORKER])
def test_limits(script):
    path = os.pathsep.join(entry for entry in sys.path if entry)
    done = subprocess.run(
        [sys.executable, "-c", PRELUDE + script],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        cwd=tempfile.gettempdir(),  # where no sources hide the installed package
    )
    assert done.returncode == 0, done.stderr[-2000:]
