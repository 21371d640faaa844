"""Scans of made scenes, cast ray by ray, with the truth about every point; numpy only.

A scene is a list of solids; rays from a station meet them; a sensor adds its errors::

    scan = scenes.make("street", 20_000, scenes.Sensor(noise=0.01, mixed=0.3), seed=1)
    scan = scenes.cast([scenes.Ball((0, 0, 1), 1)], scenes.tripod((4, 0, 1), 300, 150))

``scan.points`` are what a program gets, ``scan.normals`` the true normals of the sides that were
seen, ``scan.stations`` where each point was seen from, ``scan.stray`` the points that lie on no
surface (mixed pixels); ``scan.flipped(normals)`` is the share on the wrong side. Solids are
:class:`Box`, :class:`Ball`, :class:`Pipe` and :class:`Ground`; rays come from :func:`tripod` (a
scanner that turns, equal angles), :func:`camera` (a lattice in the image), :func:`rings` (a scanner
on a car) and :func:`strips` (an airborne one). ``SCENES`` names the scenes that :func:`make` knows:
their unit is the metre, and z is up. ``python -m scenes --out FOLDER`` writes them all.
"""

from scenes.sensors import Rays, Scan, Sensor, camera, cast, joined, rings, strips, tripod
from scenes.solids import Ball, Box, Ground, Pipe, Solid
from scenes.worlds import SCENES, Scene, make

__all__ = [
    "SCENES", "Ball", "Box", "Ground", "Pipe", "Rays", "Scan", "Scene", "Sensor", "Solid",
    "camera", "cast", "joined", "make", "rings", "strips", "tripod",
]  # fmt: skip
