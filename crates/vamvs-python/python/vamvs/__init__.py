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

import ctypes
import importlib.util
import os
import sys
from pathlib import Path

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

# Libraries of the torch package that the extension needs, in the order of loading.
_LIBRARIES = ("libc10.so", "libtorch_cpu.so")
# Libraries for GPUs, if they exist.
_CUDA = ("libc10_cuda.so", "libtorch_cuda.so")


def _load():
    """Loads the extension and, if it was built with it, before that the libtorch of the torch package."""
    if (loaded := sys.modules.get("vamvs._vamvs")) is not None:
        return loaded
    try:
        from . import _vamvs
    except ImportError as error:
        if "torch" not in str(error) and "libc10" not in str(error):
            raise
    else:
        return _vamvs
    torch = importlib.util.find_spec("torch")
    if torch is None or not torch.submodule_search_locations:
        raise ImportError('this build of vamvs needs the package torch, version 2.11.0: pip install "vamvs[torch]"')
    folder = Path(torch.submodule_search_locations[0]) / "lib"
    if "torch" not in sys.modules:
        _load_libraries(folder)
    from . import _vamvs

    return _vamvs


def _load_libraries(folder: Path) -> None:
    # libtorch_cpu.so needs two CUDA libraries even without a GPU. Its run path finds them in the
    # packages next to torch.
    if not (folder / "libtorch_cpu.so").is_file():
        import torch  # noqa: F401  (another platform: torch knows its libraries)

        return
    for name in _LIBRARIES:
        ctypes.CDLL(str(folder / name))
    if Path("/dev/nvidiactl").exists():
        for name in _CUDA:
            if (folder / name).is_file():
                ctypes.CDLL(str(folder / name))


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
