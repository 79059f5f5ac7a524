"""Photographs with known cameras in, depth maps and one dense, coloured point cloud out.

    import vamvs

    done = vamvs.reconstruct(colmap="sparse/0", images="images", out="out")
    print(done.points, "points in", done.cloud)

or step by step, with NumPy arrays in between and no file written:

    scene = vamvs.Scene.from_colmap("sparse/0", "images")
    maps = list(scene.depth_maps())
    vamvs.fuse(maps).save("cloud.ply")
    vamvs.mesh(maps).save("mesh.glb")
"""

from __future__ import annotations

import importlib.util
import os
import sys

__all__ = [
    "Cancelled",
    "Cloud",
    "DepthMap",
    "DepthMaps",
    "Error",
    "Mesh",
    "Reconstructed",
    "Scene",
    "__version__",
    "fuse",
    "mesh",
    "reconstruct",
]


def _load():
    """The extension: of the package vamvs-torch, if that is installed, or else the package's own."""
    if importlib.util.find_spec("vamvs_torch") is None:
        from . import _vamvs
    else:
        from vamvs_torch import _vamvs
    return _vamvs


def __getattr__(name: str):
    if name in __all__:
        return getattr(_load(), name)
    raise AttributeError(f"module 'vamvs' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


def _command() -> None:
    """The command `vamvs`."""
    # Waiting threads sleep instead of spinning: several times as fast beside other programs.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    sys.exit(_load()._run(sys.argv))
